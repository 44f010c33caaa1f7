"""Vehicles drawn from *cad* fly `tilthex excite`: errors of `tilthex fit`, compared with its deviations.

    python -m benchmarks.identify [FIRST] [COUNT]

The flights are simulated; the mass is weighed with a deviation of 0.2 %.
"""

from __future__ import annotations

import sys

import numpy as np
import tilthex
from tilthex.excite import trajectory
from tilthex.identify import Flight, identify

MODEL = tilthex.Vehicle.preset("tilt-hex")


def sensed(run: tilthex.simulation.Run) -> Flight:
    """A simulated flight as its sensors measured it, without the first second."""
    time = run["time"][:, 0]
    rotation = run["estimated_rotation"].reshape(-1, 3, 3)
    velocity = np.einsum("nji,nj->ni", rotation, run["estimated_velocity"])
    speeds = run["measured_rotor_speeds"], run["rotor_command"]
    return Flight(time, run["specific_force"], run["gyro"], *speeds, velocity, used=time > 1.0)


def truth(seed: int) -> dict[str, float]:
    """The drawn vehicle's figures, by the names of `identify`."""
    vehicle = tilthex.Truth(MODEL, "cad").draw(seed).vehicle
    pairs = list(zip(vehicle.rotors, MODEL.rotors, strict=True))
    ratio = [a["thrust_coefficient"] / b["thrust_coefficient"] for a, b in pairs]
    centre = np.subtract(MODEL.rotors[0]["position"], vehicle.rotors[0]["position"])
    found = {"mass": vehicle.mass, "thrust, all rotors": float(np.mean(ratio))}
    found |= {f"thrust, rotor {k + 1}": r for k, r in enumerate(ratio)}
    found |= {"drag moment": pairs[0][0]["drag_coefficient"] / pairs[0][1]["drag_coefficient"]}
    found |= {f"centre of mass {a}": float(centre[k]) for k, a in enumerate("xyz")}
    for name, i, j in (("xx", 0, 0), ("yy", 1, 1), ("zz", 2, 2), ("xy", 0, 1), ("xz", 0, 2), ("yz", 1, 2)):
        found[f"inertia {name}"] = float(vehicle.inertia[i, j])
    found |= {"rotor drag": 0.0, "flapping torque": 0.0, "age of rotor speeds": 0.0}
    return found | {"rotor lag": vehicle.rotor_time_constant, "dead time": 0.0}


def main() -> None:
    """Prints one line per figure."""
    first, count = (int(text) for text in [*sys.argv[1:], *["7000", "24"][len(sys.argv) - 1 :]])
    config = tilthex.Config.default(MODEL)
    way = trajectory(MODEL, [0, 0, 1])
    rows: dict[str, list[tuple[float, float]]] = {}
    for seed in range(first, first + count):
        run = tilthex.simulate(config, duration=way.duration, trajectory=way, truth="cad", seed=seed)
        if run.faults:
            # Its flight is another one, which may end in contact with the floor.
            print(f"seed {seed} is left out: {run.faults[0].name} at {run.faults[0].time:.1f} s")
            continue
        true = truth(seed)
        weighed = true["mass"] * (1 + 0.002 * np.random.default_rng(seed).normal())
        for figure in identify([sensed(run)], MODEL, mass=weighed).figures:
            off = figure.value - true[figure.name]
            rows.setdefault(figure.name, []).append((off, off / figure.deviation))
    if not rows:
        return
    print(f"{len(rows['mass'])} vehicles, seeds from {first}: {way.duration:.0f} s of flight each")
    print(f"{'':22s} {'rms off':>10s} {'largest':>10s} {'in 2 deviations':>16s}")
    for name, pairs in rows.items():
        off, by = np.array(pairs).T
        rms, largest = np.sqrt(np.mean(off**2)), np.max(abs(off))
        print(f"{name:22s} {rms:10.2e} {largest:10.2e} {np.mean(abs(by) < 2):16.1%}")
    every = np.array([by for pairs in rows.values() for _, by in pairs])
    print(f"all figures: {np.mean(abs(every) < 2):.1%} of {len(every)} within two deviations")


if __name__ == "__main__":
    main()
