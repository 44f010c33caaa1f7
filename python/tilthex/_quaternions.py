"""Quaternions of files and messages; everywhere else a rotation is a matrix."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tilthex import so3

Array = NDArray[np.float64]


def rotations_from_quaternions(xyzw: Array) -> Array:
    """Rotation matrices (m, 3, 3) of quaternions (m, 4) in the order x, y, z, w; NaN stays NaN."""
    with np.errstate(invalid="ignore"):
        x, y, z, w = (xyzw / np.linalg.norm(xyzw, axis=1, keepdims=True)).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), 2, 0)


def quaternion_from_rotation(rotation: Array) -> Array:
    """The quaternion x, y, z, w of a rotation matrix (3, 3); its w is not negative."""
    turn = so3.log(rotation)
    half = 0.5 * float(np.linalg.norm(turn))
    # sin(t/2)/t, without a division by zero at t = 0.
    return np.array([*(0.5 * np.sinc(half / np.pi) * turn), max(0.0, float(np.cos(half)))])
