"""Orders to a running `tilthex-rt --control`, and its state.

with tilthex.connect() as flight:
    flight.take_off()
    for state in flight.states(rate=20):
        if state["phase"] == "flying":
            break
    flight.set_admittance(stiffness=[6, 6, 6, 10, 10, 5])
    flight.go_to([0.2, 0.0, 0.7])
    flight.land()
"""

from __future__ import annotations

import contextlib
import json
import os
import socket
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike

from tilthex._logged import State

DEFAULT_PORT = 7410
# The flight ends the connection of a client that sends a longer line, bytes.
LONGEST_ORDER = 64 * 1024
# The version of the control protocol that this client speaks; docs/protocols.md says when it changes.
PROTOCOL = 1
# A vehicle that flies itself answers these orders itself. The console waits at most this long for it, s.
PASSED_ON = frozenset({"take_off", "play", "set_admittance", "zero_bias"})
LONGEST_ANSWER = 8.0
# The flight holds if it has not heard from its operator for `[supervisor] operator_timeout`, s.
HEARTBEAT = 0.2


class OrderRefused(ValueError):
    """The flight refuses an order; the text says why."""


def connect(
    host: str = "127.0.0.1",
    port: int = DEFAULT_PORT,
    timeout: float = 2.0,
    *,
    path: str | os.PathLike[str] | None = None,
    token: str | None = None,
    present: Callable[[], bool] | None = None,
) -> Flight:
    """Connects to a running flight.

    Args:
        host: The computer on which `tilthex-rt --control` runs.
        port: The port of its control socket.
        timeout: Longest wait for an answer, s.
        path: The Unix socket (`--control unix:PATH`), instead of host and port.
        token: The content of the file of `--control-token-file`, if the flight requires it.
        present: Says whether the operator is there. While it says no, the flight hears nothing of it.
            A thread calls it. Without it, the operator is there while this program runs.

    Raises:
        ConnectionError: No flight listens there, or it speaks another version of the control protocol.
        OrderRefused: The token is wrong.
    """
    where = f"{host}:{port}" if path is None else f"unix:{os.fspath(path)}"
    try:
        if path is None:
            connection = socket.create_connection((host, port), timeout)
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        else:
            connection = socket.socket(socket.AF_UNIX)
            connection.settimeout(timeout)
            try:
                connection.connect(os.fspath(path))
            except OSError:
                connection.close()
                raise
    except OSError as error:
        raise ConnectionError(
            f"no flight takes orders at {where} ({error}); start tilthex-rt with --control"
        ) from error
    return Flight(connection, token, present)


class Flight:
    """A connection to a running flight; `tilthex.connect` makes one.

    A thread tells the flight that the operator is there. If the operator, the program or the network is gone,
    a flight that this client has ordered to move holds, and lands later.
    """

    def __init__(
        self,
        connection: socket.socket,
        token: str | None = None,
        present: Callable[[], bool] | None = None,
    ) -> None:
        self._socket = connection
        self._timeout = connection.gettimeout()
        self._present = present
        self._lines = connection.makefile("r", encoding="utf-8", newline="\n")
        self._states: deque[State] = deque(maxlen=1000)
        self._id = 0
        self._sending = threading.Lock()
        self._closed = threading.Event()
        try:
            if token is not None:
                self._order("authenticate", token=token)
            _check_protocol(self._order("state").get("protocol"))
        except BaseException:
            self.close()
            raise
        threading.Thread(target=self._beat, name="tilthex-heartbeat", daemon=True).start()

    def __enter__(self) -> Flight:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Ends the connection. A flight that this client has ordered to move holds, and lands later."""
        self._closed.set()
        # A thread that waits for a state returns; the other end may have closed the connection already.
        with contextlib.suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)
        self._lines.close()
        self._socket.close()

    def take_controls(self) -> None:
        """Takes the controls from the client that holds them.

        From then on other clients may only `land` and `kill`.
        """
        self._order("take_controls")

    def take_off(self) -> None:
        """Starts the motors and takes off, as soon as everything is ready."""
        self._order("take_off")

    def go_to(
        self,
        position: ArrayLike,
        rotation: ArrayLike | None = None,
        *,
        duration: float = 0.0,
        velocity: float | None = None,
        angular_velocity: float | None = None,
    ) -> None:
        """Flies the tool to a pose and stays there.

        Args:
            position: Position of the tool tip, (3,), m, world.
            rotation: Rotation of the tool, (3, 3), maps tool to world coordinates; None keeps that of its
                set-point.
            duration: Shortest time of the motion, s; the limits may make it longer.
            velocity: Largest velocity, m/s; None takes the configured one.
            angular_velocity: Largest angular velocity, rad/s; None takes the configured one.
        """
        if rotation is None:
            rotation = self.state()["setpoint"]["rotation"]
        limits = {"velocity": velocity, "angular_velocity": angular_velocity}
        way = {
            "position": _array(position, (3,), "position"),
            "rotation": _array(rotation, (3, 3), "rotation"),
            "duration": duration,
        }
        self.play([way], **{name: value for name, value in limits.items() if value is not None})

    def play(self, waypoints: Sequence[dict[str, Any]], **limits: float) -> None:
        """Flies through way-points.

        Args:
            waypoints: A dict for each way-point with `position` (3,). Optional keys: `rotation` (3, 3)
                (or `quaternion_xyzw`, or `yaw_pitch_roll_deg`), `force` and `torque` (3,) that the tool
                must exert, `duration` and `hold`, s.
            limits: `velocity`, `acceleration`, `angular_velocity`, `angular_acceleration`, SI.
        """
        self._order("play", waypoint=[_plain(way) for way in waypoints], limits=limits)

    def follow(
        self,
        position: ArrayLike,
        rotation: ArrayLike,
        *,
        velocity: ArrayLike = (0.0, 0.0, 0.0),
        angular_velocity: ArrayLike = (0.0, 0.0, 0.0),
        acceleration: ArrayLike = (0.0, 0.0, 0.0),
        angular_acceleration: ArrayLike = (0.0, 0.0, 0.0),
        force: ArrayLike = (0.0, 0.0, 0.0),
        torque: ArrayLike = (0.0, 0.0, 0.0),
    ) -> None:
        """Streams one set-point of the tool (world); the next must come within 0.2 s."""
        self._order(
            "follow",
            position=_array(position, (3,), "position"),
            rotation=_array(rotation, (3, 3), "rotation"),
            velocity=_array(velocity, (3,), "velocity"),
            angular_velocity=_array(angular_velocity, (3,), "angular_velocity"),
            acceleration=_array(acceleration, (3,), "acceleration"),
            angular_acceleration=_array(angular_acceleration, (3,), "angular_acceleration"),
            wrench={"force": _array(force, (3,), "force"), "torque": _array(torque, (3,), "torque")},
        )

    def set_admittance(self, **parameters: ArrayLike) -> None:
        """Changes keys of `[admittance]` between two ticks; the reference does not jump.

        Args:
            **parameters: The keys that docs/configuration.md marks with `set_admittance`, in its units.
                For example `stiffness`: six numbers of a diagonal, or (6, 6).
        """
        numbers = {name: np.asarray(value, float) for name, value in parameters.items()}
        for name, value in numbers.items():
            if not np.isfinite(value).all():
                raise ValueError(f"{name} is {value.tolist()}; expected finite numbers")
        self._order("set_admittance", **{name: value.tolist() for name, value in numbers.items()})

    def set_wrench(
        self,
        force: ArrayLike = (0.0, 0.0, 0.0),
        torque: ArrayLike = (0.0, 0.0, 0.0),
        *,
        force_axes: Sequence[str] = (),
        surface: ArrayLike | None = None,
    ) -> None:
        """Sets the wrench, N and N m, that the tool must exert on the environment (world, at the tool).

        Args:
            force: Force, (3,), N.
            torque: Torque, (3,), N m.
            force_axes: Axes along which the wrench is controlled instead of the pose: x, y, z for force and
                rx, ry, rz for torque. They are axes of the tool.
            surface: (3, 3), maps coordinates of a surface to world coordinates. If it is given, the axes are
                those of the surface.
        """
        order = {"force": _array(force, (3,), "force"), "torque": _array(torque, (3,), "torque")}
        if surface is not None:
            order["surface"] = _array(surface, (3, 3), "surface")
        self._order("set_wrench", **order, force_axes=list(force_axes))

    def release_wrench(self) -> None:
        """Returns to the wrench of the trajectory."""
        self._order("release_wrench")

    def zero_bias(self) -> None:
        """Learns the wrench observer's bias again.

        The tool must be free, and no set-points may be streamed.
        """
        self._order("zero_bias")

    def land(self) -> None:
        """Lands; then `tilthex-rt` ends. Every client may call it, whoever holds the controls."""
        self._order("land")

    def kill(self) -> None:
        """Stops the motors at once.

        A flying vehicle falls, and `tilthex-rt` ends. Every client may call it.
        """
        self._order("kill")

    def configuration(self) -> str:
        """The complete configuration as TOML, with the keys that orders have changed.

        `tilthex.Config.from_text` reads it.
        """
        text: str = self._order("configuration")["configuration"]
        return text

    def state(self) -> State:
        """The newest state: a dict of numbers, texts and arrays. docs/log.md has a table of its keys.

        Raises:
            OrderRefused: The loop has not run a tick yet.
        """
        state = self._order("state")["state"]
        if state is None:
            raise OrderRefused("the loop has not run a tick yet")
        return cast(State, _arrays(state))

    def states(self, rate: float = 50.0) -> Iterator[State]:
        """Yields states, `rate` times a second (0.1 to 100), until the flight or this connection ends.

        Orders may be given between two states.

        Raises:
            ValueError: The rate is not in its range.
        """
        if not rate > 0.0:
            raise ValueError(f"rate is {rate}; expected 0.1 to 100 Hz")
        self._order("stream", rate=rate)
        try:
            while True:
                while self._states:
                    yield self._states.popleft()
                message = self._read(1.0 / rate)
                if message is None:
                    return
                if message.get("state") is not None:
                    yield cast(State, _arrays(message["state"]))
        finally:
            # The flight may have ended already.
            try:
                self._order("stream", rate=0)
                self._states.clear()
            except OSError:
                pass

    def _order(self, command: str, **arguments: Any) -> dict[str, Any]:
        self._id += 1
        self._send({"id": self._id, "command": command, **arguments})
        later = LONGEST_ANSWER if command in PASSED_ON else 0.0
        reason = "the flight has ended"
        while True:
            message = self._read(later)
            if message is None:
                raise ConnectionError(reason)
            if message.get("id") == self._id:
                break
            if message.get("id") is None:
                # An error that is not about one order; the flight may end the connection after it.
                reason = message.get("error", reason)
            if message.get("state") is not None:
                self._states.append(cast(State, _arrays(message["state"])))
        if "error" in message:
            raise OrderRefused(message["error"])
        return message

    def _send(self, request: dict[str, Any]) -> None:
        line = json.dumps(request, allow_nan=False).encode() + b"\n"
        if len(line) > LONGEST_ORDER:
            raise ValueError(
                f"the order {request['command']} has {len(line)} bytes; expected at most {LONGEST_ORDER}"
            )
        with self._sending:
            self._socket.sendall(line)

    def _beat(self) -> None:
        # A message without an id gets no answer. The flight may end before this thread does.
        with contextlib.suppress(OSError):
            while not self._closed.wait(HEARTBEAT):
                if self._present is None or self._present():
                    self._send({"command": "heartbeat"})

    def _read(self, later: float = 0.0) -> dict[str, Any] | None:
        """The next message, None at the end; `later`: time after which it is due, s."""
        try:
            if self._timeout is not None:
                self._socket.settimeout(self._timeout + later)
            line = self._lines.readline()
        except ConnectionResetError:
            return None
        except (OSError, ValueError):
            # Another thread has closed this connection.
            if self._closed.is_set():
                return None
            raise
        # A flight that ends may break off in the middle of a line.
        message: dict[str, Any] | None = json.loads(line) if line.endswith("\n") else None
        return message


def _check_protocol(found: object) -> None:
    """Refuses a flight that speaks another version of the control protocol than this client."""
    if found != PROTOCOL:
        version = "an older version" if found is None else f"version {found}"
        raise ConnectionError(
            f"the flight speaks {version} of the control protocol; expected {PROTOCOL}: "
            "use the tilthex of the flight for its clients"
        )


def _array(value: ArrayLike, shape: tuple[int, ...], name: str) -> list[Any]:
    array = np.asarray(value, float)
    if array.shape != shape or not np.isfinite(array).all():
        raise ValueError(f"{name} has shape {array.shape}; expected finite numbers of shape {shape}")
    plain: list[Any] = array.tolist()
    return plain


def _plain(way: dict[str, Any]) -> dict[str, Any]:
    return {name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in way.items()}


def _arrays(state: dict[str, Any]) -> dict[str, Any]:
    """Replaces lists of numbers by arrays, at any depth."""
    out: dict[str, Any] = {}
    for name, value in state.items():
        if isinstance(value, dict):
            out[name] = _arrays(value)
        elif isinstance(value, list) and name != "faults":
            out[name] = np.array(value, float)
        else:
            out[name] = value
    return out
