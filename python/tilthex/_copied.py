"""Functions with which `pickle` and `copy` make configurations and vehicles from their TOML."""

from __future__ import annotations

from tilthex._core import Config, Vehicle


def config(text: str) -> Config:
    """The configuration in the output of `Config.to_toml`."""
    return Config.from_text(text)


def vehicle(text: str) -> Vehicle:
    """The vehicle in the output of `Vehicle.to_toml`."""
    return Config.from_text(text).vehicle
