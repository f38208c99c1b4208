"""The viewer's page as its users see it, in a browser without a window: a plan on a desktop, two logs on a phone."""

from __future__ import annotations

import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from crux_contracts.plan_file import write_plan
from crux_tools import cli
from crux_tools.page_address import addresses
from crux_tools.telemetry.margins import planned_grip
from crux_tools.view.browser import Page, open_page
from crux_tools.view.pictures import READY
from crux_tools.view.recording import Recording, recording_of
from crux_tools.view.server import Viewer, still
from crux_tools.view.signals import unit_of
from made_up_climb import DT_S, made_up_plan

NEAR = 0.9  # share of the limit surface that a sound plan may use
PHONE_PX = (390, 844)
PIXELS = """(() => {
  const space = crux.page.spaces[0], pen = space.renderer.getContext();
  space.draw();
  const found = new Uint8Array(4 * pen.drawingBufferWidth * pen.drawingBufferHeight);
  pen.readPixels(0, 0, pen.drawingBufferWidth, pen.drawingBufferHeight, pen.RGBA, pen.UNSIGNED_BYTE, found);
  return found.reduce((sum, value, i) => (sum * 31 + value + i) % 2147483647, 7);
})()"""
# The parts of the robot, and of it those whose middle the first view shows.
SEEN = """(() => {
  const space = crux.page.spaces[0], found = [], legend = crux.byId('legend').getBoundingClientRect();
  const box = space.canvas.getBoundingClientRect();
  for (const body of space.bodies) for (const part of body.children) {
    const at = part.getWorldPosition(part.position.clone()).project(space.camera);
    const x = box.left + (1 + at.x) / 2 * box.width, y = box.top + (1 - at.y) / 2 * box.height;
    const under = x > legend.left && x < legend.right && y > legend.top && y < legend.bottom;
    found.push(Math.max(Math.abs(at.x), Math.abs(at.y)) < 1 && !under);
  }
  return [found.length, found.filter(Boolean).length];
})()"""


def known(path: Path) -> Recording:
    recording = recording_of(path)
    assert recording is not None
    return recording


@pytest.fixture(scope="module")
def plan(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    path = tmp_path_factory.mktemp("page") / "plan.mcap"
    write_plan(path, made_up_plan())
    return known(path)


@pytest.fixture
def page(opened: Page) -> Page:
    """Of the plan, with all that the test before has asked for: on a busy machine an answer comes late."""
    opened.wait_until(READY)
    return opened


@pytest.fixture(scope="module")
def opened(plan: Recording) -> Iterator[Page]:
    viewer = Viewer([still(plan)], "127.0.0.1", 0)
    try:
        with open_page(viewer.url + "/#t=1.0", (900, 600)) as found:
            yield found
            assert found.errors == []
    finally:
        viewer.close()


def test_the_printed_addresses_of_a_wildcard_can_be_opened(plan: Recording) -> None:
    viewer = Viewer([still(plan)], "0.0.0.0", 0)
    try:
        assert len(viewer.urls) == len(set(viewer.urls)) >= 1
        for url in viewer.urls:
            assert "0.0.0.0" not in url
            with urllib.request.urlopen(url, timeout=20) as answer:
                assert b"crux view" in answer.read()
    finally:
        viewer.close()
    assert addresses("::1") == ["[::1]"]


def test_a_plan_says_plan_knot_and_time_and_has_no_state(plan: Recording) -> None:
    viewer = Viewer([still(plan)], "127.0.0.1", 0)
    try:
        (told,) = viewer.at(2 * DT_S)
        story = viewer.answer("/story", {})
    finally:
        viewer.close()
    assert told["lines"] == [f"plan, knot 2 of 7, {2 * DT_S:.2f} of {7 * DT_S:.2f} s"]
    assert [lane["name"] for lane in story["sides"][0]["lanes"]] == ["LF", "RF", "LR", "RR"]
    assert not [name for name in story["signals"] if "error" in name or "supervisor" in name]
    assert "surface_used.LF" in story["signals"]


def test_the_holds_of_a_sound_plan_are_not_red(tmp_path: Path) -> None:
    """Squeezed until one finger uses NEAR of its limit surface: little margin in newtons, but it does not slip."""
    plan = made_up_plan()
    low, high = 0.0, 30.0
    while high - low > 1e-3:  # the squeeze, by bisection
        squeeze = (low + high) / 2
        _squeeze(plan, squeeze)
        low, high = (squeeze, high) if np.nanmax(planned_grip(plan).used[0]) > NEAR else (low, squeeze)
    _squeeze(plan, high)
    write_plan(tmp_path / "near.mcap", plan)
    viewer = Viewer([still(known(tmp_path / "near.mcap"))], "127.0.0.1", 0)
    try:
        (drawn,) = viewer.at(0.0)
        scale = viewer.sides[0].scene.description["used_rgb"]
    finally:
        viewer.close()
    used = [limb["used"] for limb in drawn["limbs"]]
    assert max(used) == pytest.approx(NEAR, abs=1e-3)
    assert min(limb["margin_n"] for limb in drawn["limbs"]) < 10
    assert scale[-1][0] == 1.0
    (_, (red, green, _)) = scale[-1]
    for colour in drawn["holds"].values():
        assert colour[1] > green + 20
        assert colour[0] / colour[1] < red / green / 2


def _squeeze(plan: Any, force_n: float) -> None:
    for knot in plan.knots:
        for limb in knot.limbs:
            (x1, *rest), (x2, *more) = limb.finger_force_w_n[:3], limb.finger_force_w_n[3:]
            if limb.phase == limb.STANCE:
                mean = (x1 + x2) / 2
                limb.finger_force_w_n = [mean + force_n, *rest, mean - force_n, *more]


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("margin_n.LF", "N"), ("body_error_mm", "mm"), ("LF.limb_telemetry.moment_w_nm_x", "Nm"),
        ("control_input.joint_velocity_rad_s_LR_joint4", "rad/s"), ("control_input.ft_force_g_n_LF_z", "N"),
        ("LF.limb_telemetry.compliance_m_n", "m/N"), ("robot_state.body_quaternion_w_x", ""), ("surface_used.RR", ""),
    ],
)  # fmt: skip
def test_signals_have_units(name: str, unit: str) -> None:
    assert unit_of(name) == unit


def test_the_link_is_given_where_the_clipboard_is_not(page: Page) -> None:
    """As over plain http from another machine."""
    page.value("Object.defineProperty(navigator, 'clipboard', {value: undefined, configurable: true})")
    page.value("crux.byId('link').click()")
    page.wait_until("document.querySelector('#address[open], .toast') !== null")
    assert page.value("document.querySelector('#address input').value === location.href")
    assert "#t=1.000" in page.value("location.hash")
    page.value("crux.byId('address').close()")


def test_enter_in_the_time_field_gives_the_keys_back(page: Page) -> None:
    page.press("t")
    page.call("Input.insertText", text="0.8")
    page.press("Enter")
    assert page.value("crux.view.time") == pytest.approx(0.8)
    page.press("1")
    assert page.value("crux.byId('time').value") == "0.800"
    page.press("ArrowRight")
    assert page.value("crux.view.time") == pytest.approx(0.9)


def test_a_question_mark_lists_the_keys(page: Page) -> None:
    page.press("?")
    words = page.value("document.querySelector('dialog[open]').innerText")
    for key in ("space", "Home", "next event", "measure", "wheel"):
        assert key in words
    page.value("document.querySelector('dialog[open]').close()")


def test_a_plan_that_the_robot_is_on_is_not_drawn_into_it(page: Page) -> None:
    without = page.value(PIXELS)
    page.value(
        "crux.byId('labels').checked = false; crux.page.spaces[0].what = 'log'; crux.byId('forces').checked = false"
    )
    bare = page.value(PIXELS)
    page.value("crux.byId('planned').checked = true")
    assert page.value(PIXELS) == bare != without
    page.value("crux.page.moments[0].planned[0] += 0.05; crux.page.spaces[0].show(crux.page.moments[0])")
    assert page.value(PIXELS) != bare
    page.value(
        "crux.page.spaces[0].what = 'plan'; crux.byId('planned').checked = false; crux.byId('forces').checked = true"
    )


def test_overlays_show_what_they_say(page: Page) -> None:
    page.value("for (const id of ['trails', 'reach', 'frames', 'measure']) crux.byId(id).click()")
    page.wait_until("crux.page.spaces[0].trails.lines.every((line) => line.time_s.length > 5)")
    page.wait_until("crux.page.spaces[0].reach.meshes.every((mesh) => mesh.geometry.attributes.position?.count > 100)")
    (at,) = page.value("crux.page.moments.map((side) => side.grippers.slice(0, 3))")
    corners = np.array(page.value("[...crux.page.spaces[0].reach.meshes[0].geometry.attributes.position.array]"))
    assert np.abs(corners.reshape(-1, 3)[:, :2] - at[:2]).sum(axis=1).min() < 0.04  # it stands where it can
    page.value(
        "{ const space = crux.page.spaces[0], point = space.camera.position.clone();"
        "space.measure.add(point.clone().set(0, 0, 0)); space.measure.add(point.clone().set(0.03, 0, 0.04)); }"
    )
    page.wait_until("document.querySelector('.measured')?.textContent === '50.0 mm (30.0, 0.0, 40.0)'")
    page.value("for (const id of ['trails', 'reach', 'frames', 'measure']) crux.byId(id).click()")
    page.value("crux.byId('joints').open = true")
    page.wait_until("document.querySelectorAll('.joint').length === 24")


def test_values_are_zoomed_and_drawn_over_another_signal_and_kept_by_a_name(page: Page) -> None:
    wheel = "{bubbles: true, deltaY: -400, ctrlKey: true, clientX: 400, clientY: 40}"
    page.value(f"crux.plots[0].canvas.dispatchEvent(new WheelEvent('wheel', {wheel}))")
    assert page.value("crux.plots[0].high - crux.plots[0].low > 0")
    assert page.value("crux.view.to - crux.view.from") == pytest.approx(7 * DT_S)  # time is not zoomed
    page.value("crux.plots[0].way.click()")
    page.value("crux.byId('called').value = 'mine'; crux.byId('saving').requestSubmit()")
    page.value("while (crux.plots.length) crux.plots.pop().box.remove(); crux.byId('moments').click()")
    page.value("document.querySelector('#layouts button').click()")
    assert page.value("crux.plots.map((plot) => [plot.xy, plot.names.length])") == [[True, 4], [False, 4]]
    assert page.value("crux.byId('moments').checked") is False
    page.value("crux.byId('theme').click()")
    assert page.value("document.documentElement.dataset.theme") == "dark"


def test_nothing_of_the_robot_is_under_the_legend(plan: Recording) -> None:
    viewer = Viewer([still(plan)], "127.0.0.1", 0)
    try:
        with open_page(viewer.url, (900, 600)) as page:
            page.wait_until(READY)
            page.value("crux.page.spaces[0].draw()")
            parts, seen = page.value(SEEN)
            assert parts == seen > 50
    finally:
        viewer.close()


def test_two_logs_on_a_phone_are_large_and_whole(log_path: Path, faulty_log_path: Path) -> None:
    viewer = Viewer([still(known(log_path)), still(known(faulty_log_path))], "127.0.0.1", 0)
    try:
        with open_page(viewer.url, PHONE_PX) as page:
            page.wait_until(READY)
            heights = page.value("[...document.querySelectorAll('#views > div')].map((box) => box.clientHeight)")
            widths = page.value("[...document.querySelectorAll('#views > div')].map((box) => box.clientWidth)")
            assert min(heights) > 0.5 * PHONE_PX[1]
            assert min(widths) == PHONE_PX[0]
            assert page.value("document.documentElement.scrollWidth") == PHONE_PX[0]
            parts, seen = page.value(SEEN)
            assert parts == seen > 50
            assert page.errors == []
    finally:
        viewer.close()


def test_a_report_is_whole_on_a_phone_and_on_paper(plan: Recording, tmp_path: Path) -> None:
    assert cli.main(["report", str(plan.log.path), "-o", str(tmp_path / "plan.html")]) == 0
    cut = "[...document.querySelectorAll('%s')].filter((box) => box.scrollWidth > box.clientWidth).length"
    with open_page((tmp_path / "plan.html").as_uri(), PHONE_PX) as page:
        page.wait_until("document.readyState === 'complete' && document.querySelectorAll('.plot img').length === 4")
        assert page.value(cut % ".plot") == 0
        assert page.value("document.documentElement.scrollWidth") == PHONE_PX[0]
        assert page.value(cut % "pre") == 1  # lines of the scenario are longer than a phone is wide
        page.call("Emulation.setEmulatedMedia", media="print")
        assert page.value(cut % "pre") == 0
