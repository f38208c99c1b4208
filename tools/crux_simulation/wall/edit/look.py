"""What the editor has computed of a wall, in another process: who reaches which holds, stances, and the plan."""

from __future__ import annotations

import os
import queue
import signal
import tempfile
import threading
import time
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np
from crux_contracts.scenario import Scenario

Told = dict[str, Any]
FRAMES = 300  # of a plan's motion, at most
TOLD_EVERY_S = 0.3
NICE = 5  # the page goes first


def serve(link: Connection) -> None:
    """Works on what comes through the link, one wall after the other, until the other end closes it, in the middle of
    the work, too.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the command, which ends this process
    os.nice(NICE)
    walls: queue.SimpleQueue[tuple[Scenario, bool, bool]] = queue.SimpleQueue()
    threading.Thread(target=_receive, args=(link, walls), daemon=True).start()
    import crux_planner.method_report  # noqa: F401 - while nothing is asked

    while True:
        scenario, looks, plans = walls.get()
        try:
            if looks:
                link.send(reach(scenario))
            if plans:
                plan(scenario, link)
            link.send({"kind": "done"})
        except Exception as error:  # a mistake of crux, told in the page
            link.send({"kind": "failed", "text": f"crux failed on this wall: {type(error).__name__}: {error}"})


def _receive(link: Connection, walls: queue.SimpleQueue[Any]) -> None:
    while True:
        try:
            walls.put(link.recv())
        except (EOFError, OSError):
            os._exit(0)


def reach(scenario: Scenario) -> Told:
    """By hold what limbs grip it, how well and why not, and the stances that the map has."""
    from crux_contracts.robot import robot_of
    from crux_planner.method_report import wall_offers
    from crux_tools.view.grip_marks import touched

    robot = robot_of(scenario.robot)
    report = wall_offers(scenario, robot)
    holds: dict[str, list[Told]] = {hold.name: [] for hold in scenario.holds}
    for pair in report.pairs:
        limbs = {limb: place.share for limb, place in pair.limbs.items()}
        told = {"faces": pair.faces, "off_centre": pair.off_centre, "limbs": limbs}
        hold = scenario.holds[scenario.hold_index(pair.hold)]
        marks = touched(hold, pair.faces, robot, scenario.contact.patch_radius_m)
        holds[pair.hold].append({**told, "without": pair.without, "reason": pair.reason, "marks": marks})
    stances = [
        {
            "position_m": [round(each, 4) for each in stance.body_m],
            "grasps": {limb: {"hold": hold, "faces": faces} for limb, (hold, faces) in stance.grasps.items()},
        }
        for stance in report.stances
    ]
    return {"kind": "reach", "holds": holds, "stances": stances}


def plan(scenario: Scenario, link: Connection) -> None:
    """Sends the plan's figures, then its motion, which takes a while as well; or why there is none."""
    import crux_planner
    from crux_contracts.robot import robot_of
    from crux_contracts.scenario import ScenarioError

    last = [0.0]

    def progress(what: str, share: float) -> None:
        if time.monotonic() - last[0] > TOLD_EVERY_S:
            last[0] = time.monotonic()
            link.send({"kind": "doing", "text": what, "share": share})

    try:
        if scenario.start.air:
            result = crux_planner.Planner(scenario, robot_of(scenario.robot)).plan()
        else:
            result = crux_planner.plan(scenario, scenario.robot, progress=progress)
    except crux_planner.InfeasibleError as error:
        link.send(refused(scenario, f"{error.verdict} ({error.constraint})", str(error)))
        return
    except ScenarioError as error:
        link.send(refused(scenario, "", str(error)))
        return
    told = {"cost": result.cost, "gap": result.gap, "steps": result.steps, "margin_n": result.check.friction_margin_N}
    link.send({"kind": "plan", **told, "seconds": result.plan.knots[-1].time_s})
    link.send({"kind": "motion", **motion(result.plan)})


def refused(scenario: Scenario, verdict: str, text: str) -> Told:
    """Why there is no plan, and the holds that this names."""
    words = text.replace(",", " ").replace(":", " ").replace(";", " ").split()
    named = [hold.name for hold in scenario.holds if f" {hold.name} " in f" {' '.join(words)} "]
    return {"kind": "refused", "verdict": verdict, "text": text, "holds": named}


def motion(made: Any) -> Told:
    """Of a plan_t: poses of the robot's bodies at even times, as `Bodies.poses` has them, and the body's way (3 n,)."""
    from crux_contracts.plan_file import write_plan
    from crux_tools.view.recording import recording_of
    from crux_tools.view.scene import Scene

    with tempfile.TemporaryDirectory(prefix="crux-edit-") as folder:
        path = Path(folder) / "plan.mcap"
        write_plan(path, made)
        recording = recording_of(path)
    assert recording is not None
    scene, time_s = Scene(recording), recording.log.time_s
    rows = np.unique(np.linspace(0, len(time_s) - 1, min(len(time_s), FRAMES)).astype(int))
    moments = [scene.at(int(row), recording) for row in rows]
    return {
        "time_s": np.round(time_s[rows], 3).tolist(),
        "poses": [moment["measured"] for moment in moments],
        "way": [each for moment in moments for each in moment["body"]],
    }
