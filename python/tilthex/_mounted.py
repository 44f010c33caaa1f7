"""The attitude in which a tool is mounted."""

from __future__ import annotations

from tilthex import Config, Vehicle


def mounted_rpy_deg(vehicle: Vehicle) -> tuple[float, ...]:
    """Roll, pitch and yaw of the tool while the vehicle hovers level, degrees."""
    return tuple(Config.default(vehicle).to_dict()["vehicle"]["tool_rotation_deg"])
