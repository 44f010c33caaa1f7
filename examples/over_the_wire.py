# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
# ---

# %% [markdown]
# # Your own controller over the wire
#
# `tilthex-sim` is a simulated vehicle that speaks the protocol of the real one, with its motors, its delays
# and the poses of a motion-capture system. `tilthex.wire.fly` flies it in real time with a controller in
# Python, such as the chain of [your own controller](own_controller.py). Take-off and landing are flown by
# the laws of the package.

# %%
import matplotlib.pyplot as plt
import numpy as np
import tilthex
from tilthex import wire
from tilthex.chain import Chain

vehicle = tilthex.Vehicle.preset("tilt-hex")
config = tilthex.Config.default(vehicle)

# %% [markdown]
# ## The law
#
# A virtual wall, in the place of the admittance filter. It gets the set-point of the tool and the wrench at
# the tool, and returns the reference of the tool. The reference follows the set-point, but never passes
# `x`.


# %%
class VirtualWall:
    """Keeps the reference of the tool at one side of a plane."""

    def __init__(self, x: float) -> None:
        self.x = x

    def step(self, setpoint: tilthex.Setpoint, wrench: np.ndarray, dt: float) -> tilthex.Setpoint:
        """The reference after one period."""
        position = setpoint.position
        if position[0] <= self.x:
            return setpoint
        return tilthex.Setpoint(
            [self.x, *position[1:]],
            setpoint.rotation,
            velocity=setpoint.velocity * [0, 1, 1],
            acceleration=setpoint.acceleration * [0, 1, 1],
        )


# %% [markdown]
# ## The flight
#
# `wire.simulated` runs `tilthex-sim` while the context lasts; it takes more options of the program, such as
# `"--truth", "cad"`. The same vehicle can run in a terminal of its own:
#
#     tilthex-sim --socket line --mocap natnet://127.0.0.1/TILTHEX
#
# Then `port` is `"unix:line"`, and `poses` is `"natnet://127.0.0.1/TILTHEX"`.

# %%
way = tilthex.Trajectory(
    [
        {"position": [0.0, 0.0, 0.4]},
        {"position": [0.3, 0.0, 0.4], "duration": 2.0, "hold": 0.5},
        {"position": [0.0, 0.0, 0.4], "duration": 2.0},
    ]
)
controller = Chain(vehicle, config, admittance=VirtualWall(0.15))
with wire.simulated(config) as simulated:
    flown = wire.fly(controller, config, port=simulated.port, poses=simulated.poses, trajectory=way)
print(flown)

# %% [markdown]
# The tool overshoots a little, because this law stops the reference without braking it.

# %%
plt.plot(flown.time, flown.setpoint[:, 0], "--", label="set-point")
plt.plot(flown.time, flown.reference[:, 0], label="reference")
plt.plot(flown.time, flown.position[:, 0], label="tool, estimated")
plt.axhline(0.15, color="0.6", ls=":", label="the virtual wall")
plt.xlabel("time (s)")
plt.ylabel("x of the tool (m)")
plt.legend()
plt.show()

# %% [markdown]
# ## How fast is Python?
#
# The chain is stepped when an inertial sample arrives, in every period of 2 ms if Python is fast enough. If
# a step comes later, it takes all samples that have arrived, and its `dt` is longer. `Flown.samples` is the
# number of samples of each step. `tilthex-rt` has a loop with real-time rights, which Python has not.

# %%
count = np.bincount(flown.samples, minlength=6)
plt.bar(np.arange(len(count))[1:], count[1:] / len(flown.time))
plt.xlabel("inertial samples in one step")
plt.ylabel("fraction of the steps")
plt.show()

# %% [markdown]
# ## What it does not do
#
# - It has none of the faults of `tilthex-rt` and none of its reactions. If a step raises an exception, the
#   vehicle lands, and the exception is raised after the landing; nothing else is watched. `wire.fly`
#   therefore refuses every port that cannot be that of `tilthex-sim`.
# - It writes no log. `tilthex.VehicleLink` and `tilthex.PoseClient` are the ends of the two lines, for a loop
#   of your own.
