"""`crux wall edit` as its users see it: a wall drawn from nothing by mouse and keys in a browser without a window."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import crux_planner
import numpy as np
import pytest
from crux_contracts.robot import load_robot
from crux_contracts.scenario import load_scenario
from crux_simulation.wall.edit.server import Editor
from crux_simulation.wall.edit.wall_file import WallFile
from crux_tools.paths import ROOT
from crux_tools.view.browser import Page, open_page

HOLDS = [(0.14, 0.36), (0.14, -0.36), (-0.14, 0.36), (-0.14, -0.36)]
CTRL = 2  # of the protocol's modifiers
IDLE = "crux.found.state === 'idle' && crux.found.version === crux.sketch.wall.version && !crux.found.looking"
PLANNED = f"{IDLE} && crux.found.plan?.kind === 'plan' && crux.found.motion"


class Hands:
    """Mouse and keyboard on the page."""

    def __init__(self, page: Page) -> None:
        self.page = page

    def mouse(self, kind: str, at: list[float], clicks: int = 1) -> None:
        """mousePressed, mouseMoved or mouseReleased at a place of the window."""
        more = {"button": "left", "clickCount": clicks, "buttons": 1}
        self.page.call("Input.dispatchMouseEvent", type=kind, x=at[0], y=at[1], **more)

    def at(self, x: float, y: float, z: float = 0.0) -> list[float]:
        """Where a place of the wall is in the window."""
        found: list[float] = self.page.value(f"crux.scene.pixel([{x}, {y}, {z}])")
        return found

    def double_click(self, x: float, y: float) -> None:
        """On a place of the wall."""
        for clicks in (1, 2):
            for kind in ("mousePressed", "mouseReleased"):
                self.mouse(kind, self.at(x, y), clicks)

    def drag(self, start: list[float], end: list[float]) -> None:
        """From a place of the window to another one."""
        self.mouse("mousePressed", start)
        for share in (0.5, 1.0):
            self.mouse("mouseMoved", [a + share * (b - a) for a, b in zip(start, end, strict=True)])
        self.mouse("mouseReleased", end)

    def ctrl(self, key: str) -> None:
        """A key with ctrl."""
        for kind in ("keyDown", "keyUp"):
            self.page.call("Input.dispatchKeyEvent", type=kind, key=key, modifiers=CTRL)

    def type_into(self, name: str, text: str) -> None:
        """A field by its name, as by a click on it."""
        self.page.value(f"document.querySelector('input[aria-label=\"{name}\"]').select()")
        self.page.call("Input.insertText", text=text)
        self.page.press("Enter")


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("edit") / "my-wall.yaml"


@pytest.fixture(scope="module")
def hands(file: Path) -> Iterator[Hands]:
    """Of one browser for all tests, which go on from each other."""
    editor = Editor(WallFile(file, "scaler", 60.0), "127.0.0.1", 0)
    try:
        with open_page(editor.url, (760, 480)) as page:  # drawn by the processor: the smaller, the quicker
            page.wait_until("window.crux?.ready")
            yield Hands(page)
            assert page.errors == []
    finally:
        editor.close()


def body(hands: Hands) -> dict[str, Any]:
    """The chosen one."""
    found: dict[str, Any] = hands.page.value("crux.sketch.chosen()")
    return found


def test_holds_are_added_moved_turned_resized_deleted_and_all_is_undone(hands: Hands) -> None:
    page = hands.page
    for x, y in HOLDS:
        hands.double_click(x, y)
    places = page.value("crux.sketch.bodies().map((each) => each.position_m)")
    assert places == [pytest.approx(place, abs=0.012) for place in HOLDS]
    before = page.value("JSON.stringify(crux.sketch.wall.sketch)")
    x, y = body(hands)["position_m"]
    hands.drag(hands.at(x + 0.02, y + 0.01, 0.06), hands.at(x - 0.08, y + 0.11, 0.06))
    assert body(hands)["position_m"] == pytest.approx([x - 0.1, y + 0.1], abs=0.012)
    page.press("ArrowUp")
    page.press("ArrowLeft", shift=True)
    moved = body(hands)["position_m"]
    page.press("q")
    page.press("E", shift=True)
    assert body(hands)["yaw_deg"] == 4
    page.press("x")
    page.press("Z", shift=True)
    assert body(hands)["size_m"] == [0.065, 0.06, 0.055]
    hands.type_into("x", str(1000 * moved[0] + 20))
    assert body(hands)["position_m"] == pytest.approx([moved[0] + 0.02, moved[1]])
    middle = body(hands)["position_m"]
    x, y, z = page.value("crux.scene.knobs.children[0].getWorldPosition(crux.scene.camera.position.clone()).toArray()")
    hands.drag(hands.at(x, y, z), hands.at(middle[0], middle[1] + 0.2, z))
    assert body(hands)["yaw_deg"] == 90
    page.press("o")
    assert body(hands)["obstacle"] is True
    page.press("Delete")
    assert page.value("crux.sketch.bodies().length") == 3
    for _ in range(40):
        if page.value("JSON.stringify(crux.sketch.wall.sketch)") == before:
            break
        hands.ctrl("z")
    assert page.value("JSON.stringify(crux.sketch.wall.sketch)") == before
    hands.ctrl("y")
    assert page.value("JSON.stringify(crux.sketch.wall.sketch)") != before
    hands.ctrl("z")


def test_a_hold_is_dragged_before_it_is_drawn(hands: Hands) -> None:
    """As on a busy machine, whose frames come late."""
    page = hands.page
    before = page.value("JSON.stringify(crux.sketch.wall.sketch)")
    page.value("window.drawsLater = window.requestAnimationFrame; window.requestAnimationFrame = () => 1; null")
    hands.double_click(0.3, 0.0)
    x, y = body(hands)["position_m"]
    hands.drag(hands.at(x + 0.02, y + 0.01, 0.06), hands.at(x - 0.08, y + 0.11, 0.06))
    moved = body(hands)["position_m"]
    page.value("window.requestAnimationFrame = window.drawsLater; crux.scene.waits = null; crux.scene.soon()")
    assert moved == pytest.approx([x - 0.1, y + 0.1], abs=0.012)
    for _ in range(4):
        if page.value("JSON.stringify(crux.sketch.wall.sketch)") == before:
            break
        hands.ctrl("z")
    assert page.value("JSON.stringify(crux.sketch.wall.sketch)") == before


def test_holds_show_who_grips_them_and_mistakes_are_told(hands: Hands) -> None:
    page = hands.page
    page.wait_until(IDLE)
    assert page.value("crux.found.reach.stances.length") > 3
    for name in ("h1", "h2", "h3", "h4"):
        assert page.value(f"crux.found.reach.holds.{name}.some((pair) => pair.limbs.LF > 0 && pair.limbs.RR > 0)")
    assert "Still to be set: start and goal" in page.value("crux.byId('plan').textContent")
    page.value("crux.sketch.choose(crux.sketch.named('h1').id)")
    hands.type_into("size z", "20")
    page.wait_until(IDLE)
    assert "lower than" in page.value("crux.byId('reach').textContent")
    assert page.value("crux.found.reach.stances.length") == 0
    colours = "['h1', 'h2'].map((name) => crux.scene.made.get(crux.sketch.named(name).id).children[0].material.color)"
    page.wait_until(f"(([low, good]) => low.r > 2 * low.g && good.g > 2 * good.r)({colours})")
    dots = "['h1', 'h2'].map((name) => crux.scene.made.get(crux.sketch.named(name).id).children.length)"
    assert (
        page.value(f"(([low, good]) => good - low)({dots})") == 3
    )  # four limbs' dots, and the lines of the chosen one
    page.press("s")
    assert "no stance" in page.value("document.querySelector('.toast').textContent")
    hands.type_into("size z", "2100")
    page.wait_until("crux.found.problems.length > 0")
    assert "h1.size_m[2]: 2.1" in page.value("crux.byId('problems').textContent")
    page.wait_until("document.querySelector('.labels .why')?.textContent.startsWith('h1.size_m[2]: 2.1')")
    hands.ctrl("z")
    hands.ctrl("z")
    page.wait_until(f"{IDLE} && crux.found.reach.stances.length > 3")


def test_start_and_goal_snap_to_stances_and_the_wall_is_planned_saved_and_plans_again(hands: Hands, file: Path) -> None:
    page = hands.page
    page.press("s")
    page.press("Enter")
    start = page.value("crux.sketch.wall.sketch.start.body.position_m")
    assert start in page.value("crux.found.reach.stances.map((stance) => stance.position_m)")
    page.press("g")
    page.press("ArrowUp")
    page.press("Enter")
    page.wait_until(PLANNED)
    assert page.value("crux.sketch.wall.sketch.goal.body.position_m[0]") > start[0]
    hands.ctrl("s")
    page.wait_until("document.querySelector('.toast')?.textContent.includes('is saved')")
    assert page.value("crux.byId('names').classList.contains('unsaved')") is False
    result = crux_planner.plan(load_scenario(file), "scaler")
    assert page.value("crux.found.plan.cost") == pytest.approx(result.cost, rel=1e-6)
    assert f"J {result.cost:.3f}" in page.value("crux.byId('plan').textContent")
    page.press(" ")
    page.wait_until("Number(crux.byId('time').value) > 0 && crux.robot.ends.playing")
    assert page.value("crux.scene.robot[0].visible")


def test_a_dragged_robot_snaps_and_the_plan_is_begun_anew(hands: Hands) -> None:
    page = hands.page
    x, y, z = page.value("crux.sketch.wall.sketch.goal.body.position_m")
    page.wait_until(f"{PLANNED} && crux.scene.figures.goal[0].visible")
    page.value("window.planBefore = crux.found.plan; null")
    hands.drag(hands.at(x + 0.14, y, z + 0.03), hands.at(x + 0.19, y + 0.06, z + 0.03))
    goal = page.value("crux.sketch.wall.sketch.goal")
    assert goal["body"]["position_m"] in page.value("crux.found.reach.stances.map((stance) => stance.position_m)")
    assert goal["body"]["position_m"][1] > y + 0.02
    assert "grasps" not in goal
    page.wait_until("crux.found.plan !== window.planBefore")  # whether or not the new one is there already
    page.wait_until(PLANNED)


def test_a_wall_without_a_way_says_why_at_the_hold(hands: Hands) -> None:
    page = hands.page
    page.value("crux.sketch.choose(crux.sketch.named('h1').id)")
    hands.type_into("friction", "0")
    page.wait_until(f"{IDLE} && crux.found.plan?.kind === 'refused'")
    assert "friction 0" in page.value("crux.byId('plan').textContent")
    assert page.value("crux.found.plan.holds") == ["h1"]
    page.wait_until("document.querySelector('.labels .why')?.textContent.includes('friction 0')")


def test_pads_of_grips_are_marked_on_both_faces(tmp_path: Path) -> None:
    """On the example's hold of 90 mm, the faces of which lean by 30 degrees: the pads are 30 mm over its foot."""
    wall = tmp_path / "wall.yaml"
    wall.write_bytes((ROOT / "examples" / "leaning-holds.yaml").read_bytes())
    editor = Editor(WallFile(wall, "scaler", 90.0), "127.0.0.1", 0)
    marks = "[...crux.scene.made.values()].flatMap((group) => group.children.filter((each) => each.userData.mark))"
    try:
        with open_page(editor.url, (760, 480)) as page:
            page.wait_until(f"window.crux?.ready && {marks}.length")
            found = page.value(f"{marks}.map((mark) => mark.position.toArray())")
            assert page.errors == []
    finally:
        editor.close()
    radius_m, lean = load_robot("scaler").gripper.pad_radius_m, np.radians(30.0)
    half_m = 0.045 - 0.03 * np.tan(lean) + radius_m * (1.0 / np.cos(lean) - 1.0)
    assert np.array(found) == pytest.approx(np.array([[half_m, 0.005, 0.03], [-half_m, 0.005, 0.03]]), abs=1e-6)
