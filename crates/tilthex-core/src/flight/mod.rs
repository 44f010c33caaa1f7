//! The complete tick, from the measurements to the command to the motors:
//! estimator, supervisor, guidance, controller. It knows no link and no bytes.
//!
//! It depends only on its inputs. The real-time loop, the fault campaign on virtual time and the replay of a log run
//! this same code, and get the same result bit for bit.

mod actuation;
mod airborne;
mod bounds;
mod capture;
mod capture_clock;
mod descent;
mod fence;
mod forced_descent;
mod guidance;
mod gyro_doubt;
mod gyro_leaps;
mod imu_model;
mod io;
mod landing;
mod late;
mod lift_off;
mod model;
mod motor_check;
mod orders;
mod own_poses;
mod probation;
mod record;
mod rest;
mod returning;
mod room;
mod rotors;
mod sensing;
mod stopped;
mod telemetry;
mod thrust;
mod watch;
mod witness;

pub use airborne::AirborneStart;
pub use fence::{Fence, robot_position};
pub use guidance::GuidanceParams;
pub use io::{Command, Commanded, HostFacts, KnownState, MAX_POSES, Measured, MotorCommand, Route};
pub use model::ModelRecord;
pub use motor_check::MotorFault;
pub use record::{InputRecord, LinkCounters, Record};
pub use telemetry::{Inertial, InertialTelemetry, LinkState, MAX_SAMPLES, Motor, Telemetry};
pub use watch::WatchParams;

use crate::{
    Error, Vehicle,
    admittance::AdmittanceState,
    controller::{Controller, ControllerOutput, ControllerParams, ControllerState},
    error::check_range,
    estimator::{Estimator, EstimatorParams, StartError},
    model_learning::ModelPrior,
    plant::LARGEST_ROTOR_SPEED_AGE,
    supervisor::{Facts, Fault, Phase, Supervisor, limits::LINE_LATE},
    types::{RotorVector, Vector3, Wrench},
};
use bounds::Bounds;
use capture::CaptureWatch;
use capture_clock::CaptureClock;
use guidance::Guidance;
use imu_model::ImuModel;
use landing::{FREE, Landing, Lift};
use late::Pending;
use lift_off::LiftOff;
use model::ModelState;
use motor_check::MotorCheck;
use own_poses::OwnPoses;
use returning::Returning;
use rotors::RotorModel;
use stopped::StoppedWatch;
use thrust::ThrustWatch;
use watch::Watch;

/// A time before every other time, s.
const LONG_AGO: f64 = -1e9;

/// The parts of a flight's configuration.
#[derive(Clone, Copy, Debug)]
pub struct FlightParams {
    /// The vehicle.
    pub vehicle: Vehicle,
    /// The control laws.
    pub controller: ControllerParams,
    /// The state estimator.
    pub estimator: EstimatorParams,
    /// Take-off, bias hover, landing.
    pub guidance: GuidanceParams,
    /// Standard deviations of the vehicle's errors, before a calibration flight corrects them.
    pub model_prior: ModelPrior,
    /// Whether hovers of the mission go on correcting the model after a calibration.
    pub slow_learning: bool,
    /// Limits; crossing one is a fault.
    pub watch: WatchParams,
    /// Take off as soon as everything is ready, without an order.
    pub take_off: bool,
    /// How much older a measured rotor speed is than an inertial sample that arrives with it, s. Above 0 the model of
    /// the rotors brings the speeds to the sample's time, including the wait for the next measurement.
    pub rotor_speed_age: f64,
}

/// Longer periods are shortened to this for the integrators of the laws, s.
const LONGEST_STEP: f64 = 0.1;

/// A flight, from the first tick to the motors' stop. `tilthex-config` makes its parameters from a configuration.
///
/// ```
/// use tilthex_core::flight::{Commanded, Flight, HostFacts, Measured, MotorCommand, Telemetry};
///
/// /// One period: from the telemetry at a time, s, to the command to the motors.
/// fn fly(flight: &mut Flight, telemetry: &Telemetry, time: f64) -> MotorCommand {
///     let host = HostFacts::default();
///     let measured = Measured { time, telemetry, poses: &[], command: None, host, known: None };
///     let mut out = Commanded::default();
///     flight.tick(&measured, &mut out);
///     out.motors
/// }
/// ```
#[derive(Clone, Debug)]
pub struct Flight {
    params: FlightParams,
    controller: Controller,
    /// The commands that have not arrived yet.
    pending: Pending,
    control: ControllerState,
    estimator: Estimator,
    /// The known state, which replaces that of the estimator.
    known: Option<KnownState>,
    /// The state that the laws use: the known one, or the estimator's.
    state: KnownState,
    /// Whether the caller says that this is a contact-free hover to learn from.
    learns: bool,
    /// Whether the caller says that this is a contact-free flight to learn the model from.
    learns_model: bool,
    model: ModelState,
    start_refused: Option<StartError>,
    guidance: Guidance,
    route: Option<Route>,
    watch: Watch,
    supervisor: Supervisor,
    rotor_model: RotorModel,
    imu_model: ImuModel,
    returning: Returning,
    min_speeds: RotorVector,
    max_speeds: RotorVector,
    command: RotorVector,
    output: Option<ControllerOutput>,
    take_off: bool,
    setpoint_refused: bool,
    /// The order to learn the bias was refused: the vehicle is in contact or moves.
    bias_refused: bool,
    /// A queued route was refused at the end of the last tick.
    route_refused: bool,
    not_finite: bool,
    time: Option<f64>,
    tick: u64,
    ramp: f64,
    motor_check: MotorCheck,
    landing: Landing,
    /// Smallest and largest upward force of the rotors while the reference does not yield.
    lift: Lift,
    bounds: Bounds,
    capture: CaptureWatch,
    capture_clock: CaptureClock,
    own_poses: OwnPoses,
    lift_off: LiftOff,
    thrust: ThrustWatch,
    stopped: StoppedWatch,
    /// The speeds that the model of the rotors expected in the last tick, Hz, and the external wrench that was observed.
    thrust_seen: (RotorVector, Wrench),
    /// Rotors without thrust, and all lost rotors, one bit each; and whether the vehicle cannot hover without them.
    without_thrust: u16,
    lost: u16,
    adrift: bool,
}

impl Flight {
    /// A flight that has not begun; `route` is flown after take-off, then the vehicle hovers.
    ///
    /// # Errors
    /// The first parameter that a block refuses.
    pub fn new(params: FlightParams, route: Option<Route>) -> Result<Self, Error> {
        let vehicle = params.vehicle;
        let (min_speeds, max_speeds) = vehicle.speed_limits();
        check_range("rotor_speed_age", params.rotor_speed_age, 0.0, LARGEST_ROTOR_SPEED_AGE)?;
        let controller = Controller::new(vehicle, params.controller)?;
        let estimator = Estimator::new(params.estimator)?;
        Ok(Self {
            controller,
            pending: Pending::default(),
            control: ControllerState::default(),
            known: None,
            state: sensing::state_of(&estimator),
            estimator,
            learns: false,
            learns_model: false,
            model: ModelState::new(&vehicle, &params.model_prior),
            start_refused: None,
            guidance: Guidance::new(params.guidance),
            route,
            watch: Watch::new(params.watch),
            supervisor: Supervisor::default(),
            rotor_model: RotorModel::new(&vehicle, params.rotor_speed_age),
            imu_model: ImuModel::default(),
            returning: Returning::default(),
            min_speeds,
            max_speeds,
            command: RotorVector::zeros(),
            output: None,
            take_off: params.take_off,
            setpoint_refused: false,
            bias_refused: false,
            route_refused: false,
            not_finite: false,
            time: None,
            tick: 0,
            ramp: 0.0,
            motor_check: MotorCheck::default(),
            landing: Landing::default(),
            lift: FREE,
            bounds: Bounds::default(),
            capture: CaptureWatch::default(),
            capture_clock: CaptureClock::default(),
            own_poses: OwnPoses::default(),
            lift_off: LiftOff::default(),
            thrust: ThrustWatch::new(&vehicle),
            stopped: StoppedWatch::default(),
            thrust_seen: (RotorVector::zeros(), Wrench::ZERO),
            without_thrust: 0,
            lost: 0,
            adrift: false,
            params,
        })
    }

    /// The supervisor: phase and faults.
    #[must_use]
    pub fn supervisor(&self) -> &Supervisor {
        &self.supervisor
    }

    /// Why the estimator has not started yet.
    #[must_use]
    pub fn start_refused(&self) -> Option<StartError> {
        self.start_refused
    }

    /// The fault that the check of each motor alone has found.
    #[must_use]
    pub fn motor_fault(&self) -> Option<MotorFault> {
        self.motor_check.fault()
    }

    /// The state estimator.
    #[must_use]
    pub fn estimator(&self) -> &Estimator {
        &self.estimator
    }

    /// Whether the route has been flown, or the first hover if there is no route.
    #[must_use]
    pub fn mission_done(&self) -> bool {
        self.route.is_none() && self.guidance.ready() && self.guidance.mission_done()
    }

    /// Whether take-off and bias hover are over: the mission's time runs.
    #[must_use]
    pub fn on_mission(&self) -> bool {
        self.guidance.ready()
    }

    /// One tick: estimates, supervises, controls, and returns the command to the motors.
    pub fn tick(&mut self, input: &Measured<'_>, out: &mut Commanded) {
        self.change_model();
        let now = input.time;
        let period = self.time.replace(now).map_or(0.0, |last| (now - last).max(0.0));
        let dt = period.min(LONGEST_STEP);
        self.rotor_model.set_garbled(self.supervisor.active().contains(Fault::LinkGarbage));
        self.rotor_model.step(&self.command, !input.host.link_lost, period);
        let sampled = input.telemetry.inertial.samples().last().map_or(now, |s| s.time.min(now));
        let mut rotor_speeds = self.rotor_model.speeds(input.telemetry.motors(), now, sampled);
        if self.stops_unseen() {
            rotor_speeds = self.rotor_model.turning(input.telemetry.motors(), &rotor_speeds);
        }
        let before = self.robot_state();
        self.estimate(input, &rotor_speeds, dt);
        self.absorb_jump(&before, dt);
        self.obey(input.command);
        self.supervise(input, &rotor_speeds, period, dt);
        self.control(&rotor_speeds, input.telemetry.inertial.line_delay, dt);
        out.motors = self.motor_command();
        self.record(input, period, &rotor_speeds, &mut out.record);
        self.tick += 1;
    }

    /// Whether nothing would show that a rotor stops: a model replaces the IMU of a vehicle whose rotors turned until then.
    fn stops_unseen(&self) -> bool {
        self.estimator.is_modelled() && !self.supervisor.active().contains(Fault::MotorNotSpinning)
    }

    fn supervise(&mut self, input: &Measured<'_>, rotor_speeds: &RotorVector, period: f64, dt: f64) {
        let before = self.supervisor.phase();
        let motors = input.telemetry.motors();
        let own = motors.iter().enumerate().fold(0, |set, (i, m)| set | u16::from(m.emergency) << i);
        let unlike = self.rotor_model.unlike(motors, input.time);
        let still = unlike.stopped;
        let (speeds, external) = &self.thrust_seen;
        let lifting = (!self.stops_unseen()).then(|| {
            if still == 0 { 0 } else { self.thrust.lifting(&self.params.vehicle, speeds, external) }
        });
        let stopped = self.stopped.step(still, own, lifting, dt);
        self.rotor_model.set_doubted(self.stopped.doubted());
        let wrong_speeds = self.rotor_model.wrong_speeds(unlike.wrong);
        let wrong = self.supervisor.active().contains(Fault::MotorWrongSpeed);
        let late = input.telemetry.inertial.line_delay > LINE_LATE;
        let learns = wrong && stopped == 0 && !late;
        self.rotor_model.adapt(motors, input.time, learns.then_some(wrong_speeds), dt);
        let mut conditions = self.watch.conditions(
            &watch::Seen {
                now: input.time,
                period,
                phase: before,
                telemetry: input.telemetry,
                imu_age: self.returning.age(&input.telemetry.inertial, input.time),
                estimator: &self.estimator,
                known: self.known.is_some(),
                robot: &self.robot_state(),
                tool_r: self.params.vehicle.tool().position_r,
                output: self.output.as_ref(),
                emergency: own != 0,
                stopped,
                wrong_speeds,
                host: input.host,
            },
            dt,
        );
        conditions.insert_if(Fault::ImuSaturated, self.returning.refuses());
        conditions.insert_if(Fault::Operator, input.host.land);
        conditions.insert_if(Fault::OperatorGone, input.host.operator_silent);
        conditions.insert_if(Fault::OperatorGoneForGood, input.host.operator_silent);
        let refused = core::mem::take(&mut self.route_refused) || self.setpoint_refused;
        conditions.insert_if(Fault::SetpointJump, refused);
        conditions.insert_if(Fault::SetpointStale, self.guidance.stale());
        conditions.insert_if(Fault::BiasRefused, core::mem::take(&mut self.bias_refused));
        conditions.insert_if(Fault::NotFinite, self.not_finite);
        conditions.insert_if(Fault::MotorDataWrong, self.stopped.doubted() != 0);
        conditions.insert_if(Fault::ThrustLost, self.without_thrust != 0);
        conditions.insert_if(Fault::RotorLost, self.adrift);
        conditions.insert_if(Fault::CalibrationRefused, self.model.is_refused());
        let strays = self.watch_bounds(before, &mut conditions, dt);
        let checked = self.check_motors(before, input, dt);
        conditions.insert_if(Fault::MotorCheck, self.motor_check.fault().is_some());
        let contradiction = self.watch_capture(before, &mut conditions, dt);
        let abort = self.watch_lift_off(before, contradiction.as_ref(), &mut conditions, dt);
        // If the operator is silent before the start, the order to take off is dropped: it must not wait for the next
        // operator.
        self.take_off &= !(input.host.operator_silent && before == Phase::Disarmed);
        let facts = Facts {
            link_ready: input.telemetry.link.ready,
            estimate_ready: self.estimator.is_initialized() || self.known.is_some(),
            all_spinning: checked && input.telemetry.all_spinning(),
            ramp_done: self.ramp >= actuation::RAMP,
            touchdown: self.descend(input, rotor_speeds, dt),
            take_off: self.take_off && !strays,
            kill: input.host.kill,
            abort,
        };
        let tracked = !self.supervisor.active().contains(Fault::TrackingError);
        let phase = self.supervisor.step(conditions, &facts, dt);
        self.lose_rotors(stopped);
        if phase != before {
            self.change(before, phase);
        } else if phase == Phase::Landing
            && tracked
            && self.supervisor.active().contains(Fault::TrackingError)
        {
            // The vehicle does not fly back to a reference that it could not follow.
            self.land_from(&self.actual_tool(), &Vector3::zeros());
        }
        let waiting = self.guidance.ready() && phase == Phase::Flying;
        if let Some(route) = self.route.take_if(|_| waiting) {
            self.route_refused = !(self.keeps(&route) && self.guidance.play(&route));
        }
    }

    /// Begins what belongs to a new phase.
    fn change(&mut self, before: Phase, phase: Phase) {
        match phase {
            Phase::Starting => self.motor_check = MotorCheck::default(),
            Phase::Grounded => self.ramp = 0.0,
            Phase::Flying if before == Phase::Grounded => {
                self.control = ControllerState::default();
                let robot = self.robot_state();
                self.bounds.begin(&robot.position_w, true);
                self.capture.take_off(&self.estimator.navigation());
                self.lift_off.begin();
                self.guidance.begin_take_off(&robot, self.params.vehicle.tool());
            }
            Phase::Landing => self.begin_landing(before),
            Phase::Emergency => self.control.admittance = AdmittanceState::default(),
            Phase::Disarmed => {
                self.take_off = self.take_off && !self.supervisor.landed();
                self.output = None;
            }
            Phase::Flying | Phase::Holding => {}
        }
    }
}
