"""`tilthex view` on a log and on a flight, in a real server and, where there is one, in a real browser."""

import contextlib
import json
import os
import re
import shutil
import socket
import threading
import time
from pathlib import Path

import chromium
import numpy as np
import pytest
import tilthex
from PIL import Image
from test_programs import control_port, program, started, until, vehicle
from tilthex import __main__ as command
from tilthex import _control, log
from tilthex._programs import free_port
from tilthex.client import PROTOCOL

pytest.importorskip("viser", reason="viser is not installed: the page is not tested")

from tilthex.view import simulated
from tilthex.view.live import Live
from tilthex.view.pilot import Pilot
from tilthex.view.replay import Replay
from tilthex.view.sample import TOPICS, Flown, Pose

pytestmark = pytest.mark.real_time

PHASE = "(document.getElementById('tilthex-phase') || {}).innerText"


@pytest.fixture(scope="module")
def flown(path):
    return Flown(log.Log(path))


def test_a_moment_is_what_the_log_has(path, flown):
    topics = log.read(path, TOPICS)
    times = topics["/flight"]["log_time"] - topics["/flight"]["log_time"][0]
    for row in (0, len(times) // 2, len(times) - 1):
        sample = flown.at(times[row])
        assert sample.time == times[row]
        assert np.array_equal(sample.robot.position, topics["/state"]["position_w"][row])
        assert np.array_equal(sample.force, topics["/wrench"]["tool_w.force"][row])
        assert np.array_equal(sample.rotor_speeds, topics["/rotors"]["measured"][row])
        assert sample.phase == topics["/flight"]["phase"][row]
    assert flown.at(-1.0).time == 0.0
    # Between two samples, the earlier.
    assert flown.at(0.5 * (times[5] + times[6])).time == times[5]
    events = flown.events()
    assert [what for _, what in events if what in ("starting", "flying", "landing")] == [
        "starting", "flying", "landing"
    ]  # fmt: skip
    for at, what in events:
        shown = flown.at(at)
        assert what == shown.phase or what in shown.faults
    operator = next(at for at, what in events if what == "operator")
    assert "operator" in flown.at(operator).faults and "operator" not in flown.at(operator - 0.01).faults


def test_the_slider_moves_the_vehicle(flown, served):
    replay = Replay(served, flown, "flight.mcap")
    flying = next(at for at, what in flown.events() if what == "landing")
    replay.slider.value = flying
    robot = served.scene.get_handle_by_name("/robot")
    assert np.allclose(robot.position, flown.at(flying).robot.position, atol=1e-3)
    assert robot.position[2] > 0.1


@pytest.mark.parametrize("arguments", [["no.mcap"], ["--config", "no.mcap"], ["--control", "7410"]])
def test_what_cannot_be_shown_is_one_sentence(arguments, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("no.mcap").write_bytes(b"no log")
    assert command.main(["view", *arguments, "--no-browser"]) == 2
    said = capsys.readouterr().err
    assert len(said.splitlines()) == 1 and arguments[0] in said


def documented(picture):
    """Makes a picture that of docs/howto/view.md, if somebody asks for it."""
    if os.environ.get("TILTHEX_WRITE_DOCS"):
        shutil.copy(picture, Path(__file__).parent.parent / "docs" / "images")


def test_a_browser_shows_a_log(served, flown, tmp_path):
    chromium.browser()
    picture = tmp_path / "view-log.png"
    replay = Replay(served, flown, "flight.mcap")
    landing = next(at for at, what in flown.events() if what == "landing")
    with chromium.opened(f"http://127.0.0.1:{served.get_port()}/", tmp_path / "profile") as tab:
        tab.wait(f"{PHASE} == 'disarmed'")
        replay.slider.value = landing - 0.5
        tab.wait(f"{PHASE} == 'flying'")
        tab.drawn(picture)
        replay.slider.value = landing + 0.1
        tab.wait(f"{PHASE} == 'landing'")
    documented(picture)


@contextlib.contextmanager
def shown(served, port, push_port=None):
    """The page of the flight at a port, and what it told the operator."""
    ended, told = threading.Event(), []
    page = Live(served, _control.connector(f"127.0.0.1:{port}", None), "sim", push_port)
    tell = page.page.tell
    page.page.tell = lambda title, text: (told.append(title), tell(title, text))
    thread = threading.Thread(target=page.run, args=(ended,))
    thread.start()
    try:
        yield page, told
    finally:
        ended.set()
        thread.join()


@contextlib.contextmanager
def live(served, *arguments):
    """The page of a simulated flight: its page, its port, and what it told the operator."""
    program("tilthex-rt")
    with (
        simulated.flight(list(map(str, arguments))) as (port, push_port),
        shown(served, port, push_port) as (page, told),
    ):
        yield page, port, told


def taken(port):
    """Whether a flight takes orders at a port."""
    try:
        tilthex.connect(port=port).close()
    except ConnectionError:
        return False
    return True


def test_orders_without_a_browser(served, tmp_path):
    path = tmp_path / "flight.mcap"
    with live(served, "--log", path) as (page, port, told):
        until(lambda: page.pilot.newest is not None)
        assert page.pilot.newest.phase == "disarmed"
        page.pilot.order("zero bias", lambda flight: flight.zero_bias())
        page.controls.sliders["stiffness"][2].value = 8.5
        until(lambda: page.pilot.newest.controls is not None)
        # What is no number is refused here, what cannot be now by the flight; neither ends the connection.
        page.pilot.order("wrench", lambda flight: flight.set_wrench([np.nan, 0.0, 0.0]))
        page.pilot.order("follow", lambda flight: flight.follow([0.0, 0.0, 1.0], np.eye(3)))
        until(lambda: {"wrench is not a valid order", "follow is refused"} <= set(told))
        # Far more than the most, which a hand holds until it lets go.
        page.hand.pull(np.array([0.0, 60.0, -80.0]))
        time.sleep(1.0)
        page.hand.release()
        # Nobody looks at the page.
        assert not page.presence()
        page.pilot.kill.press()
        until(lambda: "the flight has ended" in told or "the flight is gone" in told)
        # It must not wait for the next flight.
        page.pilot.order("take off", lambda flight: flight.take_off())
        until(lambda: "take off does not reach the flight" in told)
        until(lambda: not taken(port))
    pushes = log.read(path, ["/truth"])["/truth"]["tool_wrench_w.force"]
    pushed = np.any(pushes != 0.0, axis=1)
    assert np.allclose(pushes[pushed], [0.0, 3.0, -4.0]) and not pushed[0] and not pushed[-1]
    # 100 a second, through the time between the packets too.
    assert pushed.sum() > 50 and np.all(pushed[np.argmax(pushed) :][: pushed.sum()])
    orders = [message.json for _, message in log.Log(path).messages("/command")]
    assert any('"stiffness":[6.0,6.0,8.5,10.0,10.0,5.0]' in order.replace(" ", "") for order in orders), (
        orders
    )


def test_a_flight_of_another_vehicle_is_not_shown(tmp_path):
    (other := tmp_path / "other.toml").write_text('[vehicle]\npreset = "tilt-hex-light"\n')
    program("tilthex-rt")
    told = []
    with simulated.flight([]) as first, simulated.flight(["--config", str(other)]) as second:
        flights = (_control.connector(f"127.0.0.1:{ports.control}", None) for ports in (first, *[second] * 9))
        pilot = Pilot(lambda **how: next(flights)(**how), lambda: True, lambda title, _: told.append(title))
        with contextlib.closing(pilot):
            pilot.start()
            until(lambda: pilot.newest is not None)
            with tilthex.connect(port=first.control) as flight:
                flight.kill()
            until(lambda: "the flight has another vehicle" in told)
            assert pilot.newest.phase == "disarmed"
            assert pilot.config.vehicle == tilthex.Vehicle.preset("tilt-hex")


# A browser without a graphics card may be too slow for an operator.
SLOW_BROWSER = '[vehicle]\npreset = "tilt-hex"\n[supervisor]\noperator_timeout = 60.0\n'


def test_a_flight_is_steered_in_a_browser(served, tmp_path):
    chromium.browser()
    path, settings = tmp_path / "flight.mcap", tmp_path / "config.toml"
    settings.write_text(SLOW_BROWSER)
    address = f"http://127.0.0.1:{served.get_port()}/"
    with (
        live(served, "--config", settings, "--log", path) as (page, _, told),
        chromium.opened(address, tmp_path / "profile") as tab,
    ):
        tab.wait(f"{PHASE} == 'disarmed'")
        until(page.presence)
        tab.click("take off")
        tab.wait(f"{PHASE} == 'flying'")
        until(lambda: page.pilot.newest.compliant)
        start = page.pilot.newest.setpoint
        goal = start.position + np.array([0.1, 0.0, 0.1])
        page.controls.aim(Pose(goal, start.rotation))
        tab.click("go to the gizmo")
        until(lambda: np.allclose(page.pilot.newest.setpoint.position, goal, atol=1e-3))
        tab.click("hold")
        page.hand.pull(np.array([1.4, 0.0, 0.0]))
        until(lambda: page.pilot.newest.reference.position[0] > goal[0] + 0.1)
        assert page.pilot.newest.force[0] > 1.0
        page.hand.release()
        # Nobody looks any more, and somebody does again.
        tab.command("Page.navigate", url="about:blank")
        until(lambda: not page.presence())
        tab.command("Page.navigate", url=address)
        tab.wait(f"{PHASE} == 'flying'")
        until(page.presence)
        tab.press("K", modifiers=8)
        until(lambda: "the flight has ended" in told or "the flight is gone" in told)
    assert any(message.kill for _, message in log.Log(path).messages("/input"))


PUSHES = """
[[push]]
at = 14.0
duration = 4.0
force = [1.5, 0.0, -1.0]
[[push]]
at = 22.0
duration = 4.0
force = [0.0, 1.5, 0.0]
torque = [0.0, 0.0, 0.4]
[[push]]
at = 30.0
duration = 90.0
force = [1.6, 1.6, -1.0]
torque = [-0.4, -0.4, -0.3]
"""
# The hues of the arrows in the light of the scene, of 256.
ARROWS = {"force": (4, 20), "torque": (188, 215)}


def test_a_browser_shows_the_wrench_in_flight(served, tmp_path):
    chromium.browser()
    settings, pushes, picture = (tmp_path / name for name in ("config.toml", "push.toml", "view.png"))
    settings.write_text(SLOW_BROWSER)
    pushes.write_text(PUSHES)
    # Through a socket: on a busy computer the kernel moves the bytes of a pseudo-terminal too late.
    line, poses = tmp_path / "line", f"natnet://127.0.0.1:{free_port()}/TILTHEX"
    flying = ["--port", f"unix:{line}", "--mocap", poses, "--config", settings, "--no-battery-limits"]
    with (
        vehicle("--socket", line, "--mocap", poses, "--pushes", pushes),
        started(*flying, "--control", "127.0.0.1:0") as process,
        shown(served, control_port(process)) as (page, told),
    ):
        until(lambda: page.pilot.newest is not None)
        page.pilot.order("take off", lambda flight: flight.take_off())
        # The last push; the browser comes late, because its drawing disturbs the flight.
        until(lambda: np.linalg.norm(page.pilot.newest.torque) > 0.5)
        served.initial_camera.position, served.initial_camera.look_at = (1.1, -1.0, 1.0), (0.25, 0.1, 0.6)
        with chromium.opened(f"http://127.0.0.1:{served.get_port()}/", tmp_path / "profile") as tab:
            tab.wait(r"/tool wrench\s+2/.test((document.body || {}).innerText)")
            tab.drawn(picture)
            sample, text = page.pilot.newest, tab.text()
    assert sample.phase == "flying" and sample.compliant and not told
    assert np.allclose(sample.force, [1.6, 1.6, -1.0], atol=0.3)
    assert np.allclose(sample.torque, [-0.4, -0.4, -0.3], atol=0.1)
    assert "flying" in text and re.search(r"contact moves the tool\s+yes", text)
    with Image.open(picture) as image:
        scene = image.convert("RGB").crop((350, 0, 950, 800)).convert("HSV")
    hue, saturation, _ = np.moveaxis(np.asarray(scene), 2, 0)
    # The axes have more saturation, and the discs of the rotors less.
    arrows = (saturation > 70) & (saturation < 200)
    for arrow, (least, most) in ARROWS.items():
        assert int((arrows & (hue >= least) & (hue <= most)).sum()) > 100, arrow
    documented(picture)


def test_an_operator_who_is_away_is_not_heard():
    asked, here = [], threading.Event()

    def present():
        asked.append(here.is_set())
        return asked[-1]

    ours, theirs = socket.socketpair()
    theirs.sendall(json.dumps({"id": 1, "state": None, "protocol": PROTOCOL}).encode() + b"\n")
    with theirs, tilthex.Flight(ours, present=present):
        assert b"state" in theirs.recv(100)
        until(lambda: len(asked) > 1)
        theirs.setblocking(False)
        with pytest.raises(BlockingIOError):
            theirs.recv(1)
        theirs.settimeout(60.0)
        here.set()
        assert b"heartbeat" in theirs.recv(100)
