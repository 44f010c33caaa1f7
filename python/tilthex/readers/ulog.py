"""Logs of PX4 (`.ulg`), read with pyulog."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from tilthex.readers.columns import Stream

POSES = ("vehicle_visual_odometry", "vehicle_mocap_odometry")
"""Topics of poses from an external system; `vehicle_odometry` is PX4's own estimate."""


def read(path: Path) -> list[Stream]:
    """Inertial samples (`sensor_combined`) and external poses, in our axes.

    PX4 has x forward, y right, z down in the body, and z down in the world (local NED or FRD). Both are
    changed to x forward, y left, z up by a rotation of 180 deg about x.

    Raises:
        ValueError: It is not a log of PX4.
    """
    try:
        from pyulog import ULog
    except ImportError as error:
        raise ImportError("reading logs of PX4 needs pyulog: pip install 'tilthex[logs]'") from error
    try:
        with path.open("rb") as file:
            topics = ULog(file, ["sensor_combined", *POSES]).data_list
    except OSError:
        raise
    except Exception as error:
        # A file that is not a log fails in many ways, and the library recognises only some of them.
        raise ValueError(f"{path} cannot be read as a log of PX4: {error}") from error
    return [_stream(path, topic) for topic in topics]


def _stream(path: Path, topic: Any) -> Stream:
    data = {name: np.asarray(values, dtype=float) for name, values in topic.data.items()}
    columns = {"time_us": data["timestamp"]}
    flip = (1.0, -1.0, -1.0)
    if topic.name == "sensor_combined":
        for ours, theirs in (("gyro", "gyro_rad"), ("force", "accelerometer_m_s2")):
            columns |= {f"{ours}_{axis}": flip[k] * data[f"{theirs}[{k}]"] for k, axis in enumerate("xyz")}
    else:
        # Newer logs have arrays, older ones x, y, z.
        names = ["position[0]", "position[1]", "position[2]"] if "position[0]" in data else ["x", "y", "z"]
        turn = ["q[1]", "q[2]", "q[3]", "q[0]"]
        missing = [name for name in (*names, *turn) if name not in data]
        if missing:
            raise ValueError(f"{path}: {topic.name} has no {missing[0]}; expected position or x, y, z, and q")
        if "timestamp_sample" in data:
            columns = {"time_us": data["timestamp_sample"], "arrival_us": data["timestamp"]}
        columns |= {f"position_{axis}": flip[k] * data[names[k]] for k, axis in enumerate("xyz")}
        # A rotation of 180 deg about x on both sides: y and z of the quaternion change their sign.
        signs = (*flip, 1.0)
        columns |= {f"quaternion_{axis}": signs[k] * data[turn[k]] for k, axis in enumerate("xyzw")}
    return Stream(f"{path}, {topic.name}", columns, ("message", 1))
