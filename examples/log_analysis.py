# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
# ---

# %% [markdown]
# # Analyse a log
#
# `tilthex-rt` writes a log of every tick. Here it flies the simulated vehicle, in real time and over the
# real protocol, and something pushes the tool; then the log is read. A log of a real flight has the same
# topics, except `/truth`.

# %%
import subprocess
import textwrap
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from tilthex import log

Path("push.toml").write_text("""
[[push]]
at = 7.5
duration = 1.5
force = [1.4, 0.0, 0.0]
""")
call = "tilthex-rt --sim --take-off --duration 6 --pushes push.toml --log flight.mcap --overwrite"
_ = subprocess.run(call.split(), check=True, capture_output=True)

# %% [markdown]
# ## What is in it
#
# Each topic becomes columns, one row for each message. [log.md](../docs/log.md) has the meaning and the
# unit of every column.

# %%
flight = log.Log("flight.mcap")
for topic, count in sorted(flight.topics.items()):
    print(f"{topic:12} {count:6} messages")
state, wrench, phases, truth = (flight.columns(name) for name in ("/state", "/wrench", "/flight", "/truth"))
print(textwrap.fill("columns of /wrench: " + ", ".join(wrench)))

# %% [markdown]
# ## Phases, position, wrench

# %%
begin = phases["log_time"][0]
names, first = np.unique(phases["phase"], return_index=True)
for index in sorted(first):
    print(f"{phases['log_time'][index] - begin:6.2f} s  {phases['phase'][index]}")

# %%
figure, (upper, lower) = plt.subplots(2, 1, sharex=True, figsize=(8, 6), layout="constrained")
upper.plot(state["log_time"] - begin, state["position_w"], label=list("xyz"))
upper.set_ylabel("position (m)")
lower.plot(wrench["log_time"] - begin, wrench["tool_w.force"][:, 0], lw=0.8, label="observed")
lower.plot(truth["log_time"] - begin, truth["tool_wrench_w.force"][:, 0], lw=0.8, label="true")
lower.set_ylim(-3, 3)
lower.set_ylabel("tool force along x (N)")
lower.set_xlabel("time (s)")
for axes in (upper, lower):
    axes.legend()
plt.show()

# %% [markdown]
# ## With other programs
#
#     tilthex plot flight.mcap
#     tilthex view flight.mcap                  # in the browser, with a slider over time
#     tilthex convert flight.mcap --to csv      # or parquet, rosbag2, foxglove, rerun
#     tilthex-rt replay flight.mcap             # the same flight again, bit for bit
