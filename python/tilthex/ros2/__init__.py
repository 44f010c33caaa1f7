"""The bridge to ROS 2: `python -m tilthex.ros2` (docs/howto/ros2.md).

`bridge` is the node. It needs `rclpy` and the standard messages of ROS; no other part of tilthex does.
"""
