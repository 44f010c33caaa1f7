# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
# ---

# %% [markdown]
# # Your own vehicle
#
# A vehicle is a TOML file: its mass, its inertia, its rotors, and where the tool is. This one is a
# hexarotor whose rotors are tilted by 25 degrees.

# %%
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import tilthex
from tilthex import design, polytope

Path("mine.toml").write_text("""
[vehicle]
name = "my-hexarotor"
mass = 3.1                              # kg, vehicle and tool
inertia = [0.030, 0.029, 0.051]         # kg m^2, diagonal, about the centre of mass
rotor_time_constant = 0.04              # s
tool_position = [0.25, 0.0, -0.1]       # m, of the tool tip from the centre of mass

[vehicle.tilted_hexarotor]
alpha_deg = 25.0
beta_deg = 0.0
arm = 0.45                              # m
thrust_coefficient = 1.6e-3             # N/Hz^2
drag_coefficient = 3.2e-5               # N m/Hz^2
min_speed = 16.0                        # Hz
max_speed = 100.0                       # Hz
""")
vehicle = tilthex.Vehicle.from_toml("mine.toml")
print("rotor speeds in a hover (Hz):", vehicle.hover_speeds().round(1))

# %% [markdown]
# Impossible values are refused, with a sentence that names the key.

# %%
try:
    vehicle.replace(mass=-1.0)
except ValueError as error:
    print(error)

# %% [markdown]
# ## What it can do
#
# The wrenches that the rotors can produce within their limits are a polytope. It gives the lateral
# force in a level hover and the payload.

# %%
print(f"lateral force in every direction: {polytope.lateral_reach(vehicle):.1f} N")
print(f"payload: {polytope.payload(vehicle):.2f} kg")

# %% [markdown]
# Is 25 degrees a good tilt? More tilt gives more lateral force, and a hover that costs more. The command
# `tilthex design --vehicle mine.toml` draws such sweeps.

# %%
tilts = np.arange(5.0, 46.0, 5.0)
text = Path("mine.toml").read_text()
found = []
for tilt in tilts:
    Path("tilted.toml").write_text(text.replace("alpha_deg = 25.0", f"alpha_deg = {tilt}"))
    found.append(design.figures(tilthex.Vehicle.from_toml("tilted.toml")))
figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.5), layout="constrained")
left.plot(tilts, [one.lateral_reach for one in found], "o-")
left.set_xlabel("tilt of the rotors (deg)")
left.set_ylabel("lateral force (N)")
right.plot(tilts, [one.hover_efficiency for one in found], "o-")
right.set_xlabel("tilt of the rotors (deg)")
right.set_ylabel("hover efficiency")
plt.show()

# %% [markdown]
# ## Fly it
#
# A configuration with default gains gives warnings if the vehicle's rotors are too slow for them; see
# [tune.py](tune.py). The vehicle follows a path and tilts on the way.

# %%
config = tilthex.Config.default(vehicle)
print("warnings:", config.warnings)
tilted = np.array([[0.985, 0, 0.174], [0, 1, 0], [-0.174, 0, 0.985]])
u, _, v = np.linalg.svd(tilted)
path = tilthex.Trajectory(
    [
        {"position": [0, 0, 1], "rotation": np.eye(3), "hold": 1.0},
        {"position": [0.5, 0, 1], "rotation": np.eye(3)},
        {"position": [0.5, 0.5, 1.2], "rotation": u @ v, "hold": 1.0},
    ]
)
run = tilthex.simulate(config, duration=path.duration + 1.0, trajectory=path)
for k, name in enumerate("xyz"):
    (line,) = plt.plot(run["time"], run["tool_position"][:, k], label=name)
    plt.plot(run["time"], run["setpoint_position"][:, k], ":", color=line.get_color())
plt.xlabel("time (s)")
plt.ylabel("position of the tool (m); dotted: set-point")
plt.legend()
plt.show()
print(f"largest error: {1e3 * np.linalg.norm(run['position_error'], axis=1).max():.1f} mm")

# %% [markdown]
# The program flies it too, with a file that names the vehicle: `[vehicle]` with `file = "mine.toml"`. See
# [vehicle.md](../docs/howto/vehicle.md).
