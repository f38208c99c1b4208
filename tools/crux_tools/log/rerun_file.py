"""A log as a rerun recording: the robot, its wall, forces and margins in 3-D, curves, events, and a blueprint."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from crux_contracts import LIMB_NAMES
from crux_contracts.channels import SUPERVISOR_STATES

from crux_tools.log.markers import FORCE_SCALE_M_PER_N, FORCES, HOLD_RGBA, OBSTACLE_RGBA, WALL_RGBA, used_colours
from crux_tools.log.seen import ERROR, INFO, NS, WARN, WORLD, Seen
from crux_tools.telemetry.rotations import hold_middle, hold_quaternion
from crux_tools.telemetry.summary import name_of
from crux_tools.telemetry.surfaces import box_of, wall_of

if TYPE_CHECKING:  # rerun-sdk is imported where it is asked for: nobody else needs it
    import rerun as rr
    import rerun.blueprint as rrb

APPLICATION = "crux"
TIMELINE = "log time"
UTC_TIMELINE = "utc"
LEVELS = {INFO: "INFO", WARN: "WARN", ERROR: "ERROR"}  # of rerun.TextLogLevel
JOINT_QUANTITIES = ("position", "velocity", "effort")
XYZ = ("x", "y", "z")


def blueprint() -> rrb.Blueprint:
    """The 3-D view, states and events, and under tabs margins, forces and joints, of the paths written below."""
    import rerun.blueprint as rrb

    forces = [rrb.TimeSeriesView(origin=f"/forces/{limb}", name=f"force {limb}") for limb in LIMB_NAMES]
    joints = [
        rrb.TimeSeriesView(origin=f"/joints/{quantity}/{limb}", name=f"{quantity} {limb}")
        for quantity in JOINT_QUANTITIES
        for limb in LIMB_NAMES
    ]
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Spatial3DView(
                origin="/", contents=["/robot/**", "/wall/**", "/arrows/**", "/margins_3d/**", "/tf/**"], name="climb"
            ),
            rrb.Vertical(
                rrb.Tabs(
                    rrb.TimeSeriesView(origin="/margins", name="margins [N]"),
                    rrb.TimeSeriesView(origin="/body", name="body off its reference [m]"),
                    rrb.Grid(*forces, name="forces [N]"),
                    rrb.Grid(*joints, name="joints"),
                ),
                rrb.TextLogView(origin="/events", name="events"),
                row_shares=[3, 1],
            ),
            column_shares=[3, 2],
        ),
        collapse_panels=True,
    )


def write_rerun(path: Path, seen: Seen, utc: bool) -> None:
    """Writes the recording with its blueprint. Times are seconds of the log, with `utc` the date, too."""
    import rerun as rr
    from rerun.urdf import UrdfTree

    with rr.RecordingStream(APPLICATION, recording_id=seen.log.metadata.get("started_utc")) as recording:
        recording.save(path, default_blueprint=blueprint())
        UrdfTree.from_file_path(seen.robot.urdf_path, entity_path_prefix="robot").log_urdf_to_recording(recording)
        _wall(recording, seen)
        _moments(recording, seen, utc)
        _events(recording, seen, utc)


def _times(log_ns: np.ndarray, clock_ns: np.ndarray, utc: bool) -> list[rr.TimeColumn]:
    import rerun as rr

    found = [rr.TimeColumn(TIMELINE, duration=log_ns.astype("m8[ns]"))]
    return [*found, rr.TimeColumn(UTC_TIMELINE, timestamp=clock_ns.astype("M8[ns]"))] if utc else found


def _wall(recording: rr.RecordingStream, seen: Seen) -> None:
    import rerun as rr

    for (parent, child), at in zip(seen.fixed, seen.fixed_at, strict=True):
        moved = rr.Transform3D(
            translation=at[:3], quaternion=rr.Quaternion(xyzw=at[3:]), parent_frame=parent, child_frame=child
        )
        recording.log(f"/tf/{child}", moved, static=True)
    for place in ("/wall", "/arrows", "/margins_3d"):
        recording.log(place, rr.CoordinateFrame(WORLD), static=True)
    holds = [] if seen.log.plan is None else seen.log.plan.holds
    surfaces = [] if seen.log.plan is None else [box_of(slab) for slab in wall_of(seen.log.plan).slabs]
    for kind, rgba in (("holds", HOLD_RGBA), ("obstacles", OBSTACLE_RGBA), ("surfaces", WALL_RGBA)):
        chosen = [hold for hold in holds if bool(hold.graspable) == (kind == "holds")]
        chosen = surfaces if kind == "surfaces" else chosen
        if not chosen:
            continue
        sizes = np.array([hold.size_m for hold in chosen])
        boxes = rr.Boxes3D(
            sizes=sizes,
            centers=np.array([hold_middle(hold) for hold in chosen]),
            quaternions=np.array([hold_quaternion(hold) for hold in chosen])[:, [1, 2, 3, 0]],
            colors=[rgba] * len(chosen),
            labels=[hold.name for hold in chosen],
            fill_mode="solid",
        )
        recording.log(f"/wall/{kind}", rr.CoordinateFrame(WORLD), boxes, static=True)


def _moments(recording: rr.RecordingStream, seen: Seen, utc: bool) -> None:
    import rerun as rr

    n = len(seen.rows)
    times = _times(np.round(seen.log.time_s[seen.rows] * NS).astype(np.int64), seen.times_ns, utc)

    def send(entity: str, columns: rr.ComponentColumnList) -> None:
        recording.send_columns(entity, indexes=times, columns=columns)

    for i, (parent, child) in enumerate(seen.moving):
        at = seen.moving_at[:, i]
        moved = rr.Transform3D.columns(
            translation=at[:, :3], quaternion=at[:, 3:], parent_frame=[parent] * n, child_frame=[child] * n
        )
        send(f"/tf/{child}", moved)
    grippers = seen.log.limbs["gripper_position_w_m"][seen.rows]
    for name, (kind, rgba) in FORCES.items():
        force = seen.wrench(kind)[..., :3]
        for limb, limb_name in enumerate(LIMB_NAMES):
            entity = f"/arrows/{name}/{limb_name}"
            recording.log(entity, rr.CoordinateFrame(WORLD), rr.Arrows3D.from_fields(colors=[rgba]), static=True)
            vectors = FORCE_SCALE_M_PER_N * force[:, limb]
            send(entity, rr.Arrows3D.columns(vectors=vectors, origins=grippers[:, limb]))
            for axis, letter in enumerate(XYZ):
                send(f"/forces/{limb_name}/{name}_{letter}", rr.Scalars.columns(scalars=force[:, limb, axis]))
    for limb, limb_name in enumerate(LIMB_NAMES):
        margin = seen.margin_n[:, limb]
        send(f"/margins/{limb_name}", rr.Scalars.columns(scalars=margin))
        entity = f"/margins_3d/{limb_name}"
        recording.log(entity, rr.CoordinateFrame(WORLD), rr.Points3D.from_fields(radii=[0.015]), static=True)
        colours = (255 * used_colours(seen.used[:, limb])).astype(np.uint8)
        colours[np.isnan(margin), 3] = 0
        send(entity, rr.Points3D.columns(positions=grippers[:, limb], colors=colours))
    for i, joint in enumerate(seen.joints):
        for quantity, values in zip(JOINT_QUANTITIES, seen.joint_state[:, i].T, strict=True):
            send(f"/joints/{quantity}/{seen.limb_of_joint(i)}/{joint}", rr.Scalars.columns(scalars=values))
    state = seen.log.state[seen.rows]
    off = state["body_position_w_m"] - state["body_reference_position_w_m"]
    for axis, letter in enumerate(XYZ):
        send(f"/body/{letter}", rr.Scalars.columns(scalars=off[:, axis]))
    words = [name_of(SUPERVISOR_STATES, int(number)) for number in state["supervisor_state"]]
    send("/state", rr.AnyValues.columns(supervisor_state=words))


def _events(recording: rr.RecordingStream, seen: Seen, utc: bool) -> None:
    import rerun as rr

    if not seen.events:
        return
    log_ns, clock_ns = (np.array([getattr(e, name) for e in seen.events]) for name in ("log_ns", "time_ns"))
    columns = rr.TextLog.columns(
        text=[event.text for event in seen.events], level=[LEVELS[event.level] for event in seen.events]
    )
    recording.send_columns("/events", indexes=_times(log_ns, clock_ns, utc), columns=columns)
