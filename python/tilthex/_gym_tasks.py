"""The tasks of `tilthex.gym`: what an episode draws, its world, its goal, and its reward."""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

import tilthex

if TYPE_CHECKING:
    from tilthex.experiments.scenes import Scene
    from tilthex.experiments.spec import Run

Vector = NDArray[np.float64]
LEVEL = np.eye(3)
TICK = 0.002
"""Control period, s."""


class Air:
    """The simulated body in free air, with pushes of its tool; the attributes are those of `Contact`."""

    def __init__(self, drawn: tilthex.Drawn, model: tilthex.Vehicle, tool: Vector) -> None:
        """The vehicle in a level hover with its tool at a position, m, W."""
        self._captured = drawn.sensor_errors().captured
        start = tool - model.tool_position - self._captured
        self._plant = tilthex.Plant(drawn.vehicle, start, effects=drawn.effects())
        self.push = (0.0, 0.0, np.zeros(3))
        """Begin and end, s, and force, N, W."""
        self.force: Vector = np.zeros(3)
        """True force on the tool, N, W."""

    def step(self, command: Vector, time: float) -> None:
        """Advances by one control period under commanded rotor speeds, Hz."""
        begin, end, force = self.push
        self.force = force if begin <= time < end else np.zeros(3)
        self._plant.step(command, tool_wrench=np.concatenate([self.force, np.zeros(3)]), dt=TICK)

    @property
    def position(self) -> Vector:
        """Position of the centre of mass of the model, which motion capture measures, m, W."""
        return self._plant.position + self._plant.rotation @ self._captured

    @property
    def velocity(self) -> Vector:
        """Its velocity, m/s, W."""
        spin = self._plant.rotation @ np.cross(self._plant.angular_velocity, self._captured)
        return self._plant.velocity + spin

    def __getattr__(self, name: str) -> Any:
        """The other values of the state: those of the plant."""
        return getattr(self._plant, name)


class Contact:
    """The world of the experiments in MuJoCo, with contacts."""

    def __init__(
        self, drawn: tilthex.Drawn, model: tilthex.Vehicle, tool: Vector, scene: Scene, seed: int
    ) -> None:
        """The vehicle in a level hover with its tool at a position, m, W, in a scene."""
        from tilthex.experiments.world import Noise, World

        start = tool + drawn.vehicle.tool_position - model.tool_position - drawn.sensor_errors().captured
        self._world = World(
            drawn.vehicle,
            scene,
            Noise(),
            seed=seed,
            tool_position=start,
            tool_rotation=drawn.vehicle.tool_rotation,
            drawn=drawn,
        )
        self.force: Vector = np.zeros(3)
        """True force on the tool, N, W."""

    def step(self, command: Vector, time: float) -> None:
        """Advances by one control period under commanded rotor speeds, Hz."""
        self._world.step(command)
        self.force = self._world.contact_wrench()[0][:3]

    @property
    def position(self) -> Vector:
        """Position of the centre of mass of the model, which motion capture measures, m, W."""
        return np.asarray(self._world.captured_position)

    @property
    def velocity(self) -> Vector:
        """Its velocity, m/s, W."""
        spin = self.rotation @ np.cross(self.angular_velocity, self._world.captured)
        return np.asarray(self._world.velocity + spin)

    @property
    def rotation(self) -> Vector:
        """Rotation `R_WR`, (3, 3)."""
        return np.asarray(tilthex.so3.project(self._world.rotation))

    @property
    def angular_velocity(self) -> Vector:
        """Angular velocity, rad/s, R."""
        return np.array(self._world.angular_velocity)

    @property
    def rotor_speeds(self) -> Vector:
        """Rotor speeds, Hz, (n,)."""
        return np.array(self._world.rotor_speeds)

    @property
    def specific_force(self) -> Vector:
        """Specific force at the centre of mass over the last period, m/s^2, R."""
        return np.array(self._world.true_specific_force())


class Hover:
    """The tool begins up to 0.1 m from its goal, and stays there."""

    world: Air | Contact
    goal_rotation: Vector = LEVEL

    @staticmethod
    def config() -> tilthex.Config:
        """The configuration that an environment has by default."""
        return tilthex.Config.default(tilthex.Vehicle.preset("tilt-hex"))

    def __init__(self, draws: np.random.Generator, drawn: tilthex.Drawn, model: tilthex.Vehicle) -> None:
        """Draws the start. `start` and `goal` are positions of the tool, m, W."""
        self.goal = np.array([0.0, 0.0, 1.0])
        self.goal_rotation = model.tool_rotation
        self.start = self.goal + draws.uniform(-0.1, 0.1, 3) / np.sqrt(3.0)
        self.world = Air(drawn, model, self.start)

    def away(self, tool: Vector) -> float:
        """How far the tool is from the straight way to its goal, m."""
        way = self.goal - self.start
        part = np.clip((tool - self.start) @ way / max(float(way @ way), 1e-9), 0.0, 1.0)
        return float(np.linalg.norm(tool - self.start - part * way))

    def reward(self, position: float, rotation: float) -> float:
        """Reward of a second: from -1 (far) to 0 (at the goal). Takes the errors in m and rad."""
        return -min(1.0, 2.0 * position + 0.2 * rotation)

    def success(self, tool: Vector) -> bool:
        """Whether the task is done, so that the episode ends."""
        return False


class Push(Hover):
    """As hover, under a push of 1 to 3 N for 1 to 3 s that begins within 3 s."""

    def __init__(self, draws: np.random.Generator, drawn: tilthex.Drawn, model: tilthex.Vehicle) -> None:
        """Draws the start and the push."""
        super().__init__(draws, drawn, model)
        direction = draws.standard_normal(3)
        force = draws.uniform(1.0, 3.0) * direction / np.linalg.norm(direction)
        begin = draws.uniform(0.5, 3.0)
        assert isinstance(self.world, Air)
        self.world.push = (begin, begin + draws.uniform(1.0, 3.0), force)


class Slide(Hover):
    """Moves the tool by 0.3 m along x on a board tilted by up to 10 degrees, and presses it with 1 N."""

    FORCE = 1.0

    @staticmethod
    def config() -> tilthex.Config:
        """The configuration of the experiment "sliding"."""
        return _configured(_run("sliding"))

    def __init__(self, draws: np.random.Generator, drawn: tilthex.Drawn, model: tilthex.Vehicle) -> None:
        """Draws the board's tilt and friction, and the start 1 to 3 cm above it."""
        from tilthex.experiments.scenes import SCENES
        from tilthex.mjcf import TOOL_RADIUS

        tilt, friction = draws.uniform(-10.0, 10.0, 2).tolist(), float(draws.uniform(0.05, 0.3))
        scene = SCENES["plane"](point=[0.0, 0.0, 0.457], tilt_deg=tilt, friction=friction)
        self._normal = scene.rotation[:, 2]
        along = scene.rotation @ [0.3, 0.0, 0.0]
        self.goal = scene.origin + TOOL_RADIUS * self._normal + along
        self.goal_rotation = model.tool_rotation
        self.start = self.goal - along + draws.uniform(0.01, 0.03) * self._normal
        self.world = Contact(drawn, model, self.start, scene, int(draws.integers(2**31)))

    def reward(self, position: float, rotation: float) -> float:
        """As that of hover; a second without the wanted force costs up to 0.5 more."""
        pressed = float(self.world.force @ self._normal)
        return super().reward(position, rotation) - 0.5 * min(1.0, abs(pressed - self.FORCE) / self.FORCE)


class Peg(Hover):
    """Inserts the tool into a funnel whose tilt the goal does not know. The draws are the experiment's."""

    @staticmethod
    def config() -> tilthex.Config:
        """The configuration of the experiment "peg-in-hole"."""
        return _configured(_run("peg-in-hole"))

    def __init__(self, draws: np.random.Generator, drawn: tilthex.Drawn, model: tilthex.Vehicle) -> None:
        """Draws tilt, friction and place of the funnel."""
        from tilthex.experiments import peg_in_hole

        case = peg_in_hole.draw(_run("peg-in-hole"), int(draws.integers(2**31)), 0)
        self._run, self._scene = case, case.scene()
        self.start = np.array([0.0, 0.0, 0.525])
        self.goal = np.array([0.0, 0.0, 0.5 - case.judge["depth"]])
        self.goal_rotation = model.tool_rotation
        self.world = Contact(drawn, model, self.start, self._scene, case.seed)

    def success(self, tool: Vector) -> bool:
        """Whether the tip is at the bottom of the tube."""
        x, y, z = self._scene.along(tool)
        depth = self._run.judge["tip_radius"] - z
        return bool(np.hypot(x, y) < 0.006 and depth > self._run.judge["depth"] - 2e-3)


TASKS: dict[str, type[Hover]] = {"hover": Hover, "push": Push, "slide": Slide, "peg": Peg}


@functools.cache
def _run(name: str) -> Run:
    """The first run of an experiment of the package."""
    from tilthex.experiments import spec

    return spec.load(name).runs[0]


def _configured(run: Run) -> tilthex.Config:
    return run.configuration()
