"""Many flights at once: each is the single flight, and what is wrong is said."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
import tilthex

CONFIG = tilthex.Config.default(tilthex.Vehicle.preset("tilt-hex"))
SOFT = CONFIG.replace(admittance={"stiffness": [4.0, 4.0, 4.0, 10.0, 10.0, 5.0]})
HOME = tilthex.Setpoint([0, 0, 1], np.eye(3))
PUSH = {"at": 0.2, "duration": 1.0, "force": [2.0, 0, 0]}


def test_each_flight_is_the_single_one_to_the_bit():
    configs, truths, seeds = [CONFIG, SOFT, CONFIG, SOFT], ["measured", "cad", None, "exact"], [3, 4, 5, 6]
    runs = tilthex.simulate_many(
        configs,
        truths,
        seeds,
        duration=1.0,
        setpoint=HOME,
        pushes=[PUSH],
        record=("tool_position", "phase"),
        workers=3,
    )
    assert runs.record.keys() == {"tool_position", "phase"}
    for k, (config, truth, seed) in enumerate(zip(configs, truths, seeds, strict=True)):
        one = tilthex.simulate(config, duration=1.0, setpoint=HOME, pushes=[PUSH], seed=seed, truth=truth)
        np.testing.assert_array_equal(runs.record["tool_position"][k], one["tool_position"])
        error = np.linalg.norm(one["position_error"], axis=1)
        assert runs["position_error_largest"][k] == pytest.approx(error.max(), rel=1e-12)
        assert runs["position_error_rms"][k] == pytest.approx(np.sqrt(np.mean(error**2)), rel=1e-9)
        off = np.linalg.norm(one["tool_position"] - one["setpoint_position"], axis=1)
        assert runs["tool_deviation_largest"][k] == pytest.approx(off.max(), rel=1e-12)
        assert runs["tool_force_largest"][k] == 2.0
        tilt = np.arccos(np.clip(one["rotation"][:, 8], -1, 1))
        assert runs["tilt_largest"][k] == pytest.approx(tilt.max(), abs=1e-9)
        assert runs["saturated"][k] == one["saturated"].mean()
        assert runs["phase"][k] == one["phase"][-1]
    np.testing.assert_array_equal(runs["seed"], seeds)


@pytest.mark.parametrize("workers", [1, 2, 7])
def test_the_number_of_workers_changes_nothing(workers):
    runs = tilthex.simulate_many(CONFIG, "cad", range(5), duration=0.2, setpoint=HOME, workers=workers)
    alone = tilthex.simulate_many(CONFIG, "cad", range(5), duration=0.2, setpoint=HOME, workers=2)
    assert runs.keys() == alone.keys()
    for name, column in runs.items():
        np.testing.assert_array_equal(column, alone[name])


def test_progress_counts_to_the_end_and_its_exception_ends_the_flights(capsys):
    told = []
    runs = tilthex.simulate_many(
        CONFIG,
        seeds=range(4),
        duration=0.1,
        setpoint=HOME,
        progress=lambda ended, count: told.append((ended, count)),
    )
    assert told[-1] == (4, 4) and told == sorted(told) and len(runs["seed"]) == 4
    tilthex.simulate_many(CONFIG, seeds=range(2), duration=0.1, setpoint=HOME, progress=True)
    assert "2 of 2 flights\n" in capsys.readouterr().err

    def stop(ended: int, count: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        tilthex.simulate_many(CONFIG, seeds=range(1000), duration=60, setpoint=HOME, progress=stop, workers=2)


@pytest.mark.parametrize(
    ("changes", "kind", "says"),
    [
        (
            {"seeds": range(3), "truths": ["cad"] * 2},
            ValueError,
            "found 2 truths, 3 seeds; expected equally many",
        ),
        ({"record": ["tool"]}, ValueError, 'record has "tool"; expected any of time, position'),
        ({"nois": 1.0}, TypeError, "got nois; expected any of duration"),
        ({"duration": None}, TypeError, "duration"),
        ({"setpoint": None}, ValueError, "expected exactly one of them"),
        ({"truths": ["exact", "nearly"], "seeds": [1, 2]}, ValueError, "nearly"),
    ],
)
def test_what_is_wrong_is_said(changes, kind, says):
    with pytest.raises(kind, match=says):
        tilthex.simulate_many(CONFIG, **{"duration": 0.1, "setpoint": HOME} | changes)


def test_runs_are_a_table():
    pandas = pytest.importorskip("pandas")
    runs = tilthex.simulate_many(CONFIG, seeds=range(3), duration=0.1, setpoint=HOME)
    table = runs.to_dataframe()
    assert isinstance(table, pandas.DataFrame) and table.shape == (3, 9)
    again = pickle.loads(pickle.dumps(runs))
    assert again.keys() == runs.keys()
