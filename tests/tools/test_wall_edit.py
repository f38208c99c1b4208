"""The file side of `crux wall edit`: what a save leaves as it was, what it asks before, and who may send anything."""

from __future__ import annotations

import http.client
import json
import os
import signal
from collections.abc import Iterator
from copy import deepcopy
from pathlib import Path
from typing import Any

import pytest
import yaml
from crux_contracts.robot import load_robot
from crux_contracts.scenario import load_scenario
from crux_simulation.wall.edit.content import empty_wall, scenario_of
from crux_simulation.wall.edit.server import Editor
from crux_simulation.wall.edit.splice import rewritten
from crux_simulation.wall.edit.wall_file import WallFile
from crux_simulation.wall.edit.work import LOST, Work
from crux_tools.cli import main
from crux_tools.paths import ROOT, SCENARIOS

EXAMPLES = ROOT / "examples"
BY_HAND = """\
# The wall in the hall.
version: 1   # not 2
name: hall
holds:
  # the big one
  - name: jug            # since May
    position_m: [0.10, 0.2]   # measured
    size_m: [6.0e-2, 0.06, 0.06]
    friction: 2.20
  - {name: rail, position_m: [0.3, 0.2], size_m: [0.06, 0.06, 0.06], friction: 2.2}   # new
# how long
horizon: {steps: 40, dt_s: 2.0}
"""
MOVED = """\
# The wall in the hall.
version: 1   # not 2
name: hall
holds:
  # the big one
  - name: jug            # since May
    position_m: [0.15, 0.2]   # measured
    size_m: [6.0e-2, 0.06, 0.06]
    friction: 2.20
    yaw_deg: 30
  - {name: "1e3", position_m: [0.5, 0], size_m: [0.06, 0.06, 0.06], friction: 2.2}
# how long
horizon: {steps: 40, dt_s: 2.0}
start:
  body: {position_m: [0, 0, 0.185]}
  grasps:
    LF: {hold: jug, faces: x}
goal:
  body: {position_m: [0.1, 0, 0.185]}
"""
SCENES = [*sorted(SCENARIOS.glob("climb-*.yaml")), EXAMPLES / "scenario.yaml", EXAMPLES / "leaning-holds.yaml"]


def opened(path: Path, robot: str = "scaler", slope_deg: float = 90.0) -> WallFile:
    return WallFile(path, robot, slope_deg)


def copied(scene: Path, folder: Path) -> WallFile:
    path = folder / scene.name
    path.write_bytes(scene.read_bytes())
    return opened(path)


def comments(text: str) -> list[str]:
    return [line.partition("#")[2] for line in text.splitlines() if "#" in line]


def test_only_what_changes_is_written_anew() -> None:
    wanted = yaml.safe_load(BY_HAND)
    jug, rail = wanted["holds"]
    jug["position_m"], jug["size_m"], jug["yaw_deg"] = [0.15, 0.2], [0.06] * 3, 30
    wanted["holds"][1] = {**rail, "name": "1e3", "position_m": [0.5, 0]}
    wanted["start"] = {"body": {"position_m": [0, 0, 0.185]}, "grasps": {"LF": {"hold": "jug", "faces": "x"}}}
    wanted["goal"] = {"body": {"position_m": [0.1, 0, 0.185]}}
    assert rewritten(BY_HAND, wanted, {"holds": [0, None]}) == MOVED


def test_what_cannot_be_changed_in_place_is_not_tried() -> None:
    wanted = yaml.safe_load(BY_HAND)
    wanted["holds"].reverse()
    assert rewritten(BY_HAND, wanted, {"holds": [1, 0]}) is None


@pytest.mark.parametrize("scene", SCENES, ids=lambda scene: scene.stem)
def test_a_scene_keeps_its_comments_and_all_that_the_page_does_not_edit(scene: Path, tmp_path: Path) -> None:
    file = copied(scene, tmp_path)
    text, before = scene.read_text(encoding="utf-8"), load_scenario(scene)
    assert file.save(file.sketch(), over=False) == ""
    assert file.path.read_text(encoding="utf-8") == text
    sketch = deepcopy(file.sketch())
    sketch["slope_deg"], sketch["bodies"][0]["friction"] = 33.0, 1.25
    sketch["bodies"][1]["yaw_deg"] += 1.5
    sketch["bodies"].append(
        {**sketch["bodies"][0], "id": 999, "name": "added", "position_m": [3.0, 2.0], "lean_deg": {}}
    )
    assert file.save(sketch, over=False) == ""
    assert comments(file.path.read_text(encoding="utf-8")) == comments(text)
    after = load_scenario(file.path)
    assert after.wall.slope_deg == pytest.approx(33.0, abs=1e-3)
    assert after.holds[0].friction == (1.25,) * 5
    assert after.holds[1].yaw_deg == pytest.approx(before.holds[1].yaw_deg + 1.5)
    assert after.holds[2:-1] == before.holds[2:]
    assert (after.holds[-1].name, after.holds[-1].position_m) == ("added", (3.0, 2.0))
    same = ("contact", "start", "goal", "horizon", "uncertainty", "planner", "obstacles", "robot")
    assert [getattr(after, key) for key in same] == [getattr(before, key) for key in same]


def test_ids_outlive_a_save_and_a_deletion(tmp_path: Path) -> None:
    file = copied(SCENARIOS / "climb-obstacles.yaml", tmp_path)
    whole = file.sketch()
    first, *others = whole["bodies"]
    assert file.save({**whole, "bodies": others}, over=False) == ""
    assert file.save(whole, over=False) == ""  # as after an undo: what is new stands last
    assert [hold.name for hold in load_scenario(file.path).holds][-1] == first["name"]
    kinds = [{**each, "obstacle": not each["obstacle"], "friction": 2.2} for each in others]
    content = file.content_of({**whole, "bodies": [first, *kinds]})
    assert {each["name"] for each in content["obstacles"]} == {each["name"] for each in kinds if each["obstacle"]}


def test_it_asks_before_it_overwrites_what_others_wrote(tmp_path: Path) -> None:
    file = copied(SCENARIOS / "climb-one-step.yaml", tmp_path)
    file.path.write_text("mine\n", encoding="utf-8")
    assert "changed by another program" in file.save(file.sketch(), over=False)
    assert file.path.read_text(encoding="utf-8") == "mine\n"
    assert file.save(file.sketch(), over=True) == ""
    assert file.path.read_bytes() == (SCENARIOS / "climb-one-step.yaml").read_bytes()
    new = opened(tmp_path / "new.yaml")
    new.path.write_text("somebody's\n", encoding="utf-8")
    assert "changed by another program" in new.save(new.sketch(), over=False)


def test_a_new_file_is_an_empty_wall_of_the_slope_and_can_be_opened_again(tmp_path: Path) -> None:
    file = opened(tmp_path / "new.yaml", slope_deg=70.0)
    assert not file.path.exists()
    assert file.save(file.sketch(), over=False) == ""
    again = opened(file.path)
    assert (again.sketch()["slope_deg"], again.sketch()["bodies"], again.sketch()["start"]) == (70.0, [], None)
    assert scenario_of(again.content, again.robot, "new").wall.slope_deg == 70.0


def test_what_is_no_wall_for_grippers_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    wrong = tmp_path / "wrong.yaml"
    wrong.write_text((SCENARIOS / "climb-one-step.yaml").read_text().replace("slope_deg: ", "slope_deg: 4"))
    words = {
        (str(SCENARIOS / "walk-flat.yaml"),): "contact.model",
        (
            str(ROOT / "benchmarks" / "walls" / "feet-45.yaml"),
        ): "start.grasps.RR.foothold: foot-right-0: expected a hold",
        (str(wrong),): "wrong.yaml:",
        (str(tmp_path),): "is a folder",
        (str(wrong), "--slope", "70"): "--slope",
        (str(tmp_path / "new.yaml"), "--robot", "nobody"): "nobody",
    }
    for arguments, expected in words.items():
        assert main(["wall", "edit", *arguments, "--port", "0"]) == 2
        said = capsys.readouterr().err
        assert expected in said
        assert "Traceback" not in said
    assert not (tmp_path / "new.yaml").exists()


@pytest.fixture(scope="module")
def editor(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Editor]:
    running = Editor(opened(tmp_path_factory.mktemp("edit") / "wall.yaml"), "127.0.0.1", 0)
    yield running
    running.close()


def sent(editor: Editor, path: str, body: bytes, **headers: str) -> tuple[int, bytes]:
    own = {"Origin": f"http://127.0.0.1:{editor.port}", "Content-Type": "application/json"}
    connection = http.client.HTTPConnection("127.0.0.1", editor.port, timeout=60)
    connection.request("POST", path, body, {key: value for key, value in (own | headers).items() if value})
    answer = connection.getresponse()
    told = answer.status, answer.read()
    connection.close()
    return told


def test_only_the_page_itself_may_send(editor: Editor) -> None:
    whole = editor.answer("/wall", {})
    save = json.dumps({"session": whole["session"], "sketch": whole["sketch"], "over": True}).encode()
    for wrong in (
        {"Origin": ""},
        {"Origin": "http://evil.example"},
        {"Content-Type": "text/plain"},
        {"Host": "evil.example"},
        {"Sec-Fetch-Site": "cross-site"},
    ):
        assert sent(editor, "/save", save, **wrong)[0] == 403
    other = save.replace(whole["session"].encode(), b"before")
    assert sent(editor, "/save", other)[0] == 409
    assert sent(editor, "/save", b"[" * 100_000)[0] == 400
    assert sent(editor, "/save", b"{}")[0] == 404
    assert sent(editor, "/../etc/passwd", save)[0] == 404
    assert sent(editor, "/save", b"", **{"Content-Length": str(1 << 40)})[0] == 413
    assert list(editor._file.path.parent.iterdir()) == []
    assert sent(editor, "/save", save)[0] == 200
    assert list(editor._file.path.parent.iterdir()) == [editor._file.path]


def test_what_is_wrong_is_told_in_words_with_the_hold_it_is_about(editor: Editor) -> None:
    whole = editor.answer("/wall", {})
    hold: dict[str, Any] = {"id": 0, "name": "jug", "obstacle": False, "position_m": [0, 0], "yaw_deg": 0}
    hold |= {"size_m": [0.06, 0.06, 3.0], "lean_deg": {}, "friction": 2.2}
    sketch = {**whole["sketch"], "bodies": [hold]}
    (problem,) = editor.take("/edit", {"session": whole["session"], "version": 0, "sketch": sketch})["problems"]
    assert problem["hold"] == "jug"
    assert problem["text"].startswith("jug.size_m[2]: 3")


def test_a_lost_process_is_told_and_what_is_asked_next_ends_what_is_being_planned() -> None:
    work = Work()
    try:
        os.kill(work.pid, signal.SIGKILL)
        told = work.told(0, 60.0)
        assert told is not None
        assert told["plan"] == {"kind": "failed", "text": LOST}
        robot, scene = load_robot("scaler"), SCENARIOS / "climb-long.yaml"
        work.look(1, yaml.safe_load(scene.read_text(encoding="utf-8")), load_scenario(scene))
        first = work.pid
        content = empty_wall("empty", robot, 90.0)
        work.look(2, content, scenario_of(content, robot, "empty"))
        assert work.pid != first
        assert not Path(f"/proc/{first}").exists()
        while told["state"] != "idle" or told["version"] != 2:
            news = work.told(told["stamp"], 60.0)
            assert news is not None
            told = news
        told = work.told(0, 0.0)
        assert told is not None
        assert (told["plan"], told["reach"]["stances"]) == (None, [])
    finally:
        work.close()
