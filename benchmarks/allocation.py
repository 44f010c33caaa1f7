"""Compares the allocator with NumPy's pseudo-inverse and clip, and with one quadratic program per level.

python -m benchmarks.allocation

Prints the time of one allocation, and its ratio to that of the allocator in the same run. From Python the
allocator's own time is mostly that of the call; `cargo bench -p tilthex-core --bench allocation` measures
the allocator alone.
"""

import timeit

import numpy as np
import tilthex

from benchmarks.lexicographic import least_errors


def best(call, number: int) -> float:
    """Seconds per call: the least of five runs."""
    return min(timeit.repeat(call, number=number, repeat=5)) / number


def main() -> None:
    """Measures each way, with and without active limits."""
    vehicle = tilthex.Vehicle.preset("tilt-hex")
    allocator = tilthex.Allocator(vehicle)
    inverse = np.linalg.pinv(vehicle.allocation)
    lower, upper = (vehicle.rotor_speed_limits**2).T
    weight = vehicle.mass * tilthex.GRAVITY
    print("| wrench | way | time [us] | ratio |\n|---|---|---|---|")
    for name, wrench in (
        ("within reach", np.array([2, 1, weight, 0.1, -0.1, 0.05])),
        ("several limits", np.array([30, 5, weight, 0.5, -0.5, 0.2])),
    ):
        ways = {
            "tilthex.Allocator": (lambda w=wrench: allocator.allocate(w), 20000),
            "NumPy pinv and clip": (lambda w=wrench: np.clip(inverse @ w, lower, upper), 20000),
            "quadprog, level by level": (lambda w=wrench: least_errors(vehicle, w), 100),
        }
        times = {way: best(call, number) for way, (call, number) in ways.items()}
        for way, time in times.items():
            print(f"| {name} | {way} | {1e6 * time:.2f} | {time / times['tilthex.Allocator']:.1f} |")


if __name__ == "__main__":
    main()
