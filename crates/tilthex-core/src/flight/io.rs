//! Input and output of a tick.

use super::{Telemetry, record::Record};
use crate::{
    Error,
    admittance::AdmittanceFilter,
    force_axes::ForceAxes,
    trajectory::{Limits, MAX_WAYPOINTS, Trajectory, Waypoint},
    types::{PoseSample, RobotState, RotorVector, Setpoint, Vector3, Wrench},
};

/// Largest number of poses in a tick.
pub const MAX_POSES: usize = 4;

/// Way-points to fly from the present set-point of the tool.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Route {
    waypoints: [Waypoint; MAX_WAYPOINTS],
    count: usize,
    limits: Limits,
}

impl Route {
    /// Checks way-points and limits.
    ///
    /// # Errors
    /// No way-point, or what [`Trajectory::new`] refuses.
    pub fn new(waypoints: &[Waypoint], limits: &Limits) -> Result<Self, Error> {
        let Some(first) = waypoints.first() else {
            return Err(Error::Count { name: "way-points", found: 0, min: 1, max: MAX_WAYPOINTS });
        };
        Trajectory::new(*first, waypoints, limits)?;
        let mut padded = [*first; MAX_WAYPOINTS];
        padded[..waypoints.len()].copy_from_slice(waypoints);
        Ok(Self { waypoints: padded, count: waypoints.len(), limits: *limits })
    }

    /// The way-points of a trajectory, beginning with its start; `limits` may make it slower.
    ///
    /// # Errors
    /// More way-points than [`MAX_WAYPOINTS`], or limits that [`Trajectory::new`] refuses.
    pub fn of(trajectory: &Trajectory, limits: &Limits) -> Result<Self, Error> {
        let mut points = [*trajectory.start(); MAX_WAYPOINTS];
        let mut count = 1;
        for waypoint in trajectory.waypoints() {
            let Some(slot) = points.get_mut(count) else {
                let found = count + 1;
                return Err(Error::Count { name: "way-points", found, min: 1, max: MAX_WAYPOINTS });
            };
            *slot = waypoint;
            count += 1;
        }
        Self::new(points.get(..count).unwrap_or(&[]), limits)
    }

    /// The way-points.
    #[must_use]
    pub fn waypoints(&self) -> &[Waypoint] {
        self.waypoints.get(..self.count).unwrap_or(&[])
    }

    /// The limits between way-points.
    #[must_use]
    pub fn limits(&self) -> &Limits {
        &self.limits
    }
}

/// An order to a running flight, already validated. The orders to land and to kill are not among them: they are
/// [`HostFacts`], which are read in every tick and wait behind no other order.
#[derive(Clone, Copy, Debug, PartialEq)]
#[allow(clippy::large_enum_variant)] // kept in pre-sized rings; a box would allocate
pub enum Command {
    /// Start the motors and take off.
    TakeOff,
    /// Fly a route from the present set-point.
    Play(Route),
    /// Follow streamed set-points; they are stale after `SETPOINT_STALE`.
    Follow(Setpoint),
    /// Use other admittance parameters from now on; the reference does not jump.
    SetAdmittance(AdmittanceFilter),
    /// The wrench that the tool shall exert, instead of the trajectory's (world, at the tip), and the axes along which it
    /// is controlled instead of the pose.
    SetWrench(Wrench, ForceAxes),
    /// Return to the wrench of the trajectory.
    ReleaseWrench,
    /// Learn the observer's bias from a contact-free hover, from now on for the configured time.
    ZeroBias,
}

/// Facts that only the host can observe.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct HostFacts {
    /// A signal, an order or the end of the duration asks to land.
    pub land: bool,
    /// The operator's order to stop the motors at once.
    pub kill: bool,
    /// The operator whose orders are flown has been silent for longer than allowed.
    pub operator_silent: bool,
    /// The port is gone.
    pub link_lost: bool,
    /// The log cannot be written.
    pub log_lost: bool,
}

/// Everything that a tick may depend on. The same inputs give the same outputs, bit for bit.
#[derive(Clone, Copy, Debug)]
pub struct Measured<'a> {
    /// Now, s, monotonic.
    pub time: f64,
    /// The telemetry of the vehicle.
    pub telemetry: &'a Telemetry,
    /// Poses that have arrived since the last tick, at most [`MAX_POSES`].
    pub poses: &'a [PoseSample],
    /// An order.
    pub command: Option<&'a Command>,
    /// Facts that only the host can observe.
    pub host: HostFacts,
    /// The state, if it is known without the estimator, as in a simulation without an estimator.
    pub known: Option<KnownState>,
}

/// A state that needs no estimator.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KnownState {
    /// Pose and twist of the robot.
    pub robot: RobotState,
    /// Specific force at the centre of mass, m/s^2, robot.
    pub specific_force_r: Vector3,
}

/// The command to the motors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MotorCommand {
    /// Every motor shall stand still: the flight has not begun, or it is over.
    Stop,
    /// Every motor shall stop at once, by order, whoever turns it.
    Kill,
    /// This motor alone, from 0, shall start and turn at its speed of these, Hz; all other motors shall stand still.
    Alone(usize, RotorVector),
    /// Motors that do not spin shall start; those that do shall turn at these speeds, Hz.
    Start(RotorVector),
    /// Motors that spin shall turn at these speeds, Hz. No motor starts or stops.
    Turn(RotorVector),
}

/// The output of a tick: the command to the motors, and a record of the tick.
#[derive(Clone, Copy, Debug)]
pub struct Commanded {
    /// The command to the motors, for the link.
    pub motors: MotorCommand,
    /// The record of the tick, for the log.
    pub record: Record,
}

impl Default for Commanded {
    fn default() -> Self {
        Self { motors: MotorCommand::Stop, record: Record::default() }
    }
}
