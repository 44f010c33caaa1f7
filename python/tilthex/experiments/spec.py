"""The TOML file of an experiment.

A file describes one configuration, and, in its `[[run]]` tables, runs that differ from it in a few keys.
`[short]` holds the changes of a short version. To make your own experiment, copy a file, change it, and
give it to `tilthex experiment`.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import tilthex
from tilthex._toml import tomllib
from tilthex.experiments import own_scene, ranges
from tilthex.experiments.scenes import SCENES, Scene
from tilthex.experiments.waypoints import Waypoint, check_keys, check_number, check_numbers
from tilthex.experiments.waypoints import read as read_waypoints
from tilthex.experiments.world import Noise

__all__ = ["Experiment", "Run", "Waypoint", "built_in", "load", "merge", "read_toml"]

Table = dict[str, Any]

FILE_KEYS = {
    "experiment",
    "title",
    "about",
    "wire",
    "vehicle",
    "truth",
    "calibration",
    "seed",
    "config",
    "world",
    "noise",
    "trajectory",
    "push",
    "judge",
    "learn_bias",
    "random",
    "run",
    "short",
}
RUN_KEYS = FILE_KEYS - {"experiment", "title", "about", "wire", "run", "short"} | {"name"}
PUSH_KEYS = {"force", "start", "end"}
CALIBRATIONS = ("none", "tilts")
LIMIT_KEYS = {
    "velocity": "m/s",
    "acceleration": "m/s^2",
    "angular_velocity": "rad/s",
    "angular_acceleration": "rad/s^2",
}
"""The limits between way-points, and their units."""
SWING_KEYS = {"start", "end", "lowest_hz", "highest_hz", "translation", "rotation_deg"}
LIMITS = {"velocity": 0.3, "acceleration": 0.5, "angular_velocity": 0.5, "angular_acceleration": 1.0}


@dataclass(frozen=True)
class Run:
    """One flight, with everything that determines it."""

    experiment: str
    name: str
    vehicle: Table
    """The keys of a `[vehicle]` section: the model of the controller."""
    truth: str | Table
    """How the simulated vehicle differs: a level, a TOML file, or the keys of a `[truth]` table."""
    calibration: str
    """The flight that first corrects the model: "none" or "tilts" (`tilthex.calibration_flight`)."""
    seed: int
    config: Table
    world: Table
    noise: Noise
    waypoints: tuple[Waypoint, ...]
    limits: Table
    swing: Table
    """A swing of the pose about the trajectory, whose frequency rises linearly; empty for none."""
    push: Table
    """`force` (N, W) at the tool from `start` to `end` (s)."""
    learn_bias: tuple[float, float]
    """Start and end of the time in which the bias of the wrench is learnt, s; equal for never."""
    judge: Table
    """Numbers for the checks of this experiment."""
    random: Table
    """Ranges of the random cases of a campaign."""

    def model(self) -> tilthex.Vehicle:
        """The vehicle model of the controller."""
        return tilthex.Vehicle.from_dict(self.vehicle)

    def configuration(self) -> tilthex.Config:
        """The configuration of the controller."""
        return tilthex.Config.default(self.model()).replace(**self.config)

    def drawn(self) -> tilthex.Drawn:
        """The true vehicle, drawn with the run's seed."""
        return tilthex.Truth(self.model(), self.truth).draw(self.seed)

    def truth_name(self) -> str:
        """The name of the truth, with the seed of its draw; empty if the model is exact."""
        name = tilthex.Truth(self.model(), self.truth).name
        return "" if name == "exact" else f"truth {name}, drawn with seed {self.seed}"

    def scene(self) -> Scene:
        """Builds the world."""
        options = dict(self.world)
        name = options.pop("scene", None)
        own = isinstance(name, str) and name.endswith(own_scene.ENDINGS)
        if not own and name not in SCENES:
            known = ", ".join(sorted(SCENES))
            raise ValueError(f"world.scene is {name!r}; expected one of {known}, or a file .xml or .py")
        try:
            return own_scene.load(Path(name), options) if own else SCENES[name](**options)
        except TypeError as error:
            raise ValueError(f"[world] of scene {name}: {error}") from error


@dataclass(frozen=True)
class Experiment:
    """A file: its runs, and its path."""

    kind: str
    """The experiment whose module judges it: the file's key `experiment`, or the file's own name."""
    kind_is_named: bool
    title: str
    about: str
    runs: tuple[Run, ...]
    text: str
    folder: Path
    wire: bool
    """Whether `--wire` can fly it: it has a free tool, and no pulls and swings."""


def built_in() -> list[str]:
    """Names of the experiments that come with the package."""
    return sorted(path.stem for path in Path(__file__).parent.glob("*.toml"))


def load(name: str, *, short: bool = False, changes: Mapping[str, Any] | None = None) -> Experiment:
    """Reads an experiment by its built-in name or its file.

    Args:
        name: A built-in name, or the path of a TOML file.
        short: Whether to apply the file's `[short]` table.
        changes: Keys that replace those of the file, for every run.
    """
    path = Path(name)
    if path.suffix != ".toml":
        path = Path(__file__).parent / f"{name}.toml"
        if not path.exists():
            known = ", ".join([*built_in(), "all"])
            near = f"; did you mean {name}.toml?" if Path(f"{name}.toml").is_file() else ""
            raise ValueError(f"no experiment {name!r}; expected one of {known}, or a .toml file{near}")
    text = path.read_text(encoding="utf-8")
    table = read_toml(text, str(path))
    _check_kind(path, table)
    check_keys(str(path), table, FILE_KEYS)
    brief = table.pop("short", {}) if short else table.pop("short", {}) and {}
    folder = path.parent if Path(name).suffix == ".toml" else Path()
    chosen = brief.pop("runs", None)
    runs = table.pop("run", [{"name": table.get("title", path.stem)}])
    kind_is_named = "experiment" in table
    kind, wire = table.pop("experiment", path.stem), table.pop("wire", False)
    title, about = table.pop("title", kind), table.pop("about", "")
    made = []
    for run in runs:
        check_keys(f"{path} [[run]]", run, RUN_KEYS)
        if chosen is not None and run["name"] not in chosen:
            continue
        whole: Table = {"vehicle": {"preset": "tilt-hex"}}
        for layer, where in ((table, folder), (run, folder), (brief, folder), (changes or {}, Path())):
            whole = _merge_layer(whole, layer, where)
        try:
            made.append(_run(kind, whole))
        except ValueError as error:
            raise ValueError(f"{path}: {error}") from error
        _check_vehicle(made[-1], "--vehicle" if "vehicle" in (changes or {}) else f"{path}: key `vehicle`")
    return Experiment(kind, kind_is_named, title, about, tuple(made), text, path.parent.absolute(), wire)


def _check_kind(path: Path, table: Table) -> None:
    """Refuses the file of a vehicle and a configuration."""
    sections = tilthex.Config.default(tilthex.Vehicle.preset("tilt-hex")).to_dict().keys()
    if table and table.keys() <= sections:
        kind = "a vehicle" if table.keys() == {"vehicle"} else "a configuration"
        raise ValueError(
            f"{path} is the file of {kind}; expected an experiment: `tilthex new experiment mine.toml` "
            f'writes one, which names its vehicle: vehicle = "{path.name}"'
        )


def _check_vehicle(run: Run, where: str) -> None:
    try:
        run.model()
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from error


def read_toml(text: str, where: str) -> Table:
    """Reads TOML as a table; an error names the place."""
    try:
        table: Table = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ValueError(f"{where}: {error}") from error
    return table


def merge(base: Mapping[str, Any], over: Mapping[str, Any]) -> Table:
    """`base` with the keys of `over`, table by table; lists are replaced as a whole."""
    result = copy.deepcopy(dict(base))
    for key, value in over.items():
        if isinstance(value, Mapping) and isinstance(result.get(key), Mapping):
            result[key] = merge(result[key], value)
        else:
            result[key] = copy.deepcopy(value)
    return result


def _merge_layer(base: Table, layer: Mapping[str, Any], folder: Path) -> Table:
    """`base` with the keys of a layer. A vehicle or a truth of the layer replaces the one of `base`."""
    layer = dict(layer)
    if "vehicle" in layer:
        vehicle = _vehicle_keys(layer["vehicle"], folder)
        if vehicle.keys() & {"preset", "file"}:
            base = {key: value for key, value in base.items() if key != "vehicle"}
        layer["vehicle"] = vehicle
    if "truth" in layer:
        truth = layer["truth"]
        if isinstance(truth, str):
            layer["truth"] = _place(truth, folder)
        elif isinstance(base.get("truth"), str):
            base = base | {"truth": {"level": base["truth"]}}
    world = layer.get("world", {})
    if isinstance(world.get("scene"), str):
        layer["world"] = world | {"scene": _place(world["scene"], folder, own_scene.ENDINGS)}
    return merge(base, layer)


def _vehicle_keys(vehicle: Any, folder: Path) -> Table:
    """The keys of a `[vehicle]` section, from a table, a preset's name or a TOML file."""
    if isinstance(vehicle, str):
        return {"file": _place(vehicle, folder)} if vehicle.endswith(".toml") else {"preset": vehicle}
    if not isinstance(vehicle, Mapping):
        raise ValueError(f"vehicle is {vehicle!r}; expected a preset's name, a TOML file or a table of keys")
    keys = dict(vehicle)
    if "file" in keys:
        keys["file"] = _place(str(keys["file"]), folder)
    return keys


def _place(name: str, folder: Path, endings: tuple[str, ...] = (".toml",)) -> str:
    """The full path of a file that a file in `folder` names, by its ending; other names unchanged."""
    return str((folder / name).resolve()) if name.endswith(endings) else name


def _run(kind: str, table: Table) -> Run:
    ranges.check(table)
    trajectory = table.get("trajectory", {})
    check_keys("[trajectory]", trajectory, {*LIMIT_KEYS, "waypoint", "swing"})
    swing = trajectory.get("swing", {})
    check_keys("[trajectory.swing]", swing, SWING_KEYS)
    if swing and swing.keys() != SWING_KEYS:
        raise ValueError(
            f"[trajectory.swing] has no {', '.join(sorted(SWING_KEYS - swing.keys()))}; expected each"
        )
    limits = {key: trajectory[key] for key in LIMIT_KEYS if key in trajectory}
    for key, value in limits.items():
        check_number("[trajectory]", key, value, LIMIT_KEYS[key])
    push = table.get("push", {})
    check_keys("[push]", push, PUSH_KEYS)
    for key, value in push.items():
        if key == "force":
            check_numbers("[push]", key, value, 3, "N")
        else:
            check_number("[push]", key, value, "s")
    calibration = table.get("calibration", "none")
    if calibration not in CALIBRATIONS:
        raise ValueError(f"calibration is {calibration!r}; expected one of {', '.join(CALIBRATIONS)}")
    world = table.get("world", {"scene": "free"})
    if calibration != "none" and world.get("scene") == "clamp":
        raise ValueError(
            'calibration is "tilts" in the scene clamp; expected "none": the clamp holds the tool'
        )
    noise = table.get("noise", {})
    check_keys("[noise]", noise, {f.name for f in fields(Noise)})
    return Run(
        experiment=kind,
        name=table["name"],
        vehicle=table["vehicle"],
        truth=table.get("truth", "exact"),
        calibration=calibration,
        seed=table.get("seed", 1),
        config=table.get("config", {}),
        world=world,
        noise=Noise(**noise),
        waypoints=read_waypoints(trajectory.get("waypoint", [])),
        limits=LIMITS | limits,
        swing=swing,
        push=push,
        learn_bias=tuple(table.get("learn_bias", (0.0, 0.0))),
        judge=table.get("judge", {}),
        random=table.get("random", {}),
    )
