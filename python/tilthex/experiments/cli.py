"""`tilthex experiment NAME --out DIR`."""

from __future__ import annotations

import argparse
import os
import shlex
import sys
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tilthex import _json
from tilthex._needed import require
from tilthex.simulation import TRUTH_HELP

if TYPE_CHECKING:
    from tilthex.experiments.judge import Judge
    from tilthex.experiments.record import Check, Record
    from tilthex.experiments.spec import Experiment, Run

NEEDED = {"mujoco": "MuJoCo", "scipy": "SciPy", "matplotlib": "Matplotlib", "tqdm": "tqdm"}
_BAR: dict[str, Any] = {"file": sys.stderr, "leave": False, "disable": None}
"""Shows progress only on a terminal, not in a file or a pipe."""
EXECUTORS = (
    "who flies the cases: local (processes of this computer), dask://HOST:PORT (workers of Dask, by their "
    "scheduler) or slurm (jobs of SLURM); default: local"
)
WIRE_NEEDED = {"mcap": "mcap", "mcap_protobuf": "mcap-protobuf-support"}


def add_parser(subparsers: Any) -> None:
    """Registers the command with the parsers of `tilthex`."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "experiment",
        help="fly an experiment of the paper with the world simulated by MuJoCo",
        description="Flies an experiment with the complete controller in the loop and writes a report.",
    )
    parser.add_argument("name", help=f"{', '.join(built_in())}, all, or a TOML file")
    parser.add_argument("--out", type=Path, default=Path("out/experiments"), help="folder of the report")
    parser.add_argument(
        "--state",
        choices=("ukf", "exact"),
        default="ukf",
        help="what the controller gets: the estimate of the filter, or the true state",
    )
    parser.add_argument(
        "--wire",
        action="store_true",
        help="in real time, tilthex-rt against tilthex-sim, over tk3 and NatNet (files with `wire = true`)",
    )
    parser.add_argument(
        "--random", type=int, metavar="N", help="fly N random cases, if the experiment has random cases"
    )
    parser.add_argument("--seed", type=int, default=None, help="seed of the noise and of the random cases")
    parser.add_argument(
        "--case",
        type=int,
        metavar="I",
        help="with --random: fly only this case, and write its complete report",
    )
    parser.add_argument(
        "--jobs",
        type=int,
        default=None,
        help="number of processes of a campaign (default: number of cores), or of jobs of SLURM at once",
    )
    parser.add_argument("--executor", metavar="WHERE", help="with --random: " + EXECUTORS)
    parser.add_argument(
        "--vehicle", metavar="NAME", help="fly another vehicle: a preset or a TOML file (default: the file's)"
    )
    parser.add_argument("--truth", metavar="LEVEL", help=TRUTH_HELP)
    parser.add_argument(
        "--calibration",
        choices=("none", "tilts"),
        help="a first flight, which corrects the vehicle's model (default: the file's, or none)",
    )
    parser.add_argument(
        "--set", action="append", default=[], metavar="KEY=VALUE", help="change a key, as TOML"
    )
    parser.add_argument("--video", action="store_true", help="render every run as an animated GIF")
    _json.add_option(parser)
    parser.add_argument("--short", action="store_true", help="the short version that the tests fly")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> None:
    """Flies the chosen runs, prints the table and writes the report."""
    needed = NEEDED | WIRE_NEEDED if arguments.wire else NEEDED
    require("the experiments need", needed, "analysis,experiments")
    if arguments.case is not None and arguments.random is None:
        raise ValueError("--case I is a case of a campaign; give the campaign with --random N --seed S")
    if arguments.executor is not None and (arguments.random is None or arguments.case is not None):
        raise ValueError(
            "--executor says who flies the cases of a campaign; give the campaign with --random N"
        )
    if arguments.wire and (arguments.random is not None or arguments.state == "exact"):
        raise ValueError(
            "--wire always flies the runs of the file, with the estimator; leave out --random and --state"
        )
    if arguments.video and not os.environ.get("DISPLAY"):
        os.environ.setdefault("MUJOCO_GL", "egl")
    from tilthex.experiments import report, spec

    names = spec.built_in() if arguments.name == "all" else [arguments.name]
    everything: list[Check] = []
    pages = []
    said: list[dict[str, Any]] = []
    for name in names:
        experiment = spec.load(name, short=arguments.short, changes=changes(arguments))
        if arguments.wire:
            from tilthex.experiments import wire

            wire.check(experiment)
        for one in experiment.runs:
            _check_configuration(arguments.name, one)
        _say(arguments, experiment.title)
        if arguments.random is not None and arguments.case is None:
            page, checks = _campaign(experiment, arguments)
        else:
            page, checks = _fly(experiment, arguments)
        _say(arguments, report.text_table(checks))
        _say(arguments, f"report: {page}\n")
        everything += checks
        pages.append((experiment.title, page))
        said.append({"experiment": experiment.kind, "report": str(page), "checks": checks})
    if len(names) > 1:
        links = [f'<a href="{page.name}">{title}</a>' for title, page in pages]
        about = "All experiments."
        report.write(arguments.out, "index", "The experiments", about, everything, {}, "", _command(), links)
    if arguments.json:
        _json.say({"experiments": said})


def _check_configuration(name: str, run: Run) -> None:
    """Refuses a wrong configuration, and a vehicle that cannot hover."""
    try:
        found = run.configuration()
    except ValueError as error:
        raise ValueError(f"{name}: [config]: {error}") from error
    found.check_hover()


def _say(arguments: argparse.Namespace, text: str) -> None:
    """Prints for a person, not for a script."""
    if not arguments.json:
        print(text, flush=True)


def changes(arguments: argparse.Namespace) -> dict[str, Any]:
    """The changes of the file by the command line: `--set`, `--vehicle`, `--truth` and others."""
    from tilthex.experiments.spec import merge, read_toml

    result: dict[str, Any] = {}
    for item in arguments.set:
        where = f"--set {item} (expected KEY=VALUE as in TOML; a text has quotes: 'vehicle=\"hexarotor\"')"
        result = merge(result, read_toml(item, where))
    for key in ("vehicle", "truth", "calibration", "seed"):
        if getattr(arguments, key) is not None:
            result[key] = getattr(arguments, key)
    return result


def _fly(experiment: Experiment, arguments: argparse.Namespace) -> tuple[Path, list[Check]]:
    from tilthex.experiments import report
    from tilthex.experiments.found import judge_of
    from tilthex.experiments.record import Check

    runs, judged = experiment.runs, judge_of(experiment)
    if arguments.case is not None:
        runs = (_draw_of(experiment)(runs[0], runs[0].seed, arguments.case),)
    flights, checks, notes = [], [], []
    pictures: dict[str, Any] = {}
    arguments.out.mkdir(parents=True, exist_ok=True)
    # Two files with the same kind of experiment must not write the same files.
    page_name = Path(arguments.name).stem if arguments.name != "all" else experiment.kind
    page_name += "-wire" if arguments.wire else ""
    for one in runs:
        stem = f"{page_name}-{report.slug(one.name)}"
        fly = _through_the_wire if arguments.wire else _in_this_process
        record, said, landed = fly(one, arguments, stem)
        kept = arguments.out / f"{stem}.npz"
        record.save(kept)
        # A flight that was thrown away, or that the supervisor held, is not the one that is judged.
        if record.complete and not (arguments.wire and record.ended):
            flights.append((one, record))
            checks += _judged(judged, partial(_checked, judged, one, record), record, kept)
        else:
            checks.append(Check(f"{one.name}: flown to its end", "yes", "", f"no: {record.ended}", False))
            pictures[one.name] = report.overview(record)
        checks += landed
        notes.append("; ".join(filter(None, (f"{one.name}: {said}", one.truth_name(), record.ended))))
        if arguments.video:
            from tilthex.experiments.video import render

            render(one, record, arguments.out / f"{stem}.gif")
    if flights:
        record = flights[-1][1]
        pictures |= _judged(judged, lambda: judged.figures(flights), record, arguments.out)
    page = report.write(
        arguments.out,
        page_name,
        experiment.title + (", in real time through the wire" if arguments.wire else ""),
        experiment.about,
        checks,
        pictures,
        _parameters(experiment, runs, arguments),
        _command(),
        notes,
    )
    if arguments.wire:
        _say(arguments, "\n".join(notes))
    return page, checks


def _judged(judge: Judge, call: Callable[[], Any], record: Record, kept: Path) -> Any:
    """What a judge returns; an exception becomes one sentence that says where the flight is kept."""
    from tilthex.experiments.found import complaint

    try:
        return call()
    except Exception as error:
        raise ValueError(f"{complaint(error, judge, record)}; the flight is kept in {kept}") from error


def _checked(judge: Judge, run: Run, record: Record) -> list[Check]:
    from tilthex.experiments.record import Check

    found = judge.checks(run, record)
    if not isinstance(found, list) or not all(isinstance(one, Check) for one in found):
        raise TypeError(f"`checks` returned {found!r}; expected a list of Check")
    return found


def _in_this_process(one: Run, arguments: argparse.Namespace, stem: str) -> tuple[Record, str, list[Check]]:
    from tqdm import tqdm

    from tilthex.experiments.flight import fly
    from tilthex.experiments.plan import periods

    with tqdm(total=periods(one), desc=one.name, unit="tick", **_BAR) as bar:
        record = fly(one, exact=arguments.state == "exact", progress=bar.update)
    length = record.time[-1]
    speed = f"{length:.1f} s in {record.seconds:.1f} s, {length / record.seconds:.1f} times real time"
    return record, speed, []


def _through_the_wire(one: Run, arguments: argparse.Namespace, stem: str) -> tuple[Record, str, list[Check]]:
    from tqdm import tqdm

    from tilthex.experiments import wire, wire_record

    files = wire.Files.beside(arguments.out / stem)
    shape = "{desc}: {percentage:3.0f}%|{bar}| {n:.0f}/{total:.0f} s"
    with tqdm(total=wire.expected(one), desc=one.name, bar_format=shape, **_BAR) as bar:
        said = wire.fly(one, files, progress=lambda seconds: bar.update(min(seconds, bar.total - bar.n)))
    landed = wire_record.landing(one, files)
    try:
        record, notes = wire_record.read(one, wire.route(one), files)
    except ValueError as error:
        wrong = [f"{check.what}: {check.measured}" for check in landed if not check.passed]
        raise ValueError("; ".join([str(error), *wrong])) from error
    return record, "; ".join(notes + said), landed


def _campaign(experiment: Experiment, arguments: argparse.Namespace) -> tuple[Path, list[Check]]:
    from tqdm import tqdm

    from tilthex.experiments import campaign, report
    from tilthex.experiments.executors import executor

    _draw_of(experiment)
    where = executor(arguments.executor or "local", arguments.jobs, arguments.out / "jobs")
    base = experiment.runs[0]
    found: list[campaign.Attempt] = []
    arguments.out.mkdir(parents=True, exist_ok=True)
    # Written after every case, so that the results of an interrupted campaign are kept.
    table = arguments.out / f"{experiment.kind}-random.csv"
    with tqdm(total=arguments.random, unit="case", **_BAR) as bar:
        exact = arguments.state == "exact"
        for one in campaign.fly_all(base, base.seed, arguments.random, exact=exact, executor=where):
            found.append(one)
            campaign.write_table(table, found)
            why = campaign.reason(one)
            if why:
                tqdm.write(f"case {one.index}: tilt {one.tilt_deg:.1f} deg, {why}", file=sys.stderr)
            bar.update()
    found.sort(key=lambda one: one.index)
    campaign.write_table(table, found)
    checks = campaign.checks(found, base)
    page = report.write(
        arguments.out,
        f"{experiment.kind}-random",
        f"{experiment.title}: {arguments.random} random cases of seed {base.seed}{_level(base)}",
        experiment.about,
        checks,
        {"cases": campaign.figure(found)},
        _parameters(experiment, (base,), arguments),
        _command(),
        [campaign.failures(found, _command())],
    )
    return page, checks


def _level(run: Run) -> str:
    return f", each with its own vehicle ({run.truth_name().split(',')[0]})" if run.truth_name() else ""


def _parameters(experiment: Experiment, runs: Sequence[Run], arguments: argparse.Namespace) -> str:
    """The experiment's file, the changes of the command line, the files of vehicle and scene, the truths."""
    named = (
        Path(name)
        for run in runs
        for name in (run.vehicle.get("file"), run.world.get("scene"))
        if isinstance(name, str)
    )
    files = [path for path in dict.fromkeys(named) if path.is_absolute() and path.is_file()]
    changed = [f"# --set {item}" for item in arguments.set]
    texts = [f"# {path.name}\n{path.read_text(encoding='utf-8')}" for path in files]
    return "\n".join([experiment.text, *changed, *texts, *_truths(runs)])


def _truths(runs: Sequence[Run]) -> list[str]:
    """What was drawn for the runs whose vehicle differs from its model, each once."""
    drawn = {run.truth_name(): run for run in runs if run.truth_name()}
    return [f"# {name}\n{run.drawn().to_toml()}" for name, run in drawn.items()]


def built_in() -> list[str]:
    """The built-in experiments; does not import their modules."""
    return sorted(path.stem for path in Path(__file__).parent.glob("*.toml"))


def _draw_of(experiment: Experiment) -> Callable[[Run, int, int], Run]:
    from tilthex.experiments.found import judge_of

    draw = judge_of(experiment).draw
    if draw is None:
        raise ValueError(
            f"--random needs an experiment with random cases; {experiment.kind} has none: its module has no "
            "Judge with a draw (docs/howto/experiment.md)"
        )
    return draw


def _command(arguments: Sequence[str] | None = None) -> str:
    return shlex.join(["tilthex", *(sys.argv[1:] if arguments is None else arguments)])
