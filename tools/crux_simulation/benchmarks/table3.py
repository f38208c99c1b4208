"""`crux bench table3`: slips of a finger whose normal force was planned with and without the patch constraint (2)."""

from __future__ import annotations

import argparse
from functools import partial

import numpy as np
from crux_contracts.robot import load_robot
from crux_planner.method_report import least_normal_N
from crux_tools.arguments import whole
from crux_tools.output import note, print_json

SHEAR_N, TWISTS_NM = 9.0, (0.0, 0.3, 0.6)
FRICTION, PATCH_K_M, MAX_NORMAL_N = 2.2, 2 / 3 * 0.02, 60.0  # of the paper's climbs
FRICTION_SIGMA = 0.1  # of the face's friction, against the planner's
WITH_MOST = 1 / 20  # slips with the constraint
WITHOUT_LEAST = (1 / 5, 1.0, 1.0)  # without it, a twist


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `crux bench table3`."""
    parser.add_argument("--count", type=whole(1), default=20, metavar="N", help="trials a load (default: %(default)s)")
    parser.add_argument("--seed", type=whole(0), default=1, metavar="N", help="of the friction (default: %(default)s)")


def planned_N(shear_N: float, twist_Nm: float, with_patch: bool) -> float:
    """The least normal force [N] that the planner's rows of the limit surface allow a finger with this load.

    Without the patch constraint the finger is a point: Coulomb's |s| <= mu n, which leaves no room for its errors.
    """
    if with_patch:
        return least_normal_N(shear_N, twist_Nm, FRICTION, PATCH_K_M, MAX_NORMAL_N)
    return shear_N / FRICTION


def slips(normal_N: float, twist_Nm: float, frictions: list[float]) -> int:
    """Of one trial on each of the faces."""
    from crux_simulation.sim.pad_rig import box_face, pad_on_face, slips_within

    radius_m = load_robot("scaler").gripper.pad_radius_m
    count = 0
    for friction in frictions:
        model = pad_on_face(partial(box_face, friction=friction), [0.03 + radius_m, 0.0, 0.0], radius_m, PATCH_K_M)
        count += slips_within(model, normal_N, SHEAR_N, twist_Nm)
    return count


def run(options: argparse.Namespace) -> int:
    """Exit status 0 when the constraint keeps all but one in twenty from slipping, and its lack does not."""
    random = np.random.default_rng(options.seed)
    frictions = (FRICTION * (1.0 + FRICTION_SIGMA * random.standard_normal(options.count))).tolist()
    table = {}
    for with_patch in (True, False):
        for twist_Nm in TWISTS_NM:
            normal_N = planned_N(SHEAR_N, twist_Nm, with_patch)
            table[with_patch, twist_Nm] = (normal_N, slips(normal_N, twist_Nm, frictions) / options.count)
    ok = all(table[True, twist_Nm][1] <= WITH_MOST for twist_Nm in TWISTS_NM) and all(
        table[False, twist_Nm][1] >= least for twist_Nm, least in zip(TWISTS_NM, WITHOUT_LEAST, strict=True)
    )
    lines = [
        {"patch": with_patch, "twist_Nm": twist_Nm, "normal_N": normal_N, "slipped": round(share * options.count)}
        for (with_patch, twist_Nm), (normal_N, share) in table.items()
    ]
    if options.json:
        print_json({"ok": ok, "count": options.count, "shear_N": SHEAR_N, "trials": lines})
        return 0 if ok else 1
    note(f"shear {SHEAR_N:g} N, friction {FRICTION:g} ± {FRICTION * FRICTION_SIGMA:.2f} (σ)")
    for line in lines:
        note(
            f"{'with' if line['patch'] else 'without'} the patch constraint, twist {line['twist_Nm']:.1f} N m: "
            f"{line['normal_N']:5.2f} N, {line['slipped']} of {options.count} slip"
        )
    return 0 if ok else 1
