# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
# ---

# %% [markdown]
# # Your own scene: a button on a wall
#
# The scene of an experiment can be a file of your own: an MJCF model of MuJoCo, whose bodies and geoms are
# added to the world. Its bodies can have joints: the button of this wall is on a spring. The vehicle and
# the checks are own ones, too. Everything is in one folder: `forward.toml`, `wall.xml`, `button.toml` and
# `button.py`.

# %%
from pathlib import Path

import matplotlib.pyplot as plt
from tilthex.experiments import spec
from tilthex.experiments.flight import fly
from tilthex.experiments.found import judge_of
from tilthex.experiments.report import text_table

# %% [markdown]
# ## The vehicle
#
# Its tool points forward: the tip is in front of the rotors, and z of the tool points back along the rod.

# %%
VEHICLE = """
[vehicle]
name = "forward-hexarotor"
mass = 3.1
inertia = [0.030, 0.029, 0.051]
rotor_time_constant = 0.04
tool_position = [0.6, 0.0, 0.0]
tool_rotation_deg = [0.0, -90.0, 0.0]

[vehicle.tilted_hexarotor]
alpha_deg = 25.0
beta_deg = 0.0
arm = 0.45
thrust_coefficient = 1.6e-3
drag_coefficient = 3.2e-5
min_speed = 16.0
max_speed = 100.0
"""

# %% [markdown]
# ## The scene
#
# The geoms collide with the rod of the tool, with their own friction. The button moves by 8 mm against its
# spring.

# %%
WALL = """
<mujoco>
  <worldbody>
    <geom type="box" size="0.02 0.5 0.5" pos="1.02 0 1" rgba="0.8 0.8 0.78 1"/>
    <body name="button" pos="0.985 0 1">
      <joint type="slide" axis="1 0 0" limited="true" range="0 0.008" stiffness="300" damping="5"
             solreflimit="0.004 1"/>
      <geom type="cylinder" size="0.03 0.005" euler="0 90 0" mass="0.02" friction="0.5 0 0"/>
    </body>
  </worldbody>
</mujoco>
"""

# %% [markdown]
# ## The experiment
#
# The orientation of a way-point is that of the tool: with the one of its mounting the vehicle hovers level.
# The path ends behind the button, so that the spring of the admittance presses it.

# %%
EXPERIMENT = """
title = "Pressing a button"
about = "The path ends behind the button; the spring of the admittance decides how hard the tool presses."
vehicle = "forward.toml"

[config.admittance]
damping = [40.0, 40.0, 40.0, 4.0, 4.0, 4.0]
stiffness = [20.0, 20.0, 20.0, 10.0, 10.0, 5.0]

[world]
scene = "wall.xml"

[[trajectory.waypoint]]
phase = "approach"
position = [0.9, 0.0, 1.0]
rpy_deg = [0.0, -90.0, 0.0]
hold = 1.0

[[trajectory.waypoint]]
phase = "press"
position = [1.18, 0.0, 1.0]
duration = 4.0
hold = 2.0

[[trajectory.waypoint]]
phase = "release"
position = [0.9, 0.0, 1.0]
duration = 4.0
"""

# %% [markdown]
# ## The checks
#
# A module with the name of the file, in which `-` is `_`, judges the flight. The record has the coordinates
# of the scene's joints: here the travel of the button.

# %%
CHECKS = '''
from tilthex.experiments.judge import Judge
from tilthex.experiments.record import Check, below
from tilthex.experiments.report import overview

TRAVEL = 0.008  # m


def checks(run, record):
    """The button is down, and the tip stays on it."""
    press = record.during("press")
    deepest = record.scene_joints[press, 0].max()
    aside = abs(record.tool_position[press, 1]).max()
    return [
        Check("travel of the button", "8 mm", "", f"{1e3 * deepest:.1f} mm", bool(deepest > TRAVEL - 5e-4)),
        below("tip beside the middle", aside, 0.01, "mm", scale=1e3),
    ]


def figures(flights):
    """The pictures of the report."""
    return {run.name: overview(record) for run, record in flights}


JUDGE = Judge(checks, figures)
'''

# %% [markdown]
# ## The flight
#
# `tilthex experiment button.toml --out out` flies it and writes a report. The same in Python:

# %%
files = {"forward.toml": VEHICLE, "wall.xml": WALL, "button.toml": EXPERIMENT, "button.py": CHECKS}
for name, text in files.items():
    Path(name).write_text(text)
experiment = spec.load("button.toml")
(run,) = experiment.runs
record = fly(run)
print(text_table(judge_of(experiment).checks(run, record)))

# %%
figure, (above, below) = plt.subplots(2, 1, sharex=True, layout="constrained")
above.plot(record.time, 1e3 * record.scene_joints[:, 0])
above.axhline(8.0, color="0.6", ls="--", label="the button is down")
above.set_ylabel("travel of the button (mm)")
above.legend()
below.plot(record.time, -record.wrench_tool[:, 0], lw=0.8, label="observed")
below.plot(record.time, -record.true_wrench[:, 0], lw=0.8, label="true")
below.set_xlabel("time (s)")
below.set_ylabel("force on the button (N)")
below.legend()
plt.show()

# %% [markdown]
# [experiment.md](../docs/howto/experiment.md) has every key of an experiment's file. `--wire` flies such a
# file in real time with `tilthex-rt` if it has `wire = true`.
