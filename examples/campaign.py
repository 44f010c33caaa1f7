# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
# ---

# %% [markdown]
# # A campaign
#
# One flight says little about a vehicle whose model is not exact. `simulate_many` flies many of them in
# parallel, each with a vehicle and noise that are drawn from its seed.

# %%
import matplotlib.pyplot as plt
import numpy as np
import tilthex

config = tilthex.Config.default(tilthex.Vehicle.preset("tilt-hex"))
home = tilthex.Setpoint(position=[0, 0, 1], rotation=np.eye(3))
push = {"at": 2.0, "duration": 2.0, "force": [1.5, 0, 0]}
FLIGHTS = range(100, 130)

# %% [markdown]
# ## Two levels of truth
#
# *measured* is a vehicle whose parameters were measured, *cad* one whose parameters come from drawings; see
# [truth.md](../docs/truth.md). The result has one row for each flight; the table shows the mean and the
# maximum of each column.

# %%
levels = ("exact", "measured", "cad")
flown = {
    level: tilthex.simulate_many(
        config, level, FLIGHTS, record=["tool_position"], duration=6.0, setpoint=home, pushes=[push]
    )
    for level in levels
}
print(flown["measured"].to_dataframe().describe().loc[["mean", "max"]].T.round(4))

# %%
for level in levels:
    values = np.sort(flown[level]["tool_deviation_largest"])
    plt.step(1e3 * values, np.linspace(0, 1, len(values)), where="post", label=level)
plt.xlabel("largest deviation of the tool from its set-point (mm)")
plt.ylabel("part of the flights below")
plt.legend()
plt.show()

# %% [markdown]
# ## One flight again
#
# `simulate` with the same seed repeats a flight, for example the worst one. The drawings give its weight
# or its thrust wrongly. The observer takes this difference for a force on the tool, and the tool yields
# to it. The flight of [calibrate.py](calibrate.py) corrects the model.

# %%
worst = int(flown["cad"]["seed"][np.argmax(flown["cad"]["tool_deviation_largest"])])
run = tilthex.simulate(config, duration=6.0, setpoint=home, pushes=[push], truth="cad", seed=worst)
plt.plot(run["time"], run["tool_position"] - home.position, label=list("xyz"))
plt.title(f"seed {worst}")
plt.xlabel("time (s)")
plt.ylabel("deviation of the tool (m)")
plt.legend()
plt.show()

# %% [markdown]
# ## Other campaigns
#
# - `tilthex experiment peg-in-hole --random 100 --seed 7`: random cases in MuJoCo, in parallel processes.
# - `tilthex-rt campaign -n 1000 --seed 1`: random faults in the complete flight;
#   [campaign.md](../docs/campaign.md).
