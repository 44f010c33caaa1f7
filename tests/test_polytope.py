"""The attainable wrenches against Monte Carlo, linear programs and the allocator."""

import math
from pathlib import Path

import numpy as np
import pytest
import tilthex
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linprog
from tilthex import polytope

PRESETS = tilthex.Vehicle.presets()
FORCE = {"tx": 0.0, "ty": 0.0, "tz": 0.0}


def limits(vehicle, lost=()):
    u = vehicle.rotor_speed_limits * abs(vehicle.rotor_speed_limits)
    u[list(lost)] = 0
    return u[:, 0], u[:, 1]


def support(vehicle, direction, fix, lost=()):
    """Largest `direction . wrench` of all inputs within the limits, by a linear program."""
    lower, upper = limits(vehicle, lost)
    rows = [polytope.COMPONENTS.index(name) for name in fix]
    found = linprog(
        -(direction @ vehicle.allocation),
        A_eq=vehicle.allocation[rows] if fix else None,
        b_eq=list(fix.values()) if fix else None,
        bounds=list(zip(lower, upper, strict=True)),
    )
    return -found.fun if found.status == 0 else None


@pytest.mark.parametrize("name", PRESETS)
def test_every_direction_reaches_as_far_as_a_linear_program_says(name):
    vehicle = tilthex.Vehicle.preset(name)
    rng = np.random.default_rng(1)
    for fix in ({}, FORCE, {"fx": 0.0, "fy": 0.0}):
        if not fix and vehicle.rotor_count > 8:
            continue  # its hull in six dimensions takes a minute
        found = vehicle.wrench_polytope(fix=fix)
        columns = [polytope.COMPONENTS.index(c) for c in found.components]
        for _ in range(10):
            direction = np.zeros(6)
            direction[columns] = rng.normal(size=len(columns))
            expected = support(vehicle, direction, fix)
            assert (found.vertices @ direction[columns]).max() == pytest.approx(expected, rel=1e-7, abs=1e-7)
        assert (found.margin(found.vertices) > -1e-6).all()
        np.testing.assert_allclose(
            (found.inputs @ vehicle.allocation.T)[:, columns], found.vertices, atol=1e-7
        )


@pytest.mark.parametrize("name", PRESETS)
def test_volume_of_the_forces_against_monte_carlo(name):
    """Membership of random forces by linear programs, without the hull."""
    vehicle = tilthex.Vehicle.preset(name)
    found = vehicle.wrench_polytope(fix=FORCE)
    if found.dimension < 3:
        ends = support(vehicle, np.eye(6)[2], FORCE), -support(vehicle, -np.eye(6)[2], FORCE)
        assert found.dimension == 1
        assert found.volume == pytest.approx(ends[0] - ends[1])
        return
    low, high = found.vertices.min(axis=0), found.vertices.max(axis=0)
    rng = np.random.default_rng(7)
    points = rng.uniform(low, high, (200_000, 3))
    inside = found.contains(points)
    lower, upper = limits(vehicle)
    wrenches = np.column_stack([points, np.zeros_like(points)])
    if vehicle.rotor_count == 6:
        u = wrenches @ np.linalg.inv(vehicle.allocation).T
        by_rotors = ((u >= lower) & (u <= upper)).all(axis=1)
        assert (by_rotors != inside).sum() <= 2  # on a facet, rounding decides
        inside = by_rotors
    assert found.volume == pytest.approx(inside.mean() * np.prod(high - low), rel=0.01)
    if vehicle.rotor_count > 6:
        for wrench, expected in zip(wrenches[:60], inside, strict=False):
            feasible = linprog(
                np.zeros(len(lower)),
                A_eq=vehicle.allocation,
                b_eq=wrench,
                bounds=list(zip(lower, upper, strict=True)),
            )
            assert (feasible.status == 0) == expected


@pytest.mark.parametrize("name", ["tilt-hex", "tilt-hex-light"])
def test_volume_of_all_wrenches_of_six_rotors(name):
    """The image of a box under a square matrix."""
    vehicle = tilthex.Vehicle.preset(name)
    lower, upper = limits(vehicle)
    expected = abs(np.linalg.det(vehicle.allocation)) * np.prod(upper - lower)
    assert vehicle.wrench_polytope().volume == pytest.approx(expected, rel=1e-6)


@given(st.floats(-math.pi, math.pi))
def test_the_lateral_reach_is_what_the_allocator_gives(angle):
    vehicle = tilthex.Vehicle.preset("tilt-hex")
    section = vehicle.wrench_polytope(hover=True, fix={"fz": 0.0, **FORCE})
    direction = np.array([math.cos(angle), math.sin(angle)])
    reach = section.reach(direction)
    assert reach >= polytope.lateral_reach(vehicle) - 1e-9
    allocator = tilthex.Allocator(vehicle)
    weight = vehicle.mass * tilthex.GRAVITY
    for part, met in ((0.999, True), (1.001, False)):
        out = allocator.allocate([*(part * reach * direction), weight, 0, 0, 0])
        assert (out.given_up is None) == met


def test_the_largest_ball_touches_and_stays_inside():
    found = tilthex.Vehicle.preset("tilt-hex").wrench_polytope(fix=FORCE)
    centre, radius = found.inscribed_ball
    assert found.ball_around(centre) == pytest.approx(radius)
    rng = np.random.default_rng(3)
    for _ in range(200):
        near = centre + rng.normal(size=3)
        assert found.ball_around(near) <= radius + 1e-9


def test_payload_and_push():
    vehicle = tilthex.Vehicle.preset("hexarotor")
    most = 6 * 11.4e-4 * 110**2
    assert polytope.payload(vehicle) == pytest.approx(most / tilthex.GRAVITY - vehicle.mass)
    assert polytope.push(vehicle, [0, 0, 1], at=[0, 0, 0]) == pytest.approx(
        most - vehicle.mass * tilthex.GRAVITY
    )
    assert polytope.push(vehicle, [1, 0, 0]) == pytest.approx(0, abs=1e-9)
    assert polytope.push(tilthex.Vehicle.preset("tilt-hex"), [1, 0, 0]) > 2


@pytest.mark.parametrize("name", PRESETS)
def test_static_hover_after_the_loss_of_each_rotor(name):
    """The inputs are what they are said to be; where there are none, a linear program agrees."""
    vehicle = tilthex.Vehicle.preset(name)
    weight = vehicle.mass * tilthex.GRAVITY
    for rotor in range(vehicle.rotor_count if vehicle.rotor_count < 12 else 1):
        found = polytope.static_hover(vehicle, lost=[rotor])
        lower, upper = limits(vehicle, [rotor])
        if found is None:
            directions = np.random.default_rng(5).normal(size=(60, 3))
            reach = [
                support(vehicle, np.append(d / np.linalg.norm(d), [0, 0, 0]), FORCE, [rotor])
                for d in directions
            ]
            assert all(r is None or r < weight for r in reach)
        else:
            span = upper - lower
            assert (found.inputs >= lower + (found.margin - 1e-6) * span).all()
            assert (found.inputs <= upper - (found.margin - 1e-6) * span).all()
            wrench = vehicle.allocation @ found.inputs
            np.testing.assert_allclose(wrench[3:], 0, atol=1e-6)
            assert np.linalg.norm(wrench[:3]) == pytest.approx(weight, rel=1e-6)
        assert (found is not None) == row_of(name)[6].startswith("yes")


def row_of(name: str) -> list[str]:
    """The row of a preset in the table of docs/allocation.md, without its name."""
    page = Path(__file__).parent.parent / "docs" / "allocation.md"
    for line in page.read_text(encoding="utf-8").splitlines():
        if line.startswith(f"| {name} |"):
            return [cell.strip() for cell in line.split("|")[2:-1]]
    vehicle = tilthex.Vehicle.preset(name)
    along = [polytope.push(vehicle, np.array(axis)) for axis in ([1.0, 0.0, 0.0], [0.0, 0.0, 1.0])]
    survives = polytope.static_hover(vehicle, lost=[0]) is not None
    pytest.fail(
        f"docs/allocation.md has no row of the preset {name}; add | {name} | {vehicle.rotor_count} | "
        f"{np.linalg.matrix_rank(vehicle.allocation)} | {polytope.lateral_reach(vehicle):.1f} | "
        f"{polytope.payload(vehicle):.2f} | {along[0]:.1f} | {along[1]:.1f} | "
        f"{'yes, any rotor' if survives else 'no'} |"
    )


def test_the_page_has_the_values_of_the_vehicles():
    for name in PRESETS:
        vehicle = tilthex.Vehicle.preset(name)
        cells = row_of(name)[:6]
        assert cells[:2] == [str(vehicle.rotor_count), str(np.linalg.matrix_rank(vehicle.allocation))]
        found = [
            polytope.lateral_reach(vehicle),
            polytope.payload(vehicle),
            polytope.push(vehicle, np.array([1.0, 0.0, 0.0])),
            polytope.push(vehicle, np.array([0.0, 0.0, 1.0])),
        ]
        for cell, value in zip(cells[2:], found, strict=True):
            digits = len(cell.partition(".")[2])
            assert float(cell) == pytest.approx(value, abs=0.51 * 10**-digits), f"{name}: {cell}, {value}"


def test_what_is_wrong_is_said():
    vehicle = tilthex.Vehicle.preset("tilt-hex")
    with pytest.raises(ValueError, match="fix names `torque`; expected some of fx"):
        vehicle.wrench_polytope(fix={"torque": 0})
    with pytest.raises(ValueError, match="no inputs within the limits"):
        vehicle.wrench_polytope(fix={"fz": 1e4})
    with pytest.raises(ValueError, match="lost names rotor 6"):
        vehicle.wrench_polytope(lost=[6])
