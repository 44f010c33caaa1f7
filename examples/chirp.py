# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
# ---

# %% [markdown]
# # The wrench observer against a sensor
#
# The tool is clamped to a six-axis sensor, and the frequency of the set-point rises; the paper's
# figure 4. At the frequency w, the relative error of an observer with gain L is w / sqrt(w^2 +
# L^2).
#
# Run as a notebook (with jupytext) or as a script; `--full` flies every run at its whole length.

# %%
import sys

import matplotlib.pyplot as plt
from tilthex.experiments import spec
from tilthex.experiments.chirp import chirp_frequency
from tilthex.experiments.flight import fly
from tilthex.experiments.found import judge_of
from tilthex.experiments.report import text_table
from tilthex.experiments.world import PERIOD
from tilthex.wrenches import without_phase

# %% [markdown]
# The configuration is one TOML file; these are its parameters.

# %%
experiment = spec.load("chirp", short="--full" not in sys.argv)
print(experiment.text)

# %% [markdown]
# Fly with the complete controller and the estimator in the loop, and compare with the requirements.

# %%
flights = [(run, fly(run)) for run in experiment.runs]
judged = judge_of(experiment)
print(text_table([check for run, record in flights for check in judged.checks(run, record)]))

# %%
run, record = flights[0]
wrenches = (record.wrench_tool, record.true_wrench)
observed, true = (without_phase(wrench, 1.0 / PERIOD) for wrench in wrenches)
error = observed - true
plt.plot(chirp_frequency(run, record.time), abs(error[:, [0, 2]]), lw=0.8)
plt.xlabel("frequency (Hz)")
plt.ylabel("force error along x and z (N)")
plt.show()
