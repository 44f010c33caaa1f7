# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
# ---

# %% [markdown]
# # Your own experiment
#
# An experiment is a TOML file: a vehicle, changes of the configuration, a scene, way-points and runs that
# differ in a few keys. MuJoCo simulates the world; `pip install '.[experiments]'` brings it. This one
# presses the tool on a level board, with a soft and a stiff tool.

# %%
from pathlib import Path

import matplotlib.pyplot as plt
from tilthex.experiments import spec
from tilthex.experiments.flight import fly
from tilthex.experiments.record import below
from tilthex.experiments.report import text_table

Path("press.toml").write_text("""
title = "Pressing on a board"
about = "The path ends 0.1 m below the board; the stiffness decides how hard the tool presses."
vehicle = "tilt-hex"
seed = 1

[config.pose_control]
position_gain = 36.0
velocity_gain = 12.0
rotation_gain = 100.0
angular_velocity_gain = 20.0

[config.admittance]
damping = [10.0, 10.0, 20.0, 4.0, 4.0, 4.0]
stiffness = [10.0, 10.0, 10.0, 10.0, 10.0, 5.0]

[world]
scene = "plane"
point = [0.0, 0.0, 0.457]      # m; the tip has a radius of 3 mm
tilt_deg = [0.0, 0.0]
friction = 0.2

[[trajectory.waypoint]]
phase = "approach"
position = [0.0, 0.0, 0.475]
hold = 0.5

[[trajectory.waypoint]]
phase = "touch"
position = [0.0, 0.0, 0.455]
duration = 2.0

[[trajectory.waypoint]]
phase = "press"
position = [0.0, 0.0, 0.36]
duration = 2.5
hold = 4.0

[[run]]
name = "soft"

[[run]]
name = "stiff"
config.admittance.stiffness = [10.0, 10.0, 20.0, 10.0, 10.0, 5.0]
config.admittance.damping = [10.0, 10.0, 30.0, 4.0, 4.0, 4.0]
""")
experiment = spec.load(Path("press.toml"))
flights = [(run, fly(run)) for run in experiment.runs]

# %% [markdown]
# The true contact force comes from MuJoCo, the observed one from the controller. At rest the spring of K
# is compressed by 0.1 m, and the dead zone adds its 0.2 N.

# %%
for run, record in flights:
    (line,) = plt.plot(record.time, record.wrench_tool[:, 2], lw=0.8, label=f"{run.name}, observed")
    plt.plot(record.time, record.true_wrench[:, 2], ":", color=line.get_color(), label=f"{run.name}, true")
plt.xlabel("time (s)")
plt.ylabel("force on the tool along z (N)")
plt.legend()
plt.show()

# %% [markdown]
# ## Checks
#
# A module beside the file judges the flights: its `checks` give the rows of the report's table. The same
# in a few lines here:

# %%
rows = []
for run, record in flights:
    rest = record.time > record.time[-1] - 2.0
    stiffness = run.config["admittance"]["stiffness"][2]
    force = record.true_wrench[rest, 2].mean()
    rows.append(below(f"{run.name}: error of the force", abs(force - 0.1 * stiffness - 0.2), 0.15, "N"))
print(text_table(rows))

# %% [markdown]
# The command writes a report with all pictures: `tilthex experiment press.toml --out out`. See
# [experiment.md](../docs/howto/experiment.md) and [experiments.md](../docs/experiments.md).
