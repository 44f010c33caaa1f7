"""Configurations and vehicles are values: equal, hashed, copied and pickled."""

import copy
import pickle

import pytest
import tilthex
from hypothesis import given
from hypothesis import strategies as st

COPIES = (copy.copy, copy.deepcopy, lambda one: pickle.loads(pickle.dumps(one)))


@pytest.mark.parametrize("name", tilthex.Vehicle.presets())
@given(part=st.floats(0.9, 1.1), gain=st.floats(1.0, 60.0))
def test_a_copy_is_equal_to_the_last_bit(name, part, gain):
    preset = tilthex.Vehicle.preset(name)
    vehicle = preset.replace(mass=part * preset.mass)
    config = tilthex.Config.default(vehicle).replace(wrench_observer={"force_gain": gain})
    for one in (vehicle, config):
        for make in COPIES:
            other = make(one)
            assert other == one and hash(other) == hash(one) and other.to_toml() == one.to_toml()
    assert config.vehicle == vehicle


def test_a_configuration_is_its_values():
    config = tilthex.Config.default(tilthex.Vehicle.preset("tilt-hex"))
    changed = config.replace(wrench_observer={"force_gain": 12.5}, admittance={"stiffness": [7.0] * 6})
    values = changed.to_dict()
    assert values["wrench_observer"]["force_gain"] == [12.5] * 3
    assert values["admittance"]["stiffness"] == [7.0] * 6
    assert config.replace(**values) == changed and changed.replace(**config.to_dict()) == config


def test_what_differs_is_not_equal():
    vehicle = tilthex.Vehicle.preset("tilt-hex")
    heavier = vehicle.replace(mass=vehicle.mass + 1e-9)
    assert heavier != vehicle and heavier == vehicle.replace(mass=vehicle.mass + 1e-9)
    assert tilthex.Config.default(heavier) != tilthex.Config.default(vehicle)
    assert len({vehicle, heavier, copy.copy(vehicle)}) == 2
    assert vehicle != "tilt-hex"
