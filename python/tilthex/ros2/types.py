"""Messages of the installed ROS."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from typing import Any

import numpy as np


class RosTypes(dict[str, Callable[..., Any]]):
    """By the name of a message, such as "nav_msgs/msg/Odometry": a function that makes it from its fields."""

    def __missing__(self, kind: str) -> Callable[..., Any]:
        made = message(kind)
        names = list(made.get_fields_and_field_types())

        def make(*fields: Any) -> Any:
            plain = (field.tolist() if isinstance(field, np.ndarray) else field for field in fields)
            return made(**dict(zip(names, plain, strict=True)))

        self[kind] = make
        return make


def message(kind: str) -> Any:
    """The class of a message or service.

    Raises:
        ModuleNotFoundError: Its package is not installed.
    """
    package, part, name = kind.split("/")
    return getattr(importlib.import_module(f"{package}.{part}"), name)
