"""`crux view`: what its server tells of a made-up climb, and the page itself in a browser without a window."""

from __future__ import annotations

import base64
import io
import json
import shutil
import socket
import urllib.error
import urllib.request
import zipfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any
from urllib.parse import urlencode

import numpy as np
import pytest
import trimesh
from crux_contracts.plan_file import write_plan
from crux_contracts.robot import ROBOTS, load_robot
from crux_tools import cli
from crux_tools.telemetry import read_channels, read_log
from crux_tools.view.browser import Page, open_page
from crux_tools.view.film import mp4
from crux_tools.view.long_log import LongLog
from crux_tools.view.meshes import meshes_of
from crux_tools.view.pictures import READY
from crux_tools.view.recording import Recording, recording_of, recording_of_log
from crux_tools.view.server import Viewer, still
from crux_tools.view.signals import Signal, difference, reduced
from made_up_climb import CYCLE_S, DT_S, GRASP_FORCE_N, SWING_KNOTS, Story, made_up_plan, write_log
from PIL import Image, ImageSequence

READY_S = Story().ready_cycles * CYCLE_S


def known(path: Path) -> Recording:
    recording = recording_of(path)
    assert recording is not None
    return recording


@pytest.fixture(scope="module")
def viewer(log_path: Path, faulty_log_path: Path) -> Iterator[Viewer]:
    """Two logs, the second with a fault and half a second later."""
    served = Viewer([still(known(log_path)), still(known(faulty_log_path))], "127.0.0.1", 0)
    yield served
    served.close()


def asked(viewer: Viewer, path: str, **query: Any) -> Any:
    with urllib.request.urlopen(f"{viewer.url}{path}?{urlencode(query)}", timeout=600) as answer:
        return json.load(answer)


def lane(side: dict[str, Any], name: str) -> list[Any]:
    (spans,) = [lane["spans"] for lane in side["lanes"] if lane["name"] == name]
    return list(spans)


def test_the_time_line_is_that_of_the_made_up_climb(viewer: Viewer) -> None:
    sides = asked(viewer, "/story")["sides"]
    assert [word for _, _, word in lane(sides[0], "state")] == ["READY", "CLIMBING", "HOLDING"]
    assert lane(sides[0], "state")[1][0] == pytest.approx(READY_S)
    ((begin, end, word),) = lane(sides[0], "waits")
    assert word == "LF open"
    assert end - begin == pytest.approx(Story().wait_cycles * CYCLE_S, abs=2 * CYCLE_S)
    assert [word for _, _, word in lane(sides[0], "LF")] == ["stance", "swing", "stance"]
    assert lane(sides[0], "LF")[1][0] == pytest.approx(READY_S + SWING_KNOTS[0] * DT_S, abs=1.5 * CYCLE_S)
    assert [word for _, _, word in lane(sides[0], "RR")] == ["stance"]
    assert not [event for event in sides[0]["events"] if "fault" in event["text"]]
    (fault,) = [event for event in sides[1]["events"] if event["text"].startswith("fault")]
    assert fault["serious"]
    assert fault["time_s"] == pytest.approx(200 * CYCLE_S)


def test_a_moment_is_shown_as_it_was_measured(viewer: Viewer, log_path: Path) -> None:
    log = read_log(log_path)
    row = Story().ready_cycles + 40
    told = asked(viewer, "/at", time_s=log.time_s[row] + 0.001, span_s=5)[0]
    assert told["time_s"] == pytest.approx(log.time_s[row])
    assert told["lines"][0].startswith(f"CLIMBING, cycle {row}, ")
    np.testing.assert_allclose(told["body"], log.state["body_position_w_m"][row], atol=1e-6)
    np.testing.assert_allclose(told["planned_body"], log.state["body_reference_position_w_m"][row], atol=1e-6)
    for name, field in (("measured force", "force_w_n"), ("planned force", "force_reference_w_n")):
        np.testing.assert_allclose(told["arrows"][name], 0.008 * log.limbs[field][row].ravel(), atol=1e-5)
    assert sorted(told["holds"]) == ["0", "1", "2", "3"]  # all four are held
    moving = {shape["body"] for shape in asked(viewer, "/scene")[0]["shapes"]} - {-1}
    assert len(told["measured"]) == len(told["planned"]) == 7 * (max(moving) + 1)
    assert told["body"] in [told["measured"][i : i + 3] for i in range(0, len(told["measured"]), 7)]


def test_a_hold_that_a_finger_all_but_slips_on_is_red(tmp_path: Path) -> None:
    cycle = Story().ready_cycles + 40
    write_log(tmp_path / "slack.mcap", Story(slack=(cycle, 1, 2.0)))
    served = Viewer([still(known(tmp_path / "slack.mcap"))], "127.0.0.1", 0)
    try:
        (before,), (drawn,) = (served.at((cycle - n) * CYCLE_S) for n in (1, 0))
    finally:
        served.close()
    red, green, _ = drawn["holds"][1]
    assert red > green
    assert before["holds"][1][0] < before["holds"][1][1]
    assert drawn["holds"][0] == before["holds"][0]


def test_signals_come_as_least_and_largest_of_intervals(viewer: Viewer, log_path: Path) -> None:
    log = read_log(log_path)
    end_s = float(log.time_s[-1])
    sides = asked(viewer, "/signal", name="control_input.finger_force_n_RF", from_s=0, to_s=end_s, points=20)
    assert len(sides) == 3  # both logs, and their difference
    assert len(sides[0]["time_s"]) == 20
    assert {*sides[0]["low"], *sides[0]["high"]} == {GRASP_FORCE_N}
    assert {value for value in sides[2]["high"] if value is not None} == {0.0}


def test_a_spike_of_one_row_is_seen_at_any_zoom() -> None:
    value = np.zeros(100_000)
    value[54_321] = 7
    course = reduced(Signal(np.arange(100_000) * 0.002, value), 0, 200, 50)
    assert max(course["high"]) == 7
    assert sum(high > 0 for high in course["high"]) == 1
    value[:] = np.nan
    assert reduced(Signal(np.arange(100_000) * 0.002, value), 0, 200, 50)["low"] == [None] * 50


def test_a_difference_is_taken_at_the_same_moment() -> None:
    time_s = np.arange(10.0)
    found = difference(Signal(time_s, 2 * time_s), Signal(time_s + 5, 2 * time_s), -4.0)
    np.testing.assert_array_equal(found.value, [np.nan, *[2.0] * 9])


def test_two_logs_meet_where_the_climb_begins(tmp_path: Path, log_path: Path) -> None:
    write_log(tmp_path / "late.mcap", Story(ready_cycles=80))
    served = Viewer([still(known(log_path)), still(known(tmp_path / "late.mcap"))], "127.0.0.1", 0)
    try:
        assert served.sides[1].shift_s == pytest.approx((50 - 80) * CYCLE_S)
        here, there = served.at(1.0)
    finally:
        served.close()
    assert here["time_s"] == pytest.approx(there["time_s"])
    assert here["lines"][0].split(", ")[2] == there["lines"][0].split(", ")[2]  # the plan time


def test_a_plan_is_a_climb_without_errors(tmp_path: Path) -> None:
    write_plan(tmp_path / "plan.mcap", made_up_plan())
    recording = known(tmp_path / "plan.mcap")
    assert recording.log.time_s[-1] == pytest.approx(7 * DT_S)
    row = recording.row_at(2 * DT_S)
    limb = made_up_plan().knots[2].limbs[1]
    np.testing.assert_allclose(recording.log.limbs["gripper_position_w_m"][row, 1], limb.gripper_position_w_m)
    force = np.array(limb.finger_force_w_n).reshape(2, 3).sum(axis=0)
    np.testing.assert_allclose(recording.log.limbs["force_w_n"][row, 1], force, atol=1e-9)
    np.testing.assert_allclose(recording.log.limbs["grasp_force_n"][row], GRASP_FORCE_N)
    (event,) = recording.events
    assert event.log_ns / 1e9 == pytest.approx(SWING_KNOTS[0] * DT_S)
    assert event.text == "LF from a to e"
    served = Viewer([still(recording)], "127.0.0.1", 0)
    try:
        (drawn,) = served.at(2 * DT_S)
    finally:
        served.close()
    np.testing.assert_allclose(drawn["body"], drawn["planned_body"], atol=1e-6)


def test_a_long_log_has_every_cycle_where_it_is_looked_at(log_path: Path) -> None:
    whole = known(log_path)
    source = LongLog(log_path)
    assert [event.text for event in source.whole.events] == [event.text for event in whole.events]
    assert 5 < len(source.whole.log.time_s) < len(whole.log.time_s) / 3
    assert source.between(0.0, 3600.0) is source.whole
    fine = source.between(1.0, 2.0)
    assert source.between(1.1, 2.1) is fine
    np.testing.assert_array_equal(fine.log.state, whole.log.state)  # a block of 10 s is more than it has
    np.testing.assert_array_equal(fine.log.limbs, whole.log.limbs)
    np.testing.assert_array_equal(fine.grip.margin_n, whole.grip.margin_n)
    rows = np.searchsorted(whole.log.time_s, source.whole.log.time_s)
    np.testing.assert_array_equal(source.whole.log.inputs, whole.log.inputs[rows])


def test_a_link_is_drawn_by_its_mesh_where_the_file_is(
    tmp_path: Path, log_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The log of a robot with a mesh for one link that is there, one for another that is not, and one in an archive."""
    shutil.copytree(ROBOTS, tmp_path / "robots")
    monkeypatch.setattr("crux_contracts.robot.ROBOTS", tmp_path / "robots")
    trimesh.creation.box((10, 20, 30)).export(tmp_path / "robots" / "scaler" / "link.stl")
    with zipfile.ZipFile(tmp_path / "robots" / "scaler" / "bomb.zip", "w") as archive:
        archive.write(tmp_path / "robots" / "scaler" / "link.stl", "link.stl")
    urdf = tmp_path / "robots" / "scaler" / "scaler.urdf"
    text = urdf.read_text().replace("visual>", "collision>")
    for link, file in (("LF_link2", "link.stl"), ("RF_link2", "lost.stl"), ("LR_link2", "bomb.zip")):
        picture = (
            '<visual><origin xyz="1 2 3" rpy="0 0 1.5707963"/><geometry>'
            f'<mesh filename="package://scaler/{file}" scale="0.001 0.001 0.001"/></geometry></visual>'
        )
        assert f'<link name="{link}">' in text
        text = text.replace(f'<link name="{link}">', f'<link name="{link}">{picture}')
    urdf.write_text(text)
    robot = load_robot("scaler")
    ((link, (mesh,)),) = meshes_of(robot).items()
    assert link == "LF_link2"
    np.testing.assert_allclose(mesh.position, [1, 2, 3])
    np.testing.assert_allclose(mesh.wxyz, [np.sqrt(0.5), 0, 0, np.sqrt(0.5)], atol=1e-6)
    described = {"robot.yaml": robot.folder / "robot.yaml", "scaler.urdf": urdf}
    files = {name: path.read_bytes() for name, path in described.items()}
    recording = known(log_path)
    changed = replace(recording, log=replace(recording.log, robot_files=files))
    served = Viewer([still(changed)], "127.0.0.1", 0)
    try:
        (drawn,) = (shape for shape in asked(served, "/scene")[0]["shapes"] if shape["kind"] == "mesh")
        with open_page(served.url, (500, 700)) as page:
            page.wait_until(READY)
            assert page.errors == []
    finally:
        served.close()
    corners = np.frombuffer(base64.b64decode(drawn["corners"]), "<f4").reshape(-1, 3)
    np.testing.assert_allclose(np.ptp(corners, axis=0), [0.01, 0.02, 0.03], atol=1e-6)
    assert (drawn["position"], drawn["body"] >= 0) == ([1, 2, 3], True)
    assert np.frombuffer(base64.b64decode(drawn["faces"]), "<u4").max() == len(corners) - 1


def test_unknown_paths_and_numbers_that_are_none_are_refused(viewer: Viewer) -> None:
    for path in ("/nothing", "/at?time_s=soon&span_s=1", "/signal?name=x"):
        with pytest.raises(urllib.error.HTTPError) as refused:
            urllib.request.urlopen(viewer.url + path, timeout=600)
        assert refused.value.code == 404


def test_its_port_is_free_again(log_path: Path) -> None:
    served = Viewer([still(known(log_path))], "127.0.0.1", 0)
    served.close()
    with socket.socket() as again:
        again.bind(("127.0.0.1", served.port))


def test_a_log_without_a_plan_has_no_wall(
    log_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert recording_of_log(replace(read_log(log_path), plan=None), read_channels(log_path)) is None
    monkeypatch.setattr("crux_tools.view.recording.recording_of", lambda _: None)
    assert cli.main(["view", str(log_path)]) == 2
    assert "no plan was accepted" in capsys.readouterr().err


def test_the_page_in_a_browser(viewer: Viewer) -> None:
    with open_page(f"{viewer.url}/#t=1.0", (900, 600)) as page:
        page.wait_until(READY)
        assert page.value("crux.view.time") == 1.0
        page.press("ArrowRight")
        assert page.value("crux.view.time") == pytest.approx(1.0 + CYCLE_S)
        page.press("f")
        assert page.value("crux.view.time") == pytest.approx(200 * CYCLE_S)
        page.wait_until("location.hash.includes('t=2.000')")
        page.press("p")
        assert page.value("crux.view.time") < 2.0
        _drag(page, "robot_state.plan_time_s")
        page.wait_until("crux.plots.length === 3 && crux.plots[2].curves['robot_state.plan_time_s'] !== undefined")
        _plays(page)
        page.wait_until(READY)
        shown = page.value("document.getElementById('captions').innerText")
        assert shown.count("body 5.0 mm off") == 2  # both logs
        assert len(page.picture()) > 20_000
        assert page.errors == []


PIXEL = """(() => {
  const space = crux.page.spaces[0], pen = space.renderer.getContext(), rgba = new Uint8Array(4);
  space.draw();
  pen.readPixels(%s, 1, 1, pen.RGBA, pen.UNSIGNED_BYTE, rgba);
  return [...rgba];
})()"""
MIDDLE, BESIDE, ABOVE, CORNER = (
    f"{x} * pen.drawingBufferWidth, {y} * pen.drawingBufferHeight"
    for x, y in ((0.5, 0.56), (0.5, 0.1), (0.5, 0.9), (0.01, 0.99))
)


def test_the_3d_view_shows_robot_and_wall_from_where_it_is_looked_at(log_path: Path) -> None:
    served = Viewer([still(known(log_path))], "127.0.0.1", 0)
    try:
        with open_page(served.url, (900, 600)) as page:
            page.wait_until(READY)
            page.value("crux.look('wall')")  # from above onto the body
            red, green, blue, _ = page.value(PIXEL % MIDDLE)
            assert red < blue < 140  # the body is dark blue
            red, green, blue, _ = page.value(PIXEL % BESIDE)
            assert max(red, green, blue) - min(red, green, blue) < 45  # the wall is a pale wood
            assert min(page.value(PIXEL % CORNER)[:3]) > 215  # the sky
            assert blue < page.value(PIXEL % CORNER)[2] - 20
            assert page.value(PIXEL % ABOVE)[2] < page.value(PIXEL % CORNER)[2] - 20
            page.value("crux.page.rig.look(crux.page.moments[0].body, [-1.5, 0, -0.1])")  # along the wall
            assert min(page.value(PIXEL % ABOVE)[:3]) > 215
            without = (
                "const own = HTMLCanvasElement.prototype.getContext, none = document.createElement('div');"
                "HTMLCanvasElement.prototype.getContext = () => null;"
                "const { spaces, scenes, moments, rig } = crux.page;"
                "new spaces[0].constructor(none, scenes[0], rig).show(moments[0]);"
                "HTMLCanvasElement.prototype.getContext = own; none.textContent"
            )
            assert page.value(without).startswith("No 3-D view: this browser has no WebGL 2.")
            page.errors.clear()  # three.js says it, too
    finally:
        served.close()


def _drag(page: Page, name: str) -> None:
    """Drops a signal where a new plot is made."""
    page.value(
        "{ const data = new DataTransfer(); data.setData('text/plain', " + json.dumps(name) + ");"
        "document.querySelector('#plots .empty').dispatchEvent(new DragEvent('drop', {dataTransfer: data})) }"
    )


def _plays(page: Page) -> None:
    page.press("Home")
    begin_s = page.value("crux.view.time")
    page.press(" ")
    page.wait_until(f"crux.view.time > {begin_s} + 0.2")
    page.press(" ")
    assert page.value("crux.view.playing") is False


def test_a_picture_of_a_moment(log_path: Path, tmp_path: Path) -> None:
    picture = tmp_path / "moment.png"
    assert cli.main(["view", str(log_path), "--at", "1.5", "--screenshot", str(picture)]) == 0
    assert picture.read_bytes().startswith(b"\x89PNG")


@pytest.mark.sweep  # test_an_mp4_shows_its_pictures_one_after_the_other looks at the coding alone
def test_a_film_goes_from_moment_to_moment(log_path: Path, tmp_path: Path) -> None:
    film = tmp_path / "film.gif"
    words = ["view", str(log_path), "--video", str(film), "--speed", "4"]
    assert cli.main([*words, "--from", "1.0", "--to", "1.9"]) == 0
    with Image.open(film) as frames:
        assert len(list(ImageSequence.Iterator(frames))) == 3  # one each 0.4 s
        frames.seek(0)
        first = frames.convert("RGB").tobytes()
        frames.seek(2)
        assert frames.convert("RGB").tobytes() != first
    assert cli.main([*words, "--from", "7000"]) == 2
    with pytest.raises(SystemExit):
        cli.main(["view", str(log_path), "--video", "film.avi"])


def test_an_mp4_shows_its_pictures_one_after_the_other() -> None:
    colours, pictures = ((220, 30, 30), (30, 30, 220)), []
    for colour in colours:
        buffer = io.BytesIO()
        Image.new("RGB", (320, 240), colour).save(buffer, "png")
        pictures += [buffer.getvalue()] * 5
    film = mp4(pictures, (320, 240), 10)
    assert film[4:8] == b"ftyp"
    with open_page("about:blank", (400, 300)) as page:
        page.value(
            "const film = document.createElement('video'); film.muted = true;"
            f"film.src = 'data:video/mp4;base64,{base64.b64encode(film).decode()}';"
            "const canvas = document.createElement('canvas'), pen = canvas.getContext('2d');"
            "const near = (colour) => { pen.drawImage(film, 0, 0); const shown = pen.getImageData(50, 50, 1, 1).data;"
            " return !film.seeking && colour.every((part, i) => Math.abs(part - shown[i]) <= 12); };"
        )
        page.wait_until("film.readyState >= 2")
        assert page.value("[film.videoWidth, film.videoHeight]") == [320, 240]
        for time_s, colour in ((0.0, colours[0]), (page.value("film.duration"), colours[1])):
            page.value(f"film.currentTime = {time_s}")
            page.wait_until(f"near({list(colour)})")  # a decoder on a busy machine shows the picture some time later
