"""The page that logs and flights share."""

from __future__ import annotations

from typing import TYPE_CHECKING

from viser import Icon

from tilthex.view import status
from tilthex.view.charts import Charts
from tilthex.view.sample import Sample
from tilthex.view.scene import Scene

if TYPE_CHECKING:
    import viser

    from tilthex import Config


class Page:
    """Status, scene and plots on a server. Logs and flights add their own elements."""

    def __init__(self, server: viser.ViserServer, config: Config, title: str, keep: int) -> None:
        """A page whose plots keep `keep` samples."""
        self.server = server
        gui = server.gui
        gui.configure_theme(show_logo=False, show_share_button=False, control_width="medium")
        gui.main_panel.dock_right()
        gui.set_panel_label(f"tilthex: {title}")
        self.scene = Scene(server, config)
        self._status = gui.add_html("")
        # The controls of the flight or of the log are added here.
        self.controls = gui.add_folder("Controls")
        with gui.add_folder("Show", expand_by_default=False):
            hull = gui.add_checkbox("attainable forces", False)
        plots = gui.add_panel()
        with plots.add_tab("Plots", Icon.CHART_LINE):
            gui.add_markdown("x red, y green, z blue; the set-point is dashed")
            self.charts = Charts(gui, config, keep)
        plots.dock_left()
        plots.set_width(340)

        @hull.on_update
        def _(_: object) -> None:
            self.scene.hull.visible = hull.value

    def show(self, sample: Sample, link_age: float | None = None) -> None:
        """Shows a moment. `draw` of the plots is called separately."""
        text = status.html(sample, self.scene.reach, link_age)
        with self.server.atomic():
            self.scene.show(sample)
            if self._status.content != text:
                self._status.content = text

    def tell(self, title: str, text: str, colour: str = "red") -> None:
        """Shows a message on every open page."""
        for client in self.server.get_clients().values():
            client.add_notification(title, text, color=colour, auto_close_seconds=8.0)  # type: ignore[call-overload]
