"""Environments of Gymnasium: hover, push, slide and peg, with a drawn true vehicle in every episode.

Importing this module registers `tilthex/Hover-v0`, `tilthex/Push-v0`, `tilthex/Slide-v0` and
`tilthex/Peg-v0` for `gymnasium.make` and `gymnasium.make_vec`. It needs `pip install 'tilthex[gym]'`; slide
and peg need `'tilthex[gym,experiments]'`.
"""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

import tilthex
from tilthex import _gym_tasks as tasks

try:
    import gymnasium
    from gymnasium import spaces
except ImportError as error:
    raise ImportError(
        "tilthex.gym needs Gymnasium, which is not installed: pip install 'tilthex[gym]'"
    ) from error

__all__ = ["ACTIONS", "TASKS", "Flight"]

Vector = NDArray[np.float64]

TASKS = tuple(tasks.TASKS)
"""The names of the tasks."""
ACTIONS = ("setpoint", "wrench", "rotor_speeds")
"""The kinds of actions: see `Flight`."""
TICK = 0.002
"""Control period, s."""
FAR = 0.5
"""A tool that is farther than this from its way to the goal, m, ends an episode."""
LIMITS = np.repeat([1.0, np.pi, 5.0, 20.0, 100.0, 20.0, 1.0], [3, 3, 3, 3, 3, 3, 3])
"""The largest values of an observation without the rotors: beyond them it is clipped."""


class Flight(gymnasium.Env):  # type: ignore[misc]
    """A vehicle whose tool must reach the goal of a task. Every reset draws another true vehicle and world.

    The action holds for `period` seconds. Its numbers are from -1 to 1:

    - "setpoint", (6,): how fast the set-point of the admittance filter moves, 1 for 0.1 m/s and 0.5 rad/s
      about world axes. The whole controller flies, as in `tilthex.Loop`, with the true state.
    - "wrench", (6,): the body wrench in robot axes in addition to the weight, 1 for half of the weight and
      for 1 N m. The allocator turns it into rotor speeds.
    - "rotor_speeds", (n,): 0 for the speed in hover, -1 and 1 for the lowest and the highest.

    The observation, (21 + n,): the goal's position minus the tool's, m, world (3); the rotation vector from
    the tool to the goal, rad, world (3); the tool's velocity, m/s, world (3); the angular velocity, rad/s,
    robot (3); the external force, N, and torque, N m, at the tool, world, which the wrench observer of the
    package estimates (6); the world's vertical in robot axes (3); the rotor speeds as parts of the highest
    (n). Position, attitude and velocities are true, without noise.

    An episode ends (`terminated`) if the peg is at the bottom of its hole, if the tool is more than 0.5 m
    from the way to its goal, or if the flight lands after a fault. `info` has `position_error` m,
    `rotation_error` rad, `contact_force` N (true), `success` and `fault` (names, only "setpoint").
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": []}

    def __init__(
        self,
        task: str = "hover",
        *,
        action: str = "setpoint",
        config: tilthex.Config | None = None,
        truth: Any = "measured",
        period: float = 0.02,
        duration: float = 10.0,
    ) -> None:
        """An environment; it begins with the first `reset`.

        Args:
            task: "hover" holds the tool at the goal, from 0.1 m away; "push" also under a random push;
                "slide" moves the tool by 0.3 m along a tilted board that it presses with 1 N; "peg" inserts
                the tool into a tilted funnel, whose tilt the goal does not know.
            action: "setpoint", "wrench" or "rotor_speeds".
            config: The configuration, with the controller's model of the vehicle. By default that of the
                experiments, with the Tilt-Hex.
            truth: How the true vehicle differs from the model, as `tilthex.simulate` takes it.
            period: How long an action holds, s: a multiple of 0.002 s.
            duration: The episode's duration, s: then it is `truncated`.

        Raises:
            ValueError: A task, an action, a period or a duration that does not exist.
        """
        for name, found, known in (("task", task, TASKS), ("action", action, ACTIONS)):
            if found not in known:
                raise ValueError(f"{name} is {found!r}; expected one of {', '.join(known)}")
        ticks = round(period / TICK)
        if not (ticks > 0 and abs(ticks * TICK - period) < 1e-9):
            raise ValueError(f"period is {period}; expected a positive multiple of {TICK} s")
        if not duration >= period:
            raise ValueError(f"duration is {duration}; expected at least the period, {period} s")
        self.task, self.action, self.period = task, action, period
        self._task = tasks.TASKS[task]
        self._ticks, self._last = ticks, round(duration / period)
        self.config = self._task.config() if config is None else config
        self.model = self.config.vehicle
        self.truth = tilthex.Truth(self.model, truth)
        count = self.model.rotor_count
        bounds = np.concatenate([LIMITS, np.full(count, 2.0)])
        self.observation_space = spaces.Box(-bounds, bounds, dtype=np.float64)
        self.action_space = spaces.Box(-1.0, 1.0, (count if action == "rotor_speeds" else 6,), np.float64)
        self._allocator = tilthex.Allocator(self.model, self.config)
        self._hover = self.model.hover_speeds()
        self._limits = self.model.rotor_speed_limits

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Vector, dict[str, Any]]:
        """Begins an episode with a vehicle and a world that the seed draws. There are no options."""
        super().reset(seed=seed)
        drawn = self.truth.draw(int(self.np_random.integers(2**32)))
        self._episode = self._task(self.np_random, drawn, self.model)
        world = self._episode.world
        self._observer = tilthex.WrenchObserver(self.model, self.config)
        if self.action == "setpoint":
            self._loop = tilthex.Loop(self.config)
            self._loop.initialize(0.0, world.position, world.rotation)
        self._place, self._turn = self._episode.start, world.rotation @ self.model.tool_rotation
        self._command, self._steps, self._time = self._hover, 0, 0.0
        self._wrench = np.zeros(6)
        return self._observed(), self._info()

    def step(self, action: Vector) -> tuple[Vector, float, bool, bool, dict[str, Any]]:
        """Lets the action act for one period."""
        action = np.clip(np.asarray(action, dtype=float), -1.0, 1.0)
        for _ in range(self._ticks):
            self._tick(action)
        self._steps += 1
        info = self._info()
        away = self._episode.away(self._tool())
        landing = self.action == "setpoint" and self._loop.phase in ("landing", "emergency")
        terminated = bool(info["success"] or landing or away > FAR)
        reward = self._episode.reward(info["position_error"], info["rotation_error"])
        failed = terminated and not info["success"]
        remaining = self._last - self._steps
        # What ends early is not better than the worst rest of the episode.
        reward = self.period * (reward - remaining * failed + remaining * bool(info["success"]))
        return self._observed(), float(reward), terminated, self._steps >= self._last, info

    def _tick(self, action: Vector) -> None:
        world = self._episode.world
        world.step(self._command, self._time)
        self._time += TICK
        external = self._observer.step(
            rotation=world.rotation,
            angular_velocity=world.angular_velocity,
            specific_force=world.specific_force,
            rotor_speeds=world.rotor_speeds,
            dt=TICK,
        )
        self._wrench = self.model.tool_wrench(external, world.rotation)
        if self.action == "setpoint":
            self._command = self._controlled(action)
        elif self.action == "wrench":
            weight = self.model.weight
            force = 0.5 * weight * action[:3] + world.rotation.T @ [0.0, 0.0, weight]
            wanted = np.concatenate([force, action[3:]])
            found = self._allocator.allocate(wanted, world.rotor_speeds, rotation=world.rotation)
            self._command = found.rotor_speeds
        else:
            low, high = self._limits.T
            room = np.where(action > 0.0, high - self._hover, self._hover - low)
            self._command = self._hover + action * room

    def _controlled(self, action: Vector) -> Vector:
        """The command of the whole controller, whose set-point moves."""
        world = self._episode.world
        velocity, rate = 0.1 * action[:3], 0.5 * action[3:]
        self._place = self._place + TICK * velocity
        self._turn = tilthex.so3.project(tilthex.so3.exp(TICK * rate) @ self._turn)
        return self._loop.step_from(
            self._time,
            position=world.position,
            velocity=world.velocity,
            rotation=world.rotation,
            angular_velocity=world.angular_velocity,
            specific_force=world.specific_force,
            rotor_speeds=world.rotor_speeds,
            setpoint=tilthex.Setpoint(self._place, self._turn, velocity=velocity, angular_velocity=rate),
        )

    def _tool(self) -> Vector:
        world = self._episode.world
        return world.position + world.rotation @ self.model.tool_position

    def _errors(self) -> tuple[Vector, Vector]:
        """From the tool to the goal: position, m, and rotation vector, rad, world."""
        tool = self._episode.world.rotation @ self.model.tool_rotation
        turn = tilthex.so3.log(tilthex.so3.project(self._episode.goal_rotation @ tool.T))
        return self._episode.goal - self._tool(), turn

    def _observed(self) -> Vector:
        world = self._episode.world
        offset = world.rotation @ self.model.tool_position
        spin = world.rotation @ world.angular_velocity
        parts = (
            *self._errors(),
            world.velocity + np.cross(spin, offset),
            world.angular_velocity,
            self._wrench,
            world.rotation[2],
            world.rotor_speeds / self._limits[:, 1],
        )
        bounds = self.observation_space.high
        return np.asarray(np.clip(np.concatenate(parts), -bounds, bounds))

    def _info(self) -> dict[str, Any]:
        position, turn = self._errors()
        return {
            "position_error": float(np.linalg.norm(position)),
            "rotation_error": float(np.linalg.norm(turn)),
            "contact_force": float(np.linalg.norm(self._episode.world.force)),
            "success": self._episode.success(self._tool()),
            "fault": " ".join(self._loop.faults) if self.action == "setpoint" else "",
        }


for _name in TASKS:
    gymnasium.register(f"tilthex/{_name.capitalize()}-v0", "tilthex.gym:Flight", kwargs={"task": _name})
