"""Why a hold and a pair of its faces offer no grasp, in words."""

from collections.abc import Callable

import numpy as np
from crux_contracts.robot import Robot
from crux_contracts.scenario import Grip, Hold, Scenario

from crux_planner.errors import wrong
from crux_planner.model.contacts import GripperShape
from crux_planner.model.faces import PASSING_CLEARANCE_M, Faces, smooth_faces, too_steep

ROUNDING_M = 1e-6  # of places in files
WALL_CLEARANCE_M = 0.003  # of pads to the wall where a hold is turned out of its plane, and to bounded surfaces


def height_text(height_m: float, robot: Robot, patch_radius_m: float) -> str:
    """Why a hold of this height takes no pads."""
    low, high = robot.grasp.pad_height_m
    least, most = max(low, patch_radius_m) + patch_radius_m, high + Faces.top_over_pads_m(robot)
    limit = f"lower than the {least:g} m" if height_m < least else f"higher than the {most:g} m"
    return f"it is {height_m:g} m high, {limit} that the gripper's pads and palm need"


def faces_text(hold: Hold, pair: int, faces: Faces, shape: GripperShape, patch_radius_m: float) -> str | None:
    """Why a gripper cannot hold on to a pair of faces, whatever stands around; None where it can."""
    if faces.width_m < 2 * patch_radius_m:
        return f"its faces are narrower than the patch, {2 * patch_radius_m:g} m"
    if faces.half_m < shape.smallest_opening or faces.half_m + shape.pad_radius > shape.largest_opening:
        spans = f"{2 * shape.smallest_opening:g}..{2 * (shape.largest_opening - shape.pad_radius):g} m"
        return f"it is {2 * faces.half_m:g} m wide, the gripper takes {spans}"
    if (steep := too_steep(hold, pair)) is not None:
        return steep
    if smooth := smooth_faces(hold, pair):
        return f"face {smooth[0]} has friction 0, both faces of a grasp need more"
    return None


def look_at_grip(scenario: Scenario, index: int, grip: Grip | None, faces: Faces, pair: int, robot: Robot) -> None:
    """Raises ScenarioError where one of a hold's own grips has pads beyond its faces, or turns the palm into it."""
    if grip is None:
        return
    hold, why = scenario.holds[index], ""
    if faces.beyond_m > ROUNDING_M:
        why = f"its pads are {1e3 * faces.beyond_m:.1f} mm beyond the faces, or the heights they may have"
    elif grip.tilt_deg and (gap_m := faces.palm_gap_m(hold, pair, grip, robot)) < PASSING_CLEARANCE_M - ROUNDING_M:
        where = f"{1e3 * gap_m:.1f} mm off" if gap_m >= 0.0 else f"{-1e3 * gap_m:.1f} mm in"
        why = f"at {grip.tilt_deg:g} degrees the palm is {where} the hold, it needs {1e3 * PASSING_CLEARANCE_M:g} mm"
    if why:
        raise wrong(scenario, f"holds[{index}].grips[{hold.grips.index(grip)}]", "", f"{hold.name}: {why}")


def narrow_text(opens: Callable[[float], float | None], nearest: tuple[float, str], needed_m: float) -> str:
    """Why fingers cannot open: the surface that is nearest to them or to the palm, or neighbours."""
    off_m, surface = nearest
    if off_m < WALL_CLEARANCE_M:
        away = f"{1000 * off_m:.0f} mm off {surface}, they need {1000 * WALL_CLEARANCE_M:.0f} mm"
        return f"it is turned or stands so that a finger or the palm would be {away}"
    mm = f"{1000 * _left_m(opens, needed_m):.0f} mm beside the fingers, they need {1000 * needed_m:.0f} mm to open"
    return f"its neighbours leave {mm}"


def _left_m(opening: Callable[[float], float | None], needed_m: float) -> float:
    """The most clearance, 0 at least, with which there still is an opening."""
    tried = np.linspace(needed_m, 0.0, 19)
    return float(next((clearance for clearance in tried if opening(clearance) is not None), 0.0))
