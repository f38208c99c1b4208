"""Certificates: what is shown is verified from the file alone, what is damaged or about another wall is refused."""

from __future__ import annotations

import copy
import json
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from crux_contracts.robot import load_robot
from crux_planner.checker.certificate import CertificateError, digest, read, verify
from crux_planner.checker.geometry import rotation_about_z, rotation_from_rpy, turned, turned_back
from crux_planner.checker.grips import Balance, Frame, offers
from crux_planner.checker.inverse_kinematics import solve
from crux_planner.checker.limb_model import load_model
from crux_planner.checker.limit_surface import cone_excess
from crux_planner.checker.outer import FOLLOW, Outers
from crux_planner.checker.tolerances import FORCE_N
from crux_planner.pipeline.certificates import certify_no_plan
from crux_tools.cli import main
from walls import hold, scenario, text, two_rows

ROBOT = load_robot("scaler")


def slippery_start() -> dict[str, Any]:
    """No three of the start's grips bear the robot."""
    wall = two_rows()
    wall["contact"].update(spine_shear_N=0, spine_twist_Nm=0)
    for part in wall["holds"][:4]:
        part["friction"] = 0.05
    return wall


def slippery_goal() -> dict[str, Any]:
    wall = two_rows(slope_deg=90.0)
    wall["contact"].update(spine_shear_N=0, spine_twist_Nm=0)
    for part in wall["holds"][4:]:
        part["friction"] = 0.05
    return wall


def far_goal() -> dict[str, Any]:
    wall = two_rows()
    wall["holds"] += [hold(f"top-{x}-{y}", x, y) for x in (1.86, 2.14) for y in (0.36, -0.36)]
    wall["goal"] = {"body": {"position_m": [2.0, 0.0, 0.185]}}
    return wall


@lru_cache
def certified() -> dict[str, Any]:
    document = certify_no_plan(scenario(slippery_start()), ROBOT)
    assert document is not None
    return document


def refused(document: dict[str, Any], match: str) -> None:
    with pytest.raises(CertificateError, match=match):
        verify({**document, "sha256": digest(document)})


@pytest.mark.parametrize("wall", [slippery_start, slippery_goal, far_goal])
def test_what_the_planner_proves_is_verified_from_the_file_alone(wall: Any) -> None:
    document = certify_no_plan(scenario(wall()), ROBOT)
    assert document is not None
    read_again = json.loads(json.dumps(document))
    assert "no plan" in verify(read_again)[1]
    if wall is far_goal:  # out of reach: what grips bear does not matter
        return
    for entry in read_again["multipliers"]:
        entry["of"] = []
    refused(read_again, "does not show its claim: nothing shown keeps the limbs from")


def test_a_wall_that_is_climbed_has_no_certificate() -> None:
    assert certify_no_plan(scenario(two_rows()), ROBOT, limit_s=3.0) is None


@pytest.mark.parametrize("which", [0, -1])
def test_other_multipliers_show_nothing(which: int) -> None:
    """Each three of the start's four grips must be shown to bear too little."""
    document = copy.deepcopy(certified())
    entry = document["multipliers"][which]
    entry["of"] = (-np.array(entry["of"])).tolist()
    refused(document, "does not show its claim")


def test_another_wall_robot_or_claim_is_refused() -> None:
    wall = slippery_start()
    for part in wall["holds"]:
        part["friction"] = 2.2
    refused({**certified(), "scenario_yaml": text(wall)}, "does not show its claim")
    refused({**certified(), "robot_sha256": "0" * 64}, "another scaler")
    refused({**certified(), "robot": "spider"}, "expected one of")
    refused({**certified(), "claim": "a plan"}, "expected 'no plan'")
    refused({**certified(), "multipliers": [{"grips": [["none", "x"]], "of": []}]}, "no such grips")
    refused({**certified(), "multipliers": [{"grips": [["LF-low", "x"]], "of": [[1.0, 2.0]]}]}, "six numbers")
    refused({key: value for key, value in certified().items() if key != "multipliers"}, "not of the form")


def test_a_damaged_file_is_refused_by_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, whole = tmp_path / "proof.json", json.dumps(certified())
    path.write_text(whole)
    assert main(["check", str(path)]) == 0
    assert "shown: no plan" in capsys.readouterr().out
    other = tmp_path / "other.yaml"
    other.write_text(text(two_rows()))
    assert main(["check", str(path), "--scenario", str(other)]) == 1
    assert "about another scenario" in capsys.readouterr().err
    for damaged in (whole[: len(whole) // 2], whole.replace("0.05", "0.06", 1), '{"crux_certificate": 2}'):
        path.write_text(damaged)
        with pytest.raises(CertificateError):
            read(path)
        assert main(["check", str(path)]) == 1
        assert "refused" in capsys.readouterr().err


def test_a_proof_is_written_by_the_planner(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    wall, proof = tmp_path / "wall.yaml", tmp_path / "proof.json"
    wall.write_text(text({**two_rows(), "goal": {"body": {"position_m": [2.0, 0.0, 0.185]}}}))
    assert main(["plan", str(wall), "-o", str(tmp_path / "p.mcap"), "--certificate", str(proof)]) == 1
    assert "certificate that crux check accepts no plan" in capsys.readouterr().err
    assert main(["check", str(proof), "--scenario", str(wall)]) == 0


def test_a_proof_without_a_problem_has_no_certificate(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    wall, proof = tmp_path / "wall.yaml", tmp_path / "proof.json"
    wall.write_text(text({**two_rows(), "goal": {"body": {"position_m": [0.3, 0.0, 0.9]}}}))
    assert main(["plan", str(wall), "-o", str(tmp_path / "p.mcap"), "--certificate", str(proof)]) == 1
    said = capsys.readouterr().err
    assert "proven infeasible" in said
    assert "no certificate for this kind of proof" in said
    assert not proof.exists()


def test_every_posture_of_the_robot_is_within_the_outer_bounds() -> None:
    """Grippers upright at random, by numeric inverse kinematics: reach for the sole, and the true centre of mass."""
    random, model, tilt, many = np.random.default_rng(3), load_model(ROBOT), ROBOT.body.max_tilt_rad, 3000
    outer, yaw = Outers(ROBOT).within(tilt), 0.4
    frame = Frame.of(outer, yaw, 0.05)
    rpy = random.choice([-1.0, 0.0, 1.0], (many, 3)) * [tilt, tilt, 0.05] + [0.0, 0.0, yaw]
    height = random.uniform(*ROBOT.body.height_m, many)
    turn, heading, states, found, wrists = (
        rotation_from_rpy(rpy),
        rotation_about_z(rpy[:, 2]),
        [],
        np.ones(many, bool),
        [],
    )
    for limb, (low, high) in zip(model.limbs, outer.hold_m, strict=True):
        place = random.uniform(low * 1.1, high * 1.1, (many, 3))
        place[:, 2] = random.uniform(*ROBOT.grasp.pad_height_m, many) - height
        gripper = turned(heading, place)
        upright = rotation_about_z(random.uniform(-1.7, 1.7, many) + rpy[:, 2])
        (got,) = solve([limb], [turned_back(turn, gripper)], [np.einsum("nji,njk->nik", turn, upright)])
        inside = ((got.q_rad >= limb.lower_rad) & (got.q_rad <= limb.upper_rad)).all(axis=1)
        found &= inside & (got.position_error_m < 1e-6) & (got.rotation_error_rad < 1e-6)
        states.append(limb.forward(got.q_rad, np.full(many, 0.03)))
        wrists.append(place + np.array([0.0, 0.0, outer.above_m]))
    assert found.sum() > 20
    off = np.array(wrists)[:, found]
    least = (off - outer.hold_m[:, None, 1]).max(axis=0)[:, :2]  # the tilt's shift that all limbs share
    most = (off - outer.hold_m[:, None, 0]).min(axis=0)[:, :2]
    assert (np.maximum(least, -outer.sole_m) <= np.minimum(most, outer.sole_m)).all()
    centre = turned(turn, model.centre_of_mass(states))[found]
    low, high = frame.rest((0, 1, 2, 3)) + 0.0
    rest = centre - FOLLOW * turned(heading[found], off.sum(axis=0))
    assert ((rest >= low) & (rest <= high)).all()
    assert (np.abs(rest).max(axis=0) > 0.2 * np.maximum(np.abs(low), high)).any()


def test_what_the_check_forgives_fingers_in_the_air_is_kept_back() -> None:
    """One grip that bears the weight but for that, and for what balance and the largest acceleration leave."""
    read_wall = scenario(two_rows(slope_deg=0.0))
    outer, found, body = Outers(ROBOT).within(0.2), offers(read_wall, ROBOT), ROBOT.body
    balance, place = Balance(read_wall, ROBOT, outer, found), np.array([0.0, 0.0, 0.185])
    up, box, frame = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0]), np.array([place, place]), Frame.of(outer, 0.0, 0.05)
    needed = outer.mass_kg * (9.81 - 2 * body.max_speed_m_s / read_wall.horizon.dt_s * 3**0.5)
    forgiven = (6 + 3**0.5) * FORCE_N
    assert not balance.refuted(needed - forgiven, (0,), up, box, frame)
    assert balance.refuted(needed - 3 * forgiven, (0,), up, box, frame)


def test_what_the_check_forgives_a_grip_is_kept_back() -> None:
    """Along the normals and along the faces, where what a grip adds at most is what it bears."""
    read_wall = scenario(two_rows())
    found, most_N = offers(read_wall, ROBOT), read_wall.contact.max_normal_N
    balance, offer = Balance(read_wall, ROBOT, Outers(ROBOT).within(0.2), found), found[0]
    pushed, lifted = np.append(offer.axis, np.zeros(3)), np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    assert balance.most(offer, pushed) >= most_N + FORCE_N - -FORCE_N  # one finger presses, the other one pulls
    bears = offer.friction.min() * (most_N + FORCE_N) + read_wall.contact.spine_shear_N + FORCE_N
    assert balance.most(offer, lifted) >= 2 * bears


def test_no_wrench_within_the_limit_surface_adds_more_than_a_grips_most() -> None:
    wall = slippery_start()
    wall["contact"].update(spine_shear_N=5, spine_twist_Nm=0.05)
    wall["holds"][0].update(friction={"+x": 0.3, "-x": 1.5, "+y": 1.0, "-y": 0.0, "top": 1}, spines={"-x": False})
    read_wall = scenario(wall)
    outer, found, random = Outers(ROBOT).within(0.2), offers(read_wall, ROBOT), np.random.default_rng(2)
    balance, k_m, tight = Balance(read_wall, ROBOT, outer, found), read_wall.contact.patch_k_m, 0.0
    for offer in found[:2]:
        for _ in range(300):
            multipliers = random.normal(size=6) * [1, 1, 1, 3, 3, 3]
            normal, way = random.uniform(0, 60, 2) * random.integers(0, 2, 2), random.normal(size=3)
            low, high = 0.0, 200.0
            for _ in range(40):  # the longest load along a way that both fingers bear
                size = (low + high) / 2
                load = size * way / np.linalg.norm(way)
                over = [
                    cone_excess(
                        load[:2], load[2] * k_m, normal[f], friction=offer.friction[f], patch_k_m=k_m,
                        spine_shear_N=offer.spines[f, 0], spine_twist_Nm=offer.spines[f, 2] * k_m,
                    ) for f in (0, 1)
                ]  # fmt: skip
                low, high = (size, high) if max(over) <= 0.0 else (low, size)
            load = low * way / np.linalg.norm(way)
            shares = random.dirichlet(np.ones(4))
            centre = shares @ offer.corners_w_m
            force = (normal[0] - normal[1]) * offer.axis + 2 * load[0] * offer.tangent + [0.0, 0.0, 2 * load[1]]
            moment = np.cross(centre, force) + 2 * load[2] * k_m * offer.axis
            wrist = centre + np.array([0.0, 0.0, outer.above_m])
            added = multipliers @ [*force, *moment] - FOLLOW * wrist @ balance.slope(multipliers)
            most = balance.most(offer, multipliers)
            assert added <= most + 1e-6
            tight = max(tight, float(added / most)) if most > 0 else tight
    assert tight > 0.5
