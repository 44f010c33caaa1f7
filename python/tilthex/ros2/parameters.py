"""The configuration of a flight as parameters of a node, such as `admittance.stiffness`."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from tilthex._toml import tomllib

LIVE = "changed in flight by set_admittance"
"""Text in the comment of a key that an order changes."""
SECTION = "admittance."
"""The names of all such keys begin with this."""


@dataclass(frozen=True)
class Parameter:
    """One key: its value in ROS (a matrix as one list), its meaning, and whether an order changes it."""

    name: str
    value: Any
    meaning: str
    live: bool


def parameters(text: str) -> dict[str, Parameter]:
    """The parameters of a configuration as `tilthex-rt --print-config` prints it, by their names."""
    meanings = _meanings(text)
    found = {}
    for name, value in _flat("", tomllib.loads(text)):
        meaning = meanings.get(name, "")
        found[name] = Parameter(name, value, meaning, LIVE in meaning)
    return found


def same(value: Any, other: Any) -> bool:
    """Whether two values of a parameter are the same. An integer can equal a floating-point number."""
    if isinstance(value, str) or isinstance(other, str):
        return bool(value == other)
    return np.shape(value) == np.shape(other) and bool(np.all(np.asarray(value) == np.asarray(other)))


def admittance(changes: Mapping[str, Any]) -> dict[str, Any]:
    """The arguments of `set_admittance` for changed parameters; 36 numbers are 6 rows of 6."""
    found = {}
    for name, value in changes.items():
        numbers = np.asarray(value, float)
        found[name.removeprefix(SECTION)] = numbers.reshape(6, 6) if numbers.size == 36 else numbers
    return found


def _flat(name: str, value: Any) -> Iterator[tuple[str, Any]]:
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from _flat(f"{name}.{key}" if name else key, inner)
    elif isinstance(value, list) and value and isinstance(value[0], dict):
        for k, inner in enumerate(value):
            yield from _flat(f"{name}.{k}", inner)
    elif isinstance(value, list) and value and not isinstance(value[0], str):
        yield name, np.asarray(value, float).flatten().tolist()
    elif value != []:
        # ROS does not know the type of the elements of an empty list.
        yield name, value


def _meanings(text: str) -> dict[str, str]:
    """The comment above each key, by `section.key`."""
    found: dict[str, str] = {}
    section, comments = "", list[str]()
    for line in text.splitlines():
        if line.startswith("#"):
            comments.append(line.lstrip("# "))
            continue
        if match := re.match(r"\[+([\w.]+)\]+", line):
            section = match[1]
        elif match := re.match(r"(\w+) = ", line):
            found[f"{section}.{match[1]}"] = " ".join(comments)
        comments = []
    return found
