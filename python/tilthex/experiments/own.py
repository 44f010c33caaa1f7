"""A controller of your own in the place of `tilthex.Loop`, for `flight.fly`."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

import tilthex

Vector = NDArray[np.float64]


class Controller(Protocol):
    """What flies: an object with a `step` like that of `tilthex.Controller` and `tilthex.chain.Chain`."""

    def step(
        self,
        *,
        position: Vector,
        velocity: Vector,
        rotation: Vector,
        angular_velocity: Vector,
        specific_force: Vector,
        rotor_speeds: Vector,
        setpoint: tilthex.Setpoint,
        dt: float,
    ) -> tilthex.Output:
        """One control period, from the true state to rotor speeds."""


class Own:
    """Calls the controller once per control period, and keeps the columns of `tilthex.Loop.record`."""

    model_refused = None

    def __init__(self, controller: Controller) -> None:
        """Has flown nothing yet."""
        self._controller = controller
        self._last = 0.0
        self._rows: list[dict[str, Any]] = []

    def initialize(self, time: float, position: Vector, rotation: Vector) -> None:
        """Begins at a time, s."""
        self._last = time

    def step_from(
        self, time: float, *, setpoint: tilthex.Setpoint, learn_bias: bool, learn_model: bool, **state: Vector
    ) -> Vector:
        """One control period: rotor speeds, Hz, (n,).

        Raises:
            TypeError: The controller does not return a `tilthex.Output`.
        """
        said = self._controller.step(setpoint=setpoint, dt=time - self._last, **state)
        self._last = time
        if not isinstance(said, tilthex.Output):
            kind = type(said).__name__
            raise TypeError(f"the controller's step returned a {kind}; expected a tilthex.Output")
        self._rows.append(
            {
                "setpoint_position": setpoint.position,
                "setpoint_rotation": setpoint.rotation.ravel(),
                "reference_position": said.reference.position,
                "reference_rotation": said.reference.rotation.ravel(),
                "reference_velocity": said.reference.velocity,
                "estimated_position": np.array(state["position"]),
                "estimated_velocity": np.array(state["velocity"]),
                "estimated_rotation": np.array(state["rotation"]).ravel(),
                "position_error": said.position_error,
                "rotation_error": said.rotation_error,
                "wrench_robot": said.wrench_robot,
                "wrench_tool": said.wrench_tool,
                "wrench_admittance": said.wrench_admittance,
                "wrench_contact": said.wrench_tool,
                "wind": np.zeros(3),
                "contact_likelihood": np.zeros(1),
                "saturated": np.array([float(said.saturated)]),
            }
        )
        return said.rotor_speeds

    def record(self) -> dict[str, Vector]:
        """The columns, one row per control period."""
        return {name: np.array([row[name] for row in self._rows]) for name in self._rows[0]}
