"""The estimator on a real recording; skipped where it is not."""

import numpy as np
import pytest
import tilthex
from tilthex.estimate_figures import pose_errors

from benchmarks import broad

pytestmark = pytest.mark.skipif(
    not broad.path().exists(), reason=f"{broad.path()} is not there; TILTHEX_DATA names its folder"
)


@pytest.fixture(scope="module")
def recording():
    return broad.load()


def test_withheld_poses_are_met(recording):
    # What `python -m benchmarks.broad` finds.
    offset = {"body_position": [0.0045, 0.0008, -0.0100], "body_rotation_deg": [-0.081, -0.163, 0.072]}
    config = broad.config().replace(estimator={**offset, "latency": -0.0036})
    number = np.arange(len(recording.pose_time))
    for fed, position, rotation in [
        (number % 3 == 0, 0.25e-3, 0.15),
        (number % 14 == 0, 0.4e-3, 0.15),
        ((number % 14 == 0) & broad.with_gaps(recording, 10.0, 1.0), 3e-3, 0.2),
    ]:
        run = recording.select(fed).estimate(tilthex.Ukf(config))
        errors = pose_errors(recording.select(~fed), run, config)
        assert np.sqrt(np.mean(errors.position**2)) < position
        assert np.degrees(np.sqrt(np.mean(errors.rotation**2))) < rotation
