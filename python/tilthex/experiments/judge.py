"""The interface of an experiment's module: its checks against the requirements, and its figures."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tilthex.experiments.record import Check, Record
from tilthex.experiments.spec import Run

Vector = NDArray[np.float64]
Flights = Sequence[tuple[Run, Record]]
Figures = dict[str, Any]


@dataclass(frozen=True)
class Judge:
    """How one kind of experiment is judged and drawn."""

    checks: Callable[[Run, Record], list[Check]]
    figures: Callable[[Flights], Figures]
    draw: Callable[[Run, int, int], Run] | None = None
    """Makes a random case from a seed and its number, for the experiments that have random cases."""


def admittance(run: Run, key: str) -> Vector:
    """`mass`, `damping` or `stiffness` of the admittance filter, six numbers."""
    return np.array(run.config["admittance"][key], dtype=float)
