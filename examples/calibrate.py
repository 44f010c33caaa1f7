# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
# ---

# %% [markdown]
# # Calibrate
#
# The model of a vehicle comes from drawings, and is a little wrong: its mass, its thrust, its centre of
# mass. Then the observer reports a wrench although nothing touches the vehicle. A flight of half a minute,
# the calibration, learns the model: a level hover and three tilted ones. [truth.md](../docs/truth.md) has the
# method.
#
# (`tilthex calibrate` is another thing: it finds where on the robot the captured body is, and the latency
# of the poses, from a log.)

# %%
import matplotlib.pyplot as plt
import numpy as np
import tilthex

vehicle = tilthex.Vehicle.preset("tilt-hex")
SEED = 3
true = tilthex.Truth(vehicle, "cad").draw(SEED).vehicle
print(f"mass of the model {vehicle.mass:.3f} kg, true {true.mass:.3f} kg")

# %% [markdown]
# ## Without and with the calibration
#
# After the take-off the vehicle hovers for a while. `"hover"` only learns the wrench of a level hover as a
# bias; `"tilts"` flies the calibration. Then the tool tilts, in a direction that the calibration did not
# fly.

# %%
turn = np.radians(12.0)
tilted = np.array([[1, 0, 0], [0, np.cos(turn), -np.sin(turn)], [0, np.sin(turn), np.cos(turn)]])
PLACE = [0.0, 0.0, 1.0]
path = tilthex.Trajectory(
    [
        {"position": PLACE, "rotation": np.eye(3), "hold": 2.0},
        {"position": PLACE, "rotation": tilted, "hold": 8.0},
    ]
)
for mode in ("hover", "tilts"):
    config = tilthex.Config.default(vehicle).replace(mission={"calibration": mode})
    run = tilthex.simulate(config, duration=65.0, trajectory=path, start="ground", truth="cad", seed=SEED)
    force = np.linalg.norm(run["wrench_tool"][:, :3], axis=1)
    flying = run["phase"][:, 0] == 3
    plt.plot(run["time"][flying], force[flying], lw=0.7, label=f'calibration = "{mode}"')
    last = run["time"][:, 0] > run["time"][-1, 0] - 4.0
    print(f"{mode}: false force in the tilted hover {force[last].mean():.2f} N")
plt.xlabel("time (s)")
plt.ylabel("observed force without contact (N)")
plt.legend()
plt.show()

# %% [markdown]
# ## Other vehicles
#
# The same for eight vehicles: the mean false force in the tilted hover.

# %%
seeds = range(SEED, SEED + 8)
for mode, place in (("hover", -0.2), ("tilts", 0.2)):
    runs = tilthex.simulate_many(
        tilthex.Config.default(vehicle).replace(mission={"calibration": mode}),
        "cad",
        seeds,
        record=["wrench_tool"],
        duration=65.0,
        trajectory=path,
        start="ground",
    )
    force = np.linalg.norm(runs.record["wrench_tool"][:, -2000:, :3], axis=2).mean(axis=1)
    plt.bar(np.array(seeds) + place, force, width=0.4, label=f'calibration = "{mode}"')
plt.xlabel("seed of the vehicle")
plt.ylabel("observed force without contact (N)")
plt.legend()
plt.show()
