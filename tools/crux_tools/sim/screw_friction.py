"""Dry friction of the screws that drive the fingers, for grippers whose drive force comes before it.

A finger under the squeeze S closes when the drive force exceeds S / eta and opens when it falls below -r S / eta; in
between the screw stands, whatever the load. So the friction reaches from S (1/eta - 1) against closing to
S (1 + r/eta) against opening: a constant part and a symmetric one, which MuJoCo's friction loss of the finger's joint
solves with the contacts.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from crux_contracts.robot_sections import GripperMotor
from numpy.typing import NDArray

from crux_tools.sim.robot_model import RobotModel

Floats = NDArray[np.float64]

# The stiffest friction MuJoCo makes: a standing finger creeps by micrometres a second at the most.
STIFF_IMPEDANCE = (0.9999, 0.9999, 0.001, 0.5, 2.0)
STIFF_PERIODS = 2  # time constant in steps


class ScrewFriction:
    """Of some limbs' fingers in a model."""

    def __init__(self, robot: RobotModel, limbs: Sequence[int], motor: GripperMotor) -> None:
        """Makes these fingers' friction stiff; it is zero until `set`."""
        self.limbs = np.asarray(limbs, dtype=np.int64)
        self._model: Any = robot.model
        self._dof = robot.finger_dof[self.limbs]
        self._middle = 0.5 * (2 + (motor.screw_release_torque - 1) / motor.screw_efficiency)
        self._half_width = 0.5 * (1 + motor.screw_release_torque) / motor.screw_efficiency
        self._model.dof_solimp[self._dof] = STIFF_IMPEDANCE
        self._model.dof_solref[self._dof] = (STIFF_PERIODS * self._model.opt.timestep, 1.0)

    def set(self, squeeze_n: Floats) -> Floats:
        """Friction under the squeezes (n, 2) of the pads; returns the part that is a force, positive closes."""
        self._model.dof_frictionloss[self._dof] = self._half_width * squeeze_n
        return self._middle * squeeze_n
