"""The world of an experiment: MuJoCo, the rotors' lag, the sensors, and the true values."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple
from xml.etree import ElementTree as ET

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from tilthex import GRAVITY, Drawn, Effects, Vehicle
from tilthex.experiments.scenes import Scene
from tilthex.mjcf import TIMESTEP, Rod, to_mjcf

try:
    import mujoco
except ImportError as error:  # pragma: no cover - a message and the end of the program
    raise ImportError(
        "the experiments need MuJoCo, which is not installed: pip install 'tilthex[experiments]'"
    ) from error

Vector = NDArray[np.float64]
PERIOD = 0.002
"""Control period, s."""


@dataclass(frozen=True)
class Noise:
    """Standard deviations of the sensors' noise (per sample), biases, and the delay of poses."""

    position: float = 0.3e-3
    """Captured position, m."""
    orientation: float = 2e-3
    """Captured orientation, rad."""
    gyro: float = 5e-3
    """Gyroscope, rad/s."""
    accelerometer: float = 0.15
    """Accelerometer, m/s^2."""
    rotor_speed: float = 0.1
    """Measured rotor speed, Hz."""
    gyro_bias: float = 0.0
    """Standard deviation of the gyroscope's constant bias, rad/s; each seed gives another bias."""
    accelerometer_bias: float = 0.0
    """The same for the accelerometer, m/s^2."""
    pose_period: float = 0.01
    """Time between captured poses, s."""
    pose_delay: float = 0.015
    """Mean time from capture to arrival, s."""
    pose_jitter: float = 0.005
    """Half the width of the delay's uniform distribution, s."""


class Pose(NamedTuple):
    """A captured pose of the robot, on its way to the estimator."""

    arrival: float
    time: float
    position: Vector
    rotation: Vector


class World:
    """One robot in one scene, which advances by whole control periods.

    The specific force of the IMU is the mean over the period, as of a converter with an anti-alias
    filter. Angular velocity and rotor speeds are those at the end of the period.
    """

    def __init__(
        self,
        vehicle: Vehicle,
        scene: Scene,
        noise: Noise,
        *,
        seed: int,
        tool_position: Vector,
        tool_rotation: Vector,
        feet: Sequence[ET.Element] = (),
        drawn: Drawn | None = None,
    ) -> None:
        """The robot at rest with its tool at a pose, and its rotors at their hover speeds.

        Args:
            vehicle: The true vehicle.
            scene: Its environment.
            noise: The noise of its sensors.
            seed: Seed of the noise.
            tool_position: Position of its tool at the start, m, W.
            tool_rotation: Orientation of its tool at the start.
            feet: Elements of the robot's body.
            drawn: Other true properties: effects, errors of the sensors, noise and delays.
        """
        self.rotation: Vector = tool_rotation @ vehicle.tool_rotation.T
        start = tool_position - self.rotation @ vehicle.tool_position
        stiffness, length = (0.0, 0.0) if drawn is None else drawn.rod
        xml = to_mjcf(
            vehicle,
            scene.elements,
            extra=scene.extra,
            feet=feet,
            position=start,
            rotation=self.rotation,
            rod=Rod(stiffness, length) if stiffness > 0.0 else None,
        )
        try:
            self.model = mujoco.MjModel.from_xml_string(xml)
        except ValueError as error:
            raise ValueError(f"MuJoCo refuses the scene: {' '.join(str(error).split())}") from error
        self.data = mujoco.MjData(self.model)
        self.vehicle = vehicle
        self.noise = noise if drawn is None else replace(noise, **drawn.noise)
        effects = None if drawn is None else drawn.effects()
        self._effects = None if effects is None or effects.off else effects
        self._errors = None if drawn is None else drawn.sensor_errors()
        self._remembers = self._errors is not None and self._errors.remembers
        self.captured: Vector = np.zeros(3) if self._errors is None else self._errors.captured
        """The point that motion capture measures, from the centre of mass, R, m."""
        self.tool_offset = vehicle.tool_position
        self.rotor_speeds: Vector = vehicle.hover_speeds(self.rotation)
        self.push: Vector = np.zeros(3)
        """An external force at the tool's origin, N, W: the pull of a cable."""
        self.peak_force = 0.0
        """Largest norm of the sum of the contact forces in any step of the last period, N."""
        constant = vehicle.rotor_time_constant
        self._lag = 1.0 - math.exp(-TIMESTEP / constant) if constant > 0.0 else 1.0
        self._clamped = self.model.neq > 0
        self._robot = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_BODY, "robot")
        self._rod = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_GEOM, "rod")
        self._tool = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_SITE, "tool")
        self._bends = stiffness > 0.0
        self._held = mujoco.mj_name2id(
            self.model, mujoco.mjtObj.mjOBJ_BODY, "tool" if self._bends else "robot"
        )
        self._contact = np.zeros(6)
        self._turned = np.zeros((3, 3))
        self._draws = np.random.default_rng(seed)
        noise = self.noise
        self.gyro_bias: Vector = noise.gyro_bias * self._draws.standard_normal(3)
        self.accelerometer_bias: Vector = noise.accelerometer_bias * self._draws.standard_normal(3)
        self._pool = np.zeros((0, 6 + vehicle.rotor_count))
        self._noise = np.zeros(6 + vehicle.rotor_count)
        self._specific_force = np.zeros(3)
        self._specific_force_r = np.zeros(3)
        self._next_draw = 0
        self._next_capture = 0.0
        self._poses: list[Pose] = []
        mujoco.mj_forward(self.model, self.data)

    @property
    def time(self) -> float:
        """Time since the start, s."""
        return float(self.data.time)

    @property
    def position(self) -> Vector:
        """True position of the centre of mass, m, W."""
        return np.asarray(self.data.qpos[:3])

    @property
    def captured_position(self) -> Vector:
        """True position of the point that motion capture measures, m, W: the model's centre of mass."""
        return self.position + self.rotation @ self.captured

    @property
    def velocity(self) -> Vector:
        """True velocity of the centre of mass, m/s, W."""
        return np.asarray(self.data.qvel[:3])

    @property
    def angular_velocity(self) -> Vector:
        """True angular velocity, rad/s, R."""
        return np.asarray(self.data.qvel[3:6])

    @property
    def tool_position(self) -> Vector:
        """True position of the tool's origin, m, W."""
        if self._bends:
            return np.array(self.data.site_xpos[self._tool])
        return self.position + self.rotation @ self.tool_offset

    @property
    def tool_velocity(self) -> Vector:
        """True velocity of the tool's origin, m/s, W."""
        if self._bends:
            twist = np.zeros(6)
            site = mujoco.mjtObj.mjOBJ_SITE
            mujoco.mj_objectVelocity(self.model, self.data, site, self._tool, twist, 0)
            return twist[3:]
        return self.velocity + self.rotation @ np.cross(self.angular_velocity, self.tool_offset)

    @property
    def scene_joints(self) -> Vector:
        """Coordinates of the joints of the scene, m and rad, in the order of its file."""
        return np.asarray(self.data.qpos[9 if self._bends else 7 :])

    def step(self, rotor_command: Vector, period: float = PERIOD) -> None:
        """Advances by one control period, s, under commanded rotor speeds, Hz."""
        data, sums, peak, before = self.data, np.zeros(3), 0.0, self.data.qvel[:3].copy()
        commanded = rotor_command
        for _ in range(round(period / TIMESTEP)):
            if self._effects is not None:
                rotor_command = self._effects.reached(commanded)
            change = self._lag * (rotor_command - self.rotor_speeds)
            self.rotor_speeds += change
            data.ctrl[:] = self.rotor_speeds * np.abs(self.rotor_speeds)
            data.xfrc_applied[:] = 0.0
            if self.push.any():
                arm = data.site_xpos[self._tool] - data.xipos[self._held]
                data.xfrc_applied[self._held, :3] = self.push
                data.xfrc_applied[self._held, 3:] = np.cross(arm, self.push)
            if self._effects is not None:
                self._act(self._effects, change / TIMESTEP)
            mujoco.mj_step(self.model, data)
            if self._errors is not None and self._remembers:
                self._errors.step(self.rotor_speeds, TIMESTEP)
            sums += data.sensordata[:3]
            force = data.qfrc_constraint[:3]
            peak = max(peak, force @ force)
        self.peak_force = math.sqrt(peak)
        self._specific_force = sums * (TIMESTEP / period)
        acceleration = (data.qvel[:3] - before) / period
        acceleration[2] += GRAVITY
        self._specific_force_r = self.rotation.T @ acceleration
        mujoco.mju_quat2Mat(self.rotation.reshape(9), data.qpos[3:7])
        if self._bends:
            mujoco.mj_kinematics(self.model, data)
            mujoco.mj_comPos(self.model, data)
            mujoco.mj_comVel(self.model, data)
        if self._next_draw == len(self._pool):
            self._pool = self._draws.standard_normal((4096, self._pool.shape[1]))
            self._next_draw = 0
        self._noise = self._pool[self._next_draw]
        self._next_draw += 1

    def _act(self, effects: Effects, accelerations: Vector) -> None:
        """Applies the wrench of the effects to the airframe, and advances the effects by a time step."""
        data = self.data
        mujoco.mju_quat2Mat(self._turned.reshape(9), data.qpos[3:7])
        wrench = effects.step(
            data.qpos[:3],
            data.qvel[:3],
            self._turned,
            data.qvel[3:6],
            self.rotor_speeds,
            accelerations,
            TIMESTEP,
        )
        # MuJoCo applies a force at the centre of mass of the body, but the wrench acts at that of
        # the vehicle.
        away = self._turned @ self.model.body_ipos[self._robot]
        data.xfrc_applied[self._robot, :3] += wrench[:3]
        data.xfrc_applied[self._robot, 3:] += self._turned @ wrench[3:] - np.cross(away, wrench[:3])

    def perfect_accelerometer(self) -> Vector:
        """The value of an accelerometer without noise and bias, m/s^2, IMU axes."""
        return self._specific_force

    def specific_force(self) -> Vector:
        """The value of the accelerometer, m/s^2, IMU axes."""
        said = self._felt()[1]
        return said + self.noise.accelerometer * self._noise[:3] + self.accelerometer_bias

    def true_specific_force(self) -> Vector:
        """Specific force at the centre of mass over the period without noise, m/s^2, R."""
        return self._specific_force_r

    def gyro(self) -> Vector:
        """The value of the gyroscope, rad/s, IMU axes."""
        return np.asarray(self._felt()[0] + self.noise.gyro * self._noise[3:6] + self.gyro_bias)

    def _felt(self) -> tuple[Vector, Vector]:
        """The values of gyroscope and accelerometer without noise, IMU axes."""
        turned = self.vehicle.imu_rotation.T @ self.angular_velocity
        if self._errors is None:
            return turned, self._specific_force
        return self._errors.imu(turned, self._specific_force)

    def measured_rotor_speeds(self) -> Vector:
        """The rotor speeds that the motor controllers measure, Hz."""
        speeds = self.rotor_speeds
        if self._errors is not None and self._remembers:
            speeds = self._errors.rotor_speeds()
        return speeds + self.noise.rotor_speed * self._noise[6:]

    def arrived_poses(self) -> list[Pose]:
        """Captures a pose when one is due; returns each pose that has arrived, once."""
        now, noise = self.time, self.noise
        if now >= self._next_capture - 1e-9:
            self._next_capture += noise.pose_period
            turn = Rotation.from_rotvec(noise.orientation * self._draws.standard_normal(3))
            delay = noise.pose_delay + noise.pose_jitter * self._draws.uniform(-1.0, 1.0)
            place = self.captured_position + noise.position * self._draws.standard_normal(3)
            self._poses.append(Pose(now + delay, now, place, self.rotation @ turn.as_matrix()))
        due = [pose for pose in self._poses if pose.arrival <= now]
        self._poses = [pose for pose in self._poses if pose.arrival > now]
        return due

    def contact_wrench(self) -> tuple[Vector, float, Vector]:
        """True wrench of all contacts on the tool (force, torque about its origin; W).

        The force of each contact is given in the frame of the contact, and acts on the second of its
        geoms. Also returns the largest single contact force, N, and the normal forces of the surfaces
        across each world axis, N, (3,).
        """
        wrench, largest, pressure = np.zeros(6), 0.0, np.zeros(3)
        tool = self.tool_position
        for i in range(self.data.ncon):
            contact = self.data.contact[i]
            if self._rod not in contact.geom:
                continue
            mujoco.mj_contactForce(self.model, self.data, i, self._contact)
            force = self._contact[:3] @ contact.frame.reshape(3, 3)
            pressure += self._contact[0] * np.abs(contact.frame[:3])
            if contact.geom[1] != self._rod:
                force = -force
            size = math.sqrt(force @ force)
            wrench[:3] += force
            wrench[3:] += np.cross(contact.pos - tool, force)
            largest = max(largest, size)
        return wrench, largest, pressure

    def true_wrench(self) -> tuple[Vector, float, Vector]:
        """True wrench on the tool with the pull, and the two other values of [`contact_wrench`]."""
        if self._clamped:
            return self.constraint_wrench(), 0.0, np.zeros(3)
        wrench, largest, pressure = self.contact_wrench()
        wrench[:3] += self.push
        return wrench, largest, pressure

    def constraint_wrench(self) -> Vector:
        """The true wrench, computed in another way: what all constraints exert on the free joint.

        It contains contacts and clamp, as force and torque about the tool's origin (W).
        """
        force, torque = self.data.qfrc_constraint[:3], self.rotation @ self.data.qfrc_constraint[3:6]
        return np.concatenate([force, torque - np.cross(self.rotation @ self.tool_offset, force)])
