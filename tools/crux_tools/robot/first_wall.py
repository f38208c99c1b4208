"""`crux robot check --wall`: of the first walls that the planner proposes the steepest that is borne and has a plan."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import yaml
from crux_contracts import LIMB_NAMES
from crux_contracts.output_file import write_whole
from crux_contracts.robot import Robot, robot_folders
from crux_planner import InfeasibleError, plan
from crux_planner.checker import geometry
from crux_planner.checker.inverse_kinematics import solve
from crux_planner.checker.limb_model import WholeRobot
from crux_planner.method_report import first_walls

from crux_tools.preflight.machine import BAD, DOUBTFUL, GOOD, Finding
from crux_tools.robot.loads import Load, least_load, peak_torques_Nm
from crux_tools.robot.stance import Stance, standing

if TYPE_CHECKING:
    from crux_planner.method_report import FirstWall

SLOPES_DEG = (90, 75, 60, 45, 30, 15, 0)
MOST_SHARE = 0.75  # of the peak torques on three limbs: the planner keeps a quarter
TRIES = 3  # slopes that are planned,
FIT_S, LONGER_S = 30, 300  # each for so long [s of CPU], and how long one may try where that ended it
OTHERS = "other limits or stronger motors"
MOST_RAD_M = 40  # that joints may turn for a metre of a gripper: random robots climb at up to 37
ASIDE = (-0.5, 0.0, 0.5)  # steps by which the body may be below or above its holds' middle for a lift


def fitted(robot: Robot, model: WholeRobot, friction: float, path: Path) -> Finding:
    """Writes the scenario; says what it is, or why there is none."""
    try:
        walls = list(first_walls(robot))
    except InfeasibleError as none:
        remedy = "wider joint limits, or a narrower range of body.height_m or grasp.gripper_yaw_rad"
        return Finding("first wall", BAD, f"none fits: {none}", remedy)
    if not walls:
        remedy = "no four holds that the limbs reach all along a step: other limits, body.height_m or gripper_yaw_rad"
        return Finding("first wall", BAD, "none fits", remedy)
    quiet = [wall for wall in walls if wall.turns_rad_m.max() <= MOST_RAD_M]
    if not quiet:
        return _near_singular(min(walls, key=lambda wall: float(wall.turns_rad_m.max())))
    walls = quiet
    stances = [[_standing(wall, model, aside * wall.stride_m) for aside in ASIDE] for wall in walls]
    force_N, tries = robot.gripper.max_finger_force_N, 0
    found, remedy, unsure = "none fits: the motors bear no slope", "", None
    for slope in SLOPES_DEG:
        loads = [_hardest(each, slope, friction, force_N, MOST_SHARE) for each in stances]
        borne = [(-wall.stride_m, load.share, i) for i, (wall, load) in enumerate(zip(walls, loads, strict=True))]
        borne = [each for each in borne if each[1] <= MOST_SHARE]
        if not borne or tries == TRIES:
            continue
        _, share, chosen = min(borne)  # the longest step
        document, tries = walls[chosen].document(slope, friction), tries + 1
        try:
            plan(document, robot, time_limit_s=FIT_S)
        except InfeasibleError as none:
            found, remedy = f"no plan for those that fit, as on {slope} degrees: {none}", OTHERS
            unsure = document if none.undecided else unsure
            continue
        _write(path, document, robot)
        hangs = f"{share:.2f} of the peak torques to hang on three of its first holds"
        what = f"{path}: {slope} degrees, a step of {walls[chosen].stride_m:g} m, {hangs}"
        return _said(f"{what}; {_turning(walls[chosen])}", robot, path)
    if unsure is not None:
        _write(path, unsure, robot)
        remedy = f"{path} is one that time ended: crux plan {path} -o plan.mcap --time-limit {LONGER_S} goes on"
    return Finding("first wall", BAD, found, remedy or _too_weak(stances, friction, force_N))


def _too_weak(stances: list[list[Stance]], friction: float, most_N: float) -> str:
    """What the busiest motor lacks on the slope and the wall that ask least of it."""
    loads = [(slope, _hardest(each, slope, friction, most_N, np.inf)) for slope in SLOPES_DEG for each in stances]
    slope, load = min(loads, key=lambda each: each[1].share)
    wanted = f"stronger motors or a lighter robot: on three limbs at most {MOST_SHARE:g} of the peak torques"
    if not np.isfinite(load.share):
        return f"{wanted}; three grippers hold it on no slope"
    return f"{wanted}; at best, on {slope} degrees, {load.share:.2f} of that of {load.joint}"


def _near_singular(wall: FirstWall) -> Finding:
    """Of the wall on which joints turn least, and still too much."""
    limb = int(wall.turns_rad_m.argmax())
    what = f"none fits: {_turning(wall)}; expected at most {MOST_RAD_M} rad"
    remedy = f"{LIMB_NAMES[limb]} is near a singular posture: other joint limits, shoulder, links or body.height_m"
    return Finding("first wall", BAD, what, remedy)


def _turning(wall: FirstWall) -> str:
    """What the joints do on the wall's step, and what that means."""
    limb = int(wall.turns_rad_m.argmax())
    slowest = min(joint.velocity for joint in wall.robot.limbs[limb].joints)
    speed, stiffest = slowest / wall.turns_rad_m[limb], wall.stiffness_N_m.max()
    return (
        f"joints turn up to {wall.turns_rad_m[limb]:.0f} rad for a metre of a gripper ({LIMB_NAMES[limb]}, at "
        f"{speed:.2f} m/s as fast as they can), make it as stiff as {stiffest / 1000:.0f} N/mm and stay "
        f"{wall.margin_rad.min():.2f} rad off their limits"
    )


def _write(path: Path, document: dict[str, Any], robot: Robot) -> None:
    said = f"# Fitted to {robot.name} by `crux robot check --wall`: start and goal on four holds each, a step apart.\n"
    text = yaml.safe_dump(document, sort_keys=False, default_flow_style=None, width=140)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, (said + text).encode())


def _said(what: str, robot: Robot, path: Path) -> Finding:
    known = robot_folders().get(robot.name)
    if known is None or known.resolve() != robot.folder.resolve():
        remedy = f"crux plan knows no robot {robot.name} in {robot.folder}: call the folder so, "
        return Finding("first wall", DOUBTFUL, what, f"{remedy}and name the one that it is in by CRUX_ROBOTS")
    return Finding("first wall", GOOD, f"{what}; next: crux plan {path} -o plan.mcap")


def _hardest(stances: list[Stance], slope_deg: float, friction: float, most_N: float, enough: float) -> Load:
    """Of hanging on three limbs, each time in the best of the stances; the first above `enough`, infinite where nothing
    holds.
    """
    limbs, most = stances[0].model.limbs, Load(0.0, "")
    peaks = peak_torques_Nm(limbs)
    for lifted in range(len(limbs)):
        loads = (least_load(stance, np.radians(slope_deg), peaks, friction, most_N, lifted) for stance in stances)
        least = min((load for load in loads if load is not None), key=_share, default=Load(np.inf, "nothing"))
        most = max(most, least, key=_share)
        if most.share > enough:
            break
    return most


def _share(load: Load) -> float:
    return load.share


def _standing(wall: FirstWall, model: WholeRobot, up_m: float) -> Stance:
    """On the wall's first holds, the body so much further down the wall."""
    places, yaws = wall.grippers_b[:, :3] + [up_m, 0.0, 0.0], wall.grippers_b[:, 3]
    turns = geometry.rotation_about_z(yaws)
    found = solve(model.limbs, list(places[:, None]), list(turns[:, None]))
    return standing(model, [each.q_rad[0] for each in found], wall.robot.gripper.open_opening_m)
