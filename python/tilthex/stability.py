"""`tilthex.margins`: how far a configuration is from instability (docs/stability.md)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tilthex._core import Config, LoopModel

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Margins:
    """Stability of the loop in a hover and in contact.

    Arrays have one value for each of `axes`: position along x, y, z, then rotation about x, y, z.
    """

    axes: list[str]
    stable: bool
    """Whether the hover is stable."""
    phase_margin: Array
    """Phase margins, rad, (6,)."""
    sensitivity_peak: Array
    """Largest sensitivities, (6,)."""
    contact_stiffness: list[list[tuple[float, float]]]
    """The ranges of stiffness of an environment at which contact is stable: N/m along the first three axes,
    N m/rad about the others. 1e6 stands for any stiffness."""


def margins(config: Config, *, damping_time: float = 0.0) -> Margins:
    """Phase margin, sensitivity peak and the stiffnesses at which contact is stable, of each axis.

    Args:
        config: The configuration; its vehicle is taken for the true one. `LoopModel` takes a truth.
        damping_time: Damping of the touched body divided by its stiffness, s.

    >>> import tilthex
    >>> config = tilthex.Config.default(tilthex.Vehicle.preset("tilt-hex"))
    >>> found = tilthex.margins(config.replace(**tilthex.LoopModel(config).derive()))
    >>> bool(found.stable and found.phase_margin.min() > np.radians(45) and found.sensitivity_peak.max() < 2)
    True
    """
    model = LoopModel(config)
    hover = model.hover()
    return Margins(
        axes=list(model.axes),
        stable=bool(hover["stable"]),
        phase_margin=np.radians(hover["phase_margin_deg"]),
        sensitivity_peak=np.asarray(hover["sensitivity_peak"]),
        contact_stiffness=[
            *(model.contact(along=axis, damping_time=damping_time) for axis in np.eye(3)),
            *(model.contact(about=axis, damping_time=damping_time) for axis in np.eye(3)),
        ],
    )
