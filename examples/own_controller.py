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
# Each block of the controller is a class of its own, with a `step`. `tilthex.chain.Chain` joins them, and
# takes an object of your own in the place of any of them: observer, admittance, pose controller, allocator.
# Here it is the admittance: a law in Python, between the blocks of the package. It flies the simulated body
# of `tilthex.Plant`, and then an experiment in MuJoCo.

# %%
from dataclasses import dataclass, field

import matplotlib.pyplot as plt
import numpy as np
import tilthex
from tilthex.chain import Chain

DT = 0.002
vehicle = tilthex.Vehicle.preset("tilt-hex")
config = tilthex.Config.default(vehicle)
home = tilthex.Setpoint(position=[0.0, 0.0, 1.0], rotation=np.eye(3))

# %% [markdown]
# ## The law
#
# A mass with a damper, and a spring that saturates: its force never exceeds `largest`. A stronger push
# moves the tool as long as it lasts, and only the damper brakes this motion. The place of the admittance
# filter gets the set-point and the wrench at the tool (N, N m, world), and returns the reference of the
# tool.

# %%


@dataclass
class GivesWay:
    """Moves the reference of the tool under a force; SI, world axes."""

    mass: float = 2.0
    damping: float = 12.0
    stiffness: float = 10.0
    largest: float = 1.0
    offset: np.ndarray = field(default_factory=lambda: np.zeros(3))
    velocity: np.ndarray = field(default_factory=lambda: np.zeros(3))

    def step(self, setpoint: tilthex.Setpoint, wrench: np.ndarray, dt: float) -> tilthex.Setpoint:
        """The reference after one period."""
        spring = self.stiffness * self.offset
        size = np.linalg.norm(spring)
        if size > self.largest:
            spring *= self.largest / size
        acceleration = (wrench[:3] - self.damping * self.velocity - spring) / self.mass
        self.velocity = self.velocity + dt * acceleration
        self.offset = self.offset + dt * self.velocity
        return tilthex.Setpoint(
            setpoint.position + self.offset,
            setpoint.rotation,
            velocity=setpoint.velocity + self.velocity,
            acceleration=setpoint.acceleration + acceleration,
        )


# %% [markdown]
# ## In the simulated body
#
# `Chain.step` takes the measurements of a tick and returns a `tilthex.Output`, as `tilthex.Controller.step`
# does.


# %%
def fly(law: GivesWay, push: float, seconds: float = 12.0) -> tuple[np.ndarray, np.ndarray]:
    """Time, s, (N,), and deviation of the tool, m, (N, 3), under a push along x, N, from 1 to 5 s."""
    plant = tilthex.Plant(vehicle, position=home.position - vehicle.tool_position)
    controller = Chain(vehicle, config, admittance=law)
    rows = []
    for k in range(round(seconds / DT)):
        output = controller.step(
            **plant.measured,
            setpoint=home,
            dt=DT,
        )
        pushed = [push if 1.0 < k * DT < 5.0 else 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
        plant.step(output.rotor_speeds, tool_wrench=pushed, dt=DT)
        rows.append(plant.tool_position - home.position)
    return DT * np.arange(len(rows)), np.array(rows)


# %%
for force in (0.5, 0.9, 1.5):
    time, deviation = fly(GivesWay(), force)
    plt.plot(time, deviation[:, 0], label=f"push of {force:g} N")
plt.axhline(0.1, color="0.6", ls=":", label="the spring saturates")
plt.xlabel("time (s)")
plt.ylabel("deviation of the tool along x (m)")
plt.legend()
plt.show()

# %% [markdown]
# ## In an experiment
#
# `tilthex.experiments.flight.fly` takes a controller too: a `Chain`, or any object whose `step` returns a
# `tilthex.Output`. It gets the true state of the world in MuJoCo. The checks and figures of the package
# accept its flights. Here the law presses the tilted board of the experiment *sliding*, with the
# configuration of its file. The force exceeds that of the spring in the impact and while the set-point
# moves, because the damper adds its force. At rest it is the force at which the spring saturates.

# %%
from tilthex.experiments import flight, spec  # noqa: E402

way = [
    {"phase": "approach", "position": [0.0, 0.0, 0.5], "hold": 0.5},
    {"phase": "contact", "position": [0.0, 0.0, 0.3], "duration": 5.0, "hold": 1.0},
]
run = spec.load("sliding", changes={"trajectory": {"waypoint": way}}).runs[0]
of_file = tilthex.Config.default(run.model()).replace(**run.config)
record = flight.fly(run, controller=Chain(run.model(), of_file, admittance=GivesWay()))
force = np.linalg.norm(record.true_wrench[:, :3], axis=1)
plt.plot(record.time[24:], np.convolve(force, np.full(25, 1 / 25), mode="valid"))
plt.axhline(1.0, color="0.6", ls=":", label="the spring saturates")
plt.xlabel("time (s)")
plt.ylabel("contact force, mean over 50 ms (N)")
plt.legend()
plt.show()

# %% [markdown]
# ## Further
#
# - `tilthex.Controller` is the whole chain with the true state, `tilthex.Loop` the flight with estimator
#   and supervisor.
# - `tilthex.wire.fly` flies such a chain in real time against `tilthex-sim`, over the protocol of the
#   vehicle: [your own controller over the wire](over_the_wire.py). `tilthex-rt` flies only its own laws.
