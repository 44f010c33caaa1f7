# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
# ---

# %% [markdown]
# # First flight
#
# A simulated Tilt-Hex holds its tool at a place, something pushes the tool, and the tool yields as a
# mass with a spring and a damper would. No hardware is needed; `pip install '.[analysis]'` is enough.
#
# ## A flight
#
# A configuration holds a vehicle and the parameters of its controller. The set-point is a pose of the
# tool, in world coordinates: z is up, and the rotation is a matrix.

# %%
import textwrap

import matplotlib.pyplot as plt
import numpy as np
import tilthex

config = tilthex.Config.default(tilthex.Vehicle.preset("tilt-hex"))
home = tilthex.Setpoint(position=[0, 0, 1], rotation=np.eye(3))
push = {"at": 1.0, "duration": 8.0, "force": [1.4, 0, 0]}

# %% [markdown]
# `simulate` flies the flight of `tilthex-rt` with a noisy IMU, late poses and the estimator in the loop.
# The result is a dict of arrays with one row for each period of 2 ms.

# %%
run = tilthex.simulate(config, duration=14.0, setpoint=home, pushes=[push])
print(textwrap.fill(", ".join(run)))

# %% [markdown]
# ## Who pushed?
#
# There is no force sensor. The controller observes the wrench from the rotors' speeds and the IMU.

# %%
plt.plot(run["time"], run["wrench_tool"][:, 0], lw=0.8, label="observed")
plt.plot(run["time"], run["wrench_true"][:, 0], label="true")
plt.xlabel("time (s)")
plt.ylabel("force on the tool along x (N)")
plt.legend()
plt.show()

# %% [markdown]
# ## Softer and stiffer
#
# The first three stiffnesses are N/m along the axes of the world, the others N m/rad about them. The dead
# zone subtracts 0.2 N from the force, so the tool moves by (1.4 - 0.2)/K.

# %%
for stiffness in (3.0, 6.0, 12.0):
    softer = config.replace(admittance={"stiffness": [stiffness, stiffness, stiffness, 10, 10, 5]})
    run = tilthex.simulate(softer, duration=14.0, setpoint=home, pushes=[push])
    (line,) = plt.plot(run["time"], run["tool_position"][:, 0], label=f"{stiffness:g} N/m")
    plt.axhline((1.4 - 0.2) / stiffness, color=line.get_color(), ls=":")
plt.xlabel("time (s)")
plt.ylabel("position of the tool along x (m)")
plt.legend()
plt.show()

# %% [markdown]
# ## Next
#
# - The same flight with the program that flies a real vehicle, over the real protocol: `make demo`.
# - A flight to look at and to push with the mouse: `tilthex view --sim`, [view.md](../docs/howto/view.md).
# - Every key of a configuration: [configuration.md](../docs/configuration.md).
# - A vehicle of your own: [own_vehicle.py](own_vehicle.py).
