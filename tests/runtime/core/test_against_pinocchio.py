"""The core's kinematics and gravity torques against Pinocchio, on the same URDF."""

from __future__ import annotations

import subprocess
from pathlib import Path

import numpy as np
import pinocchio
import pytest

ROOT = Path(__file__).resolve().parents[3]
VECTORS = ROOT / "build" / "cmake" / "tests" / "runtime" / "core" / "core_vectors"
URDF = ROOT / "msgs" / "robots" / "scaler" / "scaler.urdf"
LIMBS = ("LF", "RF", "LR", "RR")
SAMPLES = 50


@pytest.mark.parametrize("limb", range(len(LIMBS)), ids=LIMBS)
def test_limb_equals_pinocchio(limb: int) -> None:
    model = pinocchio.buildModelFromUrdf(str(URDF))
    data = model.createData()
    prefix = LIMBS[limb]
    columns = [model.joints[model.getJointId(f"{prefix}_joint{j}")].idx_v for j in range(1, 7)]
    frame = model.getFrameId(f"{prefix}_gripper")
    random = np.random.default_rng(limb)
    angles = random.uniform(model.lowerPositionLimit[columns], model.upperPositionLimit[columns], (SAMPLES, 6))

    lines = "\n".join(" ".join(f"{angle:.17g}" for angle in row) for row in angles)
    answer = subprocess.run([VECTORS, "limb", str(limb)], input=lines, capture_output=True, text=True, check=True)
    printed = np.array([line.split() for line in answer.stdout.splitlines()], dtype=float)
    assert printed.shape == (SAMPLES, 3 + 9 + 36 + 6)

    for q_limb, row in zip(angles, printed, strict=True):
        q = np.zeros(model.nq)
        q[columns] = q_limb
        pinocchio.framesForwardKinematics(model, data, q)
        pose = data.oMf[frame]
        np.testing.assert_allclose(row[:3], pose.translation, atol=1e-12)
        np.testing.assert_allclose(row[3:12].reshape(3, 3), pose.rotation, atol=1e-12)
        jacobian = pinocchio.computeFrameJacobian(model, data, q, frame, pinocchio.LOCAL_WORLD_ALIGNED)
        np.testing.assert_allclose(row[12:48].reshape(6, 6), jacobian[:, columns], atol=1e-12)
        torque = pinocchio.computeGeneralizedGravity(model, data, q)
        np.testing.assert_allclose(row[48:], torque[columns], atol=1e-10)
