# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
# ---

# %% [markdown]
# # Shaping the physical properties
#
# A cable pulls at the tool with 1.4 N along x and is then cut. The admittance filter makes the
# robot behave as a mass-spring-damper with the chosen values; the paper's figure 7. The ideal
# response is dotted.
#
# Run as a notebook (with jupytext) or as a script; `--full` flies every run at its whole length.

# %%
import sys

import matplotlib.pyplot as plt
from tilthex.experiments import spec
from tilthex.experiments.flight import fly
from tilthex.experiments.found import judge_of
from tilthex.experiments.report import text_table
from tilthex.experiments.shaping import ideal_response

# %% [markdown]
# The configuration is one TOML file; these are its parameters.

# %%
experiment = spec.load("shaping", short="--full" not in sys.argv)
print(experiment.text)

# %% [markdown]
# Fly with the complete controller and the estimator in the loop, and compare with the requirements.

# %%
flights = [(run, fly(run)) for run in experiment.runs]
judged = judge_of(experiment)
print(text_table([check for run, record in flights for check in judged.checks(run, record)]))

# %%
run, record = flights[0]
x, _ = ideal_response(run, record.time)
deviation = (record.reference_position - record.setpoint_position)[:, 0]
plt.plot(record.time, 1e3 * deviation, label="reference")
plt.plot(record.time, 1e3 * x, ":", label="ideal")
plt.xlabel("time (s)")
plt.ylabel("deviation along x (mm)")
plt.legend()
plt.show()
