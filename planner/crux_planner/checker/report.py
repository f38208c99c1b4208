"""What the checker says about a plan: violations, the tightest value of every constraint, margins and joint loads."""

import math
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from crux_contracts import LIMB_NAMES

from crux_planner.checker import tolerances
from crux_planner.checker.geometry import Array

UNBOUNDED = 1e9
"""Stands for infinity, which JSON does not have."""
_ROUNDING = 1e-9  # of an amount, relative


@dataclass(frozen=True)
class Violation:
    """One constraint that is not met, or (in `CheckReport.worst`) the place where it comes closest to not being met.

    `amount` is how far the limit is exceeded in `unit`, negative where there is slack. `limb` and `finger` (1 or 2)
    are None where the constraint belongs to the whole robot; `time_s` is None where it belongs to the whole plan.
    `joint` (0..5) is the number of the limb's joint, where it is about one.
    """

    constraint: str
    limb: str | None
    finger: int | None
    time_s: float | None
    amount: float
    unit: str
    detail: str = ""
    joint: int | None = None


@dataclass(frozen=True)
class JointLoad:
    """Largest and root-mean-square torque and largest speed of a joint or actuator over a plan, beside its limits."""

    limb: str
    joint: str
    peak_torque_Nm: float
    rms_torque_Nm: float
    effort_limit_Nm: float
    continuous_limit_Nm: float
    peak_speed_rad_s: float
    speed_limit_rad_s: float


@dataclass(frozen=True)
class PeakTorque:
    """The largest torque of a joint or actuator, as a share of its limit, when the load is shared about the true centre
    of mass."""

    limb: str
    joint: str
    time_s: float
    torque_Nm: float
    effort_limit_Nm: float

    @property
    def share(self) -> float:
        """Of what the joint can give."""
        return self.torque_Nm / self.effort_limit_Nm


@dataclass(frozen=True)
class Correction:
    """The most that the controller adds to the blended wrenches between the knots of a climb."""

    moment_Nm: float
    """largest moment about the centre of mass that the blended wrenches lack, its norm"""
    force_N: float
    """largest change of a gripper's force that makes up for it, its norm"""


@dataclass(repr=False)
class CheckReport:
    """Outcome of `check_plan`."""

    violations: list[Violation] = field(default_factory=list)
    """what is not met; empty for a plan that is right"""
    worst: list[Violation] = field(default_factory=list)
    """one entry a constraint, the least satisfied first"""
    cost: float | None = None
    """J (6) over the plan's steps with the scenario's weights, which bounds are about; None: not counted (walks)"""
    friction_margin_N: float | None = None
    """N that the limit surface (2a) leaves the finger nearest to it at a knot; None: not checked so far"""
    tumble_margin_m: float | None = None
    """least tumble stability margin about the centre of mass, m; None: not checked so far, or without meaning for this
    stance"""
    joints: list[JointLoad] = field(default_factory=list)
    """largest loads of every joint, limb by limb"""
    actuators: list[JointLoad] = field(default_factory=list)
    """and of every actuator, where transmissions lie between them and the joints; else none"""
    largest_torque: PeakTorque | None = None
    """the joint torque nearest to its limit"""
    correction: Correction | None = None
    """what the controller adds between the knots; None: not checked so far, or on point feet"""
    seconds: float = 0.0
    """wall-clock time of the check"""

    def __repr__(self) -> str:
        said = "CheckReport: ok" if self.ok else f"CheckReport: {len(self.violations)} violations"
        if self.friction_margin_N is not None:
            said += f", least margin of the limit surface {self.friction_margin_N:.2f} N"
        for violation in self.violations[:3]:
            place = "" if violation.limb is None else f" {violation.limb}"
            when = "" if violation.time_s is None else f" at {violation.time_s:g} s"
            said += f"\n  {violation.constraint}{place}{when}: {violation.amount:.3g} {violation.unit} over"
        return said

    @property
    def ok(self) -> bool:
        """True when every constraint is met."""
        return not self.violations

    def to_json(self) -> dict[str, object]:
        """The object that `crux check --json` prints."""
        found = asdict(self)
        margin = {"friction": found.pop("friction_margin_N"), "tumble_m": found.pop("tumble_margin_m")}
        return {"ok": self.ok, "min_margin": margin, **found}


class Findings:
    """Collects the residuals of all constraints; turns those above tolerance into violations."""

    def __init__(self) -> None:
        self.violations: list[Violation] = []
        self._worst: dict[str, tuple[float, Violation]] = {}

    def add(
        self,
        constraint: str,
        amount: float,
        unit: str,
        *,
        tolerance: float | None = None,
        limb: int | None = None,
        finger: int | None = None,
        time_s: float | None = None,
        detail: str = "",
        joint: int | None = None,
    ) -> None:
        """Record one residual; its tolerance is its unit's where none is given. NaN counts as UNBOUNDED."""
        tolerance = tolerances.OF_UNIT.get(unit, 0.0) if tolerance is None else tolerance
        value = UNBOUNDED if math.isnan(amount) else min(max(float(amount), -UNBOUNDED), UNBOUNDED)
        name = None if limb is None else LIMB_NAMES[limb]
        when = None if time_s is None else float(time_s)
        entry = Violation(constraint, name, finger, when, value, unit, detail, joint)
        rank = value - tolerance if tolerance == 0.0 else value / tolerance
        if constraint not in self._worst or rank > self._worst[constraint][0]:
            self._worst[constraint] = (rank, entry)
        if value > tolerance:
            self.violations.append(entry)

    def add_series(
        self,
        constraint: str,
        amounts: Array,
        times_s: Array,
        unit: str,
        *,
        tolerance: float | None = None,
        limb: int | None = None,
        finger: int | None = None,
        detail: str = "",
        joint: int | None = None,
    ) -> None:
        """Record residuals over time, shapes (T,) and (T,). Every unbroken run above tolerance gives one violation, at
        its worst moment, the first of equals; a series without any gives one entry for `worst`. Entries of -inf mean
        "does not apply".
        """
        if amounts.size == 0:
            return
        tolerance = tolerances.OF_UNIT.get(unit, 0.0) if tolerance is None else tolerance
        values = np.where(np.isnan(amounts), np.inf, amounts)
        picks = [_first_of_the_worst(values)]
        if amounts[picks[0]] == -np.inf:
            return
        if values[picks[0]] > tolerance:
            edges = np.flatnonzero(np.diff(np.concatenate(([False], values > tolerance, [False])).astype(np.int8)))
            picks = [a + _first_of_the_worst(values[a:b]) for a, b in zip(edges[::2], edges[1::2], strict=True)]
        where: dict[str, Any] = {
            "tolerance": tolerance,
            "limb": limb,
            "finger": finger,
            "detail": detail,
            "joint": joint,
        }
        for i in picks:
            self.add(constraint, float(amounts[i]), unit, time_s=float(times_s[i]), **where)

    def worst(self) -> list[Violation]:
        """One entry a constraint, the least satisfied (relative to its tolerance) first."""
        return [entry for _, entry in sorted(self._worst.values(), key=lambda pair: -pair[0])]


def _first_of_the_worst(values: Array) -> int:
    """Values that rounding alone tells apart are equal: which is the largest would be the processor's choice."""
    worst = float(values.max())
    if not np.isfinite(worst):
        return int(values.argmax())
    return int(np.argmax(values >= worst - _ROUNDING * max(1.0, abs(worst))))
