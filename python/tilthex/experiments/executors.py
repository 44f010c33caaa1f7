"""Where the cases of a campaign are flown: processes of this machine, Dask's workers, or jobs of SLURM.

Each executor yields the results in the order in which they come. The work of a worker that is lost is given
to another one.
"""

from __future__ import annotations

import multiprocessing
import os
import re
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import Any

import tilthex
from tilthex._needed import require

Function = Callable[..., Any]
Calls = Sequence[tuple[Any, ...]]
"""The arguments of each call."""
Executor = Callable[[Function, Calls], Iterator[Any]]

TRIES = 3
"""A case that has lost so many workers is not flown again: it would lose the next one, too."""
JOBS = 100
"""Largest number of jobs of SLURM at once, if nothing else is said."""
MINUTES = 60
"""Longest time of a job of SLURM."""
POLL = 0.2
"""Time between two looks at the jobs, s."""
CONNECT = 10.0
"""Longest wait for the scheduler of Dask, s."""


def executor(name: str, jobs: int | None, folder: Path) -> Executor:
    """The executor with a name.

    Args:
        name: "local", "dask://HOST:PORT" or "slurm".
        jobs: Largest number of processes or jobs at once; None for the executor's own number.
        folder: Where jobs of SLURM have their inputs, results and logs; all machines must see it.

    Raises:
        ValueError: There is no such executor, or it does not take `jobs`.
        ImportError: Its library is not installed.
    """
    if jobs is not None and jobs < 1:
        raise ValueError(f"--jobs is {jobs}; expected at least 1")
    if name == "local":
        return lambda function, calls: local(function, calls, jobs or os.cpu_count() or 1)
    if re.fullmatch(r"dask://[^\s/]+:\d+", name):
        if jobs is not None:
            raise ValueError(
                "--jobs does not go with --executor dask://...: Dask has the workers that were started"
            )
        require("this executor needs", {"distributed": "dask.distributed"}, "cluster")
        return lambda function, calls: dask(function, calls, name.replace("dask", "tcp", 1))
    if name == "slurm":
        require("this executor needs", {"submitit": "submitit"}, "cluster")
        return lambda function, calls: submitted(function, calls, jobs or JOBS, folder)
    raise ValueError(f"--executor is {name!r}; expected local, dask://HOST:PORT or slurm")


def local(function: Function, calls: Calls, jobs: int) -> Iterator[Any]:
    """Calls in `jobs` processes of this computer."""
    left = dict(enumerate(calls))
    context = multiprocessing.get_context("spawn")
    fruitless = 0
    while left:
        before = len(left)
        pool = ProcessPoolExecutor(min(before, jobs), mp_context=context)
        try:
            waiting = {pool.submit(function, *arguments): key for key, arguments in left.items()}
            for done in as_completed(waiting):
                # A lost process ends the whole pool: calls that had no result yet go to the next one.
                if not isinstance(done.exception(), BrokenProcessPool):
                    del left[waiting[done]]
                    yield done.result()
        finally:
            pool.shutdown(cancel_futures=True)
        fruitless = fruitless + 1 if len(left) == before else 0
        if fruitless == TRIES:
            raise ChildProcessError(_lost(f"{len(left)} cases are left"))


def dask(function: Function, calls: Calls, address: str) -> Iterator[Any]:
    """Calls on the workers of a scheduler of Dask at `tcp://HOST:PORT`."""
    import distributed

    place = address.removeprefix("tcp://")
    try:
        client = distributed.Client(address, timeout=CONNECT, set_as_default=False)
    except OSError as error:
        raise ConnectionError(
            f"no scheduler of Dask answers at {place} ({error}); start one there: dask scheduler"
        ) from error
    with client:
        if not client.nthreads():
            raise ValueError(
                f"the scheduler of Dask at {place} has no workers; start some: dask worker {place}"
            )
        waiting = [client.submit(_call, tilthex.__version__, function, one, pure=False) for one in calls]
        try:
            for _, result in distributed.as_completed(waiting, loop=client.loop, with_results=True):
                yield _result(result)
        except distributed.KilledWorker as error:
            raise ChildProcessError(_lost(str(error))) from error
        finally:
            client.cancel(waiting)


def submitted(
    function: Function, calls: Calls, jobs: int, folder: Path, cluster: str = "slurm"
) -> Iterator[Any]:
    """Calls as jobs of SLURM, one each, at most `jobs` at once.

    Args:
        function: The function, which its module names.
        calls: The arguments of each call.
        jobs: Largest number of jobs at once.
        folder: Where the jobs have their inputs, results and logs.
        cluster: "slurm", or "local" for processes of this computer, as a trial.
    """
    import submitit

    try:
        submitter = submitit.AutoExecutor(folder=folder, cluster=cluster)
    except RuntimeError as error:
        raise OSError(f"no SLURM on this computer ({error}); expected its command srun") from error
    submitter.update_parameters(name="tilthex", timeout_min=MINUTES)
    left = [(arguments, 1) for arguments in reversed(calls)]
    running: dict[Any, tuple[tuple[Any, ...], int]] = {}
    try:
        while left or running:
            while left and len(running) < jobs:
                arguments, tries = left.pop()
                job = submitter.submit(_call, tilthex.__version__, function, arguments)
                running[job] = arguments, tries
            for job in [job for job in running if job.done()]:
                arguments, tries = running.pop(job)
                try:
                    result = job.result()
                except submitit.core.utils.UncompletedJobError as error:
                    if tries == TRIES:
                        raise ChildProcessError(_lost(f"the logs of its jobs are in {folder}")) from error
                    left.append((arguments, tries + 1))
                else:
                    yield _result(result)
            time.sleep(POLL)
    finally:
        for job in running:
            job.cancel(check=False)


def _call(version: str, function: Function, arguments: tuple[Any, ...]) -> Any:
    """Calls a function on another machine. An error is returned, so that no executor changes its type."""
    if tilthex.__version__ != version:
        return ValueError(f"a worker has tilthex {tilthex.__version__}; expected {version}, as here")
    try:
        return function(*arguments)
    except Exception as error:
        return error


def _result(found: Any) -> Any:
    if isinstance(found, Exception):
        raise found
    return found


def _lost(more: str) -> str:
    return f"a case has lost {TRIES} workers, and is not flown again: {more}"
