"""The record of one flight: arrays with one row per control period."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]

COLUMNS: dict[str, tuple[int, ...]] = {
    "time": (),
    "tool_position": (3,),
    "tool_velocity": (3,),
    "robot_position": (3,),
    "robot_rotation": (3, 3),
    "angular_velocity": (3,),
    "true_wrench": (6,),
    "peak_force": (),
    "largest_contact": (),
    "pressure": (3,),
    "rotor_speeds": (),
    "scene_joints": (),
}
"""The columns of the true values: name and shape. The columns of `tilthex.Loop.record`, `tool_rotation`
and `phase` are added. The wrench is that on the tool, about its origin, W. `scene_joints` are the coordinates
of the joints of a scene of your own, m and rad, in the order of its file: as MuJoCo has them."""


def shapes(rotors: int, joints: int) -> dict[str, tuple[int, ...]]:
    """The columns of the true values for these numbers of rotors and of coordinates of the scene."""
    return COLUMNS | {"rotor_speeds": (rotors,), "scene_joints": (joints,)}


@dataclass
class Record:
    """The columns of a flight, and the names of its phases."""

    columns: dict[str, Vector]
    phases: Sequence[str]
    run: str = ""
    phase: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    """The phase of every row, as an index into `phases`."""
    ended: str = ""
    """Why the flight ended early, or was not the planned one; empty if it was."""
    complete: bool = True
    """Whether the flight has all of its rows."""
    seconds: float = 0.0
    """Time that the computation took, s."""

    @classmethod
    def blank(cls, length: int, rotors: int, joints: int, phases: Sequence[str], run: str) -> Record:
        """A record without values."""
        columns = {name: np.zeros((length, *shape)) for name, shape in shapes(rotors, joints).items()}
        return cls(columns, phases, run)

    def __getattr__(self, name: str) -> Vector:
        """A column by its name."""
        try:
            columns: dict[str, Vector] = self.__dict__["columns"]
            return columns[name]
        except KeyError:
            raise AttributeError(f"the record has no column {name!r}") from None

    def take(self, chain: dict[str, Vector], tool_rotation_r: Vector) -> None:
        """Adds the record of the controller, and the tool's orientation."""
        for name, values in chain.items():
            shape = (len(values), 3, 3) if name.endswith("rotation") else values.shape
            self.columns[name] = values.reshape(shape) if name != "saturated" else values[:, 0]
        self.columns["tool_rotation"] = self.robot_rotation @ tool_rotation_r

    @property
    def attitude_error(self) -> Vector:
        """Angle between the estimated and the true orientation, rad."""
        trace = np.einsum("nij,nij->n", self.robot_rotation, self.estimated_rotation)
        return np.asarray(np.arccos(np.clip(0.5 * (trace - 1.0), -1.0, 1.0)))

    def cut(self, length: int) -> None:
        """Keeps the first rows only."""
        self.complete = False
        self.columns = {name: column[:length] for name, column in self.columns.items()}

    def during(self, *phases: str) -> NDArray[np.bool_]:
        """Which rows are in one of these phases."""
        wanted = [i for i, name in enumerate(self.phases) if name in phases]
        if not wanted:
            raise ValueError(f"no phase {' or '.join(phases)} among {', '.join(self.phases)}")
        return np.isin(self.phase, wanted)

    def spans(self) -> list[tuple[str, float, float]]:
        """Phases in order: name, start and end, s."""
        edges = np.flatnonzero(np.diff(self.phase)) + 1
        begins, ends = np.r_[0, edges], np.r_[edges, len(self.phase)] - 1
        names = [self.phases[int(self.phase[i])] for i in begins]
        return list(zip(names, self.time[begins].tolist(), self.time[ends].tolist(), strict=True))

    def save(self, path: Path) -> None:
        """Writes a NumPy archive."""
        arrays: dict[str, Any] = {f"column_{name}": values for name, values in self.columns.items()}
        arrays |= {"phases": np.array(self.phases), "phase": self.phase}
        np.savez_compressed(path, run=np.array(self.run), ended=np.array(self.ended), **arrays)

    @classmethod
    def load(cls, path: Path) -> Record:
        """Reads what [`save`] wrote."""
        with np.load(path) as data:
            columns = {name[7:]: data[name] for name in data.files if name.startswith("column_")}
            phases = [str(name) for name in data["phases"]]
            return cls(columns, phases, str(data["run"]), data["phase"], str(data["ended"]))


@dataclass(frozen=True)
class Check:
    """One line of the table: the requirement, the paper's value, the measured value."""

    what: str
    required: str
    paper: str
    measured: str
    passed: bool | None
    """None for a value without a requirement."""


def rms(values: Vector) -> float:
    """Root mean square of the norms of the rows."""
    rows = values.reshape(len(values), -1)
    return float(np.sqrt(np.mean(np.sum(rows**2, axis=1)))) if len(rows) else float("nan")


def below(what: str, value: float, limit: float, unit: str, *, paper: str = "", scale: float = 1.0) -> Check:
    """A check that a measured number does not exceed a limit."""
    return _bounded(what, value, "at most", limit, unit, paper, scale, value <= limit)


def above(what: str, value: float, limit: float, unit: str, *, paper: str = "", scale: float = 1.0) -> Check:
    """A check that a measured number reaches a limit."""
    return _bounded(what, value, "at least", limit, unit, paper, scale, value >= limit)


def _bounded(
    what: str, value: float, side: str, limit: float, unit: str, paper: str, scale: float, passed: bool
) -> Check:
    measured = f"{value * scale:.3g} {unit}"
    return Check(what, f"{side} {limit * scale:g} {unit}", paper, measured, bool(passed))
