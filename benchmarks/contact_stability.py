"""Predicted and flown borders of stable contact: `python -m benchmarks.contact_stability`.

Each case draws a vehicle, its delays, observer, admittance, and a surface with a direction and a damping.
The model (`tilthex.LoopModel`) predicts the stiffness at which contact stops being stable. The case is
then flown at 0.7 and 1.3 times that stiffness, with the controller at 500 Hz and the core's plant. Its
tip is held in both directions by a spring and a damper, presses with 2 N, and there is no noise. A tap
must die out below the border and grow above it. If no border is predicted between 0.2 and 50 kN/m, both
ends are flown.
"""

from __future__ import annotations

import argparse
from collections import deque
from dataclasses import dataclass
from typing import Any

import numpy as np
import tilthex

PERIOD = 0.002
SUBSTEPS = 8
SOFTEST, STIFFEST = 200.0, 50e3
WITHIN = 0.3
PRESSED = 2.0
"""Force on the surface, N: above the dead zone."""
TAP, TAPPED = 3.0, 0.02
"""Start and duration, s, of a tap on the tool with a tenth of that force."""
WINDOWS = (0.1, 1.3, 3.0, 4.2)
"""Start and end of the two intervals, s since the tap, in which the motion is compared."""
LARGEST = 30.0
"""Only an unstable contact reaches this force, N."""


@dataclass(frozen=True)
class Case:
    """A vehicle in contact with a surface."""

    config: tilthex.Config
    delay_ticks: int
    direction: np.ndarray
    damping_time: float

    @property
    def model(self) -> tilthex.LoopModel:
        """The configuration with the delays of the flight: rotor speeds have no age."""
        return tilthex.LoopModel(self.config, rotor_speed_age=0.0)


def draw(seed: int) -> Case:
    """A random case."""
    rng = np.random.default_rng(seed)

    def spread(low: float, high: float) -> float:
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))

    scale = spread(0.7, 1.5)
    wide = spread(0.7, 1.5)
    vehicle = tilthex.Vehicle.from_dict(
        {
            "preset": "tilt-hex",
            "mass": 2.4 * scale,
            "inertia": [0.0115 * wide, 0.0114 * wide, 0.0194 * wide],
            "rotor_time_constant": spread(0.02, 0.06),
            "tool_position": [*rng.uniform(-0.2, 0.2, 2), rng.uniform(-0.5, -0.1)],
        }
    )
    ticks = int(rng.integers(0, 4))
    text = f"{vehicle.to_toml()}\n[link]\nloop_delay = {ticks * PERIOD}\n"
    mass, damping, stiffness = spread(0.3, 6.0), spread(4.0, 60.0), spread(4.0, 60.0)
    gain = spread(10.0, 60.0)
    config = tilthex.Config.from_text(text)
    config = config.replace(**tilthex.LoopModel(config).derive()).replace(
        wrench_observer={"force_gain": gain, "torque_gain": gain},
        admittance={
            "mass": [mass] * 3 + [0.01, 0.01, 0.02],
            "damping": [damping] * 3 + [4.0] * 3,
            "stiffness": [stiffness] * 3 + [10.0, 10.0, 5.0],
            "low_pass_hz": float(rng.choice([0.0, 5.0, 20.0])),
        },
    )
    direction = rng.normal(size=3)
    return Case(config, ticks, direction / np.linalg.norm(direction), spread(2e-5, 5e-4))


def grows(case: Case, stiffness: float) -> bool:
    """Whether the oscillation of a flown contact with this stiffness grows."""
    controller = tilthex.Controller(case.config.vehicle, case.config)
    plant = tilthex.Plant(case.config.vehicle, [0.0, 0.0, 2.0])
    start, normal = plant.tool_position, case.direction
    setpoint = tilthex.Setpoint(start, np.eye(3), wrench=[*(-PRESSED * normal), 0, 0, 0])
    waiting = deque([plant.rotor_speeds] * case.delay_ticks)
    dt = PERIOD / SUBSTEPS
    lever = case.config.vehicle.tool_position
    forces = []
    for tick in range(round((TAP + WINDOWS[3]) / PERIOD)):
        out = controller.step(
            **plant.measured,
            setpoint=setpoint,
        )
        waiting.append(out.rotor_speeds)
        command = waiting.popleft()
        tap = 0.1 * PRESSED if TAP <= tick * PERIOD < TAP + TAPPED else 0.0
        for _ in range(SUBSTEPS):
            speed = plant.velocity + plant.rotation @ np.cross(plant.angular_velocity, lever)
            depth = normal @ (plant.tool_position - start)
            # A force that is constant over a substep acts half a substep late.
            force = -stiffness * (depth + (case.damping_time + 0.5 * dt) * (normal @ speed))
            plant.step(command, tool_wrench=[*((force + tap) * normal), 0.0, 0.0, 0.0], dt=dt)
        if abs(force) > LARGEST or not np.isfinite(force):
            return True
        forces.append(force)
    since = np.arange(len(forces)) * PERIOD - TAP
    early, late = (
        np.std(np.array(forces)[(since >= a) & (since < b)]) for a, b in (WINDOWS[:2], WINDOWS[2:])
    )
    return bool(late > early)


def judge(case: Case) -> tuple[float, list[tuple[float, bool, bool]]]:
    """The predicted border, N/m, and the flights: stiffness, whether it should grow, whether it grew."""
    found = case.model.contact(along=case.direction, damping_time=case.damping_time)
    border = found[0][1] if found and found[0][0] == 0.0 else 0.0

    def holds(stiffness: float) -> bool:
        return any(low <= stiffness < high for low, high in found)

    if SOFTEST < border < STIFFEST:
        # Another stable range may begin just above the border; a flight there must still be
        # unstable.
        stiffnesses = [(1 - WITHIN) * border]
        if not holds((1 + WITHIN) * border):
            stiffnesses.append((1 + WITHIN) * border)
    else:
        stiffnesses = [SOFTEST, STIFFEST]
    return border, [(k, not holds(k), grows(case, k)) for k in stiffnesses]


def main(arguments: list[str] | None = None) -> None:
    """Prints a table, and the number of cases that agree."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=100)
    parser.add_argument("--first", type=int, default=8000, help="the first case's seed")
    chosen = parser.parse_args(arguments)
    agree: dict[str, list[bool]] = {"a border": [], "none": []}
    for seed in range(chosen.first, chosen.first + chosen.cases):
        border, flown = judge(draw(seed))
        good = all(expected == found for _, expected, found in flown)
        agree["a border" if SOFTEST < border < STIFFEST else "none"].append(good)
        told: Any = ", ".join(
            f"{k:.0f} N/m {'grew' if found else 'died out'}{'' if found == expected else ' (WRONG)'}"
            for k, expected, found in flown
        )
        print(f"seed {seed}: predicted border {border:.0f} N/m; {told}", flush=True)
    for name, results in agree.items():
        print(
            f"{name} between {SOFTEST:g} and {STIFFEST:g} N/m: {sum(results)} of {len(results)} as predicted"
        )


if __name__ == "__main__":
    main()
