"""`python -m benchmarks.lexicographic`: the allocator against quadratic programs solved level by level.

Random vehicles and wrenches. The reference is quadprog, called once or more for each priority.
"""

from __future__ import annotations

import argparse
import multiprocessing
from dataclasses import dataclass

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


def least_errors(vehicle: tilthex.Vehicle, wanted: np.ndarray) -> tuple[np.ndarray, bool]:
    """The same errors for the best inputs, by one quadratic program per level; and whether quadprog
    solved all of them.

    The Hessian of a level is singular. Therefore quadprog gets a proximal term and is called again and
    again from the last solution, which converges to the exact one.
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
    complete = True
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
            if step is None:  # quadprog finds rounding infeasible at a vertex
                complete = False
                break
            moved = abs(step - x).max()
            x = step
            if moved < 1e-13:
                break
            proximal = max(0.5 * proximal, 1e-6)
        found.append(np.linalg.norm(a @ x - b) * size)
        settled = np.vstack([settled, a])
    return np.array(found), complete


def random_vehicle(rng: np.random.Generator) -> tilthex.Vehicle:
    """A preset, or 4 to 12 rotors at random places."""
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
        except ValueError:  # cannot be controlled
            continue
        if np.linalg.cond(vehicle.allocation[:, :4]) < 1e4:
            return vehicle


def random_wrench(rng: np.random.Generator, vehicle: tilthex.Vehicle) -> np.ndarray:
    """Wrenches: some within reach, most of them a little or far beyond it."""
    force = rng.choice([0, 0.1, 0.5, 2]) * vehicle.mass * tilthex.GRAVITY
    torque = rng.choice([0, 0.1, 1, 5])
    carried = Rotation.from_rotvec(rng.choice([0, 0.3, 1]) * rng.normal(size=3)).apply(
        [0, 0, vehicle.mass * tilthex.GRAVITY]
    )
    return np.concatenate([carried + force * rng.normal(size=3), torque * rng.normal(size=3)])


@dataclass
class Tally:
    """The results of some problems.

    Attributes:
        problems: Number of problems.
        limited: Problems whose solution has rotors at their limits.
        refused: Problems in which quadprog refused a program, so that the reference is worse.
        different: Problems that differ in any other way.
        largest: Largest difference of a part's error in all other problems, N or N m per `1 + |wrench|`.
        longest: Largest number of steps of a search.
    """

    problems: int = 0
    limited: int = 0
    refused: int = 0
    different: int = 0
    largest: float = 0.0
    longest: int = 0

    def add(self, other: Tally) -> None:
        self.problems += other.problems
        self.limited += other.limited
        self.refused += other.refused
        self.different += other.different
        self.largest = max(self.largest, other.largest)
        self.longest = max(self.longest, other.longest)


TOLERANCE = 1e-8
"""Allowed difference of a part's error, N or N m per `1 + |wrench|`."""


def compare(seed: int, number: int) -> Tally:
    """Solves random problems in both ways.

    Raises:
        ValueError: A rotor is commanded beyond its limits.
    """
    rng = np.random.default_rng(seed)
    tally = Tally(number)
    for _ in range(number):
        vehicle = random_vehicle(rng)
        wanted = random_wrench(rng, vehicle)
        out = tilthex.Allocator(vehicle).allocate(wanted)
        low, high = vehicle.rotor_speed_limits.T
        if (out.rotor_speeds < low - 1e-9).any() or (out.rotor_speeds > high + 1e-9).any():
            raise ValueError(f"rotor speeds {out.rotor_speeds} Hz are beyond the limits for {wanted}")
        tally.longest = max(tally.longest, out.iterations)
        if out.iterations == 0:
            continue
        tally.limited += 1
        least, complete = least_errors(vehicle, wanted)
        difference = errors(vehicle, wanted, out.inputs) - least
        difference /= 1 + np.linalg.norm(wanted)
        # The first part that differs decides.
        differs = np.flatnonzero(abs(difference) > TOLERANCE)
        if not len(differs):
            tally.largest = max(tally.largest, float(abs(difference).max()))
        elif difference[differs[0]] < 0 and not complete:
            tally.refused += 1
        else:
            tally.different += 1
    return tally


def main() -> None:
    parser = argparse.ArgumentParser(description="Compares the allocator with quadprog on random problems.")
    parser.add_argument("--number", type=int, default=10_000, help="number of problems (default: 10000)")
    parser.add_argument("--jobs", type=int, default=1, help="number of processes (default: 1)")
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    share = 500
    sizes = [min(share, arguments.number - done) for done in range(0, arguments.number, share)]
    total = Tally()
    with multiprocessing.Pool(arguments.jobs) as pool:
        for tally in pool.starmap(compare, [(arguments.seed + k, n) for k, n in enumerate(sizes)], 1):
            total.add(tally)
    print(
        f"{total.problems} problems, {total.limited} at limits: {total.refused} that quadprog refused and "
        f"the allocator solved better; {total.different} of the others differ, the largest difference is "
        f"{total.largest:.1e}; longest search {total.longest} steps"
    )
    if total.different:
        raise SystemExit(1)


if __name__ == "__main__":
    main()
