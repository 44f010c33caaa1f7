"""Campaigns on several machines: every case comes once, with the bits of this process, whoever is lost.

`make cluster-test` installs Dask and submitit; without them their tests are left out.
"""

from __future__ import annotations

import importlib.util
import json
import os
import pickle
import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
import tilthex
from tilthex import __main__ as command

pytest.importorskip("mujoco", reason="the experiments need MuJoCo: pip install 'tilthex[experiments]'")

from tilthex.experiments import executors

HERE = Path(__file__).parent
CASES = 5
BRIEF = "trajectory.waypoint=[{ phase = 'approach', position = [0, 0, 0.7], hold = 1.5 }]"

needs_dask = pytest.mark.skipif(
    importlib.util.find_spec("distributed") is None, reason="needs Dask: pip install 'tilthex[cluster]'"
)
needs_submitit = pytest.mark.skipif(
    importlib.util.find_spec("submitit") is None, reason="needs submitit: pip install 'tilthex[cluster]'"
)


def fly(case: int, folder: Path) -> tuple[int, bytes]:
    """Flies for half a second. The first worker that gets case 2 is killed in the middle of it."""
    config = tilthex.Config.default(tilthex.Vehicle.preset("tilt-hex"))
    home = tilthex.Setpoint(position=[0, 0, 1], rotation=np.eye(3))
    run = tilthex.simulate(config, duration=0.5, setpoint=home, seed=case)
    if case == 2 and not (folder / "lost").exists():
        (folder / "lost").touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return case, np.ascontiguousarray(run["tool_position"]).tobytes()


def always_lost(case: int) -> int:
    if case == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    return case


def refuses(case: int) -> int:
    raise ValueError(f"case {case} cannot be flown")


def flown_by(executor: executors.Executor, folder: Path) -> None:
    """Flies all cases, and compares them with those of this process."""
    found = list(executor(fly, [(case, folder) for case in range(CASES)]))
    assert (folder / "lost").exists()
    assert sorted(case for case, _ in found) == list(range(CASES))
    assert dict(found) == dict(fly(case, folder) for case in range(CASES))


def test_a_lost_process_loses_no_case(tmp_path: Path) -> None:
    flown_by(executors.executor("local", 2, tmp_path), tmp_path)


@needs_dask
def test_a_case_that_always_loses_its_process_ends_the_campaign() -> None:
    found = []
    with pytest.raises(ChildProcessError, match=r"has lost 3 workers"):
        found += list(executors.local(always_lost, [(1,)], 1))
    assert not found


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--random", "2", "--executor", "ray"], "'ray'; expected local, dask://HOST:PORT or slurm"),
        (["--random", "2", "--executor", "dask://here"], "'dask://here'; expected local, dask://HOST:PORT"),
        (["--random", "2", "--executor", "dask://a:1", "--jobs", "2"], "--jobs does not go with"),
        (["--random", "2", "--jobs", "0"], "--jobs is 0; expected at least 1"),
        (["--executor", "local"], "give the campaign with --random N"),
        (["--random", "2", "--case", "1", "--executor", "local"], "give the campaign with --random N"),
    ],
)
def test_what_is_wrong_is_said_in_one_sentence(
    arguments: list[str], says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert command.main(["experiment", "peg-in-hole", "--out", str(tmp_path), *arguments]) == 2
    error = capsys.readouterr().err
    assert says in error and error.count("\n") == 1


@pytest.mark.parametrize(("name", "module"), [("dask://127.0.0.1:1", "distributed"), ("slurm", "submitit")])
def test_a_library_that_is_missing_is_named(name: str, module: str, tmp_path: Path) -> None:
    if importlib.util.find_spec(module) is not None:
        pytest.skip(f"{module} is installed")
    with pytest.raises(ImportError, match=r"tilthex\[cluster\]"):
        executors.executor(name, None, tmp_path)


@contextmanager
def started(*arguments: str):
    """A process of Dask, which finds the functions of this file."""
    paths = filter(None, [str(HERE), os.environ.get("PYTHONPATH")])
    process = subprocess.Popen(
        [sys.executable, "-m", "dask", *arguments, "--no-dashboard"],
        env=os.environ | {"PYTHONPATH": os.pathsep.join(paths)},
        stderr=subprocess.DEVNULL,
    )
    try:
        yield process
    finally:
        process.kill()
        process.wait()


@contextmanager
def cluster(folder: Path):
    """A scheduler and two workers, each with a process of its own: the scheduler's place, the workers."""
    import distributed

    file = folder / "scheduler.json"
    with started(
        "scheduler", "--host", "127.0.0.1", "--port", "0", "--scheduler-file", str(file)
    ) as scheduler:
        while not file.exists() or not file.read_text():
            assert scheduler.poll() is None
            time.sleep(0.05)
        address = json.loads(file.read_text())["address"]
        # Without a nanny, which would start a new worker in place of a lost one.
        worker = ("worker", address, "--nthreads", "1", "--no-nanny", "--local-directory", str(folder))
        with started(*worker) as first, started(*worker) as second:
            with distributed.Client(address, set_as_default=False) as client:
                client.wait_for_workers(2)
            yield address.replace("tcp", "dask"), (first, second)


@pytest.fixture(name="dask")
def _dask(tmp_path: Path):
    with cluster(tmp_path) as found:
        yield found


@needs_dask
def test_a_lost_worker_of_dask_loses_no_case(dask, tmp_path: Path) -> None:
    place, workers = dask
    flown_by(executors.executor(place, None, tmp_path), tmp_path)
    assert sorted(worker.poll() or 0 for worker in workers) == [-signal.SIGKILL, 0]


@needs_dask
def test_a_campaign_on_dask_has_the_table_of_a_local_one(dask, tmp_path: Path) -> None:
    """One of two workers is killed as soon as the first case is in the table."""
    place, (victim, _) = dask
    call = ["experiment", "peg-in-hole", "--random", "6", "--seed", "71", "--set", BRIEF]
    campaign = [sys.executable, "-m", "tilthex", *call, "--executor", place, "--out", str(tmp_path / "far")]
    table = tmp_path / "far" / "peg-in-hole-random.csv"
    with subprocess.Popen(campaign, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as running:
        while running.poll() is None and not table.exists():
            time.sleep(0.05)
        assert running.poll() is None
        victim.kill()
        _, error = running.communicate()
    assert running.returncode == 0, error
    assert command.main([*call, "--out", str(tmp_path / "near")]) == 0
    assert table.read_bytes() == (tmp_path / "near" / table.name).read_bytes()
    assert table.read_text().count("\n") == 7


@needs_dask
def test_an_error_on_a_worker_of_dask_is_the_same_error_here(dask, tmp_path: Path) -> None:
    place, _ = dask
    with pytest.raises(ValueError, match=r"^case 0 cannot be flown$"):
        list(executors.executor(place, None, tmp_path)(refuses, [(0,)]))


@needs_dask
def test_a_scheduler_that_is_not_there_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(executors, "CONNECT", 0.5)
    with pytest.raises(ConnectionError, match=r"answers at 127\.0\.0\.1:9 "):
        list(executors.executor("dask://127.0.0.1:9", None, tmp_path)(always_lost, [(0,)]))


@needs_submitit
def test_a_lost_job_loses_no_case(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The jobs are real processes, submitted and collected as those of SLURM, which is not here."""
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(HERE), os.environ.get("PYTHONPATH", "")]))
    folder = tmp_path / "jobs"
    flown_by(lambda function, calls: executors.submitted(function, calls, 2, folder, "local"), tmp_path)


@needs_submitit
def test_a_case_that_always_loses_its_job_and_a_wrong_one_end_the_campaign(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(HERE), os.environ.get("PYTHONPATH", "")]))
    with pytest.raises(ChildProcessError, match=r"has lost 3 workers"):
        list(executors.submitted(always_lost, [(1,)], 2, tmp_path, "local"))
    with pytest.raises(ValueError, match=r"^case 0 cannot be flown$"):
        list(executors.submitted(refuses, [(0,)], 2, tmp_path, "local"))


def test_a_worker_with_another_version_refuses() -> None:
    """Another version may give other bits."""
    found = executors._call("0.0.0", always_lost, (0,))
    assert isinstance(found, ValueError) and "expected 0.0.0" in str(found)
    assert pickle.loads(pickle.dumps(found)).args == found.args
