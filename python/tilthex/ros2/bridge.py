"""The node between a running flight and ROS 2."""

from __future__ import annotations

import threading
from typing import Any

from rclpy.task import Future

from tilthex._core import Config
from tilthex.client import Flight
from tilthex.ros2 import parameters
from tilthex.ros2.groups import timer
from tilthex.ros2.inputs import Inputs
from tilthex.ros2.outputs import Outputs
from tilthex.ros2.parameters import Parameter

REFRESH = 1.0
"""Time between two reads of the configuration, s: other clients can change it too."""
GRACE = 3.0
"""Longest time from the end of the orders to that of the states, if the flight has ended, s."""


class Bridge:
    """A flight as the node's topics, services and parameters.

    Args:
        node: The node. Its executor executes the orders that it receives.
        pilot: A connection for orders.
        watcher: Another connection, for states.
        brake: Another connection, for kill and land, which wait for no other order.
        rate: States per second, 0.1 to 100 Hz.
    """

    def __init__(self, node: Any, pilot: Flight, watcher: Flight, brake: Flight, rate: float) -> None:
        self.ended: Any = Future()
        """Done when the flight has ended; holds an exception if the connection broke."""
        self._node, self._pilot, self._watcher, self._rate = node, pilot, watcher, rate
        self._states = 0
        text = pilot.configuration()
        self._text = text
        self._parameters = parameters.parameters(text)
        self._declare()
        self._outputs = Outputs(node, Config.from_text(text).vehicle)
        self._lost: Any = None
        self._inputs = Inputs(node, pilot, brake, self._lose)
        timer(node, REFRESH, self._look)
        threading.Thread(target=self._watch, name="tilthex-states", daemon=True).start()

    def counts(self) -> dict[str, int]:
        """Counters of the bridge, for the diagnostics."""
        return {
            "states published": self._states,
            "set-points taken": self._inputs.setpoints,
            "messages refused": self._inputs.refused,
        }

    def _watch(self) -> None:
        """Publishes states until the flight ends."""
        try:
            for state in self._watcher.states(self._rate):
                self._states += 1
                self._outputs.publish(state, self.counts())
            self._outputs.finish()
            if not self.ended.done():
                self.ended.set_result(None)
        # After any error the bridge must end: without states it must not stay the operator.
        except Exception as error:
            self._fail(error)

    def _fail(self, error: Exception) -> None:
        if not self.ended.done():
            self.ended.set_exception(error)

    def _lose(self, error: OSError) -> None:
        """Reacts to the end of the connection for orders: the bridge is no longer the operator.

        If the flight has ended, the states end too within `GRACE`, and this is not an error.
        """
        self._pilot.close()
        if self._lost is None:
            self._lost = timer(self._node, GRACE, lambda: self._fail(error))

    def _look(self) -> None:
        try:
            self._refresh()
        except OSError as error:
            self._lose(error)

    def _declare(self) -> None:
        """Declares every key as a parameter.

        Raises:
            ValueError: The node was started with another value of a key that no order changes.
        """
        from rcl_interfaces.msg import ParameterDescriptor

        wanted = {}
        for name, key in self._parameters.items():
            # A number may be given as an integer. The flight checks the values.
            described = ParameterDescriptor(
                description=key.meaning, read_only=not key.live, dynamic_typing=key.live
            )
            value = self._node.declare_parameter(name, key.value, described).value
            if parameters.same(value, key.value):
                continue
            if not key.live:
                raise ValueError(
                    f"the parameter {name} is {value}, but {key.value} in the flight's configuration, and no"
                    " order changes it; start tilthex-rt with a configuration that has it"
                )
            wanted[name] = value
        if wanted:
            self._pilot.set_admittance(**parameters.admittance(wanted))
            self._take(wanted)
        self._node.add_on_set_parameters_callback(self._set)

    def _set(self, changed: list[Any]) -> Any:
        """Sends all changed keys in one order."""
        from rcl_interfaces.msg import SetParametersResult

        wanted = {
            parameter.name: parameter.value
            for parameter in changed
            if (key := self._parameters.get(parameter.name))
            and not parameters.same(parameter.value, key.value)
        }
        try:
            if wanted:
                self._pilot.set_admittance(**parameters.admittance(wanted))
        except (ValueError, TypeError) as error:
            return SetParametersResult(successful=False, reason=str(error))
        except OSError as error:
            self._lose(error)
            return SetParametersResult(successful=False, reason=f"the flight has ended ({error})")
        self._take(wanted)
        return SetParametersResult(successful=True)

    def _take(self, values: dict[str, Any]) -> None:
        for name, value in values.items():
            old = self._parameters[name]
            self._parameters[name] = Parameter(name, value, old.meaning, old.live)

    def _refresh(self) -> None:
        """Updates the parameters that other clients have changed."""
        from rclpy.parameter import Parameter as RosParameter

        text = self._pilot.configuration()
        if text == self._text:
            return
        self._text = text
        found = parameters.parameters(text)
        changed = [
            RosParameter(name, value=key.value)
            for name, key in found.items()
            if key.live and not parameters.same(key.value, self._parameters[name].value)
        ]
        self._parameters = found
        self._node.set_parameters(changed)
