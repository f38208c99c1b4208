"""Coverage-guided fuzzing of both nodes under AddressSanitizer and UndefinedBehaviorSanitizer."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from pathlib import Path

import native
import pytest
from crux_tools.paths import ROOT

FRAMES = int(os.environ.get("CRUX_FUZZ_FRAMES", "1000000"))  # of the sweep
SEED = 20260101
SETARCH = ["setarch", "-R"]  # refused in some containers
FIXED_ADDRESSES = (
    SETARCH if subprocess.run([*SETARCH, "true"], capture_output=True, check=False).returncode == 0 else []
)
SANITIZERS = "-fsanitize=fuzzer,address,undefined"
WRITES = int(os.environ.get("CRUX_FUZZ_WRITES", "50000"))
ALL = pytest.param(1.0, marks=pytest.mark.sweep)  # else a share of all these
NODES = ROOT / "tests/firmware/fuzz/fuzz_nodes.cpp"
SERVICES = ROOT / "tests/firmware/fuzz/fuzz_services.cpp"
NODE_SOURCES = (*native.CORE_SOURCES, *native.SAFETY_SOURCES)
SOURCES = {NODES: NODE_SOURCES, SERVICES: (*NODE_SOURCES, *native.SERVICE_SOURCES)}


def build(name: str, harness: Path, *broken: Path) -> Path:
    """The fuzzer in a folder of its own: the firmware, with a broken file in place of the one of that name."""
    flags = ["-O1", "-g", SANITIZERS, "-fno-sanitize-recover=all"]
    common, folder = native.build_folder("fuzz-objects"), native.build_folder(name)
    replaced = native.objects(broken, folder, flags, family="clang")
    names = {path.name for path in replaced}
    # What all fuzzers have in common lies in one folder: the compiler cache knows an object by its folder too.
    kept = [path for path in native.objects(SOURCES[harness], common, flags, family="clang") if path.name not in names]
    driving = native.objects([harness], common, flags, family="clang")
    driving += native.objects(native.SIGNATURE_SOURCES, common, ["-O2"], family="clang")  # not ours, and slow enough
    linked = map(str, [*kept, *replaced, *driving])
    native.run(["clang++", SANITIZERS, *linked, "-o", str(folder / "fuzzer")], common)
    return folder / "fuzzer"


def fuzz(
    program: Path, frames: int = FRAMES, writes: int = WRITES, seed: int = SEED
) -> subprocess.CompletedProcess[str]:
    """Runs it from an empty corpus; what it tries depends on where its memory lies, which the kernel else draws."""
    corpus = program.parent / "corpus"
    shutil.rmtree(corpus, ignore_errors=True)
    corpus.mkdir()
    command = [
        *FIXED_ADDRESSES,
        str(program),
        str(corpus),
        f"-seed={seed}",
        "-max_len=4096",
        "-len_control=0",
        "-print_final_stats=0",
    ]
    environment = os.environ | {"CRUX_FUZZ_FRAMES": str(frames), "CRUX_FUZZ_WRITES": str(writes)}
    return subprocess.run(command, cwd=program.parent, env=environment, capture_output=True, text=True, check=False)


@pytest.mark.parametrize("share", [0.02, ALL])
def test_no_frame_makes_a_node_unsafe(share: float) -> None:
    frames = int(share * FRAMES)
    run = fuzz(build("fuzz", NODES), frames)
    assert f"fuzzed {frames} frames" in run.stdout, run.stderr[-3000:]


@pytest.mark.parametrize("share", [0.2, ALL])
def test_no_parameter_write_makes_a_node_unsafe(share: float) -> None:
    all_writes = int(share * WRITES)
    run = fuzz(build("fuzz-services", SERVICES), writes=all_writes)
    found = re.search(r"fuzzed (\d+) writes, (\d+) accepted, (\d+) images taken, (\d+) started", run.stdout)
    assert found, run.stderr[-3000:]
    writes, accepted, taken, started = map(int, found.groups())
    assert writes == all_writes
    assert accepted > writes // 1000  # 2 to 11 % as a rule, 1 % at times
    assert taken > writes // 1000
    assert started > writes // 2000  # a few in ten thousand


GAIN = "node->position_gain_Nm_rad = "
LOWER_LIMIT = "? -node->force_limit_N : "


@pytest.mark.parametrize(
    ("harness", "name", "before", "after", "complaint"),
    [
        (NODES, "joint_node.c", f"{GAIN}command->position_gain_Nm_rad;", f"{GAIN}0.0F;", "limp"),
        (NODES, "gripper_node.c", f"{LOWER_LIMIT}0.0F;", f"{LOWER_LIMIT}-node->force_limit_N;", "opens by itself"),
        pytest.param(
            SERVICES,
            "overrides.c",
            "if (overrides->table[index].acts_now)",
            "if (index < 32U)",
            "changes what a node does",
            marks=pytest.mark.sweep,  # some hundred thousand writes
        ),
        pytest.param(
            SERVICES,
            "permission.c",
            "(value >= (parameter->least_share * standard))",
            "(value >= -1.0e9F)",
            "senseless",
            marks=pytest.mark.sweep,  # several searches
        ),
        (SERVICES, "permission.c", "return crux_is_at_rest(state) && !com", "return !com", "a moving node obeys"),
    ],
)
def test_the_fuzzer_finds_a_node_that_lets_go(
    harness: Path, name: str, before: str, after: str, complaint: str
) -> None:
    (original,) = (source for source in SOURCES[harness] if source.name == name)
    broken = native.build_folder(f"fuzz-{name}") / name
    broken.parent.mkdir(parents=True, exist_ok=True)
    text = original.read_text(encoding="utf-8")
    assert before in text
    broken.write_text(text.replace(before, after), encoding="utf-8")
    program = build(f"fuzz-{name}", harness, broken)
    # Twenty short searches: a single long one may lose itself in ever longer programs.
    complaints = (fuzz(program, FRAMES // 20, WRITES, SEED + more).stderr for more in range(20))
    assert any(complaint in said for said in complaints)
