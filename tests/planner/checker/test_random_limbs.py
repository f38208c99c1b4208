"""Chains of four to seven joints, offset and tilted in any way, against Pinocchio, and there and back."""

import numpy as np
import pinocchio
import pytest
from crux_planner.checker.inverse_kinematics import arm_of, solve
from crux_planner.checker.limb_model import Limb, read_model
from hypothesis import given, settings
from hypothesis import strategies as st
from random_limbs import FAMILIES, urdf

LIMBS = st.tuples(st.sampled_from(FAMILIES), st.integers(4, 7), st.integers(0, 10**9))


def check_limb(kind: tuple[str, int, int]) -> None:
    text = urdf(*kind)
    names = tuple(f"j{i + 1}" for i in range(kind[1]))
    (limb,) = read_model(text.encode(), "base", (("LF", "tip", names, ()),)).limbs
    low, high = arm_of(limb)[0].lower_rad, arm_of(limb)[0].upper_rad
    q_rad = np.random.default_rng(kind[2]).uniform(low + 0.05, high - 0.05, (3, kind[1]))
    q_rad -= (q_rad - (low + high) / 2) @ spare_motion(limb)
    places, turns = check_forward(limb, text, q_rad)
    for i in range(len(q_rad)):
        (found,) = solve([limb], [places[i : i + 1]], [turns[i : i + 1]])
        assert found.position_error_m[0] < 1e-6
        assert found.rotation_error_rad[0] < 1e-6
        state = limb.forward(found.q_rad)
        assert state.link_position_m["tip"][0] == pytest.approx(places[i], abs=1e-6)


def spare_motion(limb: Limb) -> np.ndarray:
    """(J, J) that leaves of angles what moves the tip of a limb of seven joints nowhere, in the middle of their ranges;
    of other limbs 0.
    """
    arm, _ = arm_of(limb)
    count = len(arm.lower_rad)
    slopes = arm.forward((arm.lower_rad + arm.upper_rad)[None] / 2)[2][0]
    return np.eye(count) - np.linalg.pinv(slopes) @ slopes if count > 6 else np.zeros((count, count))


def check_forward(limb: Limb, text: str, q_rad: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Places and turns of the tip, and the Jacobian, as Pinocchio has them."""
    model = pinocchio.buildModelFromXML(text)
    data, tip = model.createData(), model.getFrameId("tip")
    state = limb.forward(q_rad)
    places, turns = state.link_position_m["tip"], state.link_rotation["tip"]
    arm, mounting = arm_of(limb)
    in_arm = arm.forward(q_rad)[2].reshape(-1, 2, 3, len(limb.joints))
    slopes = (mounting.rotation_b @ in_arm).reshape(len(q_rad), 6, -1)
    for i, angles in enumerate(q_rad):
        q = pinocchio.neutral(model)
        for name, angle in zip((joint.name for joint in limb.joints), angles, strict=True):
            joint = model.joints[model.getJointId(name)]
            q[joint.idx_q : joint.idx_q + joint.nq] = [angle] if joint.nq == 1 else [np.cos(angle), np.sin(angle)]
        pinocchio.computeJointJacobians(model, data, q)
        pinocchio.updateFramePlacements(model, data)
        assert places[i] == pytest.approx(data.oMf[tip].translation, abs=1e-12)
        assert turns[i] == pytest.approx(data.oMf[tip].rotation, abs=1e-12)
        expected = pinocchio.getFrameJacobian(model, data, tip, pinocchio.ReferenceFrame.LOCAL_WORLD_ALIGNED)
        assert slopes[i] == pytest.approx(expected, abs=1e-12)
    return places, turns


@settings(max_examples=20)
@given(kind=LIMBS)
def test_some_limbs_are_as_pinocchio_has_them_and_find_their_way_back(kind: tuple[str, int, int]) -> None:
    check_limb(kind)


@pytest.mark.sweep
@pytest.mark.parametrize("family", FAMILIES)
def test_limbs_of_every_family_are_and_do(family: str) -> None:
    for seed in range(50):
        check_limb((family, 4 + seed % 4, seed))
