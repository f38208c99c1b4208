"""`crux log export`: each form opened with the reader of the tool it is for, its values against those of the log."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from crux_contracts.robot import load_robot
from crux_msgs.tables import SCHEMAS
from crux_tools.cli import main
from crux_tools.log import ros2
from crux_tools.log.mcap_export import DERIVED
from crux_tools.log.seen import _at
from crux_tools.paths import ROOT
from crux_tools.robot3d.robot_model import build_model
from crux_tools.telemetry import read_log
from crux_tools.telemetry.margins import measured_margin_n
from made_up_climb import CYCLE_S, GRASP_FORCE_N, Story, made_up_plan, write_log
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.typesys import Stores, get_typestore

LIMBS = ("LF", "RF", "LR", "RR")
SLACK_CYCLE = 157  # between two rows at 50 Hz
Decoded = dict[str, list[tuple[int, Any]]]


def _decoded(path: Path, *topics: str) -> Decoded:
    """Messages with their times by topic, of all or of these, as mcap-ros2-support reads them."""
    found: Decoded = {}
    with path.open("rb") as file:
        for _, channel, message, decoded in make_reader(
            file, decoder_factories=[DecoderFactory()]
        ).iter_decoded_messages(topics or None):
            assert message.log_time == message.publish_time
            found.setdefault(channel.topic, []).append((message.log_time, decoded))
    return found


@pytest.fixture(scope="module")
def story_log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("export") / "climb.mcap"
    story = Story(
        faults=((200, 7, 1),),
        slack=(SLACK_CYCLE, 2, 3.0),
        joint_torque_nm=tuple(0.1 * j for j in range(24)),
        metadata={"started_utc": "2026-11-22T10:00:00.000000Z"},
    )
    write_log(path, story)
    return path


@pytest.fixture(scope="module")
def exported(story_log: Path) -> Path:
    path = story_log.with_name("seen.mcap")
    assert main(["log", "export", str(story_log), "-o", str(path), "--foxglove"]) == 0
    return path


@pytest.fixture(scope="module")
def messages(exported: Path) -> Decoded:
    return _decoded(exported)


def _stamp_ns(stamp: Any) -> int:
    return int(stamp.sec * 10**9 + stamp.nanosec)


@pytest.mark.parametrize("name", sorted(set(DERIVED.values())))
def test_definitions_are_those_of_ros(name: str) -> None:
    store = get_typestore(Stores.ROS2_HUMBLE)
    theirs, _ = store.generate_msgdef(name.replace("/", "/msg/"), ros_version=2)

    def blocks(text: str) -> dict[str, list[str]]:
        parts = text.split("=" * 80 + "\n")
        named = {"": parts[0], **dict(part.removeprefix("MSG: ").split("\n", 1) for part in parts[1:])}
        return {kind: [line for line in own.splitlines() if line and "=" not in line] for kind, own in named.items()}

    assert blocks(ros2.definition(name)) == blocks(theirs)


def test_every_derived_message_is_what_rosbags_reads_too(exported: Path, messages: Decoded) -> None:
    store = get_typestore(Stores.ROS2_HUMBLE)
    seen = set()
    with exported.open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            if schema is not None and not schema.name.startswith("crux_msgs") and channel.topic not in seen:
                seen.add(channel.topic)
                again = store.serialize_cdr(store.deserialize_cdr(message.data, schema.name), schema.name)
                assert bytes(again)[4:] == message.data[4:], channel.topic
    assert len(seen) == len(DERIVED) + 3 * 3
    assert seen < set(messages)


def test_frames_put_the_grippers_where_another_kinematics_has_them(story_log: Path, messages: Decoded) -> None:
    log, robot = read_log(story_log), load_robot("scaler")
    model = build_model(robot, made_up_plan())
    data = mujoco.MjData(model.model)
    for time_ns, message in messages["/tf"][::40]:
        row = int(np.searchsorted(log.time_s, time_ns * 1e-9 - 1e-6))
        data.qpos[:3], data.qpos[3:7] = log.state["body_position_w_m"][row], log.state["body_quaternion_w"][row]
        data.qpos[model.joint_qpos] = log.inputs["joint_position_rad"][row]
        data.qpos[model.finger_qpos] = log.inputs["finger_opening_m"][row][:, None]
        mujoco.mj_kinematics(model.model, data)
        places = _placed([*message.transforms, *messages["/tf_static"][0][1].transforms])
        for limb in robot.limbs:
            for link in (limb.gripper_link, robot.urdf.joints[limb.finger_joints[0]].child):
                body = model.model.body(link).id
                np.testing.assert_allclose(places[link][:3, 3], data.xpos[body], atol=1e-9)
                np.testing.assert_allclose(places[link][:3, :3], data.xmat[body].reshape(3, 3), atol=1e-9)
        assert {_stamp_ns(transform.header.stamp) for transform in message.transforms} == {time_ns}


def _placed(transforms: list[Any]) -> dict[str, np.ndarray]:
    """Every frame in the world, (4, 4)."""
    waiting = {t.child_frame_id: t for t in transforms}
    assert len(waiting) == len(transforms)
    placed = {"world": np.eye(4)}

    def place(name: str) -> np.ndarray:
        if name not in placed:
            t = waiting[name]
            move, turn = np.eye(4), np.zeros(9)
            q, p = t.transform.rotation, t.transform.translation
            mujoco.mju_quat2Mat(turn, np.array([q.w, q.x, q.y, q.z]))
            move[:3, :3], move[:3, 3] = turn.reshape(3, 3), (p.x, p.y, p.z)
            placed[name] = place(t.header.frame_id) @ move
        return placed[name]

    for name in waiting:
        place(name)
    return placed


def test_every_frame_and_joint_has_a_link_in_the_description_that_is_sent(messages: Decoded) -> None:
    tree = ET.fromstring(messages["/robot_description"][0][1].data)
    links = {link.get("name") for link in tree.iter("link")}
    transforms = [*messages["/tf"][0][1].transforms, *messages["/tf_static"][0][1].transforms]
    assert links <= {t.child_frame_id for t in transforms}
    moving = {joint.get("name") for joint in tree.iter("joint") if joint.get("type") not in {"fixed", None}}
    assert set(messages["/joint_states"][0][1].name) == moving


def test_joints_wrenches_and_margins_are_those_of_the_log(story_log: Path, messages: Decoded) -> None:
    log = read_log(story_log)
    margin = np.nan_to_num(measured_margin_n(log, load_robot("scaler").control.force_filter_s), nan=np.inf).min(axis=2)
    times = [time_ns for time_ns, _ in messages["/joint_states"]]
    assert np.diff(times).min() == 20_000_000
    for i in range(0, len(times), 29):
        row = int(np.searchsorted(log.time_s, times[i] * 1e-9 - 1e-6))
        joints = messages["/joint_states"][i][1]
        at = joints.name.index("LR_joint3")
        assert joints.position[at] == log.inputs["joint_position_rad"][row][2 * 6 + 2]
        assert joints.effort[at] == log.inputs["joint_torque_nm"][row][2 * 6 + 2] != 0
        for limb, name in enumerate(LIMBS):
            for topic, field in (("wrench", "force_w_n"), ("wrench_reference", "force_reference_w_n")):
                message = messages[f"/{name}/{topic}"][i][1]
                force = message.wrench.force
                np.testing.assert_array_equal([force.x, force.y, force.z], log.limbs[field][row, limb])
                assert message.header.frame_id == f"{name}_contact"
            least = margin[row : row + 2, limb].min()
            shown = messages[f"/{name}/margin"][i][1].data
            assert shown == least or (np.isnan(shown) and np.isinf(least))


def test_a_margin_that_dips_between_two_rows_is_seen(messages: Decoded) -> None:
    margins = [message.data for _, message in messages["/LR/margin"]]
    row = int(np.nanargmin(margins))
    assert messages["/LR/margin"][row][0] == (SLACK_CYCLE - 1) * int(CYCLE_S * 1e9)
    assert np.nanmedian(margins) > margins[row] + 0.5 * GRASP_FORCE_N


def test_markers_are_the_holds_and_the_forces(story_log: Path, messages: Decoded) -> None:
    log, plan = read_log(story_log), made_up_plan()
    ((_, wall),) = messages["/markers/wall"]
    cubes = {(m.ns, m.id): m for m in wall.markers if m.type == 1}
    for number, hold in enumerate(plan.holds):
        cube = cubes["holds" if hold.graspable else "obstacles", number]
        assert [cube.scale.x, cube.scale.y, cube.scale.z] == hold.size_m
        assert cube.pose.position.z == hold.size_m[2] / 2
        assert (cube.pose.position.x, cube.pose.position.y) == tuple(hold.position_w_m[:2])
    assert {m.text for m in wall.markers if m.type == 9} == {hold.name for hold in plan.holds}
    for time_ns, message in messages["/markers/forces"][::31]:
        row = int(np.searchsorted(log.time_s, time_ns * 1e-9 - 1e-6))
        arrows = {m.ns: m.points for m in message.markers if m.type == 0}
        for kind, field in (("measured", "force_w_n"), ("planned", "force_reference_w_n")):
            for limb, name in enumerate(LIMBS):
                tail, tip = (np.array([p.x, p.y, p.z]) for p in arrows[f"{kind}/{name}"])
                np.testing.assert_array_equal(tail, log.limbs["gripper_position_w_m"][row, limb])
                np.testing.assert_allclose((tip - tail) / 0.004, log.limbs[field][row, limb], atol=1e-9)
        shown = {m.ns for m in message.markers if m.type == 9 and m.action == 0}
        for name in LIMBS:
            margin = messages[f"/{name}/margin"][row // 2][1].data
            assert (f"margin/{name}" in shown) == (not np.isnan(margin))
            text = next(m.text for m in message.markers if m.type == 9 and m.ns == f"margin/{name}")
            assert np.isnan(margin) or text == f"{margin:5.1f} N"


def test_events_are_told_in_words(messages: Decoded) -> None:
    told = [(time_ns, entry.level, entry.msg) for time_ns, entry in messages["/rosout"]]
    words = [text for *_, text in told]
    assert words[0] == "command refused: not ready yet"
    assert "READY → CLIMBING" in words
    assert "CLIMBING → HOLDING" in words
    assert "the plan's clock waits for LF to open" in words
    ((time_ns, level, text),) = [entry for entry in told if entry[2].startswith("fault")]
    assert (time_ns, level) == (2_000_000_000, 40)
    assert "limb RF" in text
    assert [time for time, *_ in told] == sorted(time for time, *_ in told)


def test_diagnostics_name_every_node_and_what_is_wrong_with_it(tmp_path: Path) -> None:
    path, out = tmp_path / "log.mcap", tmp_path / "out.mcap"
    write_log(path, Story(silent=(33, 8)))  # for one cycle
    assert main(["log", "export", str(path), "-o", str(out), "--foxglove"]) == 0
    found = _decoded(out, "/diagnostics")["/diagnostics"]
    wrong = [(time_ns, s) for time_ns, array in found for s in array.status if s.level not in {b"\0", 0}]
    ((time_ns, status),) = wrong
    assert time_ns == 330_000_000
    assert status.name == "nodes/RF.joint3"
    assert status.message == "TRACK (silent in this cycle)"
    assert {s.name for s in found[0][1].status if s.name.startswith("nodes")} == {
        f"nodes/{limb}.{node}" for limb in LIMBS for node in [*(f"joint{j}" for j in range(1, 7)), "gripper"]
    }


def test_what_is_in_the_log_is_in_it_a_limb_a_topic(story_log: Path, messages: Decoded) -> None:
    log = read_log(story_log)
    original = _decoded(story_log)
    assert "/limb_telemetry" not in messages
    for limb, name in enumerate(LIMBS):
        mine = messages[f"/{name}/limb_telemetry"]
        assert len(mine) == len(original[f"/{name}/limb_telemetry"])
        assert {m.limb for _, m in mine} == {limb}
        assert [m.grasp_force_n for _, m in mine] == log.limbs["grasp_force_n"][:, limb].tolist()
    for topic in ("/plan", "/robot_state", "/control_input", "/fault"):
        assert len(messages[topic]) == len(original[topic])


def test_times_can_be_the_dates(story_log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "utc.mcap"
    assert main(["log", "export", str(story_log), "-o", str(out), "--foxglove", "--utc", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["ok"] is True
    found = _decoded(out, "/robot_state", "/tf", "/rosout")
    begin = 1_795_341_600 * 10**9  # date -u -d 2026-11-22T10:00:00 +%s
    assert found["/robot_state"][0][0] == begin
    assert found["/tf"][50][0] == begin + 10**9 == _stamp_ns(found["/tf"][50][1].transforms[0].header.stamp)
    assert next(entry.msg for _, entry in found["/rosout"]) == "command refused: not ready yet"
    undated = tmp_path / "undated.mcap"
    write_log(undated, Story(ready_cycles=3, wait_cycles=0))
    assert main(["log", "export", str(undated), "-o", str(out), "--foxglove", "--utc"]) == 2
    assert "does not say when it was made" in capsys.readouterr().err
    assert _decoded(out, "/tf")["/tf"][50][0] == begin + 10**9  # what was there stays


def test_a_log_is_never_written_over_itself(story_log: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = story_log.read_bytes()
    assert main(["log", "export", str(story_log), "-o", str(story_log), "--foxglove"]) == 2
    assert "is the input" in capsys.readouterr().err
    assert story_log.read_bytes() == before


def test_a_log_without_its_end_or_its_plan_is_exported_too(killed_log_path: Path, tmp_path: Path) -> None:
    out = tmp_path / "out.mcap"
    assert main(["log", "export", str(killed_log_path), "-o", str(out), "--foxglove"]) == 0
    assert len(_decoded(out, "/tf")["/tf"]) > 10


LAYOUTS = ROOT / "tools" / "layouts"


def _curves(topic: str, message: Any) -> set[str]:
    """What PlotJuggler calls the curves of a message: names joined by slashes, joints by their own names."""
    if hasattr(message, "position") and hasattr(message, "name"):
        return {f"{topic}/{name}/{part}" for name in message.name for part in ("position", "velocity", "effort")}

    def below(name: str, value: Any) -> set[str]:
        if hasattr(value, "__slots__"):
            return {found for slot in value.__slots__ for found in below(f"{name}/{slot}", getattr(value, slot))}
        if isinstance(value, list | tuple | np.ndarray):
            return {found for i, each in enumerate(value) for found in below(f"{name}[{i}]", each)}
        return {name} if isinstance(value, float | int) else set()

    return below(topic, message)


@pytest.mark.parametrize("words", ["log info LOG", "log export LOG -o OUT --foxglove", "report LOG -o OUT"])
def test_numbers_beyond_all_range_are_shown_too(
    words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    write_log(tmp_path / "climb.mcap", Story(body_error_m=(1e200, 0.0, -1e200), joint_torque_nm=(1e300,) * 24))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    places = {"LOG": tmp_path / "climb.mcap", "OUT": tmp_path / "out"}
    status = main([str(places.get(word, word)) for word in words.split()])
    told = capsys.readouterr().err
    assert status == 0, told
    assert "internal error" not in told


def test_a_joint_without_a_value_has_no_place() -> None:
    turning = next(joint for joint in load_robot("scaler").urdf.joints.values() if joint.kind == "revolute")
    poses = _at(turning, np.array([0.3, np.nan, np.inf, -1e300]))
    assert np.isfinite(poses[0]).all()
    assert np.isnan(poses[1:]).all()


def test_every_curve_of_the_plotjuggler_layout_is_there(messages: Decoded) -> None:
    curves = [curve.get("name", "") for curve in ET.parse(LAYOUTS / "crux.plotjuggler.xml").iter("curve")]
    assert len(curves) > 80
    wanted = {topic for topic in messages for curve in curves if curve.startswith(f"{topic}/")}
    known = {name for topic in wanted for name in _curves(topic, messages[topic][0][1])}
    known |= {f"/{limb}/bus_health/lost" for limb in LIMBS}  # the made-up log has no buses
    assert set(curves) - known == set()


def _along(message: Any, path: list[str]) -> Any:
    for part in path:
        name, _, index = part.partition("[")
        message = getattr(message, name)
        message = message[int(index.rstrip("]"))] if index else message
    return message


def test_every_path_of_the_foxglove_layout_is_there(messages: Decoded) -> None:
    layout = json.loads((LAYOUTS / "crux.foxglove.json").read_text())
    panels = layout["configById"]
    paths = [path["value"] for panel in panels.values() for path in panel.get("paths", [])]
    paths = [path for path in paths if path.startswith("/")]
    assert len(paths) > 50
    for path in paths:
        topic, *fields = path.split(".")
        if topic.endswith("bus_health"):
            assert fields[0] in SCHEMAS["bus_health_t"][1]  # the made-up log has no buses
        else:
            assert isinstance(_along(messages[topic][0][1], fields), int | float), path
    assert set(panels["3D!climb"]["topics"]) <= set(messages)
    assert panels["RosOut!events"]["topicToRender"] in messages
    assert panels["DiagnosticSummary!nodes"]["topicToRender"] in messages
    assert panels["3D!climb"]["followTf"] in {t.child_frame_id for t in messages["/tf"][0][1].transforms}

    def shown(part: Any) -> set[str]:
        return {part} if isinstance(part, str) else shown(part["first"]) | shown(part["second"])

    named = shown(layout["layout"])
    named |= {name for tab in panels["Tab!questions"]["tabs"] for name in shown(tab["layout"])}
    assert named == set(panels)
