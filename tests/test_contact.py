"""`[contact] discrimination`: wind is compensated, contact moves the tool."""

from __future__ import annotations

import numpy as np
import pytest
import tilthex

from benchmarks.contact import AIR, DRAG

CONFIG = tilthex.Config.default(tilthex.Vehicle.preset("tilt-hex")).replace(
    admittance={"stiffness": [6, 6, 6, 10, 10, 5]}
)
HOME = tilthex.Setpoint([0, 0, 1], np.eye(3))


def away(seed: int, told: bool, pushes=(), level="measured"):
    """How far the reference is from the set-point, m, and the run."""
    config = CONFIG.replace(contact={"discrimination": told, **DRAG})
    truth = {"level": level, "aerodynamics": AIR}
    run = tilthex.simulate(config, duration=16, setpoint=HOME, truth=truth, seed=seed, pushes=pushes)
    return np.linalg.norm(run["reference_position"] - run["setpoint_position"], axis=1), run


@pytest.mark.parametrize("seed", range(7100, 7104))
def test_a_wind_with_gusts_moves_the_tool_only_without_discrimination(seed):
    told, run = away(seed, True)
    taken_for_contact, _ = away(seed, False)
    assert told[4000:].max() < 0.005
    assert taken_for_contact[4000:].max() > 0.02
    assert np.all(run["contact_likelihood"][4000:] < 0.5)


@pytest.mark.parametrize("seed", range(7110, 7114))
def test_a_touch_in_the_wind_moves_the_tool_by_its_own_force(seed):
    """1.4 N less the dead zone, against 6 N/m, whatever the wind is."""
    push = {"at": 8.0, "duration": 8.0, "force": [1.4, 0, 0]}
    told, run = away(seed, True, [push], "exact")
    assert np.all(run["contact_likelihood"][4100:] > 0.5)
    assert told[7500:].mean() == pytest.approx((1.4 - 0.2) / 6, abs=0.03)


def test_without_drag_and_discrimination_nothing_changes():
    plain = tilthex.simulate(CONFIG, duration=2, setpoint=HOME, seed=3)
    off = tilthex.simulate(
        CONFIG.replace(contact={"touch_force": 3.0, **DRAG}), duration=2, setpoint=HOME, seed=3
    )
    assert all(plain[name].tobytes() == off[name].tobytes() for name in plain)
