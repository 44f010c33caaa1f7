"""The allocator against quadratic programs solved level by level (quadprog)."""

import numpy as np
import pytest
import tilthex

from benchmarks.lexicographic import ORDER, compare


def test_the_errors_are_those_of_an_independent_solver():
    # `python -m benchmarks.lexicographic` does more of them.
    tally = compare(seed=1, number=400)
    assert tally.different == 0
    assert tally.limited > 0.3 * tally.problems
    assert tally.refused <= 0.005 * tally.problems


def test_a_part_is_given_up_only_after_those_behind_it():
    vehicle = tilthex.Vehicle.preset("tilt-hex")
    weight = vehicle.mass * tilthex.GRAVITY
    out = tilthex.Allocator(vehicle).allocate([40, 0, weight, 0.1, 0.2, 0.05])
    assert out.given_up == "lateral-force"
    assert out.saturated
    np.testing.assert_allclose(out.wrench[2:], [weight, 0.1, 0.2, 0.05], atol=1e-10)
    assert list(out.shortfall) and out.shortfall["lateral-force"] == pytest.approx(
        np.linalg.norm(out.wrench[:2] - [40, 0])
    )
    config = tilthex.Config.default(vehicle).replace(allocation={"order": list(ORDER)[::-1]})
    other = tilthex.Allocator(vehicle, config).allocate([40, 0, weight, 0.1, 0.2, 0.05])
    assert other.shortfall["lateral-force"] < out.shortfall["lateral-force"]


def test_within_reach_it_is_the_inverse():
    vehicle = tilthex.Vehicle.preset("tilt-hex")
    rng = np.random.default_rng(2)
    allocator = tilthex.Allocator(vehicle)
    for _ in range(200):
        u = rng.uniform(16**2, 110**2, 6)
        out = allocator.allocate(vehicle.allocation @ u)
        np.testing.assert_allclose(out.inputs, u, rtol=0, atol=1e-7)
        assert not out.saturated


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e300, 0.0])
def test_never_a_nan(value):
    for name in tilthex.Vehicle.presets():
        allocator = tilthex.Allocator(tilthex.Vehicle.preset(name))
        for i in range(6):
            wrench = np.zeros(6)
            wrench[i] = value
            try:
                out = allocator.allocate(wrench)
            except ValueError:  # Python refuses what is not finite
                assert not np.isfinite(value)
            else:
                assert np.isfinite(out.inputs).all()
