"""The age of the measured rotor speeds in a log, for `tilthex calibrate`: that of `tilthex fit`."""

from __future__ import annotations

from dataclasses import dataclass

from tilthex import fit
from tilthex._core import Config
from tilthex._identified import Figure
from tilthex._priors import Prior
from tilthex.identify import identify
from tilthex.log import Log

EXACT = 1e-6
"""Deviation of an age that is not searched, s."""


@dataclass(frozen=True)
class SpeedAge:
    """The key `[link] rotor_speed_age` with its deviation, and what the rotors do not explain.

    `before`, `after`: the specific force, m/s^2, and the rate, rad/s, that are not explained with the
    configured age and with the found one.
    """

    age: Figure
    before: tuple[float, float]
    after: tuple[float, float]

    def __str__(self) -> str:
        return fit.link_keys([self.age]).rstrip()

    def table(self) -> list[str]:
        """The lines before and after."""
        rows = ("before", self.before), ("with all keys", self.after)
        return [f"  {name}: {force:.4g} m/s^2, {rate:.4g} rad/s" for name, (force, rate) in rows]


def find_speed_age(log: Log, config: Config) -> SpeedAge:
    """The age that explains a flight best; all figures of `identify` are searched with it, and without it.

    Raises:
        ValueError: The log holds too little free flight.
    """
    flight = fit.read(log)
    found = identify([flight], config.vehicle)
    age = found["age of rotor speeds"]
    configured = float(config.to_dict()["link"]["rotor_speed_age"])
    kept = identify([flight], config.vehicle, priors={age.name: Prior(configured, EXACT)})
    return SpeedAge(age, kept.residual, found.residual)
