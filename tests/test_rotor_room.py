"""The torque towards more room for the rotors, against a hover worked out with NumPy."""

from __future__ import annotations

import re

import numpy as np
import pytest
import tilthex
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from scipy.special import logsumexp
from strategies import rotations

TILT_HEX = tilthex.Vehicle.preset("tilt-hex")
INERTIA = 0.05
GRAVITY = 9.81


def controller(torque: float) -> tilthex.Controller:
    mass = [1.5, 1.5, 1.5, INERTIA, INERTIA, INERTIA]
    admittance = {"mass": mass, "stiffness": [6, 6, 6, 0, 0, 0], "room_torque": torque}
    return tilthex.Controller(TILT_HEX, tilthex.Config.default(TILT_HEX).replace(admittance=admittance))


def room(rotation: np.ndarray) -> float:
    """Smooth least of the distances of a hover's inputs from their limits, parts of the range."""
    weight = np.r_[rotation.T @ [0, 0, TILT_HEX.mass * GRAVITY], np.zeros(3)]
    inputs = np.linalg.solve(np.asarray(TILT_HEX.allocation), weight)
    lower, upper = 16.0**2, 110.0**2
    rooms = np.r_[inputs - lower, upper - inputs] / (upper - lower)
    return float(-logsumexp(-60.0 * rooms) / 60.0)


def first_acceleration(torque: float, rotation: np.ndarray, *, compliant: bool = True) -> np.ndarray:
    """Angular acceleration of the reference, rad/s^2, W, of a vehicle that hovers at its set-point."""
    tool = rotation @ TILT_HEX.tool_rotation
    out = controller(torque).step(
        position=np.zeros(3),
        velocity=np.zeros(3),
        rotation=rotation,
        angular_velocity=np.zeros(3),
        specific_force=rotation.T @ [0, 0, GRAVITY],
        rotor_speeds=TILT_HEX.hover_speeds(rotation),
        setpoint=tilthex.Setpoint(rotation @ TILT_HEX.tool_position, tool),
        compliant=compliant,
        dt=1e-6,
    )
    return np.asarray(out.reference.angular_acceleration)


@given(rotations(), st.floats(0.05, 2.0))
def test_the_torque_turns_the_reference_as_worked_out(rotation: np.ndarray, torque: float) -> None:
    """T s / sqrt(s^2 + 0.01^2) about the tool's axis, s the room's derivative by turning about it."""
    axis = rotation @ TILT_HEX.tool_rotation[:, 2]
    step = 1e-5
    ahead, behind = (room(Rotation.from_rotvec(a * axis).as_matrix() @ rotation) for a in (step, -step))
    slope = (ahead - behind) / (2 * step)
    expected = torque * slope / np.hypot(slope, 0.01) / INERTIA * axis
    found = first_acceleration(torque, rotation)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-3 * torque / INERTIA)


@given(rotations())
def test_without_it_or_without_compliance_nothing_turns(rotation: np.ndarray) -> None:
    np.testing.assert_allclose(first_acceleration(0.0, rotation), 0, atol=1e-9)
    np.testing.assert_allclose(first_acceleration(1.0, rotation, compliant=False), 0, atol=1e-9)


def test_a_vehicle_that_can_not_hover_tilted_refuses_it() -> None:
    flat = next(
        v for v in map(tilthex.Vehicle.preset, tilthex.Vehicle.presets()) if v.tracks != TILT_HEX.tracks
    )
    with pytest.raises(ValueError, match=re.escape("[admittance]: room_torque is")):
        tilthex.Config.default(flat).replace(admittance={"room_torque": 0.1})
