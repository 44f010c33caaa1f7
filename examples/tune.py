# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
# ---

# %% [markdown]
# # Tune
#
# The gains of the pose controller and of the wrench observer are bounded by the rotors' lag and by the
# delays of the link. `LoopModel` computes the margins of a configuration, and derives gains from the
# vehicle. The commands are `tilthex check` and `tilthex tune`; [stability.md](../docs/stability.md) has
# the model.

# %%
import matplotlib.pyplot as plt
import numpy as np
import tilthex

default = tilthex.Config.default(tilthex.Vehicle.preset("tilt-hex"))
model = tilthex.LoopModel(default)
sections = model.derive()
derived = default.replace(**sections)
print(sections)

# %% [markdown]
# ## Margins
#
# Each axis should have a phase margin of 45 degrees and a sensitivity peak of at most 2.


# %%
def table(config: tilthex.Config) -> None:
    """Prints the margins of a configuration."""
    loops = tilthex.LoopModel(config)
    found = loops.hover()
    for axis, phase, peak in zip(
        loops.axes, found["phase_margin_deg"], found["sensitivity_peak"], strict=True
    ):
        print(f"{axis:5} phase margin {phase:5.1f} deg   peak {peak:4.2f}")


print("default gains")
table(default)
print("derived gains")
table(derived)

# %% [markdown]
# ## In flight
#
# A tap of 3 N for 0.2 s in a hover. The default gains are faster than the derived ones: the error is smaller,
# but so are the margins.

# %%
home = tilthex.Setpoint(position=[0, 0, 1], rotation=np.eye(3))
tap = {"at": 1.0, "duration": 0.2, "force": [0, 3.0, 0]}
for name, config in (("default", default), ("derived", derived)):
    run = tilthex.simulate(config, duration=5.0, setpoint=home, pushes=[tap])
    plt.plot(run["time"], 1e3 * run["position_error"][:, 1], label=name)
plt.xlabel("time (s)")
plt.ylabel("position error along y (mm)")
plt.legend()
plt.show()

# %% [markdown]
# ## In contact
#
# A spring at the tool can make the loops unstable. These are the stiffnesses of an environment (with a
# damping of 1 ms times its stiffness) at which contact is stable, for several apparent masses of the
# admittance filter. A small mass is stable only against a soft environment.

# %%
masses = np.array([0.3, 0.5, 1.0, 1.5, 3.0])
largest = []
for mass in masses:
    config = derived.replace(admittance={"mass": [mass, mass, mass, 0.01, 0.01, 0.02]})
    ranges = tilthex.LoopModel(config).contact(along=[0, 0, 1], damping_time=1e-3)
    largest.append(ranges[0][1] if ranges else 0.0)
plt.loglog(masses, np.minimum(largest, 1e6), "o-")
plt.xlabel("apparent mass (kg)")
plt.ylabel("largest stable stiffness along z (N/m), up to 1e6")
plt.show()
