"""The wind in which benchmarks fly vehicles from their drawings, and the drag that a configuration knows."""

from __future__ import annotations

import json
from pathlib import Path

FILE = Path(__file__).with_name("cad-wind.toml")
"""The truth."""
CONTACT = {"discrimination": True, "rotor_drag": 2.3e-4, "drag_area": [0.03, 0.03, 0.08]}
"""The keys of `[contact]`: the mean drag in that file."""


def options() -> str:
    """The same as options of `tilthex experiment`."""
    return " ".join(f"--set 'config.contact.{key}={json.dumps(value)}'" for key, value in CONTACT.items())
