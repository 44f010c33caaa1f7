"""`tilthex view` without a flight: geometry, words, and who may connect."""

import functools
import re
import socket
import urllib.error
import urllib.request

import numpy as np
import pytest
import tilthex
from hypothesis import given
from hypothesis import strategies as st
from tilthex._faults import FAULTS

pytest.importorskip("viser", reason="viser is not installed: the page is not tested")

import viser
from tilthex.view import gate, status
from tilthex.view.geometry import Reach, cylinders
from tilthex.view.sample import Pose, Sample
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

PRESETS = tilthex.Vehicle.presets()


@pytest.mark.parametrize("name", PRESETS)
def test_a_vehicle_shows_its_rotors_where_they_are(name):
    vehicle = tilthex.Vehicle.preset(name)
    rotors = [shape for shape in cylinders(vehicle) if shape.is_rotor]
    assert len(rotors) == vehicle.rotor_count
    for shape, rotor in zip(rotors, vehicle.rotors, strict=True):
        assert np.allclose(shape.begin, rotor["position"])
        axis = shape.end - shape.begin
        assert np.allclose(axis / np.linalg.norm(axis), rotor["axis"])
    rod = next(shape for shape in cylinders(vehicle) if np.allclose(shape.begin, vehicle.tool_position))
    assert rod.radius < rotors[0].radius


@functools.cache
def reach_of(name):
    """The reach of a preset, and the section of its polytope without a torque."""
    vehicle = tilthex.Vehicle.preset(name)
    return Reach(vehicle), vehicle.wrench_polytope(fix={"tx": 0.0, "ty": 0.0, "tz": 0.0})


@pytest.mark.parametrize("name", ["tilt-hex", "hexarotor", "omnidirectional-octorotor"])
@given(parts=st.lists(st.floats(0, 1), min_size=8, max_size=8))
def test_loads_thrusts_and_margin_are_those_of_the_allocation(name, parts):
    vehicle = tilthex.Vehicle.preset(name)
    reach, section = reach_of(name)
    low, high = (vehicle.rotor_speed_limits * np.abs(vehicle.rotor_speed_limits)).T
    inputs = low + np.array(parts[: len(low)]) * (high - low)
    speeds = np.sign(inputs) * np.sqrt(np.abs(inputs))
    assert np.allclose(reach.loads(speeds), parts[: len(low)])
    axes = np.array([rotor["axis"] for rotor in vehicle.rotors])
    force = (vehicle.allocation @ inputs)[:3]
    assert np.allclose(reach.thrusts(speeds) @ axes, force, atol=1e-9)
    if section.dimension == 3:
        assert reach.margin(speeds) == pytest.approx(float(section.margin(force)), abs=1e-9)
        assert (reach.margin(vehicle.hover_speeds())) > 0.0
        # The hull's triangles enclose its volume.
        a, b, c = reach.vertices[reach.faces].transpose(1, 0, 2) - reach.vertices.mean(0)
        assert np.abs(np.sum(a * np.cross(b, c), axis=1)).sum() / 6 == pytest.approx(section.volume)
    else:
        assert reach.margin(speeds) == np.inf


@pytest.mark.parametrize(
    ("token", "path", "headers", "says"),
    [
        (None, "/", {"Host": "127.0.0.1:8080"}, None),
        (None, "/", {"Host": "localhost:8080", "Origin": "http://localhost:8080"}, None),
        (None, "/", {"Host": "[::1]:8080"}, None),
        # A name that somebody lets mean this computer.
        (None, "/", {"Host": "evil.example:8080", "Origin": "http://evil.example:8080"}, "this computer"),
        (None, "/", {}, "this computer"),
        (None, "/", {"Host": "127.0.0.1:8080", "Origin": "http://evil.example"}, "evil.example"),
        (None, "/", {"Host": "127.0.0.1:8080", "Origin": "http://127.0.0.1:9"}, "127.0.0.1:9"),
        (None, "/", {"Host": "127.0.0.1:8080", "Origin": "null"}, "null"),
        ("0123456789abcdef", "/", {"Host": "base:8080"}, "token"),
        ("0123456789abcdef", "/?token=0123456789abcdee", {"Host": "base:8080"}, "token"),
        ("0123456789abcdef", "/?token=0123456789abcdef", {"Host": "base:8080"}, None),
        ("0123456789abcdef", "/", {"Host": "base", "Cookie": "tilthex-view=0123456789abcdef"}, None),
        ("0123456789abcdef", "/", {"Host": "base", "Cookie": "tilthex-view=\x01;=;"}, "token"),
        ("0123456789abcdef", "/?token=0123456789abcdef", {"Host": "base", "Origin": "http://o"}, "http://o"),
    ],
)
def test_who_may_open_the_page(token, path, headers, says):
    refusal = gate.Gate("192.0.2.1", 8080, token).admits(path, headers)
    assert refusal is None if says is None else says in refusal


@pytest.mark.parametrize(
    ("address", "says"),
    [
        ("8080", "expected ADDRESS:PORT"),
        ("127.0.0.1:no", "expected ADDRESS:PORT"),
        ("0.0.0.0:8080", "every network"),
        ("[::]:8080", "every network"),
        ("[::ffff:0.0.0.0]:8080", "every network"),
        ("no-such-host.invalid:8080", "not an address"),
    ],
)
def test_an_address_that_is_none_is_one_sentence(address, says):
    with pytest.raises(ValueError, match=re.escape(says)):
        gate.gate(address, None)


def test_an_address_of_a_network_has_a_token(tmp_path, monkeypatch):
    assert gate.gate("127.0.0.1:0", None).token is None
    # A name of this computer that is also a name in a network.
    both = [(socket.AF_INET, socket.SOCK_STREAM, 6, "", (each, 8080)) for each in ("127.0.1.1", "192.0.2.1")]
    with monkeypatch.context() as patch:
        patch.setattr(socket, "getaddrinfo", lambda *_, **__: both)
        assert gate.gate("base:8080", None).token is not None
    tokens = {gate.gate("192.0.2.1:8080", None).token for _ in range(2)}
    assert len(tokens) == 2 and all(len(token) >= gate.SHORTEST for token in tokens)
    (file := tmp_path / "token").write_text("0123456789abcdef\n")
    assert gate.gate("127.0.0.1:0", file).url(1) == "http://127.0.0.1:1/?token=0123456789abcdef"
    file.write_text("short")
    with pytest.raises(ValueError, match="has 5 characters"):
        gate.gate("127.0.0.1:0", file)


def joins(server, **headers):
    """Whether a browser's page with these headers gets a connection."""
    protocol = f"viser-v{viser.__version__}"
    address = f"ws://127.0.0.1:{server.get_port()}/"
    try:
        with connect(address, subprotocols=[protocol], additional_headers=headers) as socket:
            return bool(socket.recv(20))
    except InvalidStatus as error:
        assert error.response.status_code == 403
        return False


def test_no_other_page_gives_orders(served):
    own = f"http://127.0.0.1:{served.get_port()}"
    assert joins(served, Origin=own)
    assert not joins(served, Origin="http://evil.example")
    with urllib.request.urlopen(own) as page:
        assert b"<html" in page.read()


@pytest.mark.parametrize("served", ["0123456789abcdef"], indirect=True)
def test_a_token_opens_the_page_and_its_connection(served):
    own = f"http://127.0.0.1:{served.get_port()}"
    with pytest.raises(urllib.error.HTTPError, match="403"):
        urllib.request.urlopen(own)
    assert not joins(served, Origin=own)
    with urllib.request.urlopen(f"{own}/?token=0123456789abcdef") as page:
        cookie = page.headers["Set-Cookie"]
    assert "HttpOnly" in cookie and "SameSite=Strict" in cookie
    assert joins(served, Origin=own, Cookie=cookie.partition(";")[0])


@pytest.mark.parametrize("phase", ["disarmed", "flying"])
@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_a_fault_says_its_reaction(fault, phase):
    vehicle = tilthex.Vehicle.preset("tilt-hex")
    text = status.html(sample(phase, (fault.name,), vehicle), Reach(vehicle), link_age=0.1)
    reaction = fault.on_ground if phase == "disarmed" else fault.in_flight
    assert f"{fault.name} - {reaction}" in text
    assert "no message from" not in text


def test_an_old_state_is_said_to_be_old_and_nothing_is_markup():
    vehicle = tilthex.Vehicle.preset("tilt-hex")
    text = status.html(sample("<b>", ("<script>",), vehicle), Reach(vehicle), link_age=3.2)
    assert "no message from the flight for 3.2 s" in text
    assert "<script>" not in text and "<b></div>" not in text


def sample(phase, faults, vehicle):
    pose, none = Pose(np.zeros(3), np.eye(3)), np.zeros(3)
    return Sample(
        time=0.0, robot=pose, setpoint=pose, reference=pose, force=none, torque=none, position_error=none,
        rotor_speeds=vehicle.hover_speeds(), phase=phase, faults=faults, given_up=None, compliant=False,
        battery=float("nan"), pose_age=float("nan"),
    )  # fmt: skip
