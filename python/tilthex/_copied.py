"""What `pickle` and `copy` make configurations and vehicles of again: their TOML."""

from __future__ import annotations

from tilthex._core import Config, Vehicle


def config(text: str) -> Config:
    """A configuration of what `Config.to_toml` wrote."""
    return Config.from_text(text)


def vehicle(text: str) -> Vehicle:
    """A vehicle of what `Vehicle.to_toml` wrote."""
    return Config.from_text(text).vehicle
