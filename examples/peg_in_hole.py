# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
# ---

# %% [markdown]
# # Peg in hole
#
# The tool descends as if the funnel stood upright, is rotated by the contact, slides down the tube,
# and comes out again; the paper's figure 12. The controller does not know the tilt.
# docs/experiments.md explains why it works.
#
# Run as a notebook (with jupytext) or as a script; `--full` flies every run at its whole length.

# %%
import sys

import matplotlib.pyplot as plt
from tilthex.experiments import spec
from tilthex.experiments.flight import fly
from tilthex.experiments.found import judge_of
from tilthex.experiments.peg_in_hole import axis_angle, insertion
from tilthex.experiments.report import text_table

# %% [markdown]
# The configuration is one TOML file; these are its parameters.

# %%
experiment = spec.load("peg-in-hole", short="--full" not in sys.argv)
print(experiment.text)

# %% [markdown]
# Fly with the complete controller and the estimator in the loop, and compare with the requirements.

# %%
flights = [(run, fly(run)) for run in experiment.runs]
judged = judge_of(experiment)
print(text_table([check for run, record in flights for check in judged.checks(run, record)]))

# %%
run, record = flights[0]
tip = run.scene().along(record.tool_position)
figure, (above, below) = plt.subplots(2, sharex=True)
above.plot(record.time, 1e3 * (run.judge["tip_radius"] - tip[:, 2]))
above.set_ylabel("depth in the tube (mm)")
below.plot(record.time, axis_angle(run, record))
below.set_ylabel("angle to the hole (deg)")
below.set_xlabel("time (s)")
plt.show()
print(insertion(run, record))
