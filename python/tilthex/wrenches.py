"""An estimated and a measured wrench side by side: the paper's low-pass, and pictures."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

LOW_PASS = 6.0
"""Cut-off of the paper's low-pass without phase shift, Hz."""
NAMES = ("force x", "force y", "force z", "torque x", "torque y", "torque z")


def without_phase(values: Array, rate: float, cut_off: float = LOW_PASS) -> Array:
    """The paper's second-order Butterworth low-pass, forwards and backwards; rates in Hz."""
    from scipy.signal import butter, filtfilt

    b, a = butter(2, cut_off, fs=rate)
    return np.asarray(filtfilt(b, a, values, axis=0))


def norms(time: Array, estimate: Array, sensor: Array) -> Figure:
    """The layout of the paper's figure 4: both wrenches, and the norms of their difference with a line."""
    import matplotlib.pyplot as plt

    figure, grid = plt.subplots(2, 2, figsize=(14, 8), sharex=True, layout="constrained")
    for row, name, first in ((grid[0], "force (N)", 0), (grid[1], "torque (N m)", 3)):
        ours, theirs = estimate[:, first : first + 3], sensor[:, first : first + 3]
        for k, colour in enumerate(("tab:blue", "tab:red", "tab:orange")):
            row[0].plot(time, theirs[:, k], "--", color=colour, lw=1.0)
            row[0].plot(time, ours[:, k], color=colour, lw=0.8, label="xyz"[k])
        norm = np.linalg.norm(ours - theirs, axis=1)
        row[1].plot(time, norm, lw=0.8)
        row[1].plot(time, np.polyval(np.polyfit(time, norm, 1), time), "r", lw=1.0)
        row[0].set_title(f"{name}: estimated, sensor dashed", fontsize=10, loc="left")
        row[1].set_title("norm of the difference, and a line through it", fontsize=10, loc="left")
        row[0].legend()
    for axes in grid[1]:
        axes.set_xlabel("time (s)")
    return figure


def components(time: Array, estimate: Array, sensor: Array) -> Figure:
    """One row per component: forces left, torques right, sensor dashed, differences below in grey."""
    import matplotlib.pyplot as plt

    figure, grid = plt.subplots(3, 2, figsize=(14, 9), sharex=True, layout="constrained")
    for k, name in enumerate(NAMES):
        axes = grid[k % 3, k // 3]
        axes.plot(time, estimate[:, k] - sensor[:, k], color="0.7", lw=0.8, label="difference")
        axes.plot(time, sensor[:, k], "k--", lw=1.0, label="sensor")
        axes.plot(time, estimate[:, k], color="tab:blue", lw=1.0, label="estimated")
        axes.set_title(f"{name}, tool axes ({'N' if k < 3 else 'N m'})", fontsize=10, loc="left")
    grid[0, 0].legend(ncols=3)
    for axes in grid[2]:
        axes.set_xlabel("time (s)")
    return figure
