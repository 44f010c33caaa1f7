"""`tilthex fit`, `tilthex plot` and the log reader."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
import tilthex
from scipy.spatial.transform import Rotation
from tilthex import __main__ as command
from tilthex.fit import Flight, fit

MODEL = tilthex.Vehicle.preset("tilt-hex")
INERTIA = [0.0135, 0.0102, 0.0215]


def flown(vehicle: tilthex.Vehicle, seed: int) -> Flight:
    """Half a minute of turning to and fro, with sensor noise, flown with the model's gains."""
    rng = np.random.default_rng(seed)
    controller = tilthex.Controller(MODEL, tilthex.Config.default(MODEL))
    plant = tilthex.Plant(vehicle)
    rows = []
    for k in range(15000):
        t = 0.002 * k
        turn = 0.15 * np.sin([2.9 * t, 3.7 * t, 2.3 * t])
        turn[0] += 0.05 * np.sin(11 * t)
        turn[1] += 0.05 * np.sin(13 * t)
        rotation = Rotation.from_rotvec(turn).as_matrix()
        setpoint = tilthex.Setpoint(rotation @ MODEL.tool_position, rotation)
        gyro = plant.angular_velocity + rng.normal(scale=5e-3, size=3)
        force = plant.specific_force + rng.normal(scale=0.15, size=3)
        speeds = plant.rotor_speeds + rng.normal(scale=0.1, size=6)
        rows.append((t, force, gyro, speeds))
        out = controller.step(
            position=plant.position,
            velocity=plant.velocity,
            rotation=plant.rotation,
            angular_velocity=gyro,
            specific_force=force,
            rotor_speeds=speeds,
            setpoint=setpoint,
            compliant=False,
        )
        plant.step(out.rotor_speeds, dt=0.002)
    return Flight(*(np.array(column) for column in zip(*rows, strict=True)))


@pytest.fixture(scope="module")
def flight():
    weaker = {"preset": "tilt-hex", "tilted_hexarotor": {"thrust_coefficient": 0.95 * 11.4e-4}}
    return flown(tilthex.Vehicle.from_dict(weaker | {"inertia": INERTIA}), 1)


def test_a_weaker_and_wider_vehicle_is_found(flight):
    found = {e.name: e for e in fit(flight, MODEL)}
    assert found["thrust ratio"].value == pytest.approx(0.95, abs=3e-3)
    for axis, moment in zip("xyz", INERTIA, strict=True):
        estimate = found[f"inertia {axis}"]
        assert estimate.value == pytest.approx(moment, rel=0.05)
        assert abs(estimate.value - moment) < 6 * estimate.error
        assert found[f"force bias {axis}"].value == pytest.approx(0, abs=0.2)
        assert found[f"torque bias {axis}"].value == pytest.approx(0, abs=0.01)
    assert "not excited" not in str(found["thrust ratio"])


def test_thrust_taken_as_known_gives_the_mass(flight):
    found = {e.name: e for e in fit(flight, MODEL, unknown="mass")}
    # What flies is a vehicle of 2.4 kg with thrust at 0.95: to a model of full thrust it is heavier.
    assert found["mass"].value == pytest.approx(2.4 / 0.95, rel=3e-3)
    with pytest.raises(ValueError, match="unknown is 'arm'; expected"):
        fit(flight, MODEL, unknown="arm")


def test_a_still_hover_says_that_it_knows_no_inertia():
    rng = np.random.default_rng(0)
    n = 3000
    hover = Flight(
        time=0.002 * np.arange(n),
        specific_force=[0, 0, tilthex.GRAVITY] + rng.normal(scale=0.15, size=(n, 3)),  # noqa: RUF005
        angular_velocity=rng.normal(scale=1e-3, size=(n, 3)),
        rotor_speeds=MODEL.hover_speeds() + rng.normal(scale=0.1, size=(n, 6)),
    )
    lines = [str(e) for e in fit(hover, MODEL) if e.name.startswith("inertia")]
    assert len(lines) == 3
    assert all("not excited enough" in line for line in lines)


def test_a_file_that_is_no_log_is_one_sentence(tmp_path, capsys):
    path = tmp_path / "flight.mcap"
    path.write_text("no log")
    for arguments in (["plot", str(path)], ["fit", str(path)]):
        assert command.main(arguments) == 2
        error = capsys.readouterr().err
        assert error.startswith("tilthex: ")
        assert str(path) in error
        assert error.count("\n") == 1
    assert command.main(["plot", str(tmp_path / "none.mcap")]) == 2
    assert "none.mcap" in capsys.readouterr().err


def test_the_command_is_installed():
    out = subprocess.run(
        [sys.executable, "-m", "tilthex", "--version"], capture_output=True, text=True, check=True
    )
    assert out.stdout == f"tilthex {tilthex.__version__}\n"


def test_the_command_starts_without_the_extras():
    code = (
        "import sys, tilthex.__main__\n"
        "extras = {'scipy', 'matplotlib', 'mujoco', 'pandas', 'mcap', 'tqdm'} & set(sys.modules)\n"
        "assert not extras, extras"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_a_missing_extra_is_one_sentence(monkeypatch, tmp_path, capsys):
    monkeypatch.setitem(sys.modules, "mcap_protobuf.decoder", None)
    assert command.main(["fit", str(tmp_path / "flight.mcap")]) == 2
    error = capsys.readouterr().err
    assert error.startswith("tilthex: ")
    assert "not installed: pip install 'tilthex[" in error
    assert error.count("\n") == 1
