"""Buttons, sliders and the gizmo that give orders to a flight."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import viser.transforms as vtf
from numpy.typing import NDArray
from viser import Icon

from tilthex.view.scene import wxyz

if TYPE_CHECKING:
    import viser

    from tilthex import Flight
    from tilthex.view.pilot import Pilot
    from tilthex.view.sample import Pose

Array = NDArray[np.float64]

AXES = ("x", "y", "z", "about x", "about y", "about z")
KILL = "KILL"
KILLS = "The motors stop at once, and the vehicle falls. The keys Shift and K do the same."
# The icon makes the button recognisable; it has no other mark.
LARGE = (
    "<style>button:has(svg.icon-tabler-skull)"
    "{height:2.6em !important;font-size:1.8em !important;font-weight:bold !important}</style>"
)
LARGEST = {
    "stiffness": (100.0, 30.0),
    "damping": (80.0, 20.0),
}
"""Ends of the sliders: translation, N/m and N s/m; rotation, N m/rad and N m s/rad."""


class Controls:
    """The controls of a flight. All orders go through the pilot, which shows refusals."""

    def __init__(self, server: viser.ViserServer, pilot: Pilot) -> None:
        self._pilot, self._gui = pilot, server.gui
        self.sliders: dict[str, list[viser.GuiSliderHandle[float]]] = {}
        self._gui.add_html(LARGE)
        kill = self._gui.add_button(KILL, color="red", icon=Icon.SKULL, hint=KILLS)
        kill.on_click(lambda _: pilot.kill.press())
        key = self._gui.add_command(KILL, hotkey="K", modifier="shift", icon=Icon.SKULL)
        key.on_trigger(lambda _: pilot.kill.press())
        self._button("take off", lambda flight: flight.take_off(), Icon.PLAYER_PLAY)
        self._button("hold", _hold, Icon.HAND_STOP)
        land = self._gui.add_button("land", icon=Icon.PLANE_ARRIVAL, color="orange")
        land.on_click(lambda _: pilot.land.press())
        with self._gui.add_folder("Go to"):
            self._go_to(server)
        with self._gui.add_folder("Stiffness and damping", expand_by_default=False):
            self._admittance()
        with self._gui.add_folder("Wrench of the tool", expand_by_default=False):
            self._wrench()
        self._button("zero bias", lambda flight: flight.zero_bias(), Icon.ADJUSTMENTS)
        self._button("take controls", lambda flight: flight.take_controls(), Icon.HAND_GRAB)

    def _button(self, label: str, order: Any, icon: Any = None) -> None:
        button = self._gui.add_button(label, icon=icon)
        button.on_click(lambda _: self._pilot.order(label, order))

    def _go_to(self, server: viser.ViserServer) -> None:
        self.gizmo = server.scene.add_transform_controls("/goal", scale=0.25, depth_test=False, visible=False)
        shown = self._gui.add_checkbox("gizmo", False, hint="Shows where to go; drag and turn it.")
        self._moved = False

        @self.gizmo.on_update
        def _(_: object) -> None:
            self._moved = True

        @shown.on_update
        def _(_: object) -> None:
            self.gizmo.visible = shown.value

        velocity = self._gui.add_slider("speed, m/s", min=0.05, max=1.0, step=0.05, initial_value=0.2)

        def go(flight: Any) -> None:
            rotation = vtf.SO3(np.asarray(self.gizmo.wxyz)).as_matrix()
            flight.go_to(self.gizmo.position, rotation, velocity=velocity.value)

        self._button("go to the gizmo", go, Icon.TARGET_ARROW)
        self._gui.add_button("gizmo to the tool").on_click(lambda _: self._back())

    def aim(self, goal: Pose) -> None:
        """Moves the gizmo to a wanted pose of the tool."""
        self._moved = True
        self.gizmo.position, self.gizmo.wxyz = goal.position, wxyz(goal.rotation)

    def _back(self) -> None:
        self._moved = False
        self.update()

    def update(self) -> None:
        """Keeps the gizmo at the set-point until the operator moves it."""
        sample = self._pilot.newest
        if not self._moved and sample is not None and np.isfinite(sample.setpoint.position).all():
            self.aim(sample.setpoint)
            self._moved = False

    def _admittance(self) -> None:
        table = self._pilot.config.to_dict()["admittance"]
        for key, ends in LARGEST.items():
            self._six(key, np.asarray(table[key], dtype=float), ends)

    def _six(self, key: str, configured: Array, ends: tuple[float, float]) -> None:
        """Six sliders for the diagonal of a matrix; the other entries stay."""
        start = configured if configured.ndim == 1 else np.diag(configured)
        sliders = []
        for axis, (name, value) in enumerate(zip(AXES, start, strict=True)):
            end = max(ends[axis // 3], 2.0 * float(value))
            slider = self._gui.add_slider(
                f"{key} {name}", min=0.0, max=end, step=end / 400, initial_value=float(value)
            )
            sliders.append(slider)

        def order(flight: Any) -> None:
            values = np.array([slider.value for slider in sliders])
            whole = values if configured.ndim == 1 else configured - np.diag(start - values)
            flight.set_admittance(**{key: whole})

        self.sliders[key] = sliders
        for slider in sliders:
            slider.on_update(lambda _: self._pilot.order(key, order))

    def _wrench(self) -> None:
        force = self._gui.add_vector3("force, N", (0.0, 0.0, 0.0), step=0.1)
        torque = self._gui.add_vector3("torque, N m", (0.0, 0.0, 0.0), step=0.01)
        self._button(
            "set wrench", lambda flight: flight.set_wrench(force.value, torque.value), Icon.ARROW_RIGHT
        )
        self._button("release wrench", lambda flight: flight.release_wrench(), Icon.ARROW_BACK)


def _hold(flight: Flight) -> None:
    """Ends the motion: the tool stays at its set-point."""
    flight.go_to(flight.state()["setpoint"]["position"])
