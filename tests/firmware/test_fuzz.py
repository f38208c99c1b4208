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

FRAMES = int(os.environ.get("CRUX_FUZZ_FRAMES", "1000000"))
SEED = 20260101
SANITIZERS = "-fsanitize=fuzzer,address,undefined"
WRITES = int(os.environ.get("CRUX_FUZZ_WRITES", "50000"))
NODES = ROOT / "tests/firmware/fuzz/fuzz_nodes.cpp"
SERVICES = ROOT / "tests/firmware/fuzz/fuzz_services.cpp"


def build(folder: Path, sources: list[Path], harness: Path = NODES) -> Path:
    """The fuzzer, made of these firmware sources."""
    flags = ["-O1", "-g", SANITIZERS, "-fno-sanitize-recover=all"]
    objects = native.objects([*sources, harness], folder, flags, family="clang")
    objects += native.objects(native.SIGNATURE_SOURCES, folder, ["-O2"], family="clang")  # not ours, and slow enough
    native.run(["clang++", SANITIZERS, *map(str, objects), "-o", "fuzzer"], folder)
    return folder / "fuzzer"


def fuzz(program: Path, frames: int = FRAMES, writes: int = WRITES) -> subprocess.CompletedProcess[str]:
    """Runs it from an empty corpus, the same way each time."""
    corpus = program.parent / "corpus"
    shutil.rmtree(corpus, ignore_errors=True)
    corpus.mkdir()
    command = [str(program), str(corpus), f"-seed={SEED}", "-max_len=4096", "-len_control=0", "-print_final_stats=0"]
    environment = os.environ | {"CRUX_FUZZ_FRAMES": str(frames), "CRUX_FUZZ_WRITES": str(writes)}
    return subprocess.run(command, cwd=program.parent, env=environment, capture_output=True, text=True, check=False)


@pytest.fixture(scope="module")
def sources() -> list[Path]:
    return [*native.CORE_SOURCES, *native.SAFETY_SOURCES]


@pytest.fixture(scope="module")
def all_sources(sources: list[Path]) -> list[Path]:
    return [*sources, *native.SERVICE_SOURCES]


def test_no_frame_makes_a_node_unsafe(sources: list[Path]) -> None:
    run = fuzz(build(native.build_folder("fuzz"), sources), FRAMES)
    assert f"fuzzed {FRAMES} frames" in run.stdout, run.stderr[-3000:]


def test_no_parameter_write_makes_a_node_unsafe(all_sources: list[Path]) -> None:
    run = fuzz(build(native.build_folder("fuzz-services"), all_sources, SERVICES))
    found = re.search(r"fuzzed (\d+) writes, (\d+) accepted, (\d+) images taken, (\d+) started", run.stdout)
    assert found, run.stderr[-3000:]
    writes, accepted, taken, started = map(int, found.groups())
    assert writes == WRITES
    assert accepted > WRITES // 100
    assert taken > WRITES // 1000
    assert started > WRITES // 1000


GAIN = "node->position_gain_Nm_rad = "
LOWER_LIMIT = "? -node->force_limit_N : "


@pytest.mark.parametrize(
    ("harness", "name", "before", "after", "complaint"),
    [
        (NODES, "joint_node.c", f"{GAIN}command->position_gain_Nm_rad;", f"{GAIN}0.0F;", "limp"),
        (NODES, "gripper_node.c", f"{LOWER_LIMIT}0.0F;", f"{LOWER_LIMIT}-node->force_limit_N;", "opens by itself"),
        (
            SERVICES,
            "overrides.c",
            "if (overrides->table[index].acts_now)",
            "if (index < 32U)",
            "changes what a node does",
        ),
        (SERVICES, "permission.c", "(value >= (parameter->least_share * standard))", "(value >= -1.0e9F)", "senseless"),
        (SERVICES, "permission.c", "return crux_is_at_rest(state) && (ack", "return (ack", "a moving node obeys"),
    ],
)
def test_the_fuzzer_finds_a_node_that_lets_go(
    all_sources: list[Path], harness: Path, name: str, before: str, after: str, complaint: str
) -> None:
    folder = native.build_folder(f"fuzz-{name}")
    folder.mkdir(parents=True, exist_ok=True)
    (original,) = (source for source in all_sources if source.name == name)
    broken = folder / name
    text = original.read_text(encoding="utf-8")
    assert before in text
    broken.write_text(text.replace(before, after), encoding="utf-8")
    run = fuzz(
        build(folder, [source for source in all_sources if source != original] + [broken], harness), writes=20 * WRITES
    )
    assert complaint in run.stderr
