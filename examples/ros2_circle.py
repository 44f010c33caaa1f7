"""Flies the tool on a circle from ROS 2, through `python -m tilthex.ros2` (docs/howto/ros2.md).

It takes off, streams set-points at 100 Hz, and lands.
"""

import math
import sys

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped, Transform, Twist
from std_srvs.srv import Trigger
from trajectory_msgs.msg import MultiDOFJointTrajectory, MultiDOFJointTrajectoryPoint

RATE, RADIUS, PERIOD, DURATION = 100.0, 0.2, 8.0, 10.0


class Circle:
    def __init__(self):
        self.node = rclpy.create_node("circle")
        self.ready, self.home = False, None
        self.node.create_subscription(DiagnosticArray, "/diagnostics", self.diagnose, 10)
        self.node.create_subscription(PoseStamped, "setpoint", self.see, 10)
        self.way = self.node.create_publisher(MultiDOFJointTrajectory, "command/trajectory", 10)

    def diagnose(self, message):
        found = {pair.key: pair.value for status in message.status for pair in status.values}
        self.ready = found.get("phase") == "flying" and found.get("compliant") == "True"

    def see(self, message):
        self.newest = message.pose.position

    def order(self, name):
        client = self.node.create_client(Trigger, name)
        client.wait_for_service()
        answer = client.call_async(Trigger.Request())
        rclpy.spin_until_future_complete(self.node, answer)
        if not answer.result().success:
            sys.exit(answer.result().message)

    def fly(self):
        self.order("take_off")
        while not self.ready:
            rclpy.spin_once(self.node)
        self.home, self.begin = self.newest, self.node.get_clock().now()
        timer = self.node.create_timer(1.0 / RATE, self.step)
        while self.time() < DURATION:
            rclpy.spin_once(self.node)
        timer.cancel()
        self.order("land")

    def time(self):
        return (self.node.get_clock().now() - self.begin).nanoseconds * 1e-9

    def step(self):
        # The radius grows from nothing: set-points begin where the tool is, at rest.
        t, omega = self.time(), 2.0 * math.pi / PERIOD
        radius = RADIUS * min(1.0, t / PERIOD) ** 2
        place, turn = Transform(), Twist()
        place.translation.x = self.home.x + radius * math.cos(omega * t)
        place.translation.y = self.home.y + radius * math.sin(omega * t)
        place.translation.z = self.home.z
        point = MultiDOFJointTrajectoryPoint(transforms=[place], velocities=[turn])
        self.way.publish(MultiDOFJointTrajectory(points=[point]))


if __name__ == "__main__":
    rclpy.init()
    Circle().fly()
