"""Every command that a page gives is run, or stands in a table here with the reason why it is not.

`crux` commands run as after `make climb`, in a folder like a checkout, in the order of the pages.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from itertools import pairwise
from pathlib import Path

import pytest
from crux_contracts.plan_file import write_plan
from crux_simulation.sim.ports import run_ports
from crux_tools import cli
from crux_tools.paths import ROOT
from fake_runtime import FakeRuntime
from made_up_climb import made_up_plan, write_log
from page_commands import Command, block_commands, misunderstood, page_commands, pages, unlabelled
from test_readme import example_wall

# Run here: `crux` commands, with these words besides, and the exit statuses that are right on any machine.
RUN: dict[str, tuple[list[str], set[int]]] = {
    r"crux (status|upload .*|start|hold|step|speed .*|reverse|clear-fault|shutdown.*)": (["--lcm", "LCM"], {0}),
    r"crux preflight.*": (["--seconds", "0.1"], {0, 1}),
    r"crux view .*": (["--port", "0"], {0}),
    r"crux replay LOG --no-view": ([], {0}),
    r"crux plan my-wall.yaml -o out/my-wall.mcap": ([], {0}),
    r"crux check (out/my-wall.mcap|PLAN.mcap)": ([], {0}),
    r"crux robot import examples/\S+ -o robots/makers": ([], {2}),  # without a mapping: says what one needs
    r"crux robot (import .* --mapping .*|check robots/makers)": ([], {0}),
    r"crux log (ls.*|info .*|note .*|cut .*|merge .*|recover .*|export .*|lcm .*)": ([], {0}),
    r"crux (key (new|show.*)|completion bash|((plan|robot import) )?--help)": ([], {0}),
}
# Run by a sweep, for they take longer: first this climb, whose log the others read.
CLIMB: dict[str, tuple[list[str], set[int]]] = {
    r"crux climb out/my-wall.mcap -o out/my-climb.mcap --report out/my-climb.html": ([], {0}),
}
SWEEP: dict[str, tuple[list[str], set[int]]] = {
    r"crux plan msgs/scenarios/climb-four-holds.yaml -o .*": ([], {0}),
    r"crux climb out/plan.mcap -o out/climb.mcap": ([], {0}),
    r"crux robot check makers --wall out/first-wall.yaml": ([], {0}),
    r"crux plan out/first-wall.yaml -o .*": ([], {0}),
    r"crux check out/first-wall.mcap": ([], {0}),
    r"crux climb out/first-wall.mcap -o .*": ([], {0}),
    r"crux climb out/plan.mcap -o out/(slick|cut).mcap .*": ([], {1}),
    r"crux report out/(telemetry|climb).mcap .*": ([], {0}),
    r"crux replay LOG(.mcap)? --check.*": ([], {0}),
}
# Run by other tests: the file, and words in it.
ELSEWHERE = {
    r"crux demo": ("tests/packaging/test_pip.py", '"demo"'),
    r"crux lease": ("tests/runtime/shell/test_signed_commands.py", '"lease"'),
    r"crux guide .*": ("tests/tools/test_guide_process.py", '"guide"'),
    r"crux sim .*": ("tests/tools/test_practice.py", '"sim"'),
    r"crux watch.*": ("tests/tools/test_watch.py", "watch"),
    r"crux can (up|check).*": ("tests/socketcan/test_can_check.py", "check"),
    r"crux can (run|kernel).*": ("tests/socketcan/test_can_run.py", '"run"'),
    r"crux can (param|sign|update) .*": ("tests/firmware/test_update.py", '"update"'),
    r"crux climb PLAN -o LOG --world .*": ("tests/tools/test_climb.py", '"--world"'),
    r"crux climb PLAN -o LOG --emulate .*": ("tests/firmware/test_emulated_climb.py", '"--emulate"'),
    r"crux campaign .*|crux report (out/walls|DIR) .*": ("tests/tools/test_campaign.py", '"campaign"'),
    r"crux (plan .* --certificate FILE.*|check FILE)": (
        "tests/planner/checker/test_bound_certificate.py",
        "certificate",
    ),
    r"crux plan SCENARIO -o NEW.mcap --from .*": ("tests/planner/pipeline/test_plan_cli.py", '"--from"'),
    r"crux plan SCENARIO -o FOLDER --stream": ("tests/planner/pipeline/test_route.py", '"--stream"'),
    r"crux upload FOLDER": ("tests/tools/test_route_upload.py", "upload_route"),
    r"crux upload .* --replan": ("tests/tools/test_replanner.py", "beside"),
    r"crux climb FOLDER -o LOG": ("tests/tools/test_route_climb.py", "climb_here"),
    r"crux wall import .*": ("tests/tools/test_wall_import.py", '"import"'),
    r"crux wall edit .*": ("tests/tools/test_wall_edit.py", '"edit"'),
    r"crux wall check .*": ("tests/tools/test_wall_check.py", '"check"'),
    r"crux robot check .*": ("tests/tools/test_robot_check.py", '"check"'),
    r"crux robot show .*": ("tests/tools/test_robot_show.py", '"show"'),
    r"python examples/\S+ .*": ("tests/examples/test_examples.py", 'example("plan_a_wall")'),
    r"python tests/msgs/msgs_golden.py": ("tests/msgs/test_golden.py", "msgs_golden"),
    r"cmake --install.*": ("tests/packaging/test_install.py", '"--install"'),
    r"pip install .*": ("tests/packaging/test_install.py", "wheel"),
    r"dask (worker|scheduler).*": ("tests/tools/test_campaign.py", '"dask", "scheduler"'),
    r"openssl req .*|cat certificate.pem .*|chmod 600 .*": ("tests/tools/test_campaign_security.py", "openssl req"),
}
# Not run.
NOT_RUN = {
    r"crux bench .*": "minutes to hours of computing; tests/tools tries what each is made of",
    r"crux plan msgs/scenarios/NAME.yaml -o PLAN.mcap --json": "tests/planner plans scenes",
    r"apt-get .*": "changes the machine",
    r"systemctl .*|journalctl .*": "needs a booted systemd; tests/cross/test_service.py reads the unit",
    r"install -D .* /etc/crux/keys": "writes to /etc",
    r"ip (route|link) .*|ulimit .*": "needs root",
    r"pre-commit install": "changes the repository",
}
WHOLE = 600  # seconds that a machine may take for all of them: a limit against hanging alone


def selects_tests(words: list[str]) -> str | None:
    """pytest: what is to be run is there; with -k, tests are selected."""
    folder = next((word for word in words if word.startswith("tests")), "tests")
    if "-k" not in words:
        return None if [*(ROOT / folder).rglob("test_*.py"), *ROOT.glob(folder)] else f"no tests in {folder}"
    command = [sys.executable, "-m", *words[words.index("pytest") :], "--collect-only", "-q"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    return None if done.returncode == 0 else done.stdout[-200:]


def lists_tests(words: list[str]) -> str | None:
    """ctest: where the build is, tests are selected."""
    folder = [] if "--test-dir" in words else ["--test-dir", "build/cmake"]
    done = subprocess.run([*words, *folder, "-N"], cwd=ROOT, capture_output=True, text=True, check=False)
    return None if re.search(r"Total Tests: [1-9]", done.stdout) else done.stdout[-200:] + done.stderr


def is_a_target(words: list[str]) -> str | None:
    """make: what it would run is known."""
    done = subprocess.run(["make", "-n", *words[1:]], cwd=ROOT, capture_output=True, text=True, check=False)
    return None if done.returncode == 0 else done.stderr


def has_the_options(words: list[str]) -> str | None:
    """crux-runtime: its --help has the options."""
    program = ROOT / "build" / "cmake" / "runtime" / "app" / "crux-runtime"
    known = subprocess.run([program, "--help"], capture_output=True, text=True, check=True).stdout
    wrong = [word for word in words if word.startswith("--") and not re.search(rf"(?<!\S){word}(?!\S)", known)]
    return f"unknown: {wrong}" if wrong else None


def sets_a_variable(words: list[str]) -> str | None:
    """export: what follows, and every command that is run, has it in its environment."""
    return None if re.fullmatch(r"[A-Z_]+=\S+", words[-1]) else f"{words}: expected one NAME=VALUE"


DRY: dict[str, Callable[[list[str]], str | None]] = {
    r"(python -m )?pytest.*": selects_tests,
    r"ctest .*": lists_tests,
    r"make .*": is_a_target,
    r"crux-runtime .*": has_the_options,
    r"export .*": sets_a_variable,
}
TABLES: tuple[Mapping[str, object], ...] = (CLIMB, SWEEP, ELSEWHERE, NOT_RUN, RUN, DRY)


@cache
def given() -> list[Command]:
    """The commands of all pages, each once; not names of commands and options without what they need."""
    found: dict[tuple[object, ...], Command] = {}
    for command in (command for page in pages() for command in page_commands(page)):
        if command.words[0] == "crux" and not command.in_block and (said := misunderstood(command.filled()[1:])):
            missing = said.partition("required: ")[2].split(", ")
            if not missing[0].startswith("-") or said.endswith("expected one argument"):
                continue  # `crux plan --prove S`: about an option
        found.setdefault((tuple(command.filled()), command.output), command)
    return list(found.values())


def chosen(command: Command) -> tuple[int, str] | None:
    """In which table a command stands, and under which pattern: the first that fits."""
    fitting = ((number, key) for number, table in enumerate(TABLES) for key in table if re.fullmatch(key, command.text))
    return next(fitting, None)


def test_every_command_has_its_place_and_every_place_a_command() -> None:
    commands = given()
    assert len(commands) > 100
    assert not [f"{command.page}: {command.text}" for command in commands if chosen(command) is None]
    used = {place for command in commands if (place := chosen(command))}
    assert not {(number, key) for number, table in enumerate(TABLES) for key in table} - used
    for file, words in ELSEWHERE.values():
        assert words in (ROOT / file).read_text(encoding="utf-8"), file
    assert not [line for page in pages() for line in unlabelled(page)], "label the block sh"


def examples_in_help(parser: argparse.ArgumentParser) -> Iterator[str]:
    yield parser.epilog or ""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for below in action.choices.values():
                yield from examples_in_help(below)


def test_every_command_of_crux_is_understood() -> None:
    commands = [(command.page, command.filled()[1:]) for command in given() if command.words[0] == "crux"]
    for text in examples_in_help(cli.parser_with(cli.COMMANDS)):
        commands += [("--help", list(command.words[1:])) for command in block_commands("--help", text, "crux")]
    wrong = {f"{where}: crux {' '.join(words)}": said for where, words in commands if (said := misunderstood(words))}
    assert not wrong


def test_other_programs_know_what_pages_ask_of_them() -> None:
    dry = [(command, place[1]) for command in given() if (place := chosen(command)) and TABLES[place[0]] is DRY]
    wrong = {command.text: said for command, key in dry if (said := DRY[key](command.filled()))}
    assert not wrong


def checkout_with_results(folder: Path) -> Path:
    """A folder like a checkout after `make climb`, with the wall of the README beside it."""
    for name in ("msgs", "examples"):
        (folder / name).symlink_to(ROOT / name)
    (folder / "tools" / "pictures").mkdir(parents=True)
    (folder / "tools" / "worlds").symlink_to(ROOT / "tools" / "worlds")
    (folder / "out").mkdir()
    (folder / "my-wall.yaml").write_text(example_wall(), encoding="utf-8")
    for page in pages():
        for example in re.findall(r"```yaml\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL):
            kind = re.search(r"^(?:name: (slick)|  - \{kind: (cut))", example, re.MULTILINE)
            if kind:
                (folder / f"{kind[1] or kind[2]}.yaml").write_text(example, encoding="utf-8")
    write_plan(folder / "out" / "plan.mcap", made_up_plan())
    for name in ("telemetry", "climb"):
        write_log(folder / "out" / f"{name}.mcap")
    return folder


def run(table: dict[str, tuple[list[str], set[int]]], folder: Path) -> None:
    """All commands of a table, in a process of their own; against a runtime that takes every command."""
    commands = [(command, place[1]) for command in given() if (place := chosen(command)) and TABLES[place[0]] is table]
    tasks = folder / "tasks.json"
    home = dict(command.words[-1].split("=", 1) for command in given() if command.words[0] == "export")
    home |= {"HOME": str(folder), "XDG_CONFIG_HOME": str(folder / "config"), "XDG_CACHE_HOME": str(folder / "cache")}
    with run_ports() as ports, FakeRuntime(ports.lcm_url):
        words = [
            (
                [*command.filled()[1:], *(ports.lcm_url if word == "LCM" else word for word in table[key][0])],
                command.output,
            )
            for command, key in commands
        ]
        tasks.write_text(json.dumps(words))
        runner = [sys.executable, str(Path(__file__).with_name("page_runner.py")), str(tasks)]
        done = subprocess.run(
            runner, cwd=folder, env=os.environ | home, capture_output=True, text=True, check=False, timeout=WHOLE
        )
    assert done.returncode == 0, done.stderr
    results = zip(commands, json.loads(done.stdout), strict=True)
    wrong = {command.text: result for (command, key), result in results if result[0] not in table[key][1]}
    assert not wrong
    for command, _ in commands:
        typed = [*command.filled(), ">", command.output or "tasks.json"]
        written = [after for word, after in pairwise(typed) if word in {"-o", ">", "--report", "--picture"}]
        assert not [file for file in written if not (folder / file).exists()], command.text


def test_commands_of_crux_do_what_pages_say(tmp_path: Path) -> None:
    run(RUN, checkout_with_results(tmp_path))


@pytest.mark.sweep
def test_longer_commands_of_crux_do_what_pages_say(tmp_path: Path) -> None:
    folder = checkout_with_results(tmp_path)
    run(RUN, folder)
    run(CLIMB, folder)
    shutil.copy(folder / "out" / "my-climb.mcap", folder / "out" / "climb.mcap")
    run(SWEEP, folder)
