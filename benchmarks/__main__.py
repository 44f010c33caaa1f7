"""`python -m benchmarks`: compares this library with NumPy on this machine."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
import tilthex

from benchmarks import allocation, instructions, ukf
from benchmarks import numpy_controller as plain

ROUNDS = 7


def best(call: Callable[[], object], count: int) -> float:
    """Time of one call, us: the fastest of some rounds of `count` calls."""
    times = []
    for _ in range(ROUNDS):
        begin = time.perf_counter()
        for _ in range(count):
            call()
        times.append(time.perf_counter() - begin)
    return 1e6 * min(times) / count


def row(name: str, ours: float, numpy: float) -> None:
    print(f"{name:48s} {ours:10.2f} {numpy:10.2f} {numpy / ours:10.0f}")


VEHICLE = tilthex.Vehicle.preset("tilt-hex")
CONFIG = tilthex.Config.default(VEHICLE)
HOME = tilthex.Setpoint([0, 0, 1], np.eye(3))
START = HOME.position - VEHICLE.tool_position
PUSH = np.array([1.4, 0, 0])
SHAPE = ([1.5] * 3 + [0.01, 0.01, 0.02], [10] * 3 + [4] * 3, [6] * 3 + [10, 10, 5])


def numpy_run(duration: float) -> np.ndarray:
    controller, plant = plain.Controller(VEHICLE, *SHAPE), plain.Plant(VEHICLE, START)
    for _ in range(round(duration / 0.002)):
        a, _ = plant.acceleration(plant.r, plant.speeds, PUSH)
        s = plant.r.T @ (a + plain.GRAVITY)
        command = controller.step(
            plant.p, plant.v, plant.r, plant.w, s, plant.speeds, HOME.position, np.eye(3), 0.002
        )
        for _ in range(2):
            plant.step(command, PUSH, 0.001)
    return plant.p + plant.r @ VEHICLE.tool_position


def rust_run(duration: float, noise: float = 0.0, **options: object) -> np.ndarray:
    push = {"at": 0.0, "duration": duration, "force": PUSH}
    run = tilthex.simulate(
        CONFIG,
        duration=duration,
        setpoint=HOME,
        pushes=[push],
        noise=noise,
        record=["tool_position"],
        **options,
    )
    return run["tool_position"][-1]


def compiled_row(r: np.ndarray, zero: np.ndarray, up: np.ndarray, speeds: np.ndarray) -> None:
    """Compares the tick in Rust with a plain loop of the same laws, compiled with numba."""
    try:
        from benchmarks import numba_controller
    except ImportError:
        print("controller tick beside a numba loop: left out, there is no numba (pip install '.[bench]')")
        return
    ticked = (START, zero, r, zero, up, speeds, HOME.position, r, 0.002)
    looped, reference = numba_controller.Controller(VEHICLE, *SHAPE), plain.Controller(VEHICLE, *SHAPE)
    for _ in range(100):
        apart = np.abs(looped.step(*ticked) - reference.step(*ticked)).max()
        if not apart < 1e-9:
            raise SystemExit(f"the numba loop and NumPy differ by {apart:.1e} Hz; expected the same laws")
    count = 100_000
    loop = best(lambda: looped.ticks(count, *ticked), 1) / count
    instructions.build()
    ours = instructions.microseconds("controller tick")
    name = "controller tick, compiled (beside numba, Euler)"
    print(f"{name:48s} {ours:10.2f} {loop:10.2f} {loop / ours:10.2f}")


def many_rows(numpy_step: float) -> None:
    """Prints the time of a world and period of `simulate_many` on one core and on two, and their ratio."""
    worlds, periods = 1000, 250

    def fly(workers: int) -> None:
        tilthex.simulate_many(
            CONFIG,
            seeds=range(worlds),
            duration=0.002 * periods,
            setpoint=HOME,
            noise=0,
            estimator=False,
            workers=workers,
        )

    one, two = (best(lambda workers=workers: fly(workers), 1) / (worlds * periods) for workers in (1, 2))
    row("simulate_many, a world and period, one core", one, numpy_step)
    row("the same on two cores", two, numpy_step)
    print(f"{'  two cores beside one, times as fast':48s} {one / two:10.2f}")


def main() -> None:
    # The times mean something only if both do the same work.
    apart = np.linalg.norm(numpy_run(10.0) - rust_run(10.0, estimator=False))
    if not apart < 2e-3:
        raise SystemExit(f"the two versions end {apart:.4f} m apart; expected the same flight")

    print(f"{'microseconds':48s} {'tilthex':>10s} {'NumPy':>10s} {'ratio':>10s}")
    controller, reference = tilthex.Controller(VEHICLE, CONFIG), plain.Controller(VEHICLE, *SHAPE)
    r, zero, speeds = np.eye(3), np.zeros(3), VEHICLE.hover_speeds()
    up = np.array([0, 0, tilthex.GRAVITY])
    row(
        "controller, one call from Python",
        best(
            lambda: controller.step(
                position=START,
                velocity=zero,
                rotation=r,
                angular_velocity=zero,
                specific_force=up,
                rotor_speeds=speeds,
                setpoint=HOME,
            ),
            2000,
        ),
        best(lambda: reference.step(START, zero, r, zero, up, speeds, HOME.position, r, 0.002), 200),
    )
    compiled_row(r, zero, up, speeds)
    steps = 5000
    numpy_step = best(lambda: numpy_run(0.4), 1) / 200
    for name, noise, estimator in (
        ("closed loop in Rust, one period, exact state", 0, False),
        ("the same with the estimator (NumPy: without)", 0, True),
        ("exact state, noise (NumPy: no noise)", 1, False),
        ("estimator and noise (NumPy: neither)", 1, True),
    ):

        def period(noise: int = noise, estimator: bool = estimator) -> object:
            return rust_run(0.002 * steps, noise=noise, estimator=estimator)

        row(name, best(period, 1) / steps, numpy_step)
    many_rows(numpy_step)
    print()
    ukf.main()
    print()
    allocation.main()


if __name__ == "__main__":
    main()
