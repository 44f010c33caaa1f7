"""A scene of your own: an MJCF file, or a function in a Python module (`[world] scene = "wall.xml"`).

Geoms that name no `solref`, `solimp` and `condim` get those of the built-in scenes.
"""

from __future__ import annotations

import importlib.util
import traceback
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any
from xml.etree import ElementTree as ET

from tilthex.experiments.scenes import Scene, floor
from tilthex.mjcf import CONTACT

ENDINGS = (".xml", ".py")
"""The endings of the files that hold a scene."""
TAKEN = {"worldbody", "asset"}
"""The sections of an MJCF file that a scene takes."""


def load(path: Path, options: Mapping[str, Any]) -> Scene:
    """The scene of a file.

    Args:
        path: An MJCF file (`.xml`), whose bodies and geoms are added to the world, or a Python module
            (`.py`). Its function `scene` gets the options, and returns a `Scene` or the text of MJCF.
        options: The other keys of `[world]`. `look_at`, m, is the point at which the camera of a video looks.

    Raises:
        ValueError: The file cannot be read, or holds no scene; one sentence.
        TypeError: The function does not take these keys.
    """
    options = dict(options)
    look_at = options.pop("look_at", None)
    if not path.is_file():
        raise ValueError(f"world.scene is {str(path)!r}; expected a file that exists")
    if path.suffix == ".py":
        function = getattr(module(path), "scene", None)
        if not callable(function):
            raise ValueError(f"{path} has no function `scene`; expected one that returns a scene")
        made = function(**options)
        found = made if isinstance(made, Scene) else _read(str(made), path)
    elif options:
        raise ValueError(f"[world] has the keys {', '.join(options)}; expected only `look_at` beside {path}")
    else:
        found = _read(path.read_text(encoding="utf-8"), path)
    return found if look_at is None else replace(found, look_at=tuple(look_at))


def module(path: Path) -> ModuleType:
    """Imports a module by its file.

    Raises:
        ValueError: The file is no module.
    """
    found = importlib.util.spec_from_file_location(path.stem, path)
    if found is None or found.loader is None:
        raise ValueError(f"{path}: cannot be imported; expected a Python module")
    made = importlib.util.module_from_spec(found)
    try:
        found.loader.exec_module(made)
    except (SyntaxError, ImportError) as error:
        raise ValueError(f"{path}: cannot be imported: {error}") from error
    except Exception as error:
        lines = [one.lineno for one in traceback.extract_tb(error.__traceback__) if one.filename == str(path)]
        where = f", line {lines[-1]}" if lines else ""
        raise ValueError(f"{path}{where}: cannot be imported: {type(error).__name__}: {error}") from error
    return made


def _read(text: str, path: Path) -> Scene:
    try:
        model = ET.fromstring(text)
    except ET.ParseError as error:
        raise ValueError(f"{path} is not XML: {error}") from error
    if model.tag != "mujoco":
        raise ValueError(f"{path} holds <{model.tag}>; expected the model <mujoco> of MuJoCo")
    others = sorted({section.tag for section in model} - TAKEN)
    if others:
        raise ValueError(
            f"{path} has <{'>, <'.join(others)}>; expected only <worldbody> and <asset>, because time step, "
            "defaults, actuators and sensors are those of the experiment"
        )
    for element in model.iter():
        if "file" in element.attrib:
            element.set("file", str((path.parent / element.attrib["file"]).resolve()))
    for geom in model.iter("geom"):
        geom.attrib.update(CONTACT | geom.attrib)
    elements = [element for body in model.iter("worldbody") for element in body]
    return Scene((floor(), *elements), extra=tuple(model.iter("asset")))
