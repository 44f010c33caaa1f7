"""The controller of `numpy_controller` as a plain loop, compiled with numba: state inside, no allocation.

It is the fastest version that can be written in Python alone. It has the same laws, except that the
admittance filter takes one semi-implicit Euler step, and that rotor limits are a clip.
"""

from __future__ import annotations

import math

import numba
import numpy as np
import tilthex

GRAVITY = tilthex.GRAVITY
jit = numba.njit(fastmath=False, cache=False)


@jit
def product(a, b, out):
    for i in range(3):
        for j in range(3):
            out[i, j] = a[i, 0] * b[0, j] + a[i, 1] * b[1, j] + a[i, 2] * b[2, j]


@jit
def transposed_product(a, b, out):
    for i in range(3):
        for j in range(3):
            out[i, j] = a[0, i] * b[0, j] + a[1, i] * b[1, j] + a[2, i] * b[2, j]


@jit
def apply(a, x, y, z):
    return (
        a[0, 0] * x + a[0, 1] * y + a[0, 2] * z,
        a[1, 0] * x + a[1, 1] * y + a[1, 2] * z,
        a[2, 0] * x + a[2, 1] * y + a[2, 2] * z,
    )


@jit
def back(a, x, y, z):
    return (
        a[0, 0] * x + a[1, 0] * y + a[2, 0] * z,
        a[0, 1] * x + a[1, 1] * y + a[2, 1] * z,
        a[0, 2] * x + a[1, 2] * y + a[2, 2] * z,
    )


@jit
def cross(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@jit
def exp(x, y, z, out):
    t2 = x * x + y * y + z * z
    t = math.sqrt(t2)
    a, b = (1 - t2 / 6, 0.5 - t2 / 24) if t < 1e-4 else (math.sin(t) / t, (1 - math.cos(t)) / t2)
    out[0, 0], out[1, 1], out[2, 2] = (
        1 - b * (y * y + z * z),
        1 - b * (x * x + z * z),
        1 - b * (x * x + y * y),
    )
    out[0, 1], out[1, 0] = b * x * y - a * z, b * x * y + a * z
    out[0, 2], out[2, 0] = b * x * z + a * y, b * x * z - a * y
    out[1, 2], out[2, 1] = b * y * z - a * x, b * y * z + a * x


@jit
def vee(m):
    return 0.5 * (m[2, 1] - m[1, 2]), 0.5 * (m[0, 2] - m[2, 0]), 0.5 * (m[1, 0] - m[0, 1])


@jit
def dead_zone(x, y, z):
    norm = math.sqrt(x * x + y * y + z * z)
    k = 1 - 0.2 / norm if norm > 0.2 else 0.0
    return k * x, k * y, k * z


@jit
def step(vehicle, shape, memory, p, v, r, w, s, speeds, p_d, r_d, dt, command):
    mass, inertia, allocation, inverse, limits, arm, tool = vehicle
    m, d, k = shape
    wrench, smooth, last, move, turn, twist, m1, m2, m3 = memory
    # Wrench observer.
    f0 = f1 = f2 = t0 = t1 = t2 = 0.0
    for i in range(6):
        u = speeds[i] * abs(speeds[i])
        f0 += allocation[0, i] * u
        f1 += allocation[1, i] * u
        f2 += allocation[2, i] * u
        t0 += allocation[3, i] * u
        t1 += allocation[4, i] * u
        t2 += allocation[5, i] * u
    jw = apply(inertia, w[0], w[1], w[2])
    h = apply(r, jw[0], jw[1], jw[2])
    force = apply(r, mass * s[0] - f0, mass * s[1] - f1, mass * s[2] - f2)
    torque = back(r, (h[0] - last[0]) / dt, (h[1] - last[1]) / dt, (h[2] - last[2]) / dt)
    part = -math.expm1(-30.0 * dt)
    if last[3] > 0:
        wrench[0] += part * (force[0] - wrench[0])
        wrench[1] += part * (force[1] - wrench[1])
        wrench[2] += part * (force[2] - wrench[2])
        wrench[3] += part * (torque[0] - t0 - wrench[3])
        wrench[4] += part * (torque[1] - t1 - wrench[4])
        wrench[5] += part * (torque[2] - t2 - wrench[5])
    last[0], last[1], last[2], last[3] = h[0], h[1], h[2], 1.0
    turned = apply(r, wrench[3], wrench[4], wrench[5])
    lever = cross(apply(r, arm[0], arm[1], arm[2]), (wrench[0], wrench[1], wrench[2]))
    part = -math.expm1(-2 * math.pi * 20.0 * dt)
    for i in range(3):
        smooth[i] += part * (wrench[i] - smooth[i])
        smooth[3 + i] += part * (turned[i] - lever[i] - smooth[3 + i])
    push = dead_zone(smooth[0], smooth[1], smooth[2])
    twisting = dead_zone(smooth[3], smooth[4], smooth[5])
    # Admittance filter: one semi-implicit step.
    bend = vee(turn)
    a = (
        (push[0] - d[0] * twist[0] - k[0] * move[0]) / m[0],
        (push[1] - d[1] * twist[1] - k[1] * move[1]) / m[1],
        (push[2] - d[2] * twist[2] - k[2] * move[2]) / m[2],
    )
    alpha = (
        (twisting[0] - d[3] * twist[3] - k[3] * bend[0]) / m[3],
        (twisting[1] - d[4] * twist[4] - k[4] * bend[1]) / m[4],
        (twisting[2] - d[5] * twist[5] - k[5] * bend[2]) / m[5],
    )
    for i in range(3):
        twist[i] = (twist[i] + dt / m[i] * (push[i] - k[i] * move[i])) / (1 + dt * d[i] / m[i])
        j = 3 + i
        twist[j] = (twist[j] + dt / m[j] * (twisting[i] - k[j] * bend[i])) / (1 + dt * d[j] / m[j])
        move[i] += dt * twist[i]
    exp(dt * twist[3], dt * twist[4], dt * twist[5], m1)
    product(m1, turn, m2)
    turn[:, :] = m2
    # Reference of the centre of mass.
    product(turn, r_d, m1)
    for i in range(3):
        for j in range(3):
            m2[i, j] = m1[i, 0] * tool[j, 0] + m1[i, 1] * tool[j, 1] + m1[i, 2] * tool[j, 2]
    lever = apply(m2, arm[0], arm[1], arm[2])
    omega = (twist[3], twist[4], twist[5])
    whirl = cross(omega, lever)
    inward = cross(omega, whirl)
    tangent = cross(alpha, lever)
    # Pose controller.
    transposed_product(r, m2, m3)
    in_reference = back(m2, omega[0], omega[1], omega[2])
    carried = apply(m3, in_reference[0], in_reference[1], in_reference[2])
    in_reference = back(m2, alpha[0], alpha[1], alpha[2])
    commanded = apply(m3, in_reference[0], in_reference[1], in_reference[2])
    error = vee(m3)
    across = cross((w[0], w[1], w[2]), carried)
    x = y = z = 0.0
    for i in range(3):
        wanted = (
            a[i]
            - tangent[i]
            - inward[i]
            + 20.0 * (twist[i] - whirl[i] - v[i])
            + 100.0 * (p_d[i] + move[i] - lever[i] - p[i])
        )
        if i == 2:
            wanted += GRAVITY
        f = mass * wanted - wrench[i]
        x += r[i, 0] * f
        y += r[i, 1] * f
        z += r[i, 2] * f
    wanted = (
        commanded[0] - across[0] - 30.0 * (w[0] - carried[0]) + 225.0 * error[0],
        commanded[1] - across[1] - 30.0 * (w[1] - carried[1]) + 225.0 * error[1],
        commanded[2] - across[2] - 30.0 * (w[2] - carried[2]) + 225.0 * error[2],
    )
    # Compensation and allocation.
    needed = apply(inertia, wanted[0], wanted[1], wanted[2])
    gyro = cross((w[0], w[1], w[2]), jw)
    tx, ty, tz = (
        needed[0] + gyro[0] - wrench[3],
        needed[1] + gyro[1] - wrench[4],
        needed[2] + gyro[2] - wrench[5],
    )
    for i in range(6):
        u = (
            inverse[i, 0] * x
            + inverse[i, 1] * y
            + inverse[i, 2] * z
            + inverse[i, 3] * tx
            + inverse[i, 4] * ty
            + inverse[i, 5] * tz
        )
        speed = math.copysign(math.sqrt(abs(u)), u)
        command[i] = min(max(speed, limits[i, 0]), limits[i, 1])


@jit
def ticks(count, vehicle, shape, memory, p, v, r, w, s, speeds, p_d, r_d, dt, command):
    for _ in range(count):
        step(vehicle, shape, memory, p, v, r, w, s, speeds, p_d, r_d, dt, command)


class Controller:
    """The interface of `numpy_controller.Controller`, and many ticks in one compiled loop."""

    def __init__(self, vehicle, mass, damping, stiffness):
        self.vehicle = (
            vehicle.mass,
            np.ascontiguousarray(vehicle.inertia),
            np.ascontiguousarray(vehicle.allocation),
            np.linalg.inv(vehicle.allocation),
            np.ascontiguousarray(vehicle.rotor_speed_limits),
            np.ascontiguousarray(vehicle.tool_position),
            np.ascontiguousarray(vehicle.tool_rotation),
        )
        self.shape = tuple(np.array(x, dtype=float) for x in (mass, damping, stiffness))
        turn = np.eye(3)
        scratch = [np.zeros((3, 3)) for _ in range(3)]
        self.memory = (np.zeros(6), np.zeros(6), np.zeros(4), np.zeros(3), turn, np.zeros(6), *scratch)
        self.command = np.zeros(6)

    def step(self, p, v, r, w, s, speeds, p_d, r_d, dt):
        step(self.vehicle, self.shape, self.memory, p, v, r, w, s, speeds, p_d, r_d, dt, self.command)
        return self.command.copy()

    def ticks(self, count, p, v, r, w, s, speeds, p_d, r_d, dt):
        """Runs `count` ticks with the same measurements."""
        ticks(count, self.vehicle, self.shape, self.memory, p, v, r, w, s, speeds, p_d, r_d, dt, self.command)
