"""The stiffnesses at which contact with walls is stable: the linear closed loop in one plane.

docs/experiments.md has the derivation. States: position and pitch of the robot and their rates, the
rotors' lagged force and torque, the observer, the low-pass, and the admittance filter. The walls are
springs at points of the rod.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]
TIP_DAMPING = 200.0
"""Damping of the contact that holds the tip, N s/m: almost critical for a stiff contact."""


@dataclass(frozen=True)
class Chain:
    """The parameters of the loop in the plane of a tilted hole; SI units."""

    mass: float = 2.4
    inertia: float = 0.0115
    lever: float = 0.4
    """Distance from the centre of mass down to the tip, m."""
    rotor_lag: float = 0.03
    position_gain: float = 16.0
    velocity_gain: float = 8.0
    rotation_gain: float = 100.0
    angular_velocity_gain: float = 20.0
    observer_gain: float = 30.0
    """Gains of the observer for force and torque, 1/s."""
    low_pass_hz: float = 0.0
    """Cut-off frequency of the low-pass, Hz; 0 for none."""
    translation: tuple[float, float, float] = (1.5, 10.0, 6.0)
    """Mass, damping and stiffness of the admittance filter across the hole."""
    rotation: tuple[float, float, float] = (0.01, 1.5, 0.05)
    """The same about the horizontal axis across the plane."""


def closed_loop(chain: Chain, walls: Sequence[tuple[float, float, float]]) -> Vector:
    """The system matrix, with walls (height above the tip in m, stiffness in N/m, damping in N s/m)."""
    names = 14
    unit = np.eye(names)
    x, pitch, v, w, force, torque, f_hat, t_hat, f_low, t_low, e, e_rate, turn, turn_rate = unit
    c, lever = chain, chain.lever
    push, moment = np.zeros(names), np.zeros(names)
    for height, stiffness, damping in walls:
        arm = lever - height
        one = -stiffness * (x - arm * pitch) - damping * (v - arm * w)
        push, moment = push + one, moment - arm * one
    (m_t, d_t, k_t), (m_r, d_r, k_r) = c.translation, c.rotation
    tool_force, tool_torque = f_hat, t_hat + lever * f_hat
    if c.low_pass_hz > 0.0:
        rate = 2.0 * math.pi * c.low_pass_hz
        low = (rate * (tool_force - f_low), rate * (tool_torque - t_low))
        tool_force, tool_torque = f_low, t_low
    else:
        low = (-f_low, -t_low)
    e_acceleration = (tool_force - d_t * e_rate - k_t * e) / m_t
    turn_acceleration = (tool_torque - d_r * turn_rate - k_r * turn) / m_r
    wanted_x = (
        e_acceleration
        + lever * turn_acceleration
        + c.velocity_gain * (e_rate + lever * turn_rate - v)
        + c.position_gain * (e + lever * turn - x)
    )
    wanted_pitch = (
        turn_acceleration + c.angular_velocity_gain * (turn_rate - w) + c.rotation_gain * (turn - pitch)
    )
    return np.array(
        [
            v,
            w,
            (force + push) / c.mass,
            (torque + moment) / c.inertia,
            (c.mass * wanted_x - f_hat - force) / c.rotor_lag,
            (c.inertia * wanted_pitch - t_hat - torque) / c.rotor_lag,
            c.observer_gain * (push - f_hat),
            c.observer_gain * (moment - t_hat),
            *low,
            e_rate,
            e_acceleration,
            turn_rate,
            turn_acceleration,
        ]
    )


def growth(chain: Chain, walls: Sequence[tuple[float, float, float]]) -> float:
    """The largest real part of the poles of the closed loop, 1/s: positive is unstable."""
    return float(np.linalg.eigvals(closed_loop(chain, walls)).real.max())


def least_damping(chain: Chain, stiffness: float) -> float:
    """The bound D_R > kappa T / (1 + T L), N m s/rad, without low-pass.

    `stiffness` is kappa, N m/rad: the stiffness of the hole against a rotation of the rod about its tip,
    k h^2 for a wall of stiffness k at the height h.
    """
    return stiffness * chain.rotor_lag / (1.0 + chain.rotor_lag * chain.observer_gain)


def chart(chain: Chain, height: float = 0.045, tip_stiffness: float = 1e5) -> Any:
    """Stable and unstable over damping and contact stiffness, and the bound between them."""
    import matplotlib.pyplot as plt

    damping, stiffness = np.geomspace(0.05, 5.0, 41), np.geomspace(1.0, 300.0, 41)
    cases = [(10.0, 0.0), (chain.observer_gain, 0.0), (100.0, 0.0), (chain.observer_gain, 5.0)]
    figure, grid = plt.subplots(1, len(cases), figsize=(15, 4.2), sharey=True, layout="constrained")
    for axes, (gain, hertz) in zip(grid, cases, strict=True):
        base = replace(chain, observer_gain=gain, low_pass_hz=hertz)
        inertia, _, spring = chain.rotation
        rates = np.array(
            [
                [
                    growth(
                        replace(base, rotation=(inertia, d, spring)),
                        ((0.0, tip_stiffness, TIP_DAMPING), (height, kappa / height**2, 0.0)),
                    )
                    for d in damping
                ]
                for kappa in stiffness
            ]
        )
        axes.contourf(damping, stiffness, rates, levels=[-1e3, 0.0, 1e3], colors=["#dff0df", "#f4d6d2"])
        if hertz == 0.0:
            axes.plot([least_damping(base, k) for k in stiffness], stiffness, "k--", lw=1.2, label="bound")
            axes.legend(loc="upper left")
        axes.set(xscale="log", yscale="log", xlabel="$D_R$ (N m s/rad)", xlim=(damping[0], damping[-1]))
        axes.set_title(
            f"observer {gain:g} 1/s, " + (f"low-pass {hertz:g} Hz" if hertz else "no low-pass"),
            fontsize=10,
            loc="left",
        )
    grid[0].set_ylabel("contact stiffness about the tip (N m/rad)")
    figure.suptitle("a rod in a hole: stable (green), unstable (red)", fontsize=11)
    return figure
