# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
# ---

# %% [markdown]
# # Sliding with several contacts
#
# A plate with two ledges: one, two, then three contacts. The wrench of the set-point demands
# saw-tooth forces of the tool; the paper's figures 13 and 14. The estimate is compared with
# MuJoCo's own contact force, dotted.
#
# Run as a notebook (with jupytext) or as a script; `--full` flies every run at its whole length.

# %%
import sys

import matplotlib.pyplot as plt
from tilthex.experiments import spec
from tilthex.experiments.flight import fly
from tilthex.experiments.found import judge_of
from tilthex.experiments.report import text_table

# %% [markdown]
# The configuration is one TOML file; these are its parameters.

# %%
experiment = spec.load("multi-contact", short="--full" not in sys.argv)
print(experiment.text)

# %% [markdown]
# Fly with the complete controller and the estimator in the loop, and compare with the requirements.

# %%
flights = [(run, fly(run)) for run in experiment.runs]
judged = judge_of(experiment)
print(text_table([check for run, record in flights for check in judged.checks(run, record)]))

# %%
run, record = flights[0]
for k, colour in enumerate(("tab:blue", "tab:red", "tab:orange")):
    plt.plot(record.time, record.true_wrench[:, k], ":", color=colour)
    plt.plot(record.time, record.wrench_tool[:, k], color=colour, lw=0.8, label="xyz"[k])
plt.xlabel("time (s)")
plt.ylabel("tool force (N)")
plt.legend()
plt.show()
