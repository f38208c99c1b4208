"""Makes the golden vectors in msgs/golden.

`python tests/msgs/msgs_golden.py` writes them anew: a deliberate act, for the vectors are what programs of different
versions and languages agree on.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import crux_msgs
import numpy as np
from crux_contracts import LIMB_NAMES, can_codec, cdr
from crux_contracts.five_bar import FiveBar
from crux_contracts.gripper_frames import gripper_rotation, yaw_and_tilt
from crux_contracts.interpolation import PlanReference
from crux_contracts.transmissions import Limits, Transmission, own_limits
from crux_msgs import limb_knot_t, plan_knot_t, plan_t
from crux_msgs.robot_keys import Transmissions
from crux_msgs.tables import MEMBERS
from five_bars import drawn

FOLDER = Path(__file__).resolve().parents[2] / "msgs" / "golden"
SHARES = (0.0, 0.13, 0.3, 0.53, 0.57, 0.8, 1.0)
DIGITS = 12

_INTEGERS = {"int8_t": 8, "int16_t": 16, "int32_t": 32, "int64_t": 64}
_DOUBLES = (0.1, -2.5, 0.0, -0.0, 1e-300, -1.7976931348623157e308, 3.141592653589793)
_TEXTS = ("", "crux", "Wand 45° · π", "a much longer text that crosses an alignment")


def _values(kind: str, numbers: Iterator[int]) -> Any:
    """The next value of a primitive type: small numbers and the ends of the range in turn."""
    n = next(numbers)
    if kind in _INTEGERS:
        top = 2 ** (_INTEGERS[kind] - 1)
        return (n % 100, -(n % 100), top - 1, -top)[n % 4]
    if kind == "float":
        return n / 8  # which single precision has
    if kind == "double":
        return _DOUBLES[n % len(_DOUBLES)] if n % 2 else n / 8
    return _TEXTS[n % len(_TEXTS)]


def _fill(type_name: str, numbers: Iterator[int], length: int) -> dict[str, Any]:
    """Fields of a message; every sequence has `length` elements. Bytes are given as hex."""
    fields: dict[str, Any] = {}
    lengths = {dimension for _, _, dimension in MEMBERS[type_name] if isinstance(dimension, str)}
    for name, kind, dimension in MEMBERS[type_name]:
        if name in lengths:
            fields[name] = length
        elif kind == "byte":
            count = dimension if isinstance(dimension, int) else length
            fields[name] = bytes(next(numbers) % 256 for _ in range(count)).hex()
        elif dimension is None:
            fields[name] = _fill(kind, numbers, length) if kind in MEMBERS else _values(kind, numbers)
        else:
            count = dimension if isinstance(dimension, int) else length
            fields[name] = [
                _fill(kind, numbers, length) if kind in MEMBERS else _values(kind, numbers) for _ in range(count)
            ]
    return fields


def message_from(type_name: str, fields: dict[str, Any]) -> Any:
    """A crux_msgs message from its fields."""
    message = getattr(crux_msgs, type_name)()
    for name, kind, dimension in MEMBERS[type_name]:
        value = fields[name]
        if kind == "byte":
            value = bytes.fromhex(value)
        elif kind in MEMBERS:
            value = [message_from(kind, item) for item in value] if dimension is not None else message_from(kind, value)
        setattr(message, name, value)
    return message


def messages() -> list[dict[str, Any]]:
    """Every type with sequences of three, and those with sequences once more with empty ones."""
    vectors = []
    for type_name, members in MEMBERS.items():
        has_sequence = any(isinstance(dimension, str) for _, _, dimension in members)
        for length in (3, 0) if has_sequence else (3,):
            fields = _fill(type_name, iter(range(10**6)), length)
            message = message_from(type_name, fields)
            vectors.append(
                {"type": type_name, "fields": fields, "lcm": message.encode().hex(), "cdr": cdr.encode(message).hex()}
            )
    return vectors


def can_frames() -> list[dict[str, Any]]:
    """Every kind of frame: zero, the ends of every signal's range, and something in between."""
    vectors = []
    for message in can_codec.database().messages:
        if not any(signal.name == "Crc" for signal in message.signals):
            continue  # a frame of ISO-TP has no layout of ours
        name, node = message.name, None
        if name.startswith("Joint"):
            name, node = f"Joint{name[6:]}", int(name[5])
        for index, share in enumerate((0.0, 1.0, 0.3)):
            values = {}
            for signal in message.signals:
                if signal.name in ("Crc", "Counter"):
                    continue
                if signal.is_float:
                    values[signal.name] = (0.0, -1.5707963705062866, 0.0010000000474974513)[index]
                    continue
                low = -(1 << (signal.length - 1)) if signal.is_signed else 0
                high = low + (1 << signal.length) - 1
                raw = 0 if index == 0 else round(low + share * (high - low))
                values[signal.name] = float(raw * signal.scale + signal.offset)
            counter = (0, 255, 87)[index]
            frame = can_codec.encode(name, values, counter, node)
            vectors.append(
                {
                    "message": name,
                    "node": node,
                    "identifier": frame.identifier,
                    "counter": counter,
                    "signals": values,
                    "data": frame.data.hex(),
                }
            )
    return vectors


def sample_plan(swings: dict[str, tuple[int, int]] | None = None, knots: int = 13, dt_s: float = 2.0) -> plan_t:
    """A plan that scaler can reach: limbs swing between the knots given (first and last in the air), one hold on by
    0.06 m; the body moves and tilts a little. Its wrenches are made up, not in equilibrium."""
    moving = {"LF": (2, 4), "RR": (8, 9)} if swings is None else swings
    plan = plan_t()
    plan.format = plan_t.FORMAT
    plan.scenario_name, plan.scenario_yaml, plan.robot_name, plan.method = "sample", "version: 1\n", "scaler", "by hand"
    plan.dt_s = dt_s
    plan.gravity_w_m_s2 = [-6.93, 0.0, -6.93]
    plan.patch_k_m, plan.max_normal_n, plan.goal_tolerance_m, plan.goal_tolerance_rad = 0.0133, 60.0, 0.01, 0.05
    corners = {"LF": (0.14, 0.36), "RF": (0.14, -0.36), "LR": (-0.14, 0.36), "RR": (-0.14, -0.36)}
    for limb, (x, y) in corners.items():
        for step in (0.0, 0.06):
            hold = crux_msgs.hold_t()
            hold.name = f"{limb}{step:g}"
            hold.graspable, hold.position_w_m, hold.size_m = 1, [x + step, y, 0.0], [0.04, 0.04, 0.05]
            hold.friction, hold.spines = [2.2] * 5, [1] * 5
            plan.holds.append(hold)
    plan.n_holds = len(plan.holds)
    for k in range(knots):
        share = k / (knots - 1)
        knot = plan_knot_t()
        knot.time_s = k * dt_s
        knot.body_position_w_m = [0.04 * share * share, 0.01 * np.sin(7 * share), 0.185 + 0.005 * np.cos(5 * share)]
        knot.body_rpy_rad = [0.02 * np.sin(4 * share), -0.03 * share, 0.02 * np.cos(9 * share) - 0.02]
        knot.limbs = [_limb_knot(i, corners[name], k, moving.get(name)) for i, name in enumerate(LIMB_NAMES)]
        plan.knots.append(knot)
    plan.n_knots = knots
    return plan


def _limb_knot(index: int, corner: tuple[float, float], k: int, swing: tuple[int, int] | None) -> limb_knot_t:
    limb = limb_knot_t()
    first, last = swing or (10**6, 10**6)
    yaw = 0.1 * (index - 1.5)
    advanced = k > last
    limb.phase = limb_knot_t.AIR if first <= k <= last else limb_knot_t.STANCE
    limb.gripper_position_w_m = [corner[0] + 0.06 * advanced, corner[1], 0.035]
    limb.gripper_yaw_w_rad = yaw + 0.2 * advanced
    limb.finger_separation_m = 0.04
    if limb.phase == limb_knot_t.AIR:
        limb.hold, limb.finger1_face = -1, limb_knot_t.FACE_NONE
        if k > first:  # at its first knot in the air the gripper still stands in its old grasp pose
            progress = (k - first) / (last + 1 - first)
            limb.gripper_position_w_m = [corner[0] + 0.06 * progress, corner[1] + 0.01, 0.09]
            limb.gripper_yaw_w_rad = yaw + 0.2 * progress
            limb.finger_separation_m = 0.09 - 0.01 * progress
        return limb
    limb.hold, limb.finger1_face, limb.friction = 2 * index + advanced, limb_knot_t.FACE_PLUS_X, 2.2
    axis = np.array([np.cos(limb.gripper_yaw_w_rad), np.sin(limb.gripper_yaw_w_rad), 0.0])
    shear = np.array([3.0 + index, -1.0 + 0.3 * k, 4.0 - 0.2 * k])
    normal = 15.0 + index + 0.5 * k
    limb.finger_force_w_n = [*(normal * axis + shear), *(-(normal - 2) * axis + shear)]
    limb.finger_moment_w_nm = [*(0.02 * (k + 1) * axis), *(0.01 * index * axis)]
    return limb


def sample_walk() -> plan_t:
    """The sample plan on point feet: LF and RR step at once, the others stand; made-up forces, five times a second."""
    plan = sample_plan({"LF": (2, 5), "RR": (2, 5), "RF": (8, 10)}, dt_s=0.2)
    plan.holds, plan.n_holds, plan.patch_k_m = [], 0, 0.0
    for k, knot in enumerate(plan.knots):
        for limb in knot.limbs:
            standing = limb.phase == limb_knot_t.STANCE
            limb.hold, limb.finger1_face = -1, limb_knot_t.FACE_WALL if standing else limb_knot_t.FACE_NONE
            limb.friction = 0.6 if standing else 0.0
            lifted = limb.gripper_position_w_m[2] > 0.05
            x, y, _ = limb.gripper_position_w_m
            limb.gripper_position_w_m = [x, y, 0.02 + 0.003 * k if lifted else 0.0]
            limb.finger_separation_m = 0.02
            force = [2.0, -1.0, 15.0 + k]
            limb.finger_force_w_n = [*force, *force] if standing else [0.0] * 6
            limb.finger_moment_w_nm = [0.0] * 6
    return plan


def walking() -> dict[str, Any]:
    """The same for point feet."""
    return interpolation(sample_walk())


def own_times(plan_format: int = plan_t.FORMAT_OWN_TIMES) -> dict[str, Any]:
    """The same for knots at times of their own."""
    plan = sample_plan()
    plan.format = plan_format
    for k, knot in enumerate(plan.knots[1:], start=1):
        knot.time_s = plan.knots[k - 1].time_s + (0.3, 1.1, 0.25, 0.7)[k % 4] * plan.dt_s
    return interpolation(plan)


def moving_fingers() -> dict[str, Any]:
    """The same for fingers that move while grippers lift and come down."""
    return own_times(plan_t.FORMAT_MOVING_FINGERS)


def tilted() -> dict[str, Any]:
    """The same for holds that are turned out of the wall's plane, each otherwise."""
    plan = sample_plan()
    for knot in plan.knots:
        for limb, grip in enumerate(knot.limbs):
            x, y, z = grip.gripper_position_w_m
            grip.gripper_tilt_w_rad = [0.1 * limb - 0.15 + 2.0 * (z - 0.035), 4.0 * x - 0.3 * y]
    return interpolation(plan)


def feet() -> dict[str, Any]:
    """The same for RR that goes from a hold to a foothold, which is turned out of the wall's plane, and LF that goes
    from one to a hold.
    """
    plan = sample_plan()
    plan.format = plan_t.FORMAT_FEET
    for place_w_m, tilt_rad in (([0.14, 0.36, 0.0], [0.0, 0.0]), ([-0.08, -0.36, 0.02], [0.2, -0.3])):
        foothold = crux_msgs.hold_t()
        foothold.name, foothold.graspable, foothold.tilt_rad = f"foothold{len(plan.holds)}", foothold.FOOTHOLD, tilt_rad
        foothold.position_w_m, foothold.size_m = place_w_m, [0.024, 0.024, 0.0]
        foothold.friction = [0.0, 0.0, 0.0, 0.0, 0.7]
        plan.holds.append(foothold)
    plan.n_holds = len(plan.holds)
    _, tilt = yaw_and_tilt(_rotation(0.2, -0.3))
    for k, knot in enumerate(plan.knots):
        left, right = knot.limbs[0], knot.limbs[3]
        if k < 2:
            _stand(left, len(plan.holds) - 2, [0.14, 0.36, 0.0], np.zeros(2))
        elif k == 2:  # the gripper's frame
            left.gripper_position_w_m = [0.14, 0.36, 0.012]
        if k in (2, 3):  # fingers rest on footholds
            left.finger_separation_m = 0.09
        if k == 9:
            right.finger_separation_m = 0.09
        if k > 9:
            _stand(right, len(plan.holds) - 1, [-0.08, -0.36, 0.02], tilt)
    return interpolation(plan)


def _rotation(roll: float, pitch: float) -> np.ndarray:
    """Ry(pitch) Rx(roll)"""
    (sr, cr), (sp, cp) = ((np.sin(angle), np.cos(angle)) for angle in (roll, pitch))
    return np.array([[cp, sp * sr, sp * cr], [0.0, cr, -sr], [-sp, cp * sr, cp * cr]])


def _stand(limb: limb_knot_t, hold: int, place_w_m: list[float], tilt_rad: np.ndarray) -> None:
    """A foot on a foothold, with a force along its normal and across it."""
    limb.hold, limb.finger1_face, limb.friction = hold, limb_knot_t.FACE_WALL, 0.7
    limb.gripper_position_w_m, limb.gripper_tilt_w_rad = place_w_m, tilt_rad.tolist()
    limb.finger_separation_m = 0.09
    turn = gripper_rotation(limb.gripper_yaw_w_rad, tilt_rad)
    limb.finger_force_w_n = np.tile(turn @ [2.0, -1.0, 14.0], 2).tolist()
    limb.finger_moment_w_nm = [0.0] * 6


def interpolation(plan: plan_t | None = None) -> dict[str, Any]:
    """A plan, LCM-encoded, and what it asks for at points (interval k, share u); limbs LF, RF, LR, RR."""
    plan = plan or sample_plan()
    reference = PlanReference(plan)
    samples = []
    for k in range(reference.intervals):
        for u in SHARES:
            own = plan.format >= plan_t.FORMAT_OWN_TIMES
            time_s = reference.time_s[k] + u * reference.step_s[k] if own else (k + u) * plan.dt_s
            position, rpy = reference.body(time_s)
            limbs = []
            for limb in range(len(LIMB_NAMES)):
                gripper = reference.limb(limb, k, u)
                limbs.append(
                    {
                        "gripper_position_w_m": _rounded(gripper.position_w_m),
                        "gripper_yaw_w_rad": _rounded(gripper.yaw_w_rad),
                        "gripper_tilt_w_rad": _rounded(gripper.tilt_w_rad),
                        "finger_opening_m": _rounded(gripper.opening_m),
                        "wrench_w": _rounded(reference.wrench(limb, k, u)),
                        "load": _rounded(reference.load(limb, k, u)),
                    }
                )
            samples.append(
                {
                    "k": k,
                    "u": u,
                    "body_position_w_m": _rounded(position),
                    "body_rpy_rad": _rounded(rpy),
                    "limbs": limbs,
                }
            )
    return {"plan_lcm": plan.encode().hex(), "samples": samples}


def transmissions() -> list[dict[str, Any]]:
    """Limbs of six joints with gears and couplings: limits that are left of 2 rad, 5 rad/s and 10 Nm, those of the
    actuators, and what actuators do as the joints do something."""
    random = np.random.default_rng(0)
    vectors = []
    for _ in range(12):
        ratio = np.where(random.random(6) < 0.5, -1, 1) * random.uniform(0.3, 3.0, 6)
        coupled = np.where(random.random(6) < 0.4, random.integers(0, np.arange(1, 7)), 0)
        keys = {
            "ratio": ratio, "offset_rad": random.uniform(-1, 1, 6), "coupled_to": coupled,
            "coupling": random.uniform(-2, 2, 6), "low_rad": random.uniform(-6, -4, 6),
            "high_rad": random.uniform(4, 6, 6), "speed_rad_s": random.uniform(2, 8, 6),
            "torque_Nm": random.uniform(2, 8, 6),
        }  # fmt: skip
        keys = {name: _rounded(values) for name, values in keys.items()}
        section = Transmissions(**{name: tuple(values) for name, values in keys.items()})
        vectors.append({"section": keys} | _told(section, None, random.uniform(-2, 2, (3, 6))))
    return vectors


def five_bars() -> list[dict[str, Any]]:
    """The same of limbs with five-bars, the ranges of whose joints are 1 rad either way."""
    random = np.random.default_rng(0)
    vectors: list[dict[str, Any]] = []
    while len(vectors) < 8:
        bar = drawn(random, int(random.integers(1, 6)))
        keys = {
            "ratio": random.choice([-1, 1], 6) * random.uniform(0.5, 2.0, 6), "offset_rad": random.uniform(-1, 1, 6),
            "coupled_to": np.zeros(6), "coupling": np.zeros(6), "low_rad": np.full(6, -6.0),
            "high_rad": np.full(6, 6.0),
            "speed_rad_s": random.uniform(2, 8, 6), "torque_Nm": random.uniform(2, 8, 6),
        }  # fmt: skip
        keys = {name: _rounded(values) for name, values in keys.items()}
        section = Transmissions(**{name: tuple(values) for name, values in keys.items()})
        does = random.uniform(-1, 1, (3, 6))
        does[0, bar.first : bar.first + 2] = bar.middle_rad + random.uniform(-0.1, 0.1, 2)
        told = _told(section, bar, does)
        if all(low < high for low, high in zip(told["left"]["low_rad"], told["left"]["high_rad"], strict=True)):
            made = {"keys": vars(bar.section), "link_m": bar.link_m, "sense": bar.sense}
            vectors.append({"section": keys, "bar": made | {"middle_rad": bar.middle_rad.tolist()}} | told)
    return vectors


def _told(section: Transmissions, bar: FiveBar | None, does: np.ndarray) -> dict[str, Any]:
    """What is left of limits, what actuators reach, and what they do as joints do (3, 6): angles, ways and torques."""
    by, own = Transmission.of(section, 6, bar), own_limits(section, 6)
    low, high = np.full(6, -2.0), np.full(6, 2.0)
    if bar is not None:
        pair = slice(bar.first, bar.first + 2)
        low[pair], high[pair] = bar.middle_rad - 1.0, bar.middle_rad + 1.0
    joints = Limits(low, high, np.full(6, 5.0), np.full(6, 10.0))
    left = by.within(joints, own)
    q, dq, torque = does
    done = {"joints_rad": q, "ways": dq, "torque_Nm": torque, "actuators_rad": by.actuators_rad(q),
            "actuator_ways": by.slope(q) @ dq, "actuators_Nm": by.actuator_torque_Nm(q, torque)}  # fmt: skip
    each = {"left": vars(left), "reached": vars(by.reached(left, joints, own)), "does": done}
    return {name: {key: _rounded(value) for key, value in values.items()} for name, values in each.items()}


def _rounded(values: Any) -> Any:
    numbers = np.asarray(values, dtype=float)
    texts = [float(f"{number:.{DIGITS}g}") for number in numbers.ravel()]
    return texts if numbers.ndim else texts[0]


VECTORS: dict[str, Callable[[], Any]] = {
    "messages.json": messages,
    "can_frames.json": can_frames,
    "interpolation.json": interpolation,
    "own_times.json": own_times,
    "moving_fingers.json": moving_fingers,
    "walking.json": walking,
    "tilted.json": tilted,
    "feet.json": feet,
    "transmissions.json": transmissions,
    "five_bars.json": five_bars,
}


def as_text(vectors: Any) -> str:
    """One vector a line, so that a change shows as a change of lines."""
    if isinstance(vectors, list):
        return "[\n" + ",\n".join(json.dumps(item, ensure_ascii=False) for item in vectors) + "\n]\n"
    lines = ",\n".join(json.dumps(item) for item in vectors["samples"])
    return f'{{"plan_lcm": "{vectors["plan_lcm"]}",\n"samples": [\n{lines}\n]}}\n'


if __name__ == "__main__":
    for file_name, make in VECTORS.items():
        (FOLDER / file_name).write_text(as_text(make()), encoding="utf-8")
