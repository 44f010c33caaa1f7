# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
# ---

# %% [markdown]
# # Your own controller
#
# Each block of the controller is a class of its own, with a `step`. So one block can be replaced, here
# the admittance filter: a law of your own in Python, between the wrench observer, the pose controller and
# the allocator of the package. It flies the simulated body of `tilthex.Plant`.

# %%
from dataclasses import dataclass, field

import matplotlib.pyplot as plt
import numpy as np
import tilthex

DT = 0.002
vehicle = tilthex.Vehicle.preset("tilt-hex")
config = tilthex.Config.default(vehicle)
LEVEL, HOME = np.eye(3), np.array([0.0, 0.0, 1.0])

# %% [markdown]
# ## The law
#
# A mass with a damper, and a spring that saturates: beyond the force `largest` the tool gives way, so a
# strong push never meets more than this force.

# %%


@dataclass
class GivesWay:
    """Moves the reference of the centre of mass under a force; SI, world axes."""

    mass: float = 2.0
    damping: float = 12.0
    stiffness: float = 10.0
    largest: float = 1.0
    offset: np.ndarray = field(default_factory=lambda: np.zeros(3))
    velocity: np.ndarray = field(default_factory=lambda: np.zeros(3))

    def step(self, force: np.ndarray) -> tilthex.Reference:
        """The reference after one period."""
        spring = self.stiffness * self.offset
        size = np.linalg.norm(spring)
        if size > self.largest:
            spring *= self.largest / size
        acceleration = (force - self.damping * self.velocity - spring) / self.mass
        self.velocity = self.velocity + DT * acceleration
        self.offset = self.offset + DT * self.velocity
        return tilthex.Reference(
            position=HOME + self.offset, rotation=LEVEL, velocity=self.velocity, acceleration=acceleration
        )


# %% [markdown]
# ## The loop around it
#
# The observer gives the external wrench at the centre of mass (force in world, torque in robot axes). The
# pose controller gives accelerations. The wanted wrench in robot axes is mass and inertia times these,
# plus the weight, minus the observed wrench; the allocator turns it into rotor speeds.


# %%
def fly(law: GivesWay, push: np.ndarray, seconds: float = 12.0) -> tuple[np.ndarray, np.ndarray]:
    """Time, s, (N,), and deviation of the centre of mass, m, (N, 3)."""
    plant = tilthex.Plant(vehicle, position=HOME)
    observer = tilthex.WrenchObserver(vehicle, config)
    pose, allocator = tilthex.PoseController(config), tilthex.Allocator(vehicle, config)
    gravity = np.array([0.0, 0.0, tilthex.GRAVITY])
    rows = []
    for k in range(round(seconds / DT)):
        r, w = plant.rotation, plant.angular_velocity
        external = observer.step(
            rotation=r,
            angular_velocity=w,
            specific_force=plant.specific_force,
            rotor_speeds=plant.rotor_speeds,
            dt=DT,
        )
        command = pose.step(
            position=plant.position,
            velocity=plant.velocity,
            rotation=r,
            angular_velocity=w,
            reference=law.step(external[:3]),
        )
        force = vehicle.mass * (command.acceleration + gravity) - external[:3]
        torque = vehicle.inertia @ command.angular_acceleration + np.cross(w, vehicle.inertia @ w)
        wanted = np.r_[r.T @ force, torque - external[3:]]
        speeds = allocator.allocate(wanted, plant.rotor_speeds, rotation=r).rotor_speeds
        pushed = 1.0 < k * DT < 5.0
        plant.step(speeds, wrench=np.r_[push, 0, 0, 0] if pushed else None, dt=DT)
        rows.append(plant.position - HOME)
    return DT * np.arange(len(rows)), np.array(rows)


# %%
for force in (0.5, 0.9, 1.5):
    time, deviation = fly(GivesWay(), np.array([force, 0.0, 0.0]))
    plt.plot(time, deviation[:, 0], label=f"push of {force:g} N")
plt.axhline(0.1, color="0.6", ls=":", label="the spring saturates")
plt.xlabel("time (s)")
plt.ylabel("position along x (m)")
plt.legend()
plt.show()

# %% [markdown]
# ## Further
#
# - `tilthex.Controller` is the whole chain with the true state, `tilthex.Loop` the flight with estimator
#   and supervisor.
# - `tilthex-rt` flies only its own laws. A controller of your own over the wire is a program that speaks
#   the vehicle's protocol ([protocols.md](../docs/protocols.md)) with `tilthex-sim`.
