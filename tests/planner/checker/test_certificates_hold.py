"""No plan that `crux check` accepts costs less than a certificate says, whatever made it (`certificate_attacks`)."""

from __future__ import annotations

import copy
import itertools
import os
from collections.abc import Iterable

import numpy as np
import pytest
from certificate_attacks import ROBOT, Certified, attacked
from crux_planner.checker.certificate import BOUND, NO_PLAN, CertificateError, sealed, verify
from crux_planner.checker.no_way import NotShownError
from crux_planner.pipeline.bound_certificate import certify_bound
from walls import scenario, two_rows

PARTS = 20  # of the sweep, tests of their own, so that several processes may share it
MANY = int(os.environ.get("CRUX_CERTIFICATES", "2000"))  # of the sweep: one takes about two seconds of computing


def held(seeds: Iterable[int], many: int) -> list[Certified]:
    """So many scenes with a certificate, none of which the search has beaten."""
    drawn = (found for seed in seeds if (found := attacked(seed)) is not None)
    scenes = list(itertools.islice(drawn, many))
    for scene in scenes:
        assert scene.bound <= scene.cheapest, (scene.wall["name"], scene.steps, scene.bound, scene.cheapest)
    return scenes


def test_no_plan_beats_a_certificate() -> None:
    scenes = held((136, 139, 141), 3)  # 137, 138 and 140 have no certificate
    assert len(scenes) == 3
    assert max(scene.bound / scene.cheapest for scene in scenes) > 0.95  # else much could be wrong and not seen
    assert max(scene.accepted for scene in scenes) > 2  # plans, each cheaper than the one before


@pytest.mark.sweep
@pytest.mark.parametrize("part", range(PARTS))
def test_no_plan_beats_any_of_many_certificates(part: int) -> None:
    first = 1_000_000 * (part + 1)
    scenes = held(range(first, first + 1_000_000), MANY // PARTS)
    ratios = sorted(scene.bound / scene.cheapest for scene in scenes if scene.cheapest > 0.0)
    print(f"{len(scenes)} certificates, {ratios[len(ratios) // 2]:.3f} of the cheapest plan, at most {ratios[-1]:.4f}")
    assert len(scenes) == MANY // PARTS


def test_a_start_in_the_air_has_no_certificate() -> None:
    wall = two_rows(all_limbs=False)
    wall["start"] = copy.deepcopy(wall["start"])
    del wall["start"]["grasps"]["LF"]
    wall["start"]["air"] = {"LF": {"position_m": [0.14, 0.36, 0.08], "yaw_deg": 0.0, "opening_m": 0.04}}
    read = scenario(wall)
    with pytest.raises(NotShownError, match="limbs in the air at the start"):
        certify_bound(read, ROBOT, 20, np.inf)
    for claim, more in ((BOUND, {"steps": 20, "bound": 0.0}), (NO_PLAN, {})):
        with pytest.raises(CertificateError, match="limbs in the air at the start"):
            verify(sealed(claim, read, ROBOT, multipliers=[], **more))
