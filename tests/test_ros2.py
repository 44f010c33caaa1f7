"""The bridge to ROS 2 without ROS: what it makes of messages and of a configuration."""

import contextlib
import re
import socket
import subprocess
import sys
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
import tilthex
from hypothesis import given
from hypothesis import strategies as st
from strategies import rotations
from test_send_pose import send_pose
from tilthex._quaternions import quaternion_from_rotation, rotations_from_quaternions
from tilthex.readers.messages import ros_types
from tilthex.ros2 import orders, parameters
from tilthex.ros2.clock import DRIFT, FlightClock
from tilthex.ros2.messages import RosMessages
from tilthex.ros2.poses import PoseSender
from tilthex.ros2.pulse import STOPPED, Pulse

TYPES = ros_types().types
SECOND = 1_000_000_000


def make(kind, *fields):
    return TYPES[kind](*fields)


def vector(kind, values):
    return make(f"geometry_msgs/msg/{kind}", *map(float, values))


def trajectory(points, frame="map"):
    """A trajectory of `(seconds, position, rotation, velocity)`; no velocity where it is None."""
    made = []
    for seconds, position, rotation, velocity in points:
        turn = vector("Quaternion", quaternion_from_rotation(rotation))
        transform = make("geometry_msgs/msg/Transform", vector("Vector3", position), turn)
        moving = (
            [] if velocity is None else [make("geometry_msgs/msg/Twist", *(vector("Vector3", velocity),) * 2)]
        )
        after = make("builtin_interfaces/msg/Duration", *divmod(round(seconds * 1e9), SECOND))
        made.append(make("trajectory_msgs/msg/MultiDOFJointTrajectoryPoint", [transform], moving, [], after))
    header = make("std_msgs/msg/Header", make("builtin_interfaces/msg/Time", 0, 0), frame)
    return make("trajectory_msgs/msg/MultiDOFJointTrajectory", header, [], made)


@given(rotation=rotations(), position=st.tuples(*[st.floats(-9, 9)] * 3), time=st.integers(0, 2**61))
def test_transforms_are_the_poses_of_robot_and_tool(rotation, position, time):
    messages, vehicle = RosMessages(TYPES), tilthex.Vehicle.preset("tilt-hex")
    row = {"position_w": np.array(position), "orientation": quaternion_from_rotation(rotation)}
    (robot,) = messages.transforms(time, row).transforms
    (tool,) = messages.tool(time, vehicle).transforms
    for found, frames, place, turn in (
        (robot, ("map", "base_link"), position, rotation),
        (tool, ("base_link", "tool"), vehicle.tool_position, vehicle.tool_rotation),
    ):
        assert (found.header.frame_id, found.child_frame_id) == frames
        assert found.header.stamp.sec * SECOND + found.header.stamp.nanosec == time
        motion = found.transform
        xyzw = [getattr(motion.rotation, name) for name in "xyzw"]
        assert [getattr(motion.translation, name) for name in "xyz"] == list(place)
        assert np.allclose(rotations_from_quaternions(np.array([xyzw]))[0], turn, atol=1e-9)


class StandIn:
    """A message of `tf2_msgs`, which ROS on PyPI has not, and a node that keeps what is published."""

    class TFMessage:
        def __init__(self, transforms):
            self.transforms = transforms

        @staticmethod
        def get_fields_and_field_types():
            return {"transforms": "sequence<geometry_msgs/TransformStamped>"}

    def __init__(self):
        self.published = {}

    def create_publisher(self, _, topic, qos):
        self.published[topic] = kept = []
        self.published[f"{topic} qos"] = qos
        return SimpleNamespace(publish=kept.append)

    def get_clock(self):
        return SimpleNamespace(now=lambda: SimpleNamespace(nanoseconds=7 * SECOND))

    def get_logger(self):
        return SimpleNamespace(warning=self.published.setdefault("warnings", []).append)


@pytest.mark.parametrize("installed", (True, False))
def test_transforms_are_published_where_their_message_is(monkeypatch, installed):
    qos = pytest.importorskip("rclpy.qos")
    from tilthex.ros2.outputs import Outputs

    message = ModuleType("tf2_msgs.msg")
    message.TFMessage = StandIn.TFMessage
    for name, module in (("tf2_msgs", ModuleType("tf2_msgs")), ("tf2_msgs.msg", message)):
        monkeypatch.setitem(sys.modules, name, module if installed else None)
    node, vehicle = StandIn(), tilthex.Vehicle.preset("tilt-hex")
    Outputs(node, vehicle)
    if not installed:
        assert "/tf" not in node.published and "/tf_static" not in node.published
        assert "tf2_msgs is not installed" in node.published["warnings"][0]
        return
    ((tool,),) = (found.transforms for found in node.published["/tf_static"])
    assert (tool.header.frame_id, tool.child_frame_id, tool.header.stamp.sec) == ("base_link", "tool", 7)
    at = tool.transform.translation
    assert [at.x, at.y, at.z] == vehicle.tool_position.tolist()
    # Who comes later gets it, too.
    assert node.published["/tf_static qos"].durability == qos.DurabilityPolicy.TRANSIENT_LOCAL
    assert "/tf" in node.published and "warnings" not in node.published


@given(rotation=rotations())
def test_a_quaternion_is_its_rotation(rotation):
    xyzw = quaternion_from_rotation(rotation)
    assert xyzw[3] >= 0 and abs(np.linalg.norm(xyzw) - 1) < 1e-12
    assert np.allclose(rotations_from_quaternions(xyzw[None])[0], rotation, atol=1e-9)


@given(
    parted=st.floats(0, 2e9),
    drift=st.floats(-0.5 * DRIFT, 0.5 * DRIFT),
    late=st.lists(st.floats(0.0, 0.5), min_size=2, max_size=60),
)
def test_stamps_increase_and_are_as_late_as_the_quickest_message(parted, drift, late):
    clock, last, best = FlightClock(), 0, np.inf
    for k, delay in enumerate(late):
        at = 100.0 + 0.01 * k
        true = round((at * (1 + drift) + parted) * 1e9)
        stamp = clock.stamp(at, true + round(delay * 1e9))
        best = min(best + 2e-2 * DRIFT, delay)
        assert -1e3 <= stamp - true <= max(best * 1e9 + 1e3, last + 1 - true)
        assert stamp > last
        last = stamp
    # A clock of ROS that is set, forwards or backwards, is followed.
    for jump in (-5, 3600):
        assert clock.stamp(200.0, round((200.0 + parted + jump) * 1e9)) == round(
            (200.0 + parted + jump) * 1e9
        )


@pytest.mark.parametrize("name", tilthex.Vehicle.presets())
def test_every_key_of_a_configuration_is_a_parameter(name):
    config = tilthex.Config.default(tilthex.Vehicle.preset(name))
    stiffness = np.diag([6.0, 6, 6, 10, 10, 5]) + 0.1
    found = parameters.parameters(config.replace(admittance={"stiffness": stiffness.tolist()}).to_toml())
    written = re.findall(r"^(\w+) = ", config.to_toml(), re.MULTILINE)
    empty = re.findall(r"^(\w+) = \[\]", config.to_toml(), re.MULTILINE)
    assert sorted(key.rpartition(".")[2] for key in found) == sorted(set_minus(written, empty))
    live = {key.name: key.value for key in found.values() if key.live}
    assert set(live) == {
        f"admittance.{key}" for key in ("mass", "damping", "stiffness", "max_translation", "max_rotation_deg")
    }
    assert all(key.meaning for key in found.values() if ".rotors." not in key.name)
    # What the flight would be sent gives the same configuration.
    back = parameters.admittance(live)
    assert np.array_equal(back["stiffness"], stiffness)
    changed = config.replace(admittance={key: np.asarray(value).tolist() for key, value in back.items()})
    assert changed == config.replace(admittance={"stiffness": stiffness.tolist()})


def set_minus(names, without):
    left = list(names)
    for name in without:
        left.remove(name)
    return left


@given(
    rotation=rotations(),
    ways=st.lists(
        st.tuples(st.floats(0.001, 9), st.lists(st.floats(-5, 5), min_size=3, max_size=3)), min_size=1
    ),
)
def test_a_trajectory_becomes_its_way_points(rotation, ways):
    times = np.cumsum([way[0] for way in ways])
    message = trajectory([(t, way[1], rotation, None) for t, way in zip(times, ways, strict=True)])
    assert not orders.is_stream(message) and not orders.unused(message)
    found = orders.waypoints(message)
    assert np.allclose([way["duration"] for way in found], [way[0] for way in ways], atol=2e-9)
    for way, (_, position) in zip(found, ways, strict=True):
        assert np.array_equal(way["position"], position)
        assert np.allclose(way["rotation"], rotation, atol=1e-9)


def test_one_point_without_a_time_is_a_set_point():
    message = trajectory([(0.0, [1, 2, 3], np.eye(3), [0.1, 0.2, 0.3])])
    assert orders.is_stream(message)
    found = orders.setpoint(message)
    assert found["position"].tolist() == [1, 2, 3] and found["angular_velocity"].tolist() == [0.1, 0.2, 0.3]
    assert "acceleration" not in found


LEVEL = ([0, 0, 1], np.eye(3), None)


@pytest.mark.parametrize(
    ("message", "says"),
    [
        (trajectory([(1, *LEVEL)], frame="odom"), 'the frame "odom"; expected "map"'),
        (trajectory([]), "no points"),
        (trajectory([(1, *LEVEL), (1, *LEVEL)]), "expected times that increase"),
        (trajectory([(1, [0, 0, np.nan], np.eye(3), None)]), "translation is .* expected finite numbers"),
    ],
)
def test_what_is_no_trajectory_is_said(message, says):
    with pytest.raises(ValueError, match=says):
        orders.waypoints(message)


@given(xyzw=st.lists(st.floats(-2, 2), min_size=4, max_size=4))
def test_a_quaternion_that_is_none_is_said(xyzw):
    place = make("geometry_msgs/msg/Pose", vector("Point", [0, 0, 1]), vector("Quaternion", xyzw))
    header = make("std_msgs/msg/Header", make("builtin_interfaces/msg/Time", 0, 0), "")
    message = make("geometry_msgs/msg/PoseStamped", header, place)
    if abs(np.linalg.norm(xyzw) - 1) <= orders.UNIT:
        assert np.allclose(orders.pose(message)[1].T @ orders.pose(message)[1], np.eye(3))
    else:
        with pytest.raises(ValueError, match="has the length"):
            orders.pose(message)


@given(
    rotation=rotations(),
    position=st.lists(st.floats(-9, 9), min_size=3, max_size=3),
    sec=st.integers(0, 2**31 - 1),
)
def test_a_pose_is_sent_as_the_example_sends_it(rotation, position, sec):
    row = {"position_w": np.array(position), "orientation": quaternion_from_rotation(rotation)}
    message = RosMessages(TYPES).pose(sec * SECOND + 5, row)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listener, contextlib.ExitStack() as ended:
        listener.bind(("127.0.0.1", 0))
        sender = PoseSender(f"127.0.0.1:{listener.getsockname()[1]}", "Tilt-Hex é")
        ended.callback(sender.close)
        for number in range(2):
            sender.send(message, 7)
            packet = listener.recv(200)
            taken = (sec * SECOND + 5 or 7) * 1e-9
            expected = send_pose.packet(number, taken, position, row["orientation"], "Tilt-Hex é")
            assert packet[:48] == expected[:48] and packet[80:] == expected[80:]
            assert np.allclose(np.frombuffer(packet, "<f8", 4, 48), row["orientation"], atol=1e-9)


@pytest.mark.parametrize(
    ("to", "body", "says"),
    [
        ("127.0.0.1:x", "hex", "the port of 127.0.0.1:x is not a number up to 65535"),
        ("127.0.0.1:65536", "hex", "the port of 127.0.0.1:65536 is not a number up to 65535"),
        ("127.0.0.1", "", "the body's name has 0 bytes; expected 1 to 64"),
    ],
)
def test_where_poses_cannot_go_is_said(to, body, says):
    with pytest.raises(ValueError, match=re.escape(says)):
        PoseSender(to, body)


@given(beats=st.lists(st.floats(0.0, 1.0), min_size=1))
def test_the_operator_is_there_while_the_executor_turns(beats):
    at = [0.0]
    pulse = Pulse(lambda: at[0])
    for wait in beats:
        begin, at[0] = at[0], at[0] + wait
        assert pulse() == (at[0] - begin < STOPPED)
        pulse.beat()
        assert pulse()


def test_without_ros_it_says_what_is_missing():
    blocked = (
        "import sys; sys.modules['rclpy'] = None; from tilthex.ros2 import __main__ as m; sys.exit(m.main())"
    )
    found = subprocess.run([sys.executable, "-c", blocked], capture_output=True, text=True, timeout=60)
    assert found.returncode == 2
    assert found.stderr.count("\n") == 1 and "source its setup.bash" in found.stderr
