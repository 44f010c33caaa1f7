"""The controller in Python, block by block, each of which can be replaced by an object of your own.

A block is any object with the method that the protocol of its place names; the compiled blocks have it.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tilthex import _core

__all__ = ["AdmittanceBlock", "AllocatorBlock", "Chain", "ObserverBlock", "PoseBlock"]

Vector = NDArray[np.float64]


class ObserverBlock(Protocol):
    """The place of `tilthex.WrenchObserver`."""

    def step(
        self,
        *,
        rotation: ArrayLike,
        angular_velocity: ArrayLike,
        specific_force: ArrayLike,
        rotor_speeds: ArrayLike,
        dt: float,
    ) -> Vector:
        """The external wrench at the centre of mass, (6,): N in world, N m in robot axes."""


class AdmittanceBlock(Protocol):
    """The place of `tilthex.AdmittanceFilter`."""

    def step(self, setpoint: _core.Setpoint, wrench: Vector, dt: float) -> _core.Setpoint:
        """The reference of the tool under a wrench at the tool, (6,), N and N m, world."""


class PoseBlock(Protocol):
    """The place of `tilthex.PoseController`."""

    def step(
        self,
        *,
        position: ArrayLike,
        velocity: ArrayLike,
        rotation: ArrayLike,
        angular_velocity: ArrayLike,
        reference: _core.Reference,
    ) -> _core.PoseCommand:
        """The accelerations that bring the robot to the reference of its centre of mass."""


class AllocatorBlock(Protocol):
    """The place of `tilthex.Allocator`."""

    def allocate(
        self, wrench: ArrayLike, rotor_speeds: ArrayLike, *, rotation: ArrayLike
    ) -> _core.Allocation:
        """The rotor speeds that produce a body wrench, (6,), N and N m, robot axes."""


class Chain:
    """The blocks of the paper's figure 5 in a row.

    `step` takes and returns what `tilthex.Controller.step` does.

    The compiled blocks and what joins them are the laws of `tilthex.Controller`. The chain has only these
    laws: no low-pass filter and dead zone before the admittance filter, no bias, no limits for a wrench
    set-point, no tilting towards a lateral force. A block of your own gets what its place names.
    """

    def __init__(
        self,
        vehicle: _core.Vehicle,
        config: _core.Config,
        *,
        observer: ObserverBlock | None = None,
        admittance: AdmittanceBlock | None = None,
        pose: PoseBlock | None = None,
        allocator: AllocatorBlock | None = None,
    ) -> None:
        """The compiled blocks of a vehicle and a configuration, except for those that are given.

        Raises:
            TypeError: An object does not have the method of its place.
        """
        places = ("observer", observer), ("admittance", admittance), ("pose", pose), ("allocator", allocator)
        for place, block in places:
            method = "allocate" if place == "allocator" else "step"
            if block is not None and not callable(getattr(block, method, None)):
                kind = type(block).__name__
                raise TypeError(f"{place} is a {kind} without a method `{method}`; expected a block")
        self.vehicle = vehicle
        self.observer = _core.WrenchObserver(vehicle, config) if observer is None else observer
        self.admittance = _core.AdmittanceFilter(config) if admittance is None else admittance
        self.pose = _core.PoseController(config) if pose is None else pose
        self.allocator = _core.Allocator(vehicle, config) if allocator is None else allocator

    def step(
        self,
        *,
        position: ArrayLike,
        velocity: ArrayLike,
        rotation: ArrayLike,
        angular_velocity: ArrayLike,
        specific_force: ArrayLike,
        rotor_speeds: ArrayLike,
        setpoint: _core.Setpoint,
        dt: float = 0.002,
    ) -> _core.Output:
        """One tick, from measurements to rotor speeds; the arguments of `tilthex.Controller.step`."""
        turn, spin = np.asarray(rotation, dtype=float), np.asarray(angular_velocity, dtype=float)
        external = self.observer.step(
            rotation=turn,
            angular_velocity=spin,
            specific_force=specific_force,
            rotor_speeds=rotor_speeds,
            dt=dt,
        )
        felt = self.vehicle.tool_wrench(external, turn)
        reference = self.admittance.step(setpoint, felt + setpoint.wrench, dt)
        followed = self.vehicle.robot_reference(reference)
        command = self.pose.step(
            position=position, velocity=velocity, rotation=turn, angular_velocity=spin, reference=followed
        )
        inertia = self.vehicle.inertia
        lift = command.acceleration + np.array([0.0, 0.0, _core.GRAVITY])
        force = turn.T @ (self.vehicle.mass * lift - external[:3])
        torque = inertia @ command.angular_acceleration + np.cross(spin, inertia @ spin) - external[3:]
        wanted = np.concatenate([force, torque])
        found = self.allocator.allocate(wanted, rotor_speeds, rotation=turn)
        return _core.Output(
            rotor_speeds=found.rotor_speeds,
            wrench_robot=external,
            wrench_tool=felt,
            wrench_admittance=felt,
            reference=reference,
            robot_reference=followed,
            position_error=command.position_error,
            velocity_error=command.velocity_error,
            rotation_error=command.rotation_error,
            angular_velocity_error=command.angular_velocity_error,
            wanted_wrench=wanted,
            allocated_wrench=found.wrench,
            saturated=found.saturated,
        )
