"""Finds the module that judges an experiment: beside its file, or in this package."""

from __future__ import annotations

import importlib
import traceback
from pathlib import Path
from types import ModuleType

from tilthex.experiments import own_scene
from tilthex.experiments.judge import Figures, Flights, Judge
from tilthex.experiments.record import Check, Record
from tilthex.experiments.report import overview
from tilthex.experiments.spec import Experiment, Run, built_in

HERE = Path(__file__).parent


def judge_of(experiment: Experiment) -> Judge:
    """Finds how an experiment is judged.

    A module beside the file, with the name of the experiment (`_` for `-`), judges it with a `Judge` in
    the variable `JUDGE`. The module of a built-in experiment is in this package. Without a module nothing
    is judged, and the report shows every flight.

    Raises:
        ValueError: The file names an experiment without a module, or the module has no `JUDGE`.
    """
    name = experiment.kind.replace("-", "_")
    beside = experiment.folder / f"{name}.py"
    if experiment.folder != HERE and beside.is_file():
        return _judge(own_scene.module(beside), str(beside))
    if experiment.kind in built_in():
        return _judge(importlib.import_module(f"tilthex.experiments.{name}"), experiment.kind)
    if experiment.kind_is_named:
        raise ValueError(
            f"experiment = {experiment.kind!r}: found neither {beside} nor a built-in experiment of "
            f"that name; expected one of {', '.join(built_in())}, or a module beside the file"
        )
    return Judge(_no_checks, _overviews)


def complaint(error: Exception, judge: Judge, record: Record) -> str:
    """One sentence on an exception in a judge: the place in its module, and the columns that there are."""
    codes = [function.__code__ for function in (judge.checks, judge.figures) if hasattr(function, "__code__")]
    files = {code.co_filename for code in codes}
    frames = traceback.extract_tb(error.__traceback__)
    inside = [(one.filename, one.lineno) for one in frames if one.filename in files]
    begins = [(code.co_filename, code.co_firstlineno) for code in codes]
    file, line = [*begins[:1], *inside][-1] if codes else (frames[-1].filename, frames[-1].lineno)
    said = " ".join(str(error).split())
    return (
        f"{file}, line {line}: the judge ended with {type(error).__name__}: {said}; the "
        f"record has {', '.join(sorted(record.columns))}"
    )


def _judge(module: ModuleType, where: str) -> Judge:
    if not hasattr(module, "JUDGE"):
        raise ValueError(f"{where} has no JUDGE; expected JUDGE = Judge(checks, figures)")
    judge = module.JUDGE
    if not isinstance(judge, Judge):
        raise ValueError(f"{where}: JUDGE is {judge!r}; expected a tilthex.experiments.judge.Judge")
    return judge


def _no_checks(run: Run, record: Record) -> list[Check]:
    return []


def _overviews(flights: Flights) -> Figures:
    return {run.name: overview(record) for run, record in flights}
