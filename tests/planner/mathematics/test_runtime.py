"""Equations (C4) and (C5) against the runtime's own code."""

from __future__ import annotations

import subprocess

import numpy as np
import yaml
from crux_tools.paths import ROOT

VECTORS = ROOT / "build" / "cmake" / "tests" / "runtime" / "core" / "core_vectors"
ROBOT = yaml.safe_load((ROOT / "msgs" / "robots" / "scaler" / "robot.yaml").read_text(encoding="utf-8"))
PERIOD_S = 0.002


def computed(what: str, lines: np.ndarray) -> np.ndarray:
    """What the runtime makes of each line of numbers."""
    text = "\n".join(" ".join(f"{number:.17g}" for number in line) for line in lines)
    answer = subprocess.run([VECTORS, what], input=text, capture_output=True, text=True, check=True)
    return np.array([line.split() for line in answer.stdout.splitlines()], dtype=float)


def test_equation_c4_the_squeeze_of_a_finger() -> None:
    random = np.random.default_rng(1)
    control = ROBOT["control"]
    assert (control["grasp_force_factor"], control["grasp_force_reserve_N"]) == (1.25, 4)
    lines, wanted = [], []
    for _ in range(100):
        f_l, t_l = random.normal(size=3) * 20, random.normal(size=3) * 0.5
        psi = random.uniform(-np.pi, np.pi)
        e_l, mu = np.array([np.cos(psi), np.sin(psi), 0.0]), random.uniform(0.2, 2.2)
        k_m, d_l, chi = random.uniform(0.005, 0.02), random.uniform(0.03, 0.1), control["trusted_friction"]
        lines.append([*f_l, *t_l, *e_l, chi * mu, k_m, d_l / 2])
        across, pads = f_l - (f_l @ e_l) * e_l, []
        for side in (1, -1):
            shear = across / 2 + side * np.cross(t_l, e_l) / d_l
            demand = np.sqrt(shear @ shear + (t_l @ e_l / (2 * k_m)) ** 2)
            pads.append(1.25 / (chi * mu) * demand - side * f_l @ e_l / 2)
        wanted.append(max(*pads, 0.0) + 4.0)
    np.testing.assert_allclose(computed("grasp", np.array(lines)).ravel(), wanted, rtol=1e-12)


def test_equation_c5_grippers_yield_as_mass_damper_and_spring() -> None:
    """M_a times the second difference, D_a times the new speed and K_a times the old offset add up to the error."""
    random, gains = np.random.default_rng(2), ROBOT["admittance"]
    errors = random.normal(size=(200, 6)) * [2.0, 2.0, 2.0, 0.1, 0.1, 0.1]
    offsets = np.vstack([np.zeros((2, 6)), computed("yield", errors)])
    speeds = np.diff(offsets, axis=0) / PERIOD_S
    for part, names in (
        (slice(0, 3), ("mass_kg", "damping_Ns_m", "stiffness_N_m", "max_speed_m_s")),
        (slice(3, 6), ("inertia_kg_m2", "rotational_damping_Nms_rad", "rotational_stiffness_Nm_rad", "max_rate_rad_s")),
    ):
        m_a, d_a, k_a, fastest = (gains[name] for name in names)
        assert np.linalg.norm(speeds[:, part], axis=1).max() < fastest
        pushed = m_a * np.diff(speeds[:, part], axis=0) / PERIOD_S + d_a * speeds[1:, part] + k_a * offsets[1:-1, part]
        np.testing.assert_allclose(pushed, errors[:, part], atol=1e-6)
