"""What happened in physics, and the judge's verdict, as messages on the channels /truth/… of the climb's log."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from crux_contracts import cdr
from crux_contracts.channels import BY_TOPIC, SCHEMAS
from crux_msgs import truth_contacts_t, truth_verdict_t
from crux_tools.telemetry.append import Series, append
from crux_tools.telemetry.cdr_table import LITTLE_ENDIAN_HEADER, fixed_dtype
from crux_tools.telemetry.channels import REPLANS, WORLD
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from crux_simulation.sim.recorder import Truth

BODY, CONTACTS, VERDICT = "/truth/body", "/truth/contacts", "/truth/verdict"


def log_truth(
    log: Path,
    truth: Truth,
    face_hold: NDArray[np.int64],
    dt_s: float,
    verdict: truth_verdict_t,
    world: str,
    replans: str = "",
) -> None:
    """Adds all samples and the verdict to a log whose runtime has ended, and the `world` as its file would have it and
    the `replans` as JSON, where there are any. `face_hold` (n faces,): RobotModel's.

    Raises OSError or ValueError as telemetry.append does; the log is then as it was.
    """
    times_ns = [round(cycle * dt_s * 1e9) for cycle in truth.cycle]
    body: dict[str, NDArray[np.generic]] = {
        "position_w_m": truth.body_position_m,
        "quaternion_w": truth.body_quaternion,
        "link_contact_force_n": truth.link_contact_force_n,
        "climbing": truth.climbing,
    }
    hold = np.where(face_hold < 0, truth_contacts_t.WALL, face_hold)[truth.pad_face]
    contacts = {
        "gripper_position_w_m": truth.gripper_position_m,
        "gripper_quaternion_w": np.roll(Rotation.from_matrix(truth.gripper_rotation.reshape(-1, 3, 3)).as_quat(), 1, 1),
        "hand_force_g_n": truth.hand_wrench_g[:, :, :3],
        "hand_moment_g_nm": truth.hand_wrench_g[:, :, 3:],
        "pad_position_w_m": truth.pad_position_m,
        "pad_normal_force_n": truth.pad_force_n,
        "pad_hold": np.where(truth.pad_face < 0, truth_contacts_t.NOTHING, hold),
    }
    append(
        log,
        [
            Series(BODY, times_ns, _messages(BODY, truth, body)),
            Series(CONTACTS, times_ns, _messages(CONTACTS, truth, contacts)),
            Series(VERDICT, times_ns[-1:], [cdr.encode(verdict)]),
        ],
        ({"crux_world": {WORLD: world}} if world else {}) | ({"crux_replans": {REPLANS: replans}} if replans else {}),
    )


def _messages(topic: str, truth: Truth, fields: dict[str, NDArray[np.generic]]) -> list[bytes]:
    """CDR of the channel's messages, one a sample; fields (n, …) in the order of the message's arrays."""
    dtype = fixed_dtype(SCHEMAS[BY_TOPIC[topic].type].definition)
    assert dtype is not None
    count = len(truth.cycle)
    table = np.zeros(count, dtype)
    bytes_of = table.view(np.uint8).reshape(count, dtype.itemsize)
    bytes_of[:, : len(LITTLE_ENDIAN_HEADER)] = np.frombuffer(LITTLE_ENDIAN_HEADER, np.uint8)
    table["cycle"] = truth.cycle
    for name, values in fields.items():
        table[name] = values.reshape(table[name].shape)
    return [row.tobytes() for row in bytes_of]
