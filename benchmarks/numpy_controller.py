"""The controller and the plant as one would write them in NumPy: clear and without optimisation."""

from __future__ import annotations

import numpy as np
import tilthex
from scipy.spatial.transform import Rotation

GRAVITY = np.array([0.0, 0.0, tilthex.GRAVITY])


def hat(a):
    return np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])


def vee(m):
    return 0.5 * np.array([m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]])


def exp(v):
    return Rotation.from_rotvec(v).as_matrix()


def dead_zone(v, threshold):
    norm = np.linalg.norm(v)
    return v * (1 - threshold / norm) if norm > threshold else np.zeros(3)


class Controller:
    """The default configuration of the Tilt-Hex: the laws of docs/laws.md."""

    def __init__(self, vehicle, mass, damping, stiffness):
        self.mass, self.inertia = vehicle.mass, vehicle.inertia
        self.allocation = vehicle.allocation
        self.inverse = np.linalg.inv(vehicle.allocation)
        self.limits = vehicle.rotor_speed_limits
        self.arm, self.tool = vehicle.tool_position, vehicle.tool_rotation
        self.m, self.d, self.k = (np.diag(x).astype(float) for x in (mass, damping, stiffness))
        self.m_inverse = np.linalg.inv(self.m)
        self.wrench = np.zeros(6)
        self.smooth = np.zeros(6)
        self.last = None
        self.move, self.turn, self.twist = np.zeros(3), np.eye(3), np.zeros(6)

    def step(self, p, v, r, w, s, speeds, p_d, r_d, dt):
        # Wrench observer.
        actuation = self.allocation @ (speeds * np.abs(speeds))
        momentum = r @ self.inertia @ w
        if self.last is not None:
            force = r @ (self.mass * s - actuation[:3])
            torque = r.T @ (momentum - self.last) / dt - actuation[3:]
            self.wrench += -np.expm1(-30.0 * dt) * (np.r_[force, torque] - self.wrench)
        self.last = momentum
        force, torque = self.wrench[:3], self.wrench[3:]
        at_tool = np.r_[force, r @ torque - np.cross(r @ self.arm, force)]
        self.smooth += -np.expm1(-2 * np.pi * 20.0 * dt) * (at_tool - self.smooth)
        push = np.r_[dead_zone(self.smooth[:3], 0.2), dead_zone(self.smooth[3:], 0.2)]
        # Admittance filter: one semi-implicit step.
        e = np.r_[self.move, vee(self.turn)]
        acceleration = self.m_inverse @ (push - self.d @ self.twist - self.k @ e)
        lag = np.linalg.inv(np.eye(6) + dt * self.m_inverse @ self.d)
        self.twist = lag @ (self.twist + dt * self.m_inverse @ (push - self.k @ e))
        self.move = self.move + dt * self.twist[:3]
        self.turn = exp(dt * self.twist[3:]) @ self.turn
        # Reference of the centre of mass.
        r_r = self.turn @ r_d @ self.tool.T
        lever = r_r @ self.arm
        omega, alpha = self.twist[3:], acceleration[3:]
        p_r = p_d + self.move - lever
        v_r = self.twist[:3] - np.cross(omega, lever)
        a_r = acceleration[:3] - np.cross(alpha, lever) - np.cross(omega, np.cross(omega, lever))
        # Pose controller.
        between = r.T @ r_r
        carried = between @ r_r.T @ omega
        v_p = a_r + 20.0 * (v_r - v) + 100.0 * (p_r - p)
        v_w = between @ r_r.T @ alpha - np.cross(w, carried) - 30.0 * (w - carried) - 225.0 * vee(between.T)
        # Compensation and allocation.
        f = r.T @ (self.mass * (v_p + GRAVITY) - force)
        t = self.inertia @ v_w + np.cross(w, self.inertia @ w) - torque
        u = self.inverse @ np.r_[f, t]
        return np.clip(np.sign(u) * np.sqrt(np.abs(u)), self.limits[:, 0], self.limits[:, 1])


class Plant:
    """A rigid body with rotor lag: classical Runge-Kutta on position, velocity, rotation, rate."""

    def __init__(self, vehicle, position):
        self.vehicle = vehicle
        self.mass, self.inertia = vehicle.mass, vehicle.inertia
        self.inverse = np.linalg.inv(vehicle.inertia)
        self.allocation = vehicle.allocation
        self.p, self.v = np.array(position, dtype=float), np.zeros(3)
        self.r, self.w = np.eye(3), np.zeros(3)
        self.speeds = vehicle.hover_speeds()

    def acceleration(self, r, speeds, push):
        actuation = self.allocation @ (speeds * np.abs(speeds))
        torque = actuation[3:] + r.T @ np.cross(r @ self.vehicle.tool_position, push)
        return (r @ actuation[:3] + push) / self.mass - GRAVITY, torque

    def rates(self, state, speeds, push):
        _, v, r, w = state
        a, torque = self.acceleration(r, speeds, push)
        return v, a, r @ hat(w), self.inverse @ (torque - np.cross(w, self.inertia @ w))

    def step(self, command, push, dt):
        speeds = [command + (self.speeds - command) * np.exp(-h / 0.03) for h in (0, dt / 2, dt)]
        start = (self.p, self.v, self.r, self.w)

        def moved(k, h):
            return tuple(x + h * dx for x, dx in zip(start, k, strict=True))

        k1 = self.rates(start, speeds[0], push)
        k2 = self.rates(moved(k1, dt / 2), speeds[1], push)
        k3 = self.rates(moved(k2, dt / 2), speeds[1], push)
        k4 = self.rates(moved(k3, dt), speeds[2], push)
        self.p, self.v, self.r, self.w = (
            x + dt / 6 * (a + 2 * b + 2 * c + d) for x, a, b, c, d in zip(start, k1, k2, k3, k4, strict=True)
        )
        u, _, vt = np.linalg.svd(self.r)
        self.r, self.speeds = u @ vt, speeds[2]
