"""The attitude in which a tool is mounted."""

from __future__ import annotations

from tilthex import Vehicle
from tilthex._toml import tomllib


def mounted_rpy_deg(vehicle: Vehicle) -> tuple[float, ...]:
    """Roll, pitch and yaw of the tool while the vehicle hovers level, degrees."""
    return tuple(tomllib.loads(vehicle.to_toml())["vehicle"]["tool_rotation_deg"])
