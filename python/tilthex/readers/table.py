"""Tables (CSV) and MAT files."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tilthex.readers.columns import Stream

Array = NDArray[np.float64]


def read_csv(path: Path) -> list[Stream]:
    """A table with names in its first line, separated by commas, semicolons, tabs or blanks.

    An empty field is NaN. Lines that begin with # may stand before the data; the last of them has the names.

    Raises:
        ValueError: A field is not a number; the message names its line.
    """
    # A byte-order mark, as spreadsheets write it, is not part of the first name.
    with path.open(newline="", encoding="utf-8-sig", errors="replace") as file:
        lines = file.read().splitlines()
    # The last line that begins with # has the names; those before it are remarks.
    first = next((k for k, line in enumerate(lines) if not line.startswith("#")), len(lines))
    first = max(first, 1)
    if not any(line.strip() for line in lines):
        raise ValueError(f"{path} is empty; expected names in its first line")
    head = lines[first - 1].lstrip("#")
    separator = max(",;\t", key=head.count)
    if separator not in head:
        separator = " "

    def split(line: str) -> list[str]:
        return line.split() if separator == " " else next(csv.reader([line], delimiter=separator), [])

    names = [name.strip() for name in split(head)]
    rows: list[list[float]] = []
    for number, line in enumerate(lines[first:], start=first + 1):
        fields = split(line)
        if len(fields) > len(names):
            raise ValueError(f"{path}, line {number} has {len(fields)} fields; expected {len(names)}")
        try:
            row = [float(field) if field.strip() else np.nan for field in fields]
        except ValueError as error:
            raise ValueError(f"{path}, line {number}: {error}") from None
        rows.append(row + [np.nan] * (len(names) - len(row)))
    twice = {name for name in names if name and names.count(name) > 1}
    if twice:
        raise ValueError(f"{path} has two columns named '{min(twice)}'; expected one of each name")
    table = np.array(rows, dtype=float).reshape(-1, len(names))
    return [Stream(str(path), dict(zip(names, table.T, strict=True)), ("line", first + 1))]


def read_mat(path: Path) -> list[Stream]:
    """The numeric variables of a MAT file (version 7 or older): one stream per structure and length.

    (n, 3) are x, y, z; (n, 4) are a quaternion in the order of the end of its name (`_xyzw` or `_wxyz`),
    or w first as in BROAD (`opt_quat`); (n, 3, 3) and (3, 3, n) are rotations. `fs` or `sampling_rate`,
    Hz, replaces a missing time.

    Raises:
        ValueError: It is not such a file.
    """
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadError

    try:
        raw = loadmat(path, simplify_cells=True)
    except NotImplementedError:
        raise ValueError(f"{path} is of version 7.3; expected an older one: save(file, '-v7')") from None
    except (MatReadError, ValueError, TypeError, EOFError) as error:
        raise ValueError(f"{path} cannot be read as a MAT file: {error}") from error
    variables = _variables("", raw)
    rates = [float(v.item()) for name, v in variables if _is(name, "fs", "sampling_rate") and v.size == 1]
    groups: dict[tuple[str, int], dict[str, Array]] = {}
    for name, values in variables:
        structure, _, own = name.rpartition(".")
        for column, samples in _columns(path, own, values).items():
            groups.setdefault((structure, len(samples)), {})[column] = samples
    streams = []
    for (structure, length), columns in groups.items():
        # Variables outside of all structures count for each structure.
        whole = groups.get(("", length), {}) | columns
        stream = Stream(f"{path}, {structure or 'variables'} ({length} samples)", whole, ("sample", 1))
        if not stream.find("time") and rates:
            whole["time"] = np.arange(length) / rates[0]
        streams.append(stream)
    return streams


def _is(name: str, *endings: str) -> bool:
    return name.lower().rpartition(".")[2] in endings


def _variables(prefix: str, group: dict[str, Any]) -> list[tuple[str, NDArray[Any]]]:
    found = []
    for name, value in group.items():
        if name.startswith("__"):
            continue
        if isinstance(value, dict):
            found += _variables(f"{prefix}{name}.", value)
        elif np.issubdtype(np.asarray(value).dtype, np.number):
            found.append((prefix + name, np.asarray(value)))
    return found


def _columns(path: Path, name: str, values: NDArray[Any]) -> dict[str, Array]:
    """The columns of one variable; none for a scalar or a variable of another shape."""
    values = np.squeeze(values).astype(float)
    if values.ndim == 1 and len(values) > 1:
        return {name: values}
    if values.ndim == 3 and sorted(values.shape)[:2] == [3, 3]:
        turns = values if values.shape[1:] == (3, 3) else np.moveaxis(values, 2, 0)
        return {f"{name}_{i + 1}{j + 1}": turns[:, i, j] for i in range(3) for j in range(3)}
    if values.ndim != 2:
        return {}
    rows = values if values.shape[1] in (3, 4) else values.T
    if rows.shape[1] == 3:
        return {f"{name}_{axis}": rows[:, k] for k, axis in enumerate("xyz")}
    if rows.shape[1] != 4:
        return {}
    plain, _, order = name.rpartition("_")
    if _is(name, "opt_quat"):
        plain, order = name, "wxyz"
    if order not in ("xyzw", "wxyz"):
        raise ValueError(
            f"{path}: the name '{name}' does not give the order of the quaternion; "
            "expected a name that ends in _xyzw or _wxyz"
        )
    return {f"{plain}_{axis}": rows[:, k] for k, axis in enumerate(order)}
