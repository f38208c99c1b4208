"""Five-bars drawn at random that close in the middle of their joints' ranges."""

from __future__ import annotations

import numpy as np
from crux_contracts.five_bar import FiveBar
from crux_msgs.robot_keys import FiveBar as Keys

DIGITS = 12


def drawn(random: np.random.Generator, first_joint: int = 2) -> FiveBar:
    """Links of 5 to 30 cm, either branch, either sense."""
    while True:
        at = {name: random.uniform(-0.1, 0.1) for name in ("crank_x_m", "crank_y_m")}
        at |= {name: random.uniform(-0.2, 0.2) for name in ("pin_x_m", "pin_y_m")}
        at |= {name: random.uniform(0.05, 0.3) for name in ("crank_m", "rod_m")}
        at = {name: float(f"{value:.{DIGITS}g}") for name, value in at.items()}
        keys = Keys(first_joint=float(first_joint), bends=float(random.choice([-1, 1])), least_sine=0.2, **at)
        link, sense = float(f"{random.uniform(0.1, 0.3):.{DIGITS}g}"), float(random.choice([-1, 1]))
        bar = FiveBar(keys, link, sense, np.round(random.uniform(-1.5, 1.5, 2), DIGITS))
        if bar.sine(bar.middle_rad) > 0.3:
            return bar
