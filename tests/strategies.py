"""What the properties range over: vehicles, attitudes, gains, periods and wrenches."""

from __future__ import annotations

import numpy as np
import tilthex
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation


def numbers(low: float, high: float, count: int) -> st.SearchStrategy[np.ndarray]:
    return st.lists(st.floats(low, high), min_size=count, max_size=count).map(np.array)


def logarithmic(low: float, high: float) -> st.SearchStrategy[float]:
    """Every order of magnitude is as likely as the next."""
    return st.floats(np.log(low), np.log(high)).map(lambda x: float(np.clip(np.exp(x), low, high)))


@st.composite
def rotations(draw, max_angle: float = np.pi) -> np.ndarray:
    axis = draw(numbers(-1, 1, 3).filter(lambda a: np.linalg.norm(a) > 0.1))
    angle = draw(st.floats(0, max_angle))
    return Rotation.from_rotvec(angle * axis / np.linalg.norm(axis)).as_matrix()


@st.composite
def inertias(draw) -> np.ndarray:
    """Principal moments that a body can have (none above the sum of the others), along any axes."""
    masses = draw(numbers(1e-3, 0.05, 3))
    axes = draw(rotations())
    inertia = axes @ np.diag(masses.sum() - masses) @ axes.T
    return 0.5 * (inertia + inertia.T)


@st.composite
def vehicles(draw, **keys) -> tilthex.Vehicle:
    """Fully actuated hexarotors, their tools anywhere, their rotors fast enough for any wrench."""
    described = {
        "name": "random",
        "mass": draw(logarithmic(0.3, 20)),
        "inertia": draw(inertias()).tolist(),
        "tool_position": draw(numbers(-0.6, 0.6, 3)),
        "tool_rotation_deg": draw(numbers(-180, 180, 3)),
        "tilted_hexarotor": {
            "alpha_deg": draw(st.floats(15, 50)),
            "beta_deg": draw(st.floats(-20, 20)),
            "arm": draw(st.floats(0.15, 0.6)),
            "thrust_coefficient": draw(logarithmic(1e-4, 1e-2)),
            "drag_coefficient": draw(logarithmic(1e-6, 1e-4)),
            "min_speed": -1000,
            "max_speed": 1000,
        },
    }
    return tilthex.Vehicle.from_dict(described | keys)


gains = logarithmic(0.1, 500)
"""Observer gains, 1/s."""
periods = st.floats(0.5e-3, 10e-3)
"""Sample periods, s."""
forces = numbers(-30, 30, 3)
torques = numbers(-5, 5, 3)


def speeds_for(vehicle: tilthex.Vehicle, body_wrench: np.ndarray) -> np.ndarray:
    """Rotor speeds, Hz, that produce a body wrench."""
    u = np.linalg.solve(vehicle.allocation, body_wrench)
    return np.sign(u) * np.sqrt(abs(u))
