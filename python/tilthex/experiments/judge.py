"""What every experiment's module offers: its checks against what is asked, and its figures."""

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


def admittance(run: Run, key: str) -> Vector:
    """`mass`, `damping` or `stiffness` of the admittance filter, six numbers."""
    return np.array(run.config["admittance"][key], dtype=float)


def of(kind: str) -> Judge:
    """The judge of one kind of experiment."""
    from tilthex.experiments import chirp, multi_contact, peg_in_hole, shaping, sliding

    judges = {
        "shaping": shaping.JUDGE,
        "sliding": sliding.JUDGE,
        "peg-in-hole": peg_in_hole.JUDGE,
        "multi-contact": multi_contact.JUDGE,
        "chirp": chirp.JUDGE,
    }
    if kind not in judges:
        raise ValueError(f"experiment = {kind!r}; expected one of {', '.join(judges)}")
    return judges[kind]
