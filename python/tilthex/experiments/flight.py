"""Flies one run: the controller of tilthex in closed loop with the world in MuJoCo."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

import tilthex
from tilthex.experiments.own import Controller, Own
from tilthex.experiments.plan import make
from tilthex.experiments.record import Record, Vector
from tilthex.experiments.spec import Run
from tilthex.experiments.world import PERIOD, World

Progress = Callable[[int], object]
FAR = 2.0
"""If the tool is farther than this from its start, m, it was thrown out, and the run ends."""


LIFT = 0.4
"""The calibration is flown this far above the start, m, because its tilts move the tool by 0.1 m."""


def fly(
    run: Run, *, exact: bool = False, progress: Progress | None = None, controller: Controller | None = None
) -> Record:
    """Flies a run and returns its record, which begins after the calibration.

    Args:
        run: The run.
        exact: Whether the controller gets the true state instead of the estimator's.
        progress: Called with the number of periods since its last call.
        controller: A controller of your own in place of the package's. It gets the true state; nothing is
            calibrated, and no supervisor watches it.
    """
    chain: tilthex.Loop | Own
    if controller is None:
        chain = tilthex.Loop(run.configuration())
    else:
        chain, exact = Own(controller), True
    drawn = run.drawn()
    vehicle = drawn.vehicle
    plan = make(run)
    start = plan.setpoints[0]
    hovers, way_down = calibration(run, start) if controller is None else ([], [])
    first = hovers[0] if hovers else start
    world = world_at(run, drawn, first)
    joints = len(world.scene_joints)
    record = Record.blank(len(plan.setpoints), vehicle.rotor_count, joints, plan.phases, run.name)
    rows = record.columns
    chain.initialize(0.0, world.captured_position, world.rotation)
    push = np.array(run.push.get("force", (0.0, 0.0, 0.0)), dtype=float)
    push_from, push_to = run.push.get("start", 0.0), run.push.get("end", 0.0)
    learn_from, learn_to = run.learn_bias
    still = np.zeros(3)
    command = vehicle.hover_speeds(world.rotation)
    begun = time.perf_counter()
    for learn, setpoints in ((True, hovers), (False, way_down)):
        for setpoint in setpoints:
            world.step(command)
            command = step(chain, world, setpoint, exact=exact, learn_model=learn)
    if hovers and chain.model_refused is not None:
        record.ended = f"calibration refused: {chain.model_refused}"
    begin = world.time
    for k, setpoint in enumerate(plan.setpoints):
        now = k * PERIOD
        world.push = push if push_from <= now < push_to else still
        world.step(command)
        now = world.time - begin
        command = step(chain, world, setpoint, exact=exact, learn_bias=learn_from <= now < learn_to)
        tool = world.tool_position
        rows["time"][k] = now
        rows["tool_position"][k] = tool
        rows["robot_position"][k] = world.position
        rows["robot_rotation"][k] = world.rotation
        rows["tool_velocity"][k] = world.tool_velocity
        rows["angular_velocity"][k] = world.angular_velocity
        rows["true_wrench"][k], rows["largest_contact"][k], rows["pressure"][k] = world.true_wrench()
        rows["peak_force"][k] = world.peak_force
        rows["rotor_speeds"][k] = world.rotor_speeds
        rows["scene_joints"][k] = world.scene_joints
        if progress is not None and k % 250 == 249:
            progress(250)
        away = tool - start.position
        if not away @ away < FAR * FAR:
            record.ended = f"thrown {FAR:g} m away from the first way-point at {now:.2f} s"
            record.cut(k + 1)
            break
    record.seconds = time.perf_counter() - begun
    record.phase = plan.phase[: len(record.time)]
    before = len(hovers) + len(way_down)
    flown = {name: column[before:] for name, column in chain.record().items()}
    record.take(flown, vehicle.tool_rotation)
    return record


def world_at(run: Run, drawn: tilthex.Drawn, setpoint: tilthex.Setpoint) -> World:
    """The world of a run with its drawn vehicle at rest, the tool at a set-point."""
    return World(
        drawn.vehicle,
        run.scene(),
        run.noise,
        seed=run.seed,
        tool_position=setpoint.position,
        tool_rotation=setpoint.rotation,
        drawn=drawn,
    )


def calibration(run: Run, start: tilthex.Setpoint) -> tuple[list[tilthex.Setpoint], list[tilthex.Setpoint]]:
    """Set-points of the calibration above a run's start, and of the way down.

    Both are empty without a calibration.
    """
    if run.calibration == "none":
        return [], []
    model = run.model()
    rotation = start.rotation @ model.tool_rotation.T
    heading = float(np.arctan2(rotation[1, 0], rotation[0, 0]))
    above = start.position + np.array([0.0, 0.0, LIFT])
    flight = tilthex.calibration_flight(model, above, heading)
    end = flight.sample(flight.duration)
    down = tilthex.Trajectory(
        [
            {"position": end.position, "rotation": end.rotation},
            {"position": start.position, "rotation": start.rotation, "hold": 2.0},
        ],
        velocity=0.3,
        acceleration=0.5,
    )
    hovers, way_down = (
        [way.sample(k * PERIOD) for k in range(round(way.duration / PERIOD))] for way in (flight, down)
    )
    return hovers, way_down


def step(
    chain: tilthex.Loop | Own,
    world: World,
    setpoint: tilthex.Setpoint,
    *,
    exact: bool = False,
    learn_bias: bool = False,
    learn_model: bool = False,
) -> Vector:
    """One control period of the controller in this world: commanded rotor speeds, Hz, (n,)."""
    if exact or isinstance(chain, Own):
        return chain.step_from(
            world.time,
            position=world.captured_position,
            velocity=world.velocity,
            rotation=world.rotation,
            angular_velocity=world.angular_velocity,
            specific_force=world.true_specific_force(),
            rotor_speeds=world.measured_rotor_speeds(),
            setpoint=setpoint,
            learn_bias=learn_bias,
            learn_model=learn_model,
        )
    return chain.step(
        world.time,
        world.gyro(),
        world.specific_force(),
        world.measured_rotor_speeds(),
        world.arrived_poses(),
        setpoint,
        learn_bias=learn_bias,
        learn_model=learn_model,
    )
