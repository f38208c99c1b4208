"""From a solution to the plan message (crux_msgs.plan_t), turned back from the heading frame H to W."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any

import crux_msgs
import numpy as np
from crux_contracts.interpolation import is_walk
from crux_contracts.plan_file import plan_id
from crux_contracts.plan_series import PlanSeries, plan_series
from crux_contracts.robot import Robot
from crux_contracts.scenario import Foothold, Hold, Scenario
from crux_msgs import plan_t

from crux_planner.errors import FOR_ALL_REACH, FOR_ITS_REACH
from crux_planner.model.arrays import Array
from crux_planner.model.hands import TILTED
from crux_planner.model.kinematics import rotation_z

if TYPE_CHECKING:
    import pandas

    from crux_planner.admm.admm import Decided, Knots
    from crux_planner.certificates.other_sequences import OtherSequences
    from crux_planner.checker import CheckReport
    from crux_planner.model.problem import CentroidalProblem, Problem
    from crux_planner.model.schedule import Schedule
    from crux_planner.model.walk_problem import WalkProblem
    from crux_planner.pipeline.session import Work
    from crux_planner.trajectory.solution import Solution, WalkSolution


@dataclass(repr=False)
class PlanResult:
    """A plan that passed the check, and how it came about: what `crux_planner.plan` and `Planner` return."""

    ok: bool
    """the plan passed the check"""
    plan: plan_t
    """the message that runtime and files take (`crux_contracts.plan_file.write_plan`); `arrays` shows it as NumPy's"""
    check: CheckReport
    """margins, joint loads and the tightest constraints, by the independent checker"""
    cost: float
    """J of the plan's knots, without unit"""
    iterations: int
    """of the method: of its consensus, else of the exact NLP's solver"""
    gait: list[str]
    """limbs in the order in which they move: LF, RF, LR, RR"""
    position_residual_m: float
    """what the exact NLP's solution leaves of the equations of motion: m"""
    force_residual_N: float
    """the same in N"""
    method: str = "auto"
    """as asked for: auto, two_block, multi_block or benchmark"""
    seconds: float = 0.0
    """by the wall's clock"""
    computed_s: float = 0.0
    """CPU time of the planner and its workers, which the time limit counts"""
    """wall-clock time of planning and check"""
    gap: float | None = None
    """share of the cost by which a plan of `scope` could be cheaper, at most; None: no bound was worked out"""
    others: OtherSequences | None = None
    """what a MIP says of other contacts and orders; None: it was not asked"""
    nominal_cost: float | None = None
    """J of the same contacts where nothing is uncertain; None: the scenario has no uncertainty"""
    history: list[dict[str, float]] = field(default_factory=list)
    """residuals of the method's consensus, iteration by iteration; empty: the method has none"""
    method_report: dict[str, object] | None = None
    """what one of the paper's methods reached before the exact NLP"""
    timing: dict[str, float] = field(default_factory=dict)
    """wall-clock seconds of each part of the work"""
    in_pairs: PlanResult | None = None
    """the same climb with two limbs in the air at once, before it has its pace; None: none was found, or looked for"""

    def __repr__(self) -> str:
        gap = "not bounded" if self.gap is None else f"at most {100 * self.gap:.0f} % of it"
        verdict = "passed the check" if self.ok else "did not pass the check"
        return (
            f"PlanResult: {self.plan.scenario_name} for {self.plan.robot_name}, {verdict}\n"
            f"  {self.steps} steps in {self.plan.knots[-1].time_s:g} s, gait {' '.join(self.gait)}\n"
            f"  cost {self.cost:.3f}, gap {gap}; method {self.method}, {self.seconds:.1f} s\n"
            f"  {self.check}"
        )

    @property
    def arrays(self) -> PlanSeries:
        """The plan's knots as new NumPy arrays: times, body and gripper poses, forces and wrenches, contacts."""
        return plan_series(self.plan)

    def to_dataframe(self) -> pandas.DataFrame:
        """One row a knot (`PlanSeries.to_dataframe`). Raises ImportError where pandas is not installed."""
        return self.arrays.to_dataframe()

    @classmethod
    def of(
        cls, plan: plan_t, check: CheckReport, solution: Solution | WalkSolution, gait: list[str], work: Work
    ) -> PlanResult:
        """A plan that passed the check, of the exact problem's solution."""
        return cls(
            ok=True,
            plan=plan,
            check=check,
            cost=solution.cost,
            iterations=solution.iterations,
            gait=gait,
            position_residual_m=solution.position_residual_m,
            force_residual_N=solution.force_residual_N,
            timing=work.seconds,
        )

    def found_by(self, decided: Decided[Knots], check: CheckReport) -> None:
        """Say which of the paper's methods it comes from, and what the checker says of what that reached by itself."""
        self.iterations, self.history = decided.iterations, decided.history
        worst = [asdict(violation) for violation in check.worst[:1]]
        self.method_report = {**decided.to_json(), "check": {"ok": check.ok, "worst": worst}}

    @property
    def scope(self) -> str:
        """What the gap is about: the plans that the bound of the cost is below."""
        if is_walk(self.plan):
            return f"{FOR_ITS_REACH}, its accelerations and single steps"
        return f"{FOR_ALL_REACH}, its swings and its places on the holds"

    @property
    def steps(self) -> int:
        """N of the plan: what J and the gap are about."""
        return int(self.plan.n_knots) - 1

    @property
    def residuals(self) -> dict[str, float]:
        """Of the consensus where the method is an ADMM, else of the exact NLP's dynamics."""
        if self.history:
            return self.history[-1]
        return {"position_m": self.position_residual_m, "force_N": self.force_residual_N}

    def to_json(self) -> dict[str, object]:
        """The object `crux plan --json` prints."""
        return {
            "ok": self.ok,
            "method": self.method,
            "seconds": round(self.seconds, 3),
            "computed_s": round(self.computed_s, 3),
            "cost": self.cost,
            "nominal_cost": self.nominal_cost,
            "gap": self.gap,
            "scope": None if self.gap is None else self.scope,
            "sequence": None if self.others is None else self.others.to_json(),
            "steps": self.steps,
            "dt_s": self.plan.dt_s,
            "iterations": self.iterations,
            "residuals": self.residuals,
            "history": self.history,
            "method_report": self.method_report,
            "gait": self.gait,
            "check": {"ok": self.check.ok, "worst": self.check.to_json()["worst"]},
            "timing": self.timing,
        }


def plan_message(
    scenario: Scenario, robot: Robot, problem: Problem, schedule: Schedule, solution: Solution, method: str = "auto"
) -> Any:
    """The plan as a message, complete with its plan_id."""
    from crux_planner.physics.dynamics import WRENCH_INPUTS  # with casadi, which walks do without
    from crux_planner.physics.limit_surface import finger_forces

    plan = plan_header(scenario, robot, solution.cost, method)
    plan.patch_k_m = problem.patch.k_m
    plan.max_normal_n = problem.patch.max_normal_N
    plan.spine_shear_n = problem.patch.spine_shear_N
    plan.spine_twist_nm = problem.patch.spine_twist_Nm
    held = [problem.contacts[c] if c is not None else None for knot in schedule.contacts for c in knot]
    loads = [*solution.wrenches, solution.wrenches[-1]]  # the last knot repeats the one before
    none = np.zeros(WRENCH_INPUTS)
    q = np.array([none if c is None else loads[i // 4][i % 4] for i, c in enumerate(held)])
    axes, tangents, ups = (
        np.array([_UP if c is None else getattr(c, name) for c in held]) for name in ("axis", "tangent", "up")
    )
    grips = [None if c is None else (c.hold, c.finger1_face, float(c.friction.min())) for c in held]
    leaning = None
    if problem.leans:
        parts = [(_NOWHERE, _NOWHERE) if c is None else (c.normals, c.touch_m) for c in held]
        leaning = np.array([normals for normals, _ in parts]), np.array([touch for _, touch in parts])
    forces, moments = finger_forces(q, axes, tangents, leaning, ups)
    poses = schedule.poses.copy()
    feet = np.array([c is not None and c.foot for c in held])
    if feet.any():
        plan.format = plan_t.FORMAT_FEET
        plan.holds += [_foothold(foothold, robot.gripper.pad_radius_m) for foothold in scenario.footholds]
        plan.n_holds = len(plan.holds)
        forces[feet] = forces[feet].mean(axis=1, keepdims=True)
        moments[feet] = 0.0
        poses.reshape(len(held), -1)[feet, :3] = [c.place_h_m for c in held if c is not None and c.foot]
    return _with_knots(plan, problem, solution.body, poses, (forces, moments), grips)


def walk_message(
    scenario: Scenario, robot: Robot, problem: WalkProblem, solution: WalkSolution, method: str = "auto"
) -> Any:
    """The plan of a walk, complete with its plan_id (msgs/PLAN.md, point feet)."""
    plan = plan_header(scenario, robot, solution.cost, method)
    plan.patch_k_m, plan.spine_shear_n, plan.spine_twist_nm = 0.0, 0.0, 0.0
    plan.max_normal_n = problem.max_normal_N
    gait = solution.gait
    height, yaw = problem.step_height_m * gait.height, gait.yaw(float(problem.goal.body.rpy_rad[2]))
    opening = np.full(height.shape, problem.opening_m)
    poses = np.concatenate([gait.blend @ solution.footholds, np.stack([height, yaw, opening], axis=2)], axis=2)
    forces = np.concatenate([solution.forces, solution.forces[-1:]]) * gait.stance[..., None]
    both = np.repeat(forces.reshape(-1, 1, 3) / 2, 2, axis=1)
    wall = (-1, crux_msgs.limb_knot_t.FACE_WALL, problem.wall_friction)
    grips = [wall if on else None for on in gait.stance.ravel()]
    return _with_knots(plan, problem, solution.body, poses, (both, np.zeros_like(both)), grips)


def _with_knots(
    plan: Any,
    problem: CentroidalProblem,
    body: Array,
    poses: Array,
    loads: tuple[Array, Array],
    grips: list[tuple[int, int, float] | None],
) -> Any:
    """The plan with its knots: poses (N + 1, 4, 5 or 7) of grippers; forces and moments (4 (N + 1), 2, 3) of their
    fingers and what they hold (hold, face of finger 1, its friction), None in the air, limb by limb of all knots.
    """
    to_w, heading = rotation_z(problem.heading_rad), np.array([0.0, 0.0, problem.heading_rad])
    columns = [body[:, 0:3] @ to_w.T, body[:, 3:6] + heading, body[:, 6:9] @ to_w.T, body[:, 9:12]]
    limbs = []
    forces, moments = ((part @ to_w.T).reshape(-1, 6).tolist() for part in loads)
    positions = (poses[..., :3] @ to_w.T).reshape(-1, 3).tolist()
    yaws = (poses[..., 3].ravel() + problem.heading_rad).tolist()
    separations = (2 * poses[..., 4].ravel()).tolist()
    tilted = poses.shape[-1] > TILTED
    tilt = poses[..., 5:] if tilted else np.zeros((*poses.shape[:2], 2))
    tilts = (tilt @ to_w[:2, :2].T).reshape(-1, 2).tolist()
    for i, grip in enumerate(grips):
        limb = crux_msgs.limb_knot_t()
        limb.gripper_position_w_m, limb.gripper_yaw_w_rad = positions[i], yaws[i]
        limb.gripper_tilt_w_rad = tilts[i]
        limb.finger_separation_m = separations[i]
        limb.finger_force_w_n, limb.finger_moment_w_nm = forces[i], moments[i]
        limb.phase = limb.AIR if grip is None else limb.STANCE
        limb.hold, limb.finger1_face, limb.friction = grip or (-1, limb.FACE_NONE, 0.0)
        limbs.append(limb)
    for k, (position, rpy, velocity, rate) in enumerate(zip(*(part.tolist() for part in columns), strict=True)):
        knot = crux_msgs.plan_knot_t()
        knot.time_s = k * problem.dt_s
        knot.body_position_w_m, knot.body_rpy_rad = position, rpy
        knot.body_velocity_w_m_s, knot.body_angular_velocity_b_rad_s = velocity, rate
        knot.limbs = limbs[4 * k : 4 * k + 4]
        plan.knots.append(knot)
    plan.n_knots = len(plan.knots)
    plan.plan_id = plan_id(plan)
    return plan


def plan_header(scenario: Scenario, robot: Robot, cost: float, method: str = "auto") -> Any:
    """A plan_t with all that does not depend on the contact model: names, hashes, gravity, goal tolerances, cuboids."""
    plan = crux_msgs.plan_t()
    plan.format = crux_msgs.plan_t.FORMAT_FROM_AIR if scenario.start.air else crux_msgs.plan_t.FORMAT
    plan.scenario_name = scenario.name
    plan.scenario_yaml = scenario.yaml_text
    plan.scenario_sha256 = scenario.sha256
    plan.robot_name = robot.name
    plan.robot_sha256 = robot.hash
    plan.method = method
    plan.cost = cost
    plan.dt_s = scenario.horizon.dt_s
    plan.gravity_w_m_s2 = list(scenario.wall.gravity_w_m_s2)
    plan.goal_tolerance_m = scenario.goal.tolerance_m
    plan.goal_tolerance_rad = scenario.goal.tolerance_rad
    plan.holds = [_hold(cuboid) for cuboid in scenario.cuboids]
    plan.n_holds = len(plan.holds)
    return plan


def _hold(cuboid: Any) -> Any:
    hold = crux_msgs.hold_t()
    graspable = isinstance(cuboid, Hold)
    hold.name = cuboid.name
    hold.graspable = int(graspable)
    hold.position_w_m = [*cuboid.position_m, cuboid.foot_z_m]
    hold.size_m = list(cuboid.size_m)
    hold.yaw_rad = cuboid.yaw_rad
    hold.tilt_rad = list(cuboid.tilt_rad)
    hold.friction = list(cuboid.friction) if graspable else [0.0] * 5
    hold.spines = [int(s) for s in cuboid.spines] if graspable else [0] * 5
    hold.lean_rad = list(cuboid.lean_rad) if graspable else [0.0] * 4
    return hold


def _foothold(foothold: Foothold, pad_radius_m: float) -> Any:
    hold = crux_msgs.hold_t()
    roll, pitch, hold.yaw_rad = foothold.rpy_rad
    hold.name, hold.graspable, hold.tilt_rad = foothold.name, hold.FOOTHOLD, [roll, pitch]
    hold.position_w_m, hold.size_m = list(foothold.position_m), [2 * pad_radius_m, 2 * pad_radius_m, 0.0]
    hold.friction = [0.0, 0.0, 0.0, 0.0, foothold.friction]
    return hold


_NOWHERE = np.zeros((2, 3))
_UP = np.array([0.0, 0.0, 1.0])  # any: nothing is multiplied by it
