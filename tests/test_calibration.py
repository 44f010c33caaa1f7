"""The calibration flight of a loop whose world has another vehicle, from Python."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import tilthex
from tilthex import so3

pytest.importorskip("mujoco")
from tilthex.experiments import spec
from tilthex.experiments.scenes import free_air
from tilthex.experiments.world import PERIOD, Noise, World

PLACE = np.array([0.12, 0.0, 0.6])


class Pair:
    """A loop that has a preset for its model, and a world of a vehicle drawn around it."""

    def __init__(self, seed: int, touch: float = 0.0) -> None:
        self.model = tilthex.Vehicle.preset("tilt-hex")
        drawn = tilthex.Truth(self.model, "cad").draw(seed)
        self.loop = tilthex.Loop(tilthex.Config.default(self.model))
        self.flight = tilthex.calibration_flight(self.model, PLACE)
        self.world = World(
            drawn.vehicle,
            free_air(),
            Noise(),
            seed=seed,
            tool_position=PLACE,
            tool_rotation=np.eye(3),
            drawn=drawn,
        )
        self.truth = drawn.vehicle
        self.command = self.truth.hover_speeds(self.world.rotation)
        self.loop.initialize(0.0, self.world.captured_position, self.world.rotation)
        self.touch = touch

    def fly(self, trajectory: tilthex.Trajectory, *, learn_model: bool = False) -> None:
        """Flies a trajectory to its end."""
        for k in range(round(trajectory.duration / PERIOD)):
            self.world.push = np.array([self.touch if k % 1500 > 700 else 0.0, 0.0, 0.0])
            self.world.step(self.command)
            self.command = self.loop.step(
                self.world.time,
                self.world.gyro(),
                self.world.specific_force(),
                self.world.measured_rotor_speeds(),
                self.world.arrived_poses(),
                trajectory.sample(k * PERIOD),
                learn_model=learn_model,
            )

    def felt(self) -> np.ndarray:
        """Mean wrench at the tool, (6,), over the end of a hover tilted as the calibration was not."""
        axis = np.array([np.cos(0.9), np.sin(0.9), 0.0])
        tilted = tilthex.Trajectory(
            [
                {"position": PLACE},
                {"position": PLACE, "rotation": so3.exp(np.radians(15.0) * axis), "hold": 7.0},
            ]
        )
        self.fly(tilted)
        return np.asarray(self.loop.record()["wrench_tool"][-1500:].mean(axis=0))


@pytest.mark.parametrize("seed", [301, 302])
def test_a_loop_learns_the_vehicle_of_the_world(seed: int, tmp_path: Path) -> None:
    pair = Pair(seed)
    before = pair.loop.model_deviation
    assert (
        pair.loop.model.name == "tilt-hex" and before["hovers"] == 0 and not before["excited"]["false_force"]
    )
    pair.fly(pair.flight, learn_model=True)
    felt = pair.felt()
    assert pair.loop.model_refused is None
    assert np.linalg.norm(felt[:3]) < 0.08 and np.linalg.norm(felt[3:]) < 0.04, felt
    assert pair.loop.phase == "flying" and pair.loop.faults == []
    after, model = pair.loop.model_deviation, pair.loop.model
    # Four of the calibration; the hover afterwards is one more to learn from.
    assert after["hovers"] == 5 and after["excited"]["false_force"] and after["excited"]["false_torque"]
    assert not after["excited"]["mass"], "no hover tells mass from thrust"
    assert after["false_force"] < 0.1 * before["false_force"]
    errors = (model.tool_position - pair.model.tool_position) - (
        pair.truth.tool_position - pair.model.tool_position
    )
    # The centre of mass moves tool, rotors and IMU; where the tip is on the airframe no hover tells (3 mm).
    assert np.all(np.abs(errors) < 4.0 * np.hypot(after["centre_of_mass"], 0.003))
    # What holds the weight in hover holds in reality.
    for tilt in (so3.exp(np.array([0.2, 0.0, 0.0])), np.eye(3)):
        speeds = pair.truth.hover_speeds(tilt)
        np.testing.assert_allclose(model.hover_speeds(tilt), speeds, rtol=0.01)
    path = tmp_path / "mine.toml"
    path.write_text(model.to_toml())
    again = tilthex.Vehicle.from_toml(path)
    np.testing.assert_allclose(again.allocation, model.allocation, rtol=1e-9, atol=1e-15)
    assert again.name == "tilt-hex, calibrated"


def test_a_hand_on_the_vehicle_teaches_nothing() -> None:
    pair = Pair(303, touch=1.0)
    pair.fly(pair.flight, learn_model=True)
    pair.touch = 0.0
    pair.fly(tilthex.Trajectory([{"position": PLACE, "hold": 0.5}]))
    refused = pair.loop.model_refused
    assert refused is not None and "nothing may touch the vehicle" in refused
    assert pair.loop.faults == ["calibration refused"] and pair.loop.phase == "flying"
    assert pair.loop.model.mass == pair.model.mass and pair.loop.model_deviation["hovers"] == 0


def test_the_flight_tilts_about_the_centre_of_mass_within_the_rotors_limits() -> None:
    vehicle = tilthex.Vehicle.preset("tilt-hex")
    flight = tilthex.calibration_flight(vehicle, PLACE, heading=0.7)
    centre = PLACE - so3.exp(np.array([0.0, 0.0, 0.7])) @ vehicle.tool_position
    low, high = vehicle.rotor_speed_limits.T
    tilts = []
    for time in np.arange(0.0, flight.duration, 0.05).tolist():
        point = flight.sample(time)
        rotation = point.rotation @ vehicle.tool_rotation.T
        tilts.append(np.degrees(np.arccos(min(1.0, rotation[2, 2]))))
        speeds = vehicle.hover_speeds(rotation)
        assert np.all((speeds > low) & (speeds < high))
        if np.linalg.norm(point.velocity) < 1e-9:
            np.testing.assert_allclose(point.position - rotation @ vehicle.tool_position, centre, atol=1e-9)
    assert 10.0 <= max(tilts) <= 15.01
    np.testing.assert_allclose(flight.sample(0.0).position, PLACE)
    np.testing.assert_allclose(flight.sample(flight.duration).position, PLACE)
    assert flight.duration < 40.0
    flat = tilthex.calibration_flight(tilthex.Vehicle.preset("quadrotor"), PLACE)
    np.testing.assert_allclose(flat.sample(0.5 * flat.duration).rotation, np.eye(3), atol=1e-12)


def test_the_configuration_says_what_can_not_be() -> None:
    config = tilthex.Config.default(tilthex.Vehicle.preset("tilt-hex"))
    with pytest.raises(ValueError, match="tilts"):
        config.replace(mission={"calibration": "tilt"})
    flat = tilthex.Config.default(tilthex.Vehicle.preset("quadrotor"))
    with pytest.raises(ValueError, match="hovers in one attitude"):
        flat.replace(mission={"calibration": "tilts"})
    flat.replace(mission={"calibration": "hover"})
    with pytest.raises(ValueError, match="calibration is 'hop'"):
        spec.load("sliding", changes={"calibration": "hop"})
