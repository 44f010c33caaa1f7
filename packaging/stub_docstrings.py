"""Gives the API pages the docstrings of the compiled module, whose stub `_core.pyi` has only signatures."""

from __future__ import annotations

import importlib
import inspect
from operator import attrgetter
from typing import Any

import griffe

COMPILED = "tilthex._core"


class StubDocstrings(griffe.Extension):  # type: ignore[misc]
    """Takes each docstring from the installed module, at the name that the stub gives it."""

    def on_object(self, *, obj: griffe.Object, **_: Any) -> None:
        """Completes an object of the stub."""
        name = obj.path.removeprefix(f"{COMPILED}.")
        if obj.docstring is not None or name == obj.path:
            return
        try:
            found = attrgetter(name)(importlib.import_module(COMPILED))
        except AttributeError:
            return
        text = inspect.getdoc(found)
        if text and not isinstance(found, int | float | str):
            obj.docstring = griffe.Docstring(text, parent=obj, parser="google")
