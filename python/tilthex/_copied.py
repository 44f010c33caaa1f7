"""What the compiled values need to be copied, pickled, compared and shown.

The names of a value's attributes are those of its constructor's arguments.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from tilthex._core import Config, Drawn, Truth, Vehicle


def config(text: str) -> Config:
    """The configuration in the output of `Config.to_toml`."""
    return Config.from_text(text)


def vehicle(text: str) -> Vehicle:
    """The vehicle in the output of `Vehicle.to_toml`."""
    return Config.from_text(text).vehicle


def drawn(truth: Truth, seed: int) -> Drawn:
    """The vehicle that a truth gives for a seed."""
    return truth.draw(seed)


def arguments(value: object, names: Sequence[str]) -> tuple[tuple[()], dict[str, Any]]:
    """The attributes with these names, as arguments of the constructor, none of them by place."""
    return (), {name: getattr(value, name) for name in names}


def shown(value: object, names: Sequence[str], needed: int) -> str:
    """The call of the constructor that makes an equal value.

    An attribute after the first `needed` ones is left out if it is missing, empty, false or zero: the
    constructor's default.
    """
    parts = []
    for k, name in enumerate(names):
        found = getattr(value, name)
        if k < needed or not _is_default(found):
            plain = found.tolist() if isinstance(found, np.ndarray) else found
            parts.append(f"{name}={plain!r}")
    return f"{type(value).__name__}({', '.join(parts)})"


def equal(one: object, other: object, names: Sequence[str]) -> bool:
    """Whether the attributes with these names are equal. NaN is equal to NaN, so that a copy is equal."""
    return all(_same(getattr(one, name), getattr(other, name)) for name in names)


def hashed(value: object, names: Sequence[str]) -> int:
    """A hash that is equal for equal values."""
    return hash(tuple(_key(getattr(value, name)) for name in names))


def _is_default(found: Any) -> bool:
    if isinstance(found, np.ndarray):
        return not found.any()
    if isinstance(found, dict):
        return not any(found.values())
    return isinstance(found, bool | int | list | None) and not found


def _same(one: Any, other: Any) -> bool:
    if isinstance(one, np.ndarray) and isinstance(other, np.ndarray):
        return np.array_equal(one, other, equal_nan=True)
    return bool(one == other)


def _key(found: Any) -> Any:
    if isinstance(found, np.ndarray):
        return tuple(found.ravel().tolist())
    if isinstance(found, dict):
        return tuple(sorted(found.items()))
    return tuple(found) if isinstance(found, list) else found
