"""Control of fully actuated multirotors as flying end-effectors.

Arrays are float64 and SI; rotor speeds are in Hz. Rotations are 3x3 matrices `R_WR` that map robot
coordinates to world coordinates. External wrenches are exerted by the environment on the robot. "(n)" in
a docstring is an equation of Ryll et al., "6D interaction control with aerial robots: the flying
end-effector paradigm", IJRR 38(9), 2019.
"""

from tilthex import so3
from tilthex._core import (
    GRAVITY,
    AdmittanceFilter,
    Allocation,
    Allocator,
    Config,
    Controller,
    Drawn,
    Effects,
    Loop,
    LoopModel,
    Output,
    Plant,
    PoseClient,
    PoseCommand,
    PoseController,
    Reference,
    SensorErrors,
    Setpoint,
    Trajectory,
    Truth,
    Ukf,
    UkfRun,
    Vehicle,
    VehicleLink,
    WrenchObserver,
    __version__,
    calibration_flight,
)
from tilthex.client import Flight, OrderRefused, connect
from tilthex.simulation import FaultChange, Run, Runs, simulate, simulate_many
from tilthex.stability import Margins, margins

__all__ = [
    "GRAVITY",
    "AdmittanceFilter",
    "Allocation",
    "Allocator",
    "Config",
    "Controller",
    "Drawn",
    "Effects",
    "FaultChange",
    "Flight",
    "Loop",
    "LoopModel",
    "Margins",
    "OrderRefused",
    "Output",
    "Plant",
    "PoseClient",
    "PoseCommand",
    "PoseController",
    "Reference",
    "Run",
    "Runs",
    "SensorErrors",
    "Setpoint",
    "Trajectory",
    "Truth",
    "Ukf",
    "UkfRun",
    "Vehicle",
    "VehicleLink",
    "WrenchObserver",
    "__version__",
    "calibration_flight",
    "connect",
    "margins",
    "simulate",
    "simulate_many",
    "so3",
]
