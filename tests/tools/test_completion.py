"""`crux completion`: what a real bash makes of the script, and all commands in those of the other shells."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest
from crux_tools.cli import COMMANDS, main
from crux_tools.completion import SHELLS


@pytest.fixture(scope="module")
def bash_script(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("completion") / "crux.bash"
    with pytest.MonkeyPatch.context() as patch, path.open("w", encoding="utf-8") as file:
        patch.setattr("sys.stdout", file)
        assert main(["completion", "bash"]) == 0
    return path


def completed(script: Path, *words: str, folder: Path) -> set[str]:
    """What bash offers for the last of these words after `crux`."""
    given = " ".join(f"'{word}'" for word in ("crux", *words))
    code = f'source {script}; COMP_WORDS=({given}); COMP_CWORD={len(words)}; _shtab_crux; echo "${{COMPREPLY[@]}}"'
    done = subprocess.run(["bash", "-c", code], capture_output=True, text=True, check=True, cwd=folder)
    return set(done.stdout.split())


def test_bash_completes_commands_options_and_files(bash_script: Path, tmp_path: Path) -> None:
    (tmp_path / "wall.yaml").touch()
    assert completed(bash_script, "cl", folder=tmp_path) == {"climb", "clear-fault"}
    assert completed(bash_script, "plan", "--meth", folder=tmp_path) == {"--method"}
    assert {"auto", "two_block"} <= completed(bash_script, "plan", "--method", "", folder=tmp_path)
    assert completed(bash_script, "plan", "wa", folder=tmp_path) == {"wall.yaml"}
    assert "--measure" in completed(bash_script, "can", "check", "--", folder=tmp_path)


@pytest.mark.parametrize("shell", SHELLS)
def test_every_command_is_in_the_script(shell: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["completion", shell]) == 0
    script = capsys.readouterr().out
    assert {name for name in COMMANDS if name not in script} == set()
    if shutil.which(shell):
        subprocess.run([shell, "-n"], input=script, text=True, check=True)


def test_of_commands_that_are_not_installed_there_is_the_name(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("crux_tools.completion.find_spec", lambda name: None if name == "crux_simulation" else name)
    assert main(["completion", "bash"]) == 0
    script = capsys.readouterr().out
    assert "climb" in script
    assert "--emulate" not in script
    assert "--meth" in script
