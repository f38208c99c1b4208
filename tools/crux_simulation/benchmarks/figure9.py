"""`crux bench fig9`: planned and measured wrench of a climb, with fixed and with calibrated gains of the admittance, on
holds that give more or less, and with gains that are wrong by a factor of four."""

from __future__ import annotations

import argparse
import math
import os
import shutil
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass, replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from crux_contracts.plan_file import plan_id, read_plan
from crux_contracts.robot import Robot, RobotError, load_robot
from crux_msgs import plan_t
from crux_tools.errors import UsageError
from crux_tools.output import note, print_json, progress
from numpy.typing import NDArray

from crux_simulation.benchmarks.cold_process import planned_scene
from crux_simulation.sim.judge import CLIMBING, FULL_LOAD, STANCE

SCENE = "climb-four-holds"
STIFFNESSES_N_m = (2e4, 5e4, 1e5, 2e5, math.inf)  # of each hold; below, planned grasps give way by more than is allowed
WRONG = 4.0
FACTORS = (1.0, WRONG, 1.0 / WRONG)
GAINS = ("mass_kg", "damping_Ns_m", "stiffness_N_m", "inertia_kg_m2", "rotational_damping_Nms_rad",
         "rotational_stiffness_Nm_rad")  # fmt: skip
COUNT = 2  # climbs of each: a pad that slips or catches is worth more than gains that are right
NO_WORSE = 1.02  # of the RMS with the same gains fixed: two climbs are never quite the same
BETTER = 0.7  # of the RMS with gains that are wrong

Floats = NDArray[np.float64]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `crux bench fig9`."""
    parser.add_argument(
        "--stiffnesses", nargs="+", type=float, default=list(STIFFNESSES_N_m), metavar="N/m",
        help="of what fixes each hold to the wall; inf for rock (default: %(default)s)",
    )  # fmt: skip
    parser.add_argument(
        "--count", type=int, default=COUNT, metavar="N",
        help="climbs of each kind, with seeds 0, 1, … (default: %(default)s); two at a time on two cores, and so on",
    )  # fmt: skip
    parser.add_argument(
        "--output", type=Path, default=Path("out/bench-fig9"), metavar="DIR", help="for plan, logs and picture"
    )


@dataclass(frozen=True)
class Climb:
    """One climb of the sweep. RMS of the measured wrench less the planned one, of limbs under their whole load."""

    stiffness_N_m: float
    factor: float
    """of the gains, on those of the description"""
    calibrated: bool
    seed: int = 0
    ok: bool = False
    refused: str = ""
    """why the runtime does not take the gains"""
    reason: str = ""
    force_N: float = math.nan
    moment_Nm: float = math.nan
    wrench_N: float = math.nan
    """both, moments over the arm that the controller weighs them by"""
    true_force_N: float | None = None
    """the contact's own force, not the sensor's, less the planned one"""
    damping_Ns_m: float = math.nan
    """at the end"""
    rotational_damping_Nms_rad: float = math.nan


def write_robot_with(robot: Robot, factor: float, folder: Path) -> None:
    """A copy of the description in `folder` with all gains of the admittance times `factor`."""
    folder.mkdir(parents=True, exist_ok=True)
    shutil.copy(robot.urdf_path, folder)
    text = yaml.safe_load((robot.folder / "robot.yaml").read_text(encoding="utf-8"))
    for name in GAINS:
        text["admittance"][name] *= factor
    (folder / "robot.yaml").write_text(yaml.safe_dump(text), encoding="utf-8")


def loaded_limbs(log: Any) -> NDArray[np.bool_]:
    """(n, 4): rows of a telemetry.Telemetry, and limbs, in stance under their whole load while the robot climbs."""
    climbs = log.limbs_fresh & (log.state["supervisor_state"] == CLIMBING)
    loaded = (log.references["phase"] == STANCE) & (log.references["load"] > FULL_LOAD)
    return np.asarray(climbs[:, None] & loaded)


def wrench_rms(log: Any, arm_m: float) -> tuple[float, float, float]:
    """RMS of force [N], moment [Nm] and both [N], measured less planned, of loaded_limbs(); NaN without any."""
    rows = loaded_limbs(log)
    if not rows.any():
        return math.nan, math.nan, math.nan
    force, moment = (
        np.sum((log.limbs[f"{name}"] - log.limbs[f"{planned}"]) ** 2, axis=2)[rows].mean()
        for name, planned in (("force_w_n", "force_reference_w_n"), ("moment_w_nm", "moment_reference_w_nm"))
    )
    return math.sqrt(force), math.sqrt(moment), math.sqrt(force + moment / arm_m**2)


def climb_with(plan: plan_t, folder: Path, wanted: Climb, log: Path) -> Climb:
    """Runs one climb of the robot in `folder`, which has the gains already."""
    from crux_tools.telemetry.reader import read_log

    from crux_simulation.sim.climb import ClimbOptions, climb
    from crux_simulation.sim.world_file import parse_world

    try:
        robot = load_robot(folder)
    except RobotError as error:
        return replace(wanted, refused=str(error))
    own: plan_t = plan_t.decode(plan.encode())
    own.robot_sha256 = robot.hash
    own.plan_id = plan_id(own)
    world = None
    if math.isfinite(wanted.stiffness_N_m):
        text = f"version: 1\nname: holds that give\nholds: {{all: {{stiffness_N_m: {wanted.stiffness_N_m:.0f}}}}}\n"
        world = parse_world(text.encode()).draw(0, own)
    result = climb(own, robot, log, ClimbOptions(world=world, seed=wanted.seed, calibrate=wanted.calibrated))
    telemetry = read_log(log)
    force_N, moment_Nm, wrench_N = wrench_rms(telemetry, robot.control.moment_length_m)
    gains = telemetry.limbs["admittance_gains"][-1, 0]
    return replace(
        wanted,
        ok=result.ok,
        reason=result.reason,
        force_N=force_N,
        moment_Nm=moment_Nm,
        wrench_N=wrench_N,
        true_force_N=result.tracking.force_rms_n,
        damping_Ns_m=float(gains[1]),
        rotational_damping_Nms_rad=float(gains[4]),
    )


def log_name(climb: Climb) -> str:
    """Of a climb of the sweep."""
    how = "calibrated" if climb.calibrated else "fixed"
    return f"{climb.stiffness_N_m:.0f}-{climb.factor:g}-{how}-{climb.seed}.mcap"


def climb_in(folder: Path, wanted: Climb) -> Climb:
    """One climb of the sweep, in a process of its own: plan and robots lie in `folder`."""
    robot = folder / f"gains-{wanted.factor:g}"
    return climb_with(read_plan(folder / "plan.mcap"), robot, wanted, folder / log_name(wanted))


def sweep(base: Robot, stiffnesses: list[float], count: int, folder: Path) -> list[Climb]:
    """Every climb of the figure, as many at a time as there are cores; planned_scene() has been at `folder`."""
    for factor in FACTORS:
        write_robot_with(base, factor, folder / f"gains-{factor:g}")
    wanted = [
        Climb(k, factor, how, seed)
        for k in stiffnesses for factor in FACTORS for how in (False, True) for seed in range(count)
    ]  # fmt: skip
    with (
        progress("climbing", float(len(wanted))) as bar,
        ProcessPoolExecutor(os.cpu_count(), mp_context=get_context("spawn")) as pool,
    ):
        climbs = [pool.submit(climb_in, folder, each) for each in wanted]
        for done, _ in enumerate(as_completed(climbs), 1):
            bar.at(float(done))
    return [climb.result() for climb in climbs]


def pooled(climbs: list[Climb]) -> dict[tuple[float, float, bool], float]:
    """By stiffness, factor and whether it was calibrated: the wrench's RMS [N] of all climbs that were not refused."""
    squares: dict[tuple[float, float, bool], list[float]] = {}
    for c in climbs:
        if not c.refused:
            squares.setdefault((c.stiffness_N_m, c.factor, c.calibrated), []).append(c.wrench_N**2)
    return {which: math.sqrt(np.mean(each)) for which, each in squares.items()}


def verdicts(climbs: list[Climb]) -> list[dict[str, Any]]:
    """For each stiffness and gains that the runtime takes: the RMS with calibration over that without, and whether that
    is as wanted: no worse, or better by 30 % where the gains are wrong; and the right gains' RMS over that without, for
    most of an error may be none that gains lessen."""
    rms_N = pooled(climbs)
    lines = []
    for (stiffness, factor, calibrated), wrench_N in rms_N.items():
        if not calibrated:
            continue
        fixed_N = rms_N[stiffness, factor, False]
        ratio, right = wrench_N / fixed_N, rms_N[stiffness, 1.0, False] / fixed_N
        wanted = NO_WORSE if factor == 1.0 else BETTER
        lines.append(
            {"stiffness_N_m": stiffness, "factor": factor, "ratio": ratio, "right": right, "ok": ratio <= wanted}
        )
    return lines


def draw(climbs: list[Climb], folder: Path, path: Path) -> None:
    """RMS over stiffness; beside it planned and measured force of LF on the softest holds with gains four times too
    large, fixed and calibrated."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    from crux_tools.telemetry.reader import read_log

    figure, (over, *rows) = plt.subplots(3, 1, figsize=(8, 10))
    stiffnesses = list(dict.fromkeys(c.stiffness_N_m for c in climbs))
    names = ["rock" if math.isinf(k) else f"{k:.0e}" for k in stiffnesses]
    rms_N = pooled(climbs)
    for factor, calibrated in dict.fromkeys(which[1:] for which in rms_N):
        line = [rms_N[k, factor, calibrated] for k in stiffnesses]
        label = f"gains × {factor:g}, {'calibrated' if calibrated else 'fixed'}"
        over.plot(names, line, marker="o", linestyle="-" if calibrated else "--", label=label)
    over.set(xlabel="stiffness of the holds [N/m]", ylabel="RMS of measured less planned wrench [N]", ylim=(0, None))
    over.legend(fontsize=8)
    for axes, calibrated in zip(rows, (False, True), strict=True):
        log = read_log(folder / log_name(Climb(stiffnesses[0], WRONG, calibrated)))
        loaded = loaded_limbs(log)[:, 0]
        rows_of_limb = np.flatnonzero(log.limbs_fresh)
        for axis, name in enumerate("xyz"):
            for field, style in (("force_w_n", "-"), ("force_reference_w_n", ":")):
                force = np.where(loaded, log.limbs[field][:, 0, axis], np.nan)[rows_of_limb]
                label = f"{name} {'measured' if style == '-' else 'planned'}"
                axes.plot(log.time_s[rows_of_limb], force, style, color=f"C{axis}", linewidth=1, label=label)
        how = "calibrated" if calibrated else "fixed"
        axes.set(
            title=f"LF on holds of {names[0]} N/m, gains × {WRONG:g}, {how}", xlabel="time [s]", ylabel="force [N]"
        )
        axes.legend(fontsize=7, ncol=3)
    figure.tight_layout()
    figure.savefig(path, dpi=150)
    plt.close(figure)


def line_of(climb: Climb) -> str:
    """What the terminal shows of a climb."""
    how = "calibrated" if climb.calibrated else "fixed"
    name = f"holds {climb.stiffness_N_m:7g} N/m, gains × {climb.factor:<4g} {how:10} seed {climb.seed}"
    if climb.refused:
        return f"{name} refused: {climb.refused}"
    truth = "" if climb.true_force_N is None else f" (true {climb.true_force_N:.2f})"
    return (
        f"{name} wrench {climb.wrench_N:.2f} N, force {climb.force_N:.2f} N{truth}, moment {climb.moment_Nm:.3f} Nm; "
        f"D {climb.damping_Ns_m:.0f}, {climb.rotational_damping_Nms_rad:.1f}; {climb.reason or 'at the goal'}"
    )


def run(options: argparse.Namespace) -> int:
    """Exit status 0 when calibrated gains are nowhere worse, and 30 % better where the fixed ones are wrong."""
    if options.count < 1:
        raise UsageError(f"--count is {options.count}; it must be at least 1")
    plan, _ = planned_scene(SCENE, options.output)
    climbs = sweep(load_robot(plan.robot_name), options.stiffnesses, options.count, options.output)
    picture = options.output / "fig9.png"
    draw(climbs, options.output, picture)
    lines = verdicts(climbs)
    ok = bool(lines) and all(line["ok"] for line in lines)
    if options.json:
        print_json({"ok": ok, "climbs": [asdict(climb) for climb in climbs], "calibrated_over_fixed": lines})
        return 0 if ok else 1
    for climb in climbs:
        note(line_of(climb))
    for line in lines:
        wanted = "no worse" if line["factor"] == 1.0 else "30 % better"
        note(
            f"holds {line['stiffness_N_m']:7g} N/m, gains × {line['factor']:<4g} calibrated over fixed "
            f"{line['ratio']:.2f}: {'' if line['ok'] else 'not '}{wanted} (the right gains, fixed: {line['right']:.2f})"
        )
    note(f"picture {picture}")
    return 0 if ok else 1
