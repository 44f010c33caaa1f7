# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
# ---

# %% [markdown]
# # Sliding on a tilted board
#
# The desired path goes through the board and continues behind it; the reference stays on the
# surface. The distance that the tool slides sideways down the slope depends on the stiffness only;
# the paper's figures 8 and 10.
#
# Run as a notebook (with jupytext) or as a script; `--full` flies every run at its whole length.

# %%
import sys

import matplotlib.pyplot as plt
from tilthex.experiments import spec
from tilthex.experiments.flight import fly
from tilthex.experiments.found import judge_of
from tilthex.experiments.report import text_table
from tilthex.experiments.sliding import closed_form

# %% [markdown]
# The configuration is one TOML file; these are its parameters.

# %%
experiment = spec.load("sliding", short="--full" not in sys.argv)
print(experiment.text)

# %% [markdown]
# Fly with the complete controller and the estimator in the loop, and compare with the requirements.

# %%
flights = [(run, fly(run)) for run in experiment.runs]
judged = judge_of(experiment)
print(text_table([check for run, record in flights for check in judged.checks(run, record)]))

# %%
run, record = flights[0]
deviation = record.reference_position - record.setpoint_position
expected, normal_force = closed_form(run, record.setpoint_position[record.during("rest")][-1])
plt.plot(record.time, 1e3 * deviation[:, 1], label="y")
plt.axhline(1e3 * expected[1], ls=":", c="k", label="closed form, at rest")
plt.xlabel("time (s)")
plt.ylabel("reference - set-point (mm)")
plt.legend()
plt.show()
print(f"normal force at rest by the closed form: {normal_force:.2f} N")
