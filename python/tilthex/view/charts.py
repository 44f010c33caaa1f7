"""The plots of the page: tool position, errors, wrench and rotor speeds over time."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tilthex.view.sample import Sample

if TYPE_CHECKING:
    import viser

    from tilthex import Config

Array = NDArray[np.float64]

COLOURS = (
    "#d62728", "#2ca02c", "#1f77b4", "#ff7f0e", "#9467bd", "#8c564b",
    "#e377c2", "#7f7f7f", "#bcbd22", "#17becf", "#000000", "#aa5500",
)  # fmt: skip
XYZ = ("x", "y", "z")


class Charts:
    """Plots of the newest samples; each has its own vertical axis."""

    def __init__(self, gui: viser.GuiApi, config: Config, keep: int) -> None:
        """Plots of at most `keep` samples."""
        self._config = config
        self._rows: deque[Array] = deque(maxlen=keep)
        self._begin: float | None = None
        rotors = tuple(f"{i + 1}" for i in range(config.vehicle.rotor_count))
        both = tuple(f"{name} {what}" for what in ("reference", "set-point") for name in XYZ)
        self._plots = [
            _add(gui, "tool position, m", both),
            _add(gui, "position error, mm", XYZ),
            _add(gui, "tool force, N", XYZ),
            _add(gui, "tool torque, N m", XYZ),
            _add(gui, "rotor speed, Hz", rotors),
        ]
        self._widths = (6, 3, 3, 3, len(rotors))

    def add(self, sample: Sample) -> None:
        """Adds a sample. `draw` shows it. Times are since the first sample."""
        speeds = np.full(self._widths[-1], np.nan)
        if len(sample.rotor_speeds) == len(speeds):
            speeds = sample.rotor_speeds
        if self._begin is None:
            self._begin = sample.time
        columns = (
            [sample.time - self._begin],
            sample.reference.position,
            sample.setpoint.position,
            1e3 * sample.position_error,
            sample.force,
            sample.torque,
            speeds,
        )
        self._rows.append(np.concatenate(columns))

    def fill(self, samples: Iterable[Sample]) -> None:
        """Replaces all samples."""
        self._rows.clear()
        for sample in samples:
            self.add(sample)
        self.draw()

    def draw(self) -> None:
        """Shows the samples that were added."""
        if not self._rows:
            return
        table = np.array(self._rows)
        begin = 1
        for plot, width in zip(self._plots, self._widths, strict=True):
            plot.data = (table[:, 0], *table[:, begin : begin + width].T)
            begin += width


def _add(gui: viser.GuiApi, title: str, names: tuple[str, ...]) -> viser.GuiUplotHandle:
    from viser import uplot

    series = [uplot.Series(label="time, s")]
    for name, colour in zip(names, COLOURS, strict=False):
        dashed = name.endswith("set-point")
        line = COLOURS[XYZ.index(name[0])] if len(names) == 6 and dashed else colour
        shown = uplot.Series(label=name, stroke=line, width=1.0)
        if dashed:
            shown["dash"] = (4.0, 4.0)
        series.append(shown)
    none = np.zeros(2)
    return gui.add_uplot(
        (np.arange(2.0), *(none for _ in names)),
        tuple(series),
        title=title,
        # The axis shows seconds, not dates.
        scales={"x": uplot.Scale(time=False)},
        legend=uplot.Legend(show=False),
        aspect=2.2,
    )
