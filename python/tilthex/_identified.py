"""Inputs and results of the identification: flights, figures, and the windows of a flight."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

WINDOW = 1.0
"""Length of the windows, s. In each window the rate is integrated from its first value."""
BLOCK = 1.0
"""Residuals that are further apart than this count as independent, s."""
LEARNT = 0.5
"""A figure is learnt if the flight reduced its deviation to less than this part."""
PRIOR = {
    "mass": 0.03,
    "thrust": 0.05,
    "thrust_each": 0.03,
    "drag_moment": 0.15,
    "rotor_axis": np.radians(1.5),
    "centre_of_mass": 0.006,
    "inertia": 0.15,
    "inertia_product": 0.05,
    "accelerometer_bias": 0.1,
    "rotor_drag": 3e-4,
    "flapping": 5e-6,
    "speed_age": 0.003,
    "rotor_lag": 0.3,
    "dead_time": 0.005,
    "throttle_exponent": 0.5,
}
"""Standard deviations before a flight: fractions, rad, m, fractions of the inertia, m/s^2, N s/m per Hz,
N m s/m per Hz, s, 1."""


@dataclass(frozen=True)
class Flight:
    """A flight, one row per sample, with constant time steps.

    `used` is False while the vehicle stands on the ground. `identify` finds contact in the air.
    """

    time: Array
    specific_force: Array
    """Specific force at the model's centre of mass, m/s^2, robot axes, (N, 3)."""
    angular_velocity: Array
    """Angular velocity, rad/s, robot axes, (N, 3)."""
    rotor_speeds: Array
    """Measured rotor speeds, Hz, (N, n)."""
    rotor_command: Array | None = None
    """Commanded rotor speeds, Hz, (N, n); they show the rotors' lag."""
    velocity: Array | None = None
    """Velocity, m/s, robot axes, (N, 3); it shows drag and flapping of the rotors."""
    used: Mask | None = None
    speed_age: float = 0.0
    """The age of the measured speeds that the flight corrected, s: its `[link] rotor_speed_age`."""
    mapped_speeds: Array | None = None
    """Speeds that the map of the link gives for the throttles at its voltage, Hz, (N, n), or NaN."""
    voltage: Array | None = None
    """Voltage of the battery as a part of the map's, (N,)."""
    exponent: float = 1.0
    """`[link] throttle_exponent` of the flight."""
    throttle_map: tuple[float, ...] = ()
    """Coefficients and voltage of the map."""

    @cached_property
    def rotor_acceleration(self) -> Array:
        """Smoothed slope of the measured speeds, Hz/s, (N, n)."""
        from scipy.signal import savgol_filter

        step = float(np.median(np.diff(self.time)))
        half = max(2, round(0.01 / step))
        return np.asarray(savgol_filter(self.rotor_speeds, 2 * half + 1, 2, deriv=1, delta=step, axis=0))

    def rows(self, values: Array, step: float) -> Array:
        """Means of a column (N, ...) of this flight over `step`, s."""
        count = max(1, round(step / float(np.median(np.diff(self.time)))))
        rows = len(self.time) // count
        whole: Array = values[: rows * count].reshape(rows, count, *values.shape[1:]).mean(axis=1)
        return whole

    def coarser(self, step: float) -> Flight:
        """Means over two or more samples, so that rows are about `step` apart, s."""

        def mean(values: Array) -> Array:
            return self.rows(values, step)

        return Flight(
            mean(self.time),
            mean(self.specific_force),
            mean(self.angular_velocity),
            mean(self.rotor_speeds),
            None if self.rotor_command is None else mean(self.rotor_command),
            None if self.velocity is None else mean(self.velocity),
            None if self.used is None else mean(self.used.astype(float)) > 0.999,
            self.speed_age,
        )


@dataclass(frozen=True)
class Figure:
    """A parameter with its standard deviations after and before the flight, and the value of the model."""

    name: str
    unit: str
    value: float
    deviation: float
    prior: float
    model: float
    given: float | None = None
    """The user's value before the flight, with the deviation `prior`; the flight need not determine it."""

    @property
    def learnt(self) -> bool:
        """Whether the flight determines it."""
        return self.deviation < LEARNT * self.prior

    @property
    def known(self) -> bool:
        """Whether the flight or the user determines it."""
        return self.learnt or self.given is not None

    def __str__(self) -> str:
        """One line of a table."""
        figure = f"{self.name:22s} {self.value:12.6g} +- {self.deviation:9.2g} {self.unit:10s}"
        if self.given is not None:
            return f"{figure} (given: {self.given:.5g} +- {self.prior:.2g}, model: {self.model:.5g})"
        tail = "" if self.learnt else "  not learnt"
        return f"{figure} (model: {self.model:.5g} +- {self.prior:.2g}){tail}"


def windows(flight: Flight, length: float) -> NDArray[np.int64]:
    """The number of the window of each sample; -1 if its window is not complete."""
    step = float(np.median(np.diff(flight.time)))
    number: NDArray[np.int64] = np.floor((flight.time - flight.time[0]) / length + 1e-9).astype(np.int64)
    counts = np.bincount(number)
    number[counts[number] < 0.9 * length / step] = -1
    return number


def centred(values: Array, window: NDArray[np.int64]) -> Array:
    """The values minus the mean of their window; 0 outside of all windows."""
    inside = window >= 0
    number = np.where(inside, window, window.max() + 1)
    counts = np.maximum(np.bincount(number), 1)
    means = np.stack([np.bincount(number, column) / counts for column in values.T], axis=1)
    return np.asarray((values - means[number]) * inside[:, None])
