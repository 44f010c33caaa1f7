"""The estimator is as good as a plain error-state filter without a gate where noises do not match."""

import numpy as np
import pytest

from benchmarks import eskf, ungated

CELLS = {cell.name: cell for cell in ungated.CELLS}


@pytest.mark.parametrize(
    "name",
    [
        "vibration, 10 Hz, 30 ms late, gaps of 1 s",
        "poses 10 times as noisy",
        "IMU 10 times as noisy, 10 Hz, gaps",
        "the same, 10 Hz, 30 ms late, gaps",
    ],
)
def test_no_worse_than_without_a_gate(name):
    noise = eskf.Noise()
    fed, truth = ungated.recording(CELLS[name], 20_000, noise, seconds=16.0)
    found = [ungated.compare(fed, truth, ungated.config(), noise)]
    for part in ("position", "rotation"):
        ours, theirs = ungated.figures(found, part)
        assert np.all(np.isfinite(theirs))
        assert ours[0] < 1.1 * theirs[0]
        assert ours[1] < 1.1 * theirs[1]


def test_the_two_filters_are_one_where_noises_match():
    noise = eskf.Noise()
    fed, truth = ungated.recording(CELLS["matched noises, 20 Hz"], 20_001, noise, seconds=10.0)
    ours, theirs = ungated.figures([ungated.compare(fed, truth, ungated.config(), noise)], "position")
    assert ours[0] == pytest.approx(theirs[0], rel=0.02)
