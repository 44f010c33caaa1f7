"""The allocation problem solved level by level with an independent solver, and random instances of it."""

import numpy as np
import tilthex
from qpsolvers import solve_qp
from scipy.spatial.transform import Rotation

ORDER = {
    "roll-pitch-torque": [3, 4],
    "vertical-force": [2],
    "yaw-torque": [5],
    "lateral-force": [0, 1],
}


def errors(vehicle: tilthex.Vehicle, wanted: np.ndarray, inputs: np.ndarray) -> np.ndarray:
    """Norm of each part's error, in the order of priority."""
    error = wanted - vehicle.allocation @ inputs
    return np.array([np.linalg.norm(error[rows]) for rows in ORDER.values()])


def least_errors(vehicle: tilthex.Vehicle, wanted: np.ndarray) -> np.ndarray:
    """The same of the best inputs, by one quadratic program a level.

    A level's Hessian is singular: quadprog gets it with a proximal term, again
    and again from the last solution, which converges to the exact one.
    """
    limits = vehicle.rotor_speed_limits
    limits = limits * abs(limits)
    scale = abs(limits).max()
    lower, upper = limits.T / scale
    matrix = vehicle.allocation * scale
    n = len(lower)
    x = np.clip(np.zeros(n), lower, upper)
    settled = np.zeros((0, n))
    found = []
    for rows in ORDER.values():
        size = max(np.linalg.norm(matrix[rows], axis=1).max(), 1e-12)
        a, b = matrix[rows] / size, wanted[rows] / size
        kept = {}
        if len(settled):
            _, values, right = np.linalg.svd(settled)
            rank = int((values > 1e-9).sum())
            kept = {"A": right[:rank], "b": right[:rank] @ x}
        proximal = 1e-3
        for _ in range(60):
            hessian = a.T @ a + proximal * np.eye(n)
            step = solve_qp(hessian, -a.T @ b - proximal * x, lb=lower, ub=upper, solver="quadprog", **kept)
            if step is None:  # quadprog finds rounding infeasible at a vertex: x is the solution
                break
            moved = abs(step - x).max()
            x = step
            if moved < 1e-13:
                break
            proximal = max(0.5 * proximal, 1e-6)
        found.append(np.linalg.norm(a @ x - b) * size)
        settled = np.vstack([settled, a])
    return np.array(found)


def random_vehicle(rng: np.random.Generator) -> tilthex.Vehicle:
    """A preset, or 4 to 12 rotors anywhere."""
    if rng.random() < 0.5:
        return tilthex.Vehicle.preset(str(rng.choice(tilthex.Vehicle.presets())))
    while True:
        rotors = []
        for _ in range(rng.integers(4, 13)):
            axis = rng.normal((0, 0, 2))
            rotors.append(
                {
                    "position": (0.3 * rng.normal(size=3)).tolist(),
                    "axis": (axis / np.linalg.norm(axis)).tolist(),
                    "spin": float(rng.choice([-1, 1])),
                    "thrust_coefficient": 11.4e-4 * rng.uniform(0.5, 2),
                    "drag_coefficient": 2.4e-5,
                    "min_speed": float(rng.choice([16, 0, -80])),
                    "max_speed": rng.uniform(80, 120),
                }
            )
        described = {"mass": 2.4, "inertia": [0.01, 0.01, 0.02], "rotors": rotors}
        try:
            vehicle = tilthex.Vehicle.from_dict(described)
        except ValueError:  # can not be controlled
            continue
        if np.linalg.cond(vehicle.allocation[:, :4]) < 1e4:
            return vehicle


def random_wrench(rng: np.random.Generator, vehicle: tilthex.Vehicle) -> np.ndarray:
    """Some within reach, most beyond it by little or by much."""
    force = rng.choice([0, 0.1, 0.5, 2]) * vehicle.mass * tilthex.GRAVITY
    torque = rng.choice([0, 0.1, 1, 5])
    carried = Rotation.from_rotvec(rng.choice([0, 0.3, 1]) * rng.normal(size=3)).apply(
        [0, 0, vehicle.mass * tilthex.GRAVITY]
    )
    return np.concatenate([carried + force * rng.normal(size=3), torque * rng.normal(size=3)])
