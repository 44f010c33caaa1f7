"""Optional libraries: one sentence for those that are missing."""

from __future__ import annotations

import importlib.util
from collections.abc import Mapping


def require(user: str, libraries: Mapping[str, str], extras: str) -> None:
    """Checks that libraries are installed.

    Args:
        user: Who needs them, with the verb: "a video needs".
        libraries: The name of each library, by that of its module.
        extras: The extras of tilthex that install them.

    Raises:
        ImportError: One is missing.
    """
    missing = [name for module, name in libraries.items() if importlib.util.find_spec(module) is None]
    if missing:
        names = " and ".join(missing)
        raise ImportError(f"{user} {names}, not installed: pip install 'tilthex[{extras}]'")
