"""Emulated boards start by their boot stage, take new images over ISO-TP, and come back whatever happens to them."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from crux_contracts.node_services import number
from crux_contracts.robot import Robot, load_robot
from crux_simulation.sim.crux_emulated import GRIPPER, Board, Cut
from crux_tools.can.image import read_images
from crux_tools.can.node_link import NodeLink, Refused, limb_bus, node_name
from crux_tools.can.update_command import load, slots, suitable, wait_until_confirmed
from crux_tools.cli import main
from crux_tools.errors import WorkFailed
from emulated import board
from host import HOLD, TRACK, host
from service_host import Desk
from slotted import VECTORS, Maker, endless, program_file

LF, JOINT = 0, 2
ANSWER_S = 20.0  # of a board emulated on a busy machine; a node that boots does not hear
UNIT, HEADER = 8, 192
TRACKED = {"Mode": TRACK, "Kp_Nm_rad": 100.0, "Kd_Nms_rad": 4.0}


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("scaler")


@contextmanager
def on_desk(
    robot: Robot, maker: Maker, on_trial: tuple[bytes, bytes] | None = None
) -> Iterator[tuple[Board, Desk, NodeLink]]:
    """A board with version 1, confirmed, in slot 0 and perhaps an image on trial in slot 1, and a link to it."""
    node = GRIPPER if maker.kind == "gripper" else JOINT
    with board(robot, LF, node, maker.board_file(on_trial=on_trial)) as emulated, host(robot) as spoken:
        emulated.look_into(program_file(f"crux_{maker.kind}_slot0"))
        spoken.nodes.replace(LF, node, emulated.port)
        desk = Desk(spoken)
        name = node_name(f"LF.{'gripper' if node == GRIPPER else node}")
        try:
            with NodeLink(name, limb_bus(desk.base(), robot, LF), ANSWER_S) as link:
                assert on_trial or slots(link)["confirmed"]
                yield emulated, desk, link
        finally:
            desk.end()


def test_a_board_takes_an_image_for_the_other_slot_at_rest_alone(robot: Robot, tmp_path: Path) -> None:
    maker = Maker(tmp_path)
    with on_desk(robot, maker) as (_, desk, link):
        image = maker.image(1, 2, endless(1, 1000))
        assert refused(link, maker.image(0, 2, endless(0, 1000))) == number("refusal", "NOT_ACCEPTED")
        desk.command(TRACKED)
        assert refused(link, image) == number("refusal", "CONDITIONS")
        desk.command(TRACKED | {"Mode": HOLD})  # at rest, but commanded
        assert refused(link, image) == number("refusal", "CONDITIONS")
        desk.command(None)
        desk.await_periods(200)
        load(link, *image)
        after = slots(link)
        assert (after["slot"], after["address"], after["other_version"]) == (0, VECTORS[1], 2)


@pytest.mark.parametrize("kind", ["joint", "gripper"])
def test_the_nodes_own_image_on_trial_in_the_other_slot_confirms_itself(
    robot: Robot, tmp_path: Path, kind: str
) -> None:
    maker = Maker(tmp_path, kind)
    with on_desk(robot, maker, maker.image(1, 2)) as (emulated, desk, link):
        desk.await_periods(500)  # while it verifies the signature it hears nothing
        wait_until_confirmed(link, 2)
        after = slots(link)
        assert (after["slot"], after["address"], after["other_version"]) == (1, VECTORS[0], 1)
        desk.end()
        assert starts(emulated) == 1


@pytest.mark.sweep
@pytest.mark.parametrize("kind", ["joint", "gripper"])
def test_a_board_takes_the_image_for_the_slot_that_does_not_run(robot: Robot, tmp_path: Path, kind: str) -> None:
    maker = Maker(tmp_path, kind)
    package = tmp_path / "package"
    programs = [str(program_file(f"crux_{kind}_slot{slot}")) for slot in (0, 1)]
    words = ["can", "sign", *programs, "--kind", kind, "--key", str(maker.key), "-o", str(package)]
    assert main([*words, "--firmware-version", "0.2.0"]) == 0
    with on_desk(robot, maker) as (emulated, desk, link):
        emulated.record()
        before = slots(link)
        assert (before["slot"], before["address"]) == (0, VECTORS[1])
        images = read_images(package)
        wrong, right = images
        assert suitable(images, link, before, "package") == right
        assert refused(link, (wrong.header, wrong.payload)) == number("refusal", "NOT_ACCEPTED")
        before_it = len(desk.forces_N)
        load(link, right.header, right.payload)
        assert slots(link)["other_version"] == right.version
        link.restart()
        wait_until_confirmed(link, right.version)
        after = slots(link)
        assert (after["slot"], after["address"], after["other_version"]) == (1, VECTORS[0], 1)
        desk.end()
        assert min(forces_N[LF] for forces_N in desk.forces_N[before_it:]) > -0.5  # it never opens
        for operation in (emulated.recorded - 1, emulated.recorded):  # its try, its confirmation
            emulated.replay(operation, Cut.WITHIN)
            assert starts(emulated) == 1
        assert emulated.fault == ""


def refused(link: NodeLink, image: tuple[bytes, bytes]) -> int:
    """The reason for which the node refuses an image."""
    with pytest.raises(Refused) as refusal:
        load(link, *image)
    return refusal.value.code


@pytest.mark.parametrize("how", ["hangs", "faults"])
def test_a_program_that_hangs_is_left_after_three_tries(robot: Robot, tmp_path: Path, how: str) -> None:
    maker = Maker(tmp_path)
    program = endless(1, 1000)
    if how == "faults":  # the first instruction is none
        program = program[:4] + struct.pack("<I", (VECTORS[1] + 68) | 1) + program[8:68] + b"\xff\xff\xff\xff"
    with board(robot, LF, JOINT, maker.board_file(1, maker.image(1, 2, program))) as emulated:
        emulated.record()
        emulated.power_on(0.0)
        tries, seconds, before = 0, 0.0, 0
        while emulated.vectors != VECTORS[0] and seconds < 3.0:
            emulated.control(0.01, 0.0)
            tries += before == 0 and emulated.vectors == VECTORS[1]
            seconds, before = seconds + 0.01, emulated.vectors
        assert emulated.vectors == VECTORS[0]
        assert tries == 3
        assert 1.5 < seconds < 2.0  # the watchdog waits half a second each time
        assert emulated.recorded == 3


def starts(emulated: Board) -> int:
    """The slot whose program runs after a power-on."""
    emulated.power_on(0.0)
    for _ in range(40):
        if emulated.vectors != 0:
            break
        emulated.control(0.01, 0.0)
    assert emulated.vectors in VECTORS
    return VECTORS.index(emulated.vectors)


@pytest.mark.sweep
def test_a_valid_image_starts_wherever_the_power_is_cut(robot: Robot, tmp_path: Path) -> None:
    maker = Maker(tmp_path)
    payload = endless(1, 2500)  # of two pages
    writes = -(-len(payload) // UNIT)
    with on_desk(robot, maker) as (emulated, desk, link):
        emulated.record()
        load(link, *maker.image(1, 2, payload))
        link.restart()
        with pytest.raises(WorkFailed, match="went back"):
            wait_until_confirmed(link, 2)
        # header and marks are erased, the second page when it is reached; the header comes last, then three tries
        image_is_whole = 2 + 1 + writes + HEADER // UNIT
        assert emulated.recorded == image_is_whole + 3
        desk.end()
        for operation in range(1, emulated.recorded + 1):
            emulated.replay(operation, Cut.WITHIN)
            tried = image_is_whole < operation <= image_is_whole + 2
            assert starts(emulated) == (1 if tried else 0), operation
        emulated.replay(image_is_whole, Cut.AFTER)
        assert starts(emulated) == 1
        assert emulated.fault == ""
