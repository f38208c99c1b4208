"""What a runtime says of its climb, its limbs, its fault and its nodes, in words and as JSON."""

from __future__ import annotations

import time
from typing import Any

from crux_contracts import LIMB_NAMES, can_codec
from crux_contracts.channels import FAULT_BY_CODE
from crux_contracts.robot_bounds import JOINTS, MOST_JOINTS
from crux_contracts.terminal import in_a_line
from crux_msgs import acknowledgement_t, fault_t, robot_state_t, status_t
from crux_msgs.tables import FAULT_HELP

from crux_tools.telemetry.summary import MOTION_NAMES, PHASE_NAMES, STANCE, WAIT_NAMES, name_of

GRIPPING = (0, 1, 7)  # limb_reference_t.phase: stance, unload, load
NODE_WORDS = {
    status_t.SILENT: ("silent", "look at power and cables"),
    status_t.UNIDENTIFIED: (
        "not identified yet",
        "asked for its identity; firmware without this protocol never answers",
    ),
    status_t.WRONG_PROTOCOL: ("other CAN protocol", "update its firmware"),
    status_t.WRONG_PLACE: ("in another limb's place", "cables of two limbs are swapped"),
    status_t.WRONG_ROBOT: ("made for another robot description", "update its firmware, or start with its --robot"),
}


def role_of(node: int) -> str:
    """What a node of a limb's bus moves."""
    return "gripper" if node == can_codec.GRIPPER_NODE else f"joint {can_codec.JOINT_NODES.index(node) + 1}"


def fault_of(status: status_t | None) -> dict[str, Any] | None:
    """The fault that stands: code, name, place, text, since when, cause and what to do; None where there is none."""
    if status is None or status.fault.code == 0:
        return None
    return _in_words(status.fault, status.fault_age_s)


def faults_of(status: status_t | None) -> list[dict[str, Any]]:
    """All faults that stand, each as fault_of: the one that led first, then the gravest, the older first of equals."""
    if status is None or (first := fault_of(status)) is None:
        return []
    beside = zip(status.beside, status.beside_age_s, strict=True)
    return [first, *(_in_words(fault, age_s) for fault, age_s in beside)]


def _in_words(fault: fault_t, age_s: float) -> dict[str, Any]:
    kind = FAULT_BY_CODE.get(fault.code)
    limb = LIMB_NAMES[fault.limb] if 0 <= fault.limb < len(LIMB_NAMES) else None
    role = role_of(fault.node) if fault.node else None
    where = "" if limb is None else f"{limb} node {fault.node} ({role}): " if role else f"{limb}: "
    cause, remedy = FAULT_HELP.get(
        fault.code, ("the runtime is newer than this command", "use the crux of its version")
    )
    return {
        "code": fault.code,
        "name": kind.name if kind else "unknown",
        "limb": limb,
        "node": fault.node or None,
        "role": role,
        "where": where,
        "text": kind.describe(fault.value, fault.limit) if kind else "a fault this version does not know",
        "age_s": age_s,
        "since": time.strftime("%Y-%m-%dT%H:%M:%S%z", time.localtime(time.time() - age_s)),
        "cause": cause,
        "do": remedy,
    }


def is_only_told(fault: dict[str, Any]) -> bool:
    """A fault_of() for whose sake no robot stops."""
    kind = FAULT_BY_CODE.get(fault["code"])
    return kind is not None and kind.to == "CLIMBING"


def hanging(status: status_t) -> str:
    """Which limbs grip and which are in the air, and where."""
    grips = [name for name, limb in zip(LIMB_NAMES, status.reference, strict=True) if limb.phase in GRIPPING]
    told = [f"hanging on {' '.join(grips)}"] if grips else []
    for name, reference, telemetry in zip(LIMB_NAMES, status.reference, status.telemetry, strict=True):
        if reference.phase not in GRIPPING:
            x, y, z = telemetry.gripper_position_w_m
            told.append(f"{name} in the air at ({x:.3f}, {y:.3f}, {z:.3f}) m")
    return ", ".join(told)


def _nodes(status: status_t) -> dict[int, list[str]]:
    """Names of the nodes that are not well, by what is wrong with them."""
    wrong: dict[int, list[str]] = {}
    for index, state in enumerate(status.node_state):
        if state != status_t.WELL:
            wrong.setdefault(state, []).append(f"{LIMB_NAMES[index // can_codec.NODES]}.{index % can_codec.NODES + 1}")
    return wrong


def climb_of(status: status_t | None) -> dict[str, Any]:
    """Place in the plan, speed, what the clock waits for, and every limb; numbers are None before the first cycle."""
    if status is None or status.state.cycle == 0:
        names = ("plan_time_s", "plan_end_s", "verified_time_s", "speed_scale", "motion", "waiting_for", "waiting_limb")
        return dict.fromkeys((*names, "limbs"))
    state = status.state
    return {
        "plan_time_s": state.plan_time_s,
        "plan_end_s": state.plan_end_s,
        "verified_time_s": state.verified_time_s if state.verified_time_s >= 0 else None,
        "speed_scale": state.speed_scale,
        "motion": name_of(MOTION_NAMES, state.motion),
        "waiting_for": name_of(WAIT_NAMES, state.waiting_for) if state.waiting_for else None,
        "waiting_limb": name_of(LIMB_NAMES, state.waiting_limb) if state.waiting_limb >= 0 else None,
        "limbs": {
            limb: {
                "phase": name_of(PHASE_NAMES, reference.phase),
                "grasp_force_N": telemetry.grasp_force_n,
                "grasp_force_reference_N": telemetry.grasp_force_reference_n,
                "utilisation": telemetry.utilisation,
                "borne_friction": telemetry.borne_friction,
                "slip_friction": telemetry.slip_friction or None,
                "compliance_m_N": telemetry.compliance_m_n or None,
            }
            for limb, reference, telemetry in zip(LIMB_NAMES, status.reference, status.telemetry, strict=True)
        },
    }


def status_json(answer: acknowledgement_t, status: status_t | None) -> dict[str, Any]:
    """What `crux status --json` prints."""
    from crux_tools.operator_link import STATES

    return {
        "ok": True,
        "state": STATES.get(answer.supervisor_state, str(answer.supervisor_state)),
        "plan_id": answer.plan_id,
        **climb_of(status),
        "fault": fault_of(status),
        "faults": faults_of(status),
        "joint_dead_time_s": dead_times_of(status),
        "insecure": None if status is None else bool(status.insecure),
        "operator": None if status is None else status.lease_holder or None,
        "nodes": None if status is None else {NODE_WORDS[state][0]: names for state, names in _nodes(status).items()},
    }


def _phase(status: status_t, phase: str) -> str:
    """Before control has taken over the runtime knows only whether fingers press."""
    if status.state.supervisor_state == robot_state_t.IDLE:
        return f"{'grips' if phase == PHASE_NAMES[STANCE] else 'in the air':<10}"
    return f"{phase:<7}"


def dead_times_of(status: status_t | None) -> dict[str, float | None] | None:
    """By joint, how late its drive answered when control took over; None before that, and of a joint that did not."""
    if status is None or status.state.cycle == 0 or all(dead_s < 0 for dead_s in status.joint_dead_time_s):
        return None
    joints = [f"{limb}.{joint}" for limb in LIMB_NAMES for joint in range(1, MOST_JOINTS + 1)]
    told = dict(zip(joints, status.joint_dead_time_s, strict=True))
    # Of robots with fewer joints a limb nobody knows seventh ones.
    slots = range(1, (JOINTS if all(told[f"{limb}.{MOST_JOINTS}"] < 0 for limb in LIMB_NAMES) else MOST_JOINTS) + 1)
    known = {f"{limb}.{joint}": told[f"{limb}.{joint}"] for limb in LIMB_NAMES for joint in slots}
    return {joint: dead_s if dead_s >= 0 else None for joint, dead_s in known.items()}


def _climb_lines(status: status_t) -> list[str]:
    """Place in the plan, and a line a limb: nothing before the first cycle."""
    climb = climb_of(status)
    if climb["limbs"] is None:
        return []
    place = f"plan time {climb['plan_time_s']:.2f} of {climb['plan_end_s']:.2f} s, speed {climb['speed_scale']:g}"
    place += "" if climb["motion"] == MOTION_NAMES[0] else f", {climb['motion']}"
    if climb["verified_time_s"] is not None:
        place += f"; last verified stance at {climb['verified_time_s']:.2f} s"
    if climb["waiting_for"] is not None:
        place += f"; waits for {climb['waiting_limb'] or 'all limbs'} to {climb['waiting_for']}"
    limbs = [
        f"  {name} {_phase(status, limb['phase'])} grip {limb['grasp_force_N']:4.1f} of "
        f"{limb['grasp_force_reference_N']:4.1f} N, {limb['utilisation']:4.0%} of the limit surface"
        + ("" if limb["slip_friction"] is None else f", slipped at friction {limb['slip_friction']:.2f}")
        for name, limb in climb["limbs"].items()
    ]
    return [place, *limbs]


def status_lines(status: status_t | None) -> list[str]:
    """What `crux status` prints below the state."""
    if status is None:
        return ["no node or fault status: older crux version, or message lost"]
    lines = ["INSECURE: whoever reaches LCM commands it; for tests and simulations"] if status.insecure else []
    if status.lease_holder:
        lines.append(f"{in_a_line(status.lease_holder)} commands it, for {status.lease_s:.0f} s more")
    lines += _climb_lines(status)
    late_s = {joint: dead_s for joint, dead_s in (dead_times_of(status) or {}).items() if dead_s}
    if late_s:
        latest = max(late_s, key=late_s.__getitem__)
        lines.append(f"drives of {len(late_s)} joints answer late, {latest} by {late_s[latest] * 1e3:.0f} ms")
    for fault in faults_of(status):
        lines.append(f"fault {fault['code']} {fault['name']}: {fault['where']}{fault['text']}")
        lines.append(f"  since {fault['since']}, {fault['age_s']:.0f} s ago")
        if fault["name"] == "restarted":
            lines.append(f"  found {hanging(status)}")
        lines.append(f"  cause: {fault['cause']}")
        lines.append(f"  do: {fault['do']}")
    for state, names in _nodes(status).items():
        word, remedy = NODE_WORDS[state]
        which = ", ".join(f"{name} {role_of(int(name[-1]))}" for name in names)
        robots = (can_codec.GRIPPER_NODE, can_codec.NODES)  # nodes a limb, with six joints and with seven
        which = "all" if len(names) in {len(LIMB_NAMES) * nodes for nodes in robots} else which
        lines.append(f"{len(names)} nodes {word} ({which}): {remedy}")
    return lines
