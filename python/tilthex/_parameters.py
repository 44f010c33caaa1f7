"""The parameters of an identification: the model that they change, and the vehicle that follows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tilthex._core import Vehicle
from tilthex._identified import Array, Figure, Flight


@dataclass(frozen=True)
class Model:
    """The numbers of the model, and the vehicle that follows from a vector of parameters."""

    mass: float
    inertia: Array
    position: Array
    axis: Array
    across: Array
    thrust: Array
    drag: Array
    rotor_drag: float
    flapping: float
    speed_age: float
    names: list[str]

    @staticmethod
    def of(vehicle: Vehicle, flights: Sequence[Flight]) -> Model:
        rotors = vehicle.rotors

        def column(key: str) -> Array:
            return np.array([rotor[key] for rotor in rotors], dtype=float)

        axis = column("axis")
        first = np.cross(axis, np.where(abs(axis[:, :1]) < 0.9, [1.0, 0, 0], [0, 1.0, 0]))
        first /= np.linalg.norm(first, axis=1, keepdims=True)
        n = len(rotors)
        names = ["mass", "thrust", *["thrust_each"] * n, "drag_moment", *["rotor_axis"] * (2 * n)]
        names += ["centre_of_mass"] * 3 + ["inertia"] * 3 + ["inertia_product"] * 3
        names += ["rotor_drag", "flapping", "speed_age", *["accelerometer_bias"] * (3 * len(flights))]
        return Model(
            vehicle.mass,
            vehicle.inertia,
            column("position"),
            axis,
            np.stack([first, np.cross(axis, first)], axis=1),
            column("thrust_coefficient"),
            column("drag_coefficient") * column("spin"),
            vehicle.rotor_drag,
            vehicle.flapping,
            float(np.mean([flight.speed_age for flight in flights])),
            names,
        )

    def at(self, x: Array) -> Numbers:
        """The vehicle with these parameters, in their units (fractions, rad, m, ...)."""
        n = len(self.thrust)
        mass, common, each, drag, turn, rest = np.split(x, np.cumsum([1, 1, n, 1, 2 * n]))
        centre, moments, products, (rotor_drag, flapping, age), bias = np.split(rest, [3, 6, 9, 12])
        turned = self.axis + np.einsum("ij,ijk->ik", turn.reshape(n, 2), self.across)
        root = np.sqrt(np.diag(self.inertia) * np.exp(moments))
        scale = np.sqrt(np.diag(self.inertia))
        inertia = self.inertia / np.outer(scale, scale) * np.outer(root, root)
        for (i, j), part in zip(((0, 1), (0, 2), (1, 2)), products, strict=True):
            inertia[i, j] += part * root[i] * root[j]
            inertia[j, i] = inertia[i, j]
        return Numbers(
            float(self.mass * np.exp(mass[0])),
            inertia,
            self.position - centre,
            turned / np.linalg.norm(turned, axis=1, keepdims=True),
            self.thrust * np.exp(common[0] + each),
            self.drag * np.exp(drag[0]),
            centre,
            self.rotor_drag + float(rotor_drag),
            self.flapping + float(flapping),
            self.speed_age + float(age),
            bias.reshape(-1, 3),
        )


@dataclass(frozen=True)
class Numbers:
    """One vehicle; positions are relative to its own centre of mass."""

    mass: float
    inertia: Array
    position: Array
    axis: Array
    thrust: Array
    drag: Array
    centre: Array
    rotor_drag: float
    flapping: float
    speed_age: float
    bias: Array

    def predict(self, flight: Flight, number: int) -> tuple[Array, Array]:
        """Specific force at the model's centre of mass (N, 3), and angular acceleration (N, 3)."""
        # Shifted with a smoothed slope: a mean between noisy samples would reduce their noise.
        speeds = flight.rotor_speeds + (self.speed_age - flight.speed_age) * flight.rotor_acceleration
        lift = speeds * abs(speeds)
        forces = self.thrust[:, None] * self.axis
        torques = np.cross(self.position, forces) + self.drag[:, None] * self.axis
        force, torque = lift @ forces, lift @ torques
        omega = flight.angular_velocity
        if flight.velocity is not None and (self.rotor_drag != 0.0 or self.flapping != 0.0):
            hub = flight.velocity[:, None] + np.cross(omega[:, None], self.position)
            along = np.einsum("nik,ik->ni", hub, self.axis)
            in_disc = abs(speeds)[:, :, None] * (hub - along[:, :, None] * self.axis)
            push, twist = -self.rotor_drag * in_disc, -self.flapping * np.cross(self.axis, in_disc)
            force = force + push.sum(axis=1)
            torque = torque + (np.cross(self.position, push) + twist).sum(axis=1)
        turn = torque - np.cross(omega, omega @ self.inertia)
        alpha = turn @ np.linalg.inv(self.inertia)
        lever = -self.centre
        moved = np.cross(alpha, lever) + np.cross(omega, np.cross(omega, lever))
        return force / self.mass + moved + self.bias[number], alpha


def reported(model: Model, x: Array) -> tuple[list[tuple[str, str]], Array]:
    """Names with units, and values, of the reported parameters."""
    at = model.at(x)
    ratio = at.thrust / model.thrust
    names = [("mass", "kg"), ("thrust, all rotors", "of model")]
    names += [(f"thrust, rotor {k + 1}", "of model") for k in range(len(ratio))]
    names += [("drag moment", "of model"), *((f"centre of mass {a}", "m") for a in "xyz")]
    names += [(f"inertia {a}", "kg m^2") for a in ("xx", "yy", "zz", "xy", "xz", "yz")]
    names += [("rotor drag", "N s/m/Hz"), ("flapping torque", "N m s/m/Hz"), ("age of rotor speeds", "s")]
    drag = float(np.linalg.norm(at.drag) / np.linalg.norm(model.drag))
    i = at.inertia
    moments = [i[0, 0], i[1, 1], i[2, 2], i[0, 1], i[0, 2], i[1, 2]]
    values = [at.mass, ratio.mean(), *ratio, drag, *at.centre, *moments]
    return names, np.array([*values, at.rotor_drag, at.flapping, at.speed_age])


def corrected(vehicle: Vehicle, found: Numbers, figures: Sequence[Figure]) -> Vehicle:
    """The corrected model; positions move relative to the centre of mass.

    The model keeps drag and flapping of its rotors if neither the flight nor the user determines them. A drag
    that was found below 0 is 0.

    Raises:
        ValueError: The flight determined so little that no vehicle has these values.
    """
    centre = found.centre
    named = {one.name: one for one in figures}

    def determined(name: str, model: float, low: float) -> float:
        one = named.get(name)
        return min(max(one.value, low), 1.0) if one is not None and one.known else model

    rotors = [
        rotor
        | {
            "position": position.tolist(),
            "axis": axis.tolist(),
            "thrust_coefficient": float(thrust),
            "drag_coefficient": float(abs(drag)),
        }
        for rotor, position, axis, thrust, drag in zip(
            vehicle.rotors, found.position, found.axis, found.thrust, found.drag, strict=True
        )
    ]
    keys = {
        "name": vehicle.name,
        "mass": found.mass,
        "inertia": found.inertia.tolist(),
        "rotor_time_constant": named["rotor lag"].value
        if "rotor lag" in named
        else vehicle.rotor_time_constant,
        "rotor_drag": determined("rotor drag", vehicle.rotor_drag, 0.0),
        "flapping": determined("flapping torque", vehicle.flapping, -1.0),
        "tool_position": (vehicle.tool_position - centre).tolist(),
        "tool_rotation_deg": _angles(vehicle.tool_rotation),
        "imu_position": (vehicle.imu_position - centre).tolist(),
        "imu_rotation_deg": _angles(vehicle.imu_rotation),
        "rotors": rotors,
    }
    try:
        return Vehicle.from_dict(keys)
    except ValueError as error:
        raise ValueError(
            f"the flight does not determine the vehicle, the fit found an impossible one: {error}; "
            "fly the trajectory of `tilthex excite`, leave out times in contact (--begin, --end), or give "
            "what you know with --prior (docs/identification.md)"
        ) from error


def _angles(rotation: Array) -> list[float]:
    """Roll, pitch and yaw, degrees."""
    from scipy.spatial.transform import Rotation

    angles: list[float] = Rotation.from_matrix(rotation).as_euler("ZYX", degrees=True)[::-1].tolist()
    return angles
