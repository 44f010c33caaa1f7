"""The faults that the supervisor knows, and its reactions; docs/faults.md has the same as a table.

Written by `TILTHEX_WRITE_DOCS=1 cargo test --workspace --test faults_document`; do not change it by hand.
"""
# ruff: noqa: E501

from __future__ import annotations

from typing import NamedTuple


class Fault(NamedTuple):
    """A row of the table."""

    name: str
    on_ground: str
    """Reaction before take-off: note or refuse."""
    in_flight: str
    """Reaction in flight: note, hold, land or descend."""
    remark: str
    """What replaces a missing value, and how to remove the cause; may be empty."""


FAULTS = (
    Fault(
        "IMU late",
        "note",
        "note",
        "the model predicts until the next sample",
    ),
    Fault(
        "IMU silent",
        "refuse",
        "land",
        "the model replaces the IMU; the stream is requested again every 500 ms",
    ),
    Fault(
        "IMU frozen",
        "refuse",
        "land",
        "the model replaces the IMU",
    ),
    Fault(
        "IMU saturated",
        "refuse",
        "land",
        "the model replaces the sample; a short shock is not a fault",
    ),
    Fault(
        "IMU out of range",
        "note",
        "note",
        "the sample is dropped; if many are dropped, the IMU counts as silent",
    ),
    Fault(
        "motor data stale",
        "note",
        "note",
        "from 30 ms on, the lagged command replaces the measured speed",
    ),
    Fault(
        "motor data silent",
        "refuse",
        "land",
        "the lagged command replaces the measured speed; the stream is requested again every 500 ms",
    ),
    Fault(
        "motor emergency",
        "refuse",
        "land",
        "the motor counts as lost",
    ),
    Fault(
        "motor not spinning",
        "refuse",
        "land",
        "the motor counts as lost",
    ),
    Fault(
        "motor at a wrong speed",
        "refuse",
        "land",
        "its command is increased by the missing speed; the lagged command replaces a speed that the rotor cannot have reached since the one before",
    ),
    Fault(
        "command not followed",
        "refuse",
        "land",
        "if commands do not reach the vehicle, its own watchdog takes the rotors to their lowest speed",
    ),
    Fault(
        "thrust lost",
        "refuse",
        "land",
        "the motor counts as lost, because its propeller is lost; a wrench that stays is a push",
    ),
    Fault(
        "rotor lost",
        "refuse",
        "descend",
        "yaw is given up; the vehicle descends at 1 m/s, before its spin becomes too fast; if it topples or spins beyond the gyro's range, its rotors turn at their lowest speeds",
    ),
    Fault(
        "battery low",
        "refuse",
        "land",
        "change the battery",
    ),
    Fault(
        "battery critical",
        "refuse",
        "land",
        "change the battery",
    ),
    Fault(
        "pose late",
        "note",
        "note",
        "the estimator goes on with the IMU",
    ),
    Fault(
        "pose lost",
        "refuse",
        "hold",
        "the estimator goes on with the IMU",
    ),
    Fault(
        "pose lost for long",
        "refuse",
        "land",
        "lands with IMU and model, and with poses if they return; without poses the descent becomes faster by 0.5 m/s in a second, at most by 1.5 m/s",
    ),
    Fault(
        "pose lost for good",
        "refuse",
        "descend",
        "horizontal position is given up",
    ),
    Fault(
        "pose jumping",
        "refuse",
        "hold",
        "refused poses do not count as poses; if they accelerate as the vehicle does, the state is taken from them",
    ),
    Fault(
        "estimate inconsistent",
        "refuse",
        "land",
        "check the noise and the mounting in the configuration",
    ),
    Fault(
        "estimate uncertain",
        "refuse",
        "descend",
        "horizontal position is given up",
    ),
    Fault(
        "tracking error",
        "note",
        "land",
        "a landing continues from the present pose; check mass, thrust coefficients and limits",
    ),
    Fault(
        "tilt",
        "refuse",
        "land",
        "if the IMU is silent and no pose shows the attitude, or the rotors are at their limits, the rotors turn at their lowest speeds, because thrust would carry the vehicle away",
    ),
    Fault(
        "speed",
        "refuse",
        "land",
        "",
    ),
    Fault(
        "excursion",
        "note",
        "hold",
        "the tool is held back or pushed too far",
    ),
    Fault(
        "external wrench",
        "note",
        "hold",
        "",
    ),
    Fault(
        "set-point stale",
        "note",
        "hold",
        "the last one is held",
    ),
    Fault(
        "set-point refused",
        "note",
        "hold",
        "the last good one is held",
    ),
    Fault(
        "set-point infeasible",
        "note",
        "hold",
        "slow the trajectory or tilt less",
    ),
    Fault(
        "loop overrun",
        "note",
        "note",
        "the loop skips whole periods; the control laws use the measured time",
    ),
    Fault(
        "long loop overrun",
        "note",
        "hold",
        "after 500 ms without a command, the vehicle's own watchdog takes the rotors to their lowest speed",
    ),
    Fault(
        "link garbage",
        "refuse",
        "hold",
        "the model replaces the motors' data; check cable, adapter and speed of the line",
    ),
    Fault(
        "reboot",
        "refuse",
        "land",
        "the streams are requested and the motors started again",
    ),
    Fault(
        "link lost",
        "refuse",
        "descend",
        "nothing reaches the vehicle; after 500 ms its own watchdog takes the rotors to their lowest speed, and stops them 10 s later",
    ),
    Fault(
        "log lost",
        "note",
        "note",
        "the flight goes on without a log",
    ),
    Fault(
        "not finite",
        "refuse",
        "land",
        "the last good command is sent again",
    ),
    Fault(
        "start timeout",
        "refuse",
        "note",
        "see the vehicle's own messages",
    ),
    Fault(
        "operator",
        "refuse",
        "land",
        "",
    ),
    Fault(
        "calibration refused",
        "note",
        "note",
        "the configured model is kept; the mean wrench of the next hover is the bias",
    ),
    Fault(
        "operator silent",
        "refuse",
        "hold",
        "a line on the control socket from the client that holds the controls ends it",
    ),
    Fault(
        "operator gone",
        "refuse",
        "land",
        "the vehicle does not wait for an operator who is gone",
    ),
    Fault(
        "geofence",
        "refuse",
        "land",
        "plan the mission inside it, or widen it",
    ),
    Fault(
        "landing fails",
        "note",
        "descend",
        "descends at 0.7 m/s at its present place, with less and less thrust while it does not sink",
    ),
    Fault(
        "bias not learnt",
        "note",
        "note",
        "the bias stays as it was; free the tool, let it rest, and order zero_bias",
    ),
    Fault(
        "line late",
        "refuse",
        "land",
        "slower control, which tolerates the delay; check the adapter, its driver and the load of the machine",
    ),
    Fault(
        "motor data wrong",
        "refuse",
        "land",
        "the lagged command replaces the measured speed; check the motor's telemetry",
    ),
    Fault(
        "pose frozen",
        "refuse",
        "hold",
        "it does not count as a pose; check that the body is tracked",
    ),
    Fault(
        "pose contradicts the IMU",
        "refuse",
        "land",
        "poses are not used until they accelerate as the vehicle does; lands with IMU and model; check that the tracked body is the vehicle's, and the latency of its poses",
    ),
    Fault(
        "motor order",
        "refuse",
        "land",
        "up to 0.3 m above the ground its motors are stopped; check number, spin direction and propeller of each motor",
    ),
    Fault(
        "capture axes",
        "refuse",
        "land",
        "up to 0.3 m above the ground its motors are stopped; above it the yaw that was found is taken out of the poses; check the up axis of motion capture, that its axes are right-handed, and the yaw at which the body is defined",
    ),
    Fault(
        "lift-off",
        "refuse",
        "land",
        "up to 0.3 m above the ground its motors are stopped; check mass, thrust coefficients and what holds the vehicle",
    ),
    Fault(
        "motor check",
        "refuse",
        "note",
        "no motor is started; the message names the motor",
    ),
    Fault(
        "capture mirrored",
        "refuse",
        "land",
        "up to 0.3 m above the ground its motors are stopped; check that motion capture streams right-handed axes",
    ),
    Fault(
        "capture late",
        "refuse",
        "land",
        "up to 0.3 m above the ground its motors are stopped; above it the delay that was found is subtracted from the times of the poses; set the `[estimator] latency` that tilthex calibrate finds",
    ),
    Fault(
        "capture clock",
        "note",
        "note",
        "until the delay is the usual one again, the capture time of a pose is its arrival minus the usual delay",
    ),
    Fault(
        "tool astray",
        "note",
        "hold",
        "the attitude yields or something holds the tool; the mission waits until the tool is back",
    ),
)
"""All faults; the number of a fault, its bit in a log, is its place."""
