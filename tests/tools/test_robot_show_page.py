"""`crux robot show` as its users see it: sliders and keys in a browser without a window, against MuJoCo."""

from __future__ import annotations

from collections.abc import Iterator

import mujoco
import numpy as np
import pytest
from crux_contracts.robot import load_robot
from crux_tools.robot.described import described
from crux_tools.robot3d.robot_model import urdf_spec
from crux_tools.view.browser import Page, open_page
from crux_tools.view.robot.figure import Figure
from crux_tools.view.robot.server import READY, RobotPage

SLOPE_DEG = 60.0


@pytest.fixture(scope="module")
def page() -> Iterator[Page]:
    """Of one browser for all tests, which go on from each other."""
    server = RobotPage(Figure(described("scaler"), 2.2), SLOPE_DEG, "127.0.0.1", 0)
    try:
        with open_page(server.url, (760, 480)) as opened:
            opened.wait_until(READY)
            yield opened
            assert opened.errors == []
    finally:
        server.close()


def slide(page: Page, name: str, key: str, times: int = 1) -> float:
    """Presses a key on a slider as by hand; where it is then."""
    page.value(f"document.querySelector('input[aria-label=\"{name}\"]').focus()")
    code = {"ArrowRight": 39, "ArrowLeft": 37, "Home": 36, "End": 35}[key]
    for _ in range(times):
        for kind in ("rawKeyDown", "keyUp"):
            page.call("Input.dispatchKeyEvent", type=kind, key=key, code=key, windowsVirtualKeyCode=code)
    page.wait_until("crux.idle()")
    return float(page.value(f"Number(document.querySelector('input[aria-label=\"{name}\"]').value)"))


def by_mujoco(page: Page) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """The robot at the angles that the page's sliders have, body and wall aside."""
    model = urdf_spec(load_robot("scaler")).compile()
    data = mujoco.MjData(model)
    for limb in ("LF", "RF", "LR", "RR"):
        for number in range(1, 7):
            name = f"{limb}_joint{number}"
            data.joint(name).qpos = page.value(f"Number(document.querySelector('input[aria-label=\"{name}\"]').value)")
    mujoco.mj_kinematics(model, data)
    return model, data


def text(page: Page, where: str) -> str:
    return str(page.value(f"document.querySelector('{where}').textContent"))


def test_a_slider_moves_the_gripper_as_mujoco_has_it(page: Page) -> None:
    before = page.value("crux.scene.place(crux.told.limbs[0].gripper)")
    moved = slide(page, "LF_joint1", "ArrowRight", 30)
    assert moved == pytest.approx(page.value("crux.posture.q[0][0]"))
    slide(page, "RR_joint3", "ArrowLeft", 20)
    model, data = by_mujoco(page)
    for k, limb in enumerate(("LF", "RF", "LR", "RR")):
        there = page.value(f"crux.scene.place(crux.told.limbs[{k}].gripper)")
        assert there == pytest.approx(data.body(f"{limb}_gripper").xpos, abs=1e-5)
    after = page.value("crux.scene.place(crux.told.limbs[0].gripper)")
    assert np.linalg.norm(np.subtract(after, before)) > 0.02
    x, y, z = data.body("LF_gripper").xpos * 1000
    said = text(page, "#gripper-0").replace("−", "-").split(" mm")[0]
    assert [float(each) for each in said.split(",")] == pytest.approx([x, y, z], abs=0.51)
    assert model.nq == 32


def test_sliders_end_at_the_limits(page: Page) -> None:
    model = urdf_spec(load_robot("scaler")).compile()
    low, high = model.joint("LF_joint1").range
    assert slide(page, "LF_joint1", "Home") == pytest.approx(low, abs=1e-6)
    assert slide(page, "LF_joint1", "End") == pytest.approx(high, abs=1e-6)
    page.value("document.activeElement.blur()")
    page.press("s")
    page.wait_until("crux.idle()")
    assert page.value("crux.posture.q[0][0] === crux.told.limbs[0].joints[0].start")


def test_links_that_meet_turn_red_and_are_named(page: Page) -> None:
    assert text(page, "#meets") == ""
    red = "crux.scene.solids.filter(([, each]) => each.material.emissive.r > 0.3).map(([shape]) => shape.body)"
    page.value("crux.scene.draw()")
    assert page.value(red) == []
    for joint, key in (("LF_joint2", "End"), ("LF_joint1", "End"), ("LF_joint3", "Home"), ("LF_joint4", "End")):
        slide(page, joint, key)
    slide(page, "LR_joint1", "Home")
    page.wait_until("crux.found().meets.length > 0")
    page.value("crux.scene.draw()")
    named = page.value("crux.found().meets.flatMap((each) => each.bodies)")
    assert set(page.value(red)) == set(named)
    one, other = page.value("crux.found().meets[0].links")
    assert one in text(page, "#meets")
    assert other in text(page, "#meets")
    page.value("document.activeElement.blur()")
    page.press("s")
    page.wait_until("crux.idle() && crux.found().meets.length === 0")
    page.value("crux.scene.draw()")
    assert page.value(red) == []


def test_loads_follow_slope_and_lifted_limb(page: Page) -> None:
    share = page.value("crux.found().loads.share")
    assert slide(page, "slope", "ArrowLeft", int(SLOPE_DEG)) == 0
    flat = page.value("crux.found().loads.share")
    assert flat < 0.9 * share
    down = "crux.scene.wall.getWorldDirection(crux.scene.camera.position.clone()).toArray()"
    assert page.value(down) == pytest.approx([0, 0, 1], abs=1e-6)  # the wall's normal: a floor
    assert slide(page, "slope", "ArrowRight", 90) == 90
    page.value("crux.scene.draw()")
    assert page.value(down) == pytest.approx([-1, 0, 0], abs=1e-6)
    hung = page.value("crux.found().loads.share")
    busiest = page.value("crux.found().loads.joint")
    assert busiest in text(page, "#verdict")
    assert f"{round(100 * hung)} %" in text(page, "#verdict")
    page.value("(() => { const s = crux.byId('lifted'); s.value = '1'; s.onchange(); })()")
    page.wait_until("crux.idle()")
    assert page.value("crux.found().loads.share") > 1.2 * hung
    shown = page.value("[...document.querySelectorAll('.used b')].map((each) => each.textContent)")
    assert f"{round(100 * page.value('crux.found().loads.share'))} %" in shown


def test_reach_and_frames_are_shown_on_demand(page: Page) -> None:
    visible = "crux.scene.reach.map((each) => each.visible)"
    page.value("crux.scene.draw()")
    assert page.value(visible) == [True] * 4
    page.press("r")
    page.press("f")
    page.value("crux.scene.draw()")
    assert page.value(visible) == [False] * 4
    frame = "crux.scene.frames.filter((each) => each.isGroup && each.visible).length"
    assert page.value(frame) == 1 + 4 * 7
    # The x axis of the gripper's frame, as drawn, is that of MuJoCo.
    ahead = "crux.scene.camera.position.clone().set(1, 0, 0)"
    body = "crux.scene.bodies[crux.told.limbs[3].gripper]"
    tip = page.value(f"crux.scene.tilted.worldToLocal({body}.localToWorld({ahead})).toArray()")
    way = np.subtract(tip, page.value("crux.scene.place(crux.told.limbs[3].gripper)"))
    _, data = by_mujoco(page)
    assert way == pytest.approx(data.body("RR_gripper").xmat.reshape(3, 3)[:, 0], abs=1e-5)
    page.press("f")


def test_the_drawn_reach_is_where_mujoco_brings_the_gripper(page: Page) -> None:
    """Postures whose gripper is upright are inside the surface, by rays; a place above the body is not."""
    q = np.array(page.value("crux.posture.q"))
    place = page.value("crux.scene.place(crux.told.limbs[1].gripper)")
    inside = """((place) => {
      const form = crux.scene.reach[1].geometry, at = form.attributes.position.array, index = form.index.array;
      let crossings = 0;
      for (let t = 0; t < index.length; t += 3) {
        const [a, b, c] = [0, 1, 2].map((k) => [0, 1, 2].map((i) => at[3 * index[t + k] + i] - place[i]));
        const side = (p, q) => p[0] * q[1] - p[1] * q[0];
        const parts = [side(b, c), side(c, a), side(a, b)], sum = parts[0] + parts[1] + parts[2];
        if (!parts.every((part) => part * sum > 0)) continue;
        if ((parts[0] * a[2] + parts[1] * b[2] + parts[2] * c[2]) / sum > 0) crossings += 1;
      }
      return crossings % 2 === 1;
    })"""
    assert q.shape == (4, 6)
    assert page.value(f"{inside}({[x + 0.0037 for x in place]})") is True
    assert page.value(f"{inside}([{place[0]}, {-place[1]}, {place[2]}])") is False
    assert page.value(f"{inside}([0.003, 0.002, 0.2])") is False
