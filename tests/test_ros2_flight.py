"""A flight on ROS 2, with the real rclpy: everything that the bridge gives and takes, while it flies."""

import contextlib
import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time

import numpy as np
import pytest
import tilthex
from test_firmware import vehicle
from test_programs import control_port, running, started, until
from test_ros2 import SECOND
from test_send_pose import capture_line, port  # noqa: F401
from tilthex import log
from tilthex._quaternions import rotations_from_quaternions
from tilthex.ros2.groups import timer

# What warns is a parser that ROS brings.
pytestmark = [pytest.mark.real_time, pytest.mark.filterwarnings("ignore:module 'sre_:DeprecationWarning")]

WHEELS = "rclpy is not installed here (docs/howto/ros2.md): the bridge to ROS 2 does not fly"


@pytest.fixture(scope="module")
def ros():
    """ROS on this computer alone, and in a domain of this process."""
    rclpy = pytest.importorskip("rclpy", reason=WHEELS)
    patch = pytest.MonkeyPatch()
    patch.setenv("ROS_DOMAIN_ID", str(1 + os.getpid() % 100))
    patch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    rclpy.init()
    yield rclpy
    rclpy.shutdown()
    patch.undo()


class Peer:
    """A node that listens, and calls, while its executor turns in a thread."""

    def __init__(self, rclpy):
        self.node = rclpy.create_node("peer")
        self.heard = {}
        self._executor = rclpy.executors.SingleThreadedExecutor()
        self._executor.add_node(self.node)
        self._thread = threading.Thread(target=self._spin)
        self._ended = False

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *_):
        self._ended = True
        self._thread.join()
        self.node.destroy_node()

    def _spin(self):
        while not self._ended:
            self._executor.spin_once(timeout_sec=0.05)

    def hear(self, topic, kind, depth=1000):
        self.heard[topic] = []
        self.node.create_subscription(kind, topic, self.heard[topic].append, depth)

    def hear_transforms(self):
        """Where ROS has their message; its wheels of PyPI have not."""
        from rclpy.qos import DurabilityPolicy, QoSProfile

        with contextlib.suppress(ModuleNotFoundError):
            from tf2_msgs.msg import TFMessage

            self.hear("/tf", TFMessage)
            kept = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
            self.hear("/tf_static", TFMessage, kept)

    def call(self, kind, name, request):
        client = self.node.create_client(kind, name)
        assert client.wait_for_service(30), f"no service {name}"
        answer = client.call_async(request)
        until(answer.done)
        return answer.result()

    def trigger(self, name):
        from std_srvs.srv import Trigger

        return self.call(Trigger, name, Trigger.Request())


EVERY_STATE = ("odom", "imu", "joint_states", "tool_wrench")


def bridge(*arguments):
    return running(sys.executable, "-m", "tilthex.ros2", *arguments, stderr=subprocess.STDOUT)


def stamp(message):
    return message.header.stamp.sec * SECOND + message.header.stamp.nanosec


def xyz(value):
    return [value.x, value.y, value.z]


def diagnosis(message):
    return {pair.key: pair.value for pair in message.status[0].values}


def test_a_flight_is_flown_from_ros(ros, tmp_path):
    from diagnostic_msgs.msg import DiagnosticArray
    from geometry_msgs.msg import PoseStamped, Transform, WrenchStamped
    from nav_msgs.msg import Odometry
    from rcl_interfaces.srv import GetParameters, SetParameters
    from rclpy.parameter import Parameter
    from sensor_msgs.msg import Imu, JointState
    from trajectory_msgs.msg import MultiDOFJointTrajectory, MultiDOFJointTrajectoryPoint

    path = tmp_path / "flight.mcap"
    flying = started("--sim", "--control", "127.0.0.1:0", "--log", path)
    with flying as process, Peer(ros) as peer:
        to_port = control_port(process)
        for topic, kind in {
            "odom": Odometry,
            "imu": Imu,
            "joint_states": JointState,
            "setpoint": PoseStamped,
            "tool_wrench": WrenchStamped,
            "commanded_wrench": WrenchStamped,
            "/diagnostics": DiagnosticArray,
        }.items():
            peer.hear(topic, kind)
        peer.hear_transforms()
        publishers = {
            kind: peer.node.create_publisher(kind, f"command/{name}", 1000)
            for name, kind in {
                "pose": PoseStamped,
                "trajectory": MultiDOFJointTrajectory,
                "wrench": WrenchStamped,
            }.items()
        }

        def newest(topic):
            return peer.heard[topic][-1]

        def diagnosed(**wanted):
            heard = peer.heard["/diagnostics"]
            until(
                lambda: heard and wanted.items() <= diagnosis(heard[-1]).items(), lambda: diagnosis(heard[-1])
            )

        def count(what):
            return int(diagnosis(newest("/diagnostics"))[what])

        def parameter(name):
            request = GetParameters.Request(names=[name])
            found = peer.call(GetParameters, "tilthex/get_parameters", request).values[0]
            return list(found.double_array_value)

        def set_parameter(name, value):
            request = SetParameters.Request(parameters=[Parameter(name, value=value).to_parameter_msg()])
            return peer.call(SetParameters, "tilthex/set_parameters", request).results[0]

        def follow(x):
            point = MultiDOFJointTrajectoryPoint(transforms=[Transform()])
            moved = point.transforms[0].translation
            moved.x, moved.y, moved.z = first[0] + x, first[1], first[2]
            publishers[MultiDOFJointTrajectory].publish(MultiDOFJointTrajectory(points=[point]))

        with bridge("--control", f"127.0.0.1:{to_port}") as bridging:
            # Before take-off: what cannot be obeyed is said.
            assert "not fly" in peer.trigger("zero_bias").message
            assert peer.trigger("take_off").success
            diagnosed(phase="flying", compliant="True", faults="")
            assert newest("/diagnostics").status[0].level == b"\0"
            again = peer.trigger("take_off")
            assert not again.success and "already" in again.message

            # The parameters are the configuration; an order changes some of them.
            assert parameter("admittance.stiffness") == [6.0, 6.0, 6.0, 10.0, 10.0, 5.0]
            assert set_parameter("admittance.stiffness", [8.0, 8.0, 8.0, 10.0, 10.0, 5.0]).successful
            negative = set_parameter("admittance.stiffness", [-8.0, 8.0, 8.0, 10.0, 10.0, 5.0])
            assert not negative.successful and "stiffness" in negative.reason
            assert not set_parameter("vehicle.mass", 3.0).successful
            with tilthex.connect(port=to_port) as other:
                assert "stiffness = [8.0, 8.0, 8.0, 10.0, 10.0, 5.0]" in other.configuration()
                other.take_controls()
                other.set_admittance(stiffness=[7, 7, 7, 10, 10, 5])
                until(lambda: parameter("admittance.stiffness")[0] == 7.0)
                assert peer.trigger("take_controls").success

            # Set-points at 100 Hz: every one is ordered; a loop that is late itself refuses some.
            first = xyz(newest("setpoint").pose.position)
            begin = time.monotonic()
            for k in range(150):
                follow(0.001 * k)
                time.sleep(max(0.0, begin + 0.01 * (k + 1) - time.monotonic()))
            until(lambda: count("set-points taken") + count("messages refused") == 150)
            refused = count("messages refused")
            until(lambda: abs(newest("setpoint").pose.position.x - first[0] - 0.149) < 0.02)

            # A place, and one in a frame that nobody knows.
            goal = PoseStamped()
            goal.pose.position.x, goal.pose.position.y, goal.pose.position.z = first
            publishers[PoseStamped].publish(goal)
            until(lambda: abs(newest("setpoint").pose.position.x - first[0]) < 1e-3)
            goal.header.frame_id = "odom"
            publishers[PoseStamped].publish(goal)
            until(lambda: count("messages refused") == refused + 1)

            # A wrench, and the route's again.
            push = WrenchStamped()
            push.wrench.force.x = 0.7
            publishers[WrenchStamped].publish(push)
            until(
                lambda: newest("commanded_wrench").wrench.force.x == 0.7,
                lambda: (diagnosis(newest("/diagnostics")), newest("commanded_wrench")),
            )
            assert peer.trigger("release_wrench").success
            until(lambda: newest("commanded_wrench").wrench.force.x == 0.0)

            # The bridge is the operator: without it the vehicle holds.
            bridging.send_signal(signal.SIGSTOP)
            with tilthex.connect(port=to_port) as witness:
                for state in witness.states(rate=20):
                    if "operator silent" in state["faults"]:
                        break
                assert state["phase"] == "holding"
            bridging.send_signal(signal.SIGCONT)
            diagnosed(phase="flying", faults="")

            # Set-points that come after the end of the flight do not make it a broken connection.
            peer.node.create_timer(0.01, lambda: follow(0.0))
            assert peer.trigger("kill").success
            assert process.wait(20) == 4
            said, _ = bridging.communicate(timeout=20)
            assert bridging.returncode == 0, said
        heard = peer.heard
        until(lambda: len({stamp(heard[topic][-1]) for topic in EVERY_STATE}) == 1)
    published = int(re.search(r"the flight has ended: (\d+) states published", said)[1])
    check_nothing_is_lost(heard, published)
    if "/tf" in heard:
        check_transforms(heard)
    check_axes(heard, log.read(path, ["/state", "/rotors", "/wrench"]))


def check_nothing_is_lost(heard, published):
    """Between the first diagnostics and the end, every state is there once, in order."""
    stamps = [stamp(message) for message in heard["odom"]]
    assert (np.diff(stamps) > 0).all()
    begin = heard["/diagnostics"][0]
    before = int(diagnosis(begin)["states published"])
    assert sum(at > stamp(begin) for at in stamps) == published - before > 500
    for topic in EVERY_STATE:
        assert [stamp(message) for message in heard[topic] if stamp(message) > stamp(begin)] == [
            at for at in stamps if at > stamp(begin)
        ]


def check_transforms(heard):
    """Where /odom has the robot, /tf has it too; the tool is where the vehicle has it."""
    places = {stamp(message): xyz(message.pose.pose.position) for message in heard["odom"]}
    found = [message.transforms[0] for message in heard["/tf"]]
    assert {(one.header.frame_id, one.child_frame_id) for one in found} == {("map", "base_link")}
    both = [one for one in found if stamp(one) in places]
    assert len(both) > 500
    assert all(xyz(one.transform.translation) == places[stamp(one)] for one in both)
    (tool,) = (message.transforms[0] for message in heard["/tf_static"])
    assert (tool.header.frame_id, tool.child_frame_id) == ("base_link", "tool")
    assert xyz(tool.transform.translation) == tilthex.Vehicle.preset("tilt-hex").tool_position.tolist()


def check_axes(heard, topics):
    """What was heard is what the log has of the same tick, in the axes of REP 103 and REP 105."""
    state = topics["/state"]
    rotations = rotations_from_quaternions(state["orientation"])
    velocities = np.einsum("kij,ki->kj", rotations, state["velocity_w"])
    speeds = 2 * np.pi * topics["/rotors"]["measured"]
    variances = state["position_deviation"][:, None] ** 2 / 3
    logged = np.hstack(
        [
            rotations.reshape(-1, 9),
            velocities,
            variances,
            state["specific_force_r"],
            speeds,
            topics["/wrench"]["tool_w.torque"],
        ]
    )
    rows = np.hstack([state["position_w"], state["angular_velocity_r"], topics["/wrench"]["tool_w.force"]])
    ticks = {tuple(row): [] for row in rows}
    for k, row in enumerate(rows):
        ticks[tuple(row)].append(k)
    by_stamp = [{stamp(message): message for message in heard[topic]} for topic in EVERY_STATE]
    for at in set.intersection(*map(set, by_stamp)):
        odometry, imu, joints, wrench = (messages[at] for messages in by_stamp)
        assert (odometry.header.frame_id, odometry.child_frame_id) == ("map", "base_link")
        assert imu.header.frame_id == "base_link"
        place, turning, force = odometry.pose.pose.position, odometry.twist.twist.angular, wrench.wrench.force
        turn = odometry.pose.pose.orientation
        rotation = rotations_from_quaternions(np.array([[*xyz(turn), turn.w]]))[0]
        told = np.hstack(
            [
                rotation.ravel(),
                xyz(odometry.twist.twist.linear),
                odometry.pose.covariance[0],
                xyz(imu.linear_acceleration),
                joints.velocity,
                xyz(wrench.wrench.torque),
            ]
        )
        # A tick without an inertial sample keeps the state of the one before: one of them was heard.
        same = logged[ticks[(*xyz(place), *xyz(turning), *xyz(force))]]
        nearest = same[np.abs(same - told).max(axis=1).argmin()]
        assert np.allclose(told, nearest, atol=1e-9), (told, nearest)
    # In hover the accelerometer shows the weight, upwards.
    assert max(imu.linear_acceleration.z for imu in heard["imu"]) > 9


def test_a_pose_topic_is_motion_capture(ros, port, tmp_path):  # noqa: F811
    from geometry_msgs.msg import PoseStamped
    from nav_msgs.msg import Odometry

    address = f"unix:{tmp_path / 'flight'}"
    poses = ["--pose-topic", "vrpn/hex", "--pose-to", f"127.0.0.1:{port}"]
    # The clock of ROS stands still: what the bridge does in time does not depend on it.
    clock = ["--ros-args", "-p", "use_sim_time:=true"]
    with Peer(ros) as peer, bridge("--control", address, *poses, *clock) as bridging:
        publisher = peer.node.create_publisher(PoseStamped, "vrpn/hex", 10)
        peer.hear("odom", Odometry)

        def publish():
            pose = PoseStamped()
            pose.header.stamp = peer.node.get_clock().now().to_msg()
            pose.pose.position.z = 0.1
            publisher.publish(pose)

        peer.node.create_timer(0.01, publish)
        # It forwards poses while it waits for a flight.
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listener:
            listener.bind(("127.0.0.1", port))
            listener.settimeout(40)
            assert listener.recv(200).startswith(b"tilthex1")
        with started("--sim", "--control", address) as flying:
            until(lambda: peer.heard["odom"])
            # The flight hangs: it may still need poses.
            flying.send_signal(signal.SIGSTOP)
            said = ""
            while "poses are still forwarded" not in said:
                said += bridging.stdout.readline()
            assert "poses per second" in capture_line(port, "hex", tmp_path)
            bridging.send_signal(signal.SIGINT)
            said += bridging.communicate(timeout=20)[0]
    assert bridging.returncode == 130
    assert f"no flight takes orders at {address}" in said and "waiting for it" in said
    assert "the connection to the flight broke: timed out" in said and "Traceback" not in said


def test_a_flight_is_bridged_until_the_bridge_is_told_to_end(ros, tmp_path):
    from nav_msgs.msg import Odometry

    address = f"unix:{tmp_path / 'flight'}"
    with started("--sim", "--control", address) as flying, Peer(ros) as peer:
        peer.hear("odom", Odometry)
        with bridge("--control", address, "--rate", "0.4") as bridging:
            # The second one comes later than an answer may.
            until(lambda: len(peer.heard["odom"]) > 1)
            bridging.send_signal(signal.SIGINT)
            said, _ = bridging.communicate(timeout=20)
        assert bridging.returncode == 130 and "Traceback" not in said
        assert flying.poll() is None


def test_kill_does_not_wait_for_another_order(ros, tmp_path):
    """The bridge of a vehicle that flies itself waits for its answers."""
    from nav_msgs.msg import Odometry
    from std_srvs.srv import Trigger

    address = f"unix:{tmp_path / 'flight'}"
    with vehicle() as (board, console), started("console", *console, "--control", address) as process:
        with Peer(ros) as peer, bridge("--control", address) as bridging:
            peer.hear("odom", Odometry)
            until(lambda: peer.heard["odom"])
            client = peer.node.create_client(Trigger, "take_off")
            assert client.wait_for_service(30)
            board.send_signal(signal.SIGSTOP)
            waiting = client.call_async(Trigger.Request())
            with tilthex.connect(path=tmp_path / "flight") as witness:
                until(lambda: witness.state()["controls"])
            assert peer.trigger("kill").success
            until(waiting.done)
            # It was still on its way when the motors were stopped.
            assert "the motors are stopped" in waiting.result().message
            board.send_signal(signal.SIGCONT)
            process.communicate(timeout=60)
            said, _ = bridging.communicate(timeout=20)
        assert "Traceback" not in said, said


def test_timers_run_while_the_clock_of_ros_stands_still(ros):
    node = ros.create_node("still", parameter_overrides=[ros.parameter.Parameter("use_sim_time", value=True)])
    called = ros.task.Future()
    timer(node, 0.01, lambda: called.set_result(True))
    executor = ros.executors.SingleThreadedExecutor()
    executor.add_node(node)
    executor.spin_until_future_complete(called, timeout_sec=20)
    assert node.get_clock().now().nanoseconds == 0 and called.done()
    node.destroy_node()


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--control", "here"], "expected HOST:PORT or unix:PATH"),
        (["--pose-topic", "poses", "--pose-to", "127.0.0.1:x"], "the port of 127.0.0.1:x is not a number"),
        (["--control-token-file", "/no/such"], "/no/such"),
    ],
)
def test_what_is_wrong_is_said(ros, arguments, says):
    with bridge(*arguments) as bridging:
        said, _ = bridging.communicate(timeout=20)
    assert bridging.returncode == 2 and said.count("\n") == 1 and says in said
