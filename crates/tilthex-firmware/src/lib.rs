//! tilthex on the vehicle: one tick reads a board, flies, drives the rotors, and speaks with a base computer.
//!
//! The board is a trait, [`Board`]; nothing here knows a processor. The base forwards the poses of motion capture, gives
//! orders and shows what the vehicle tells: `tilthex-rt console`. The vehicle flies by itself: if the base is silent, or the
//! poses end, it does what `docs/faults.md` says. `docs/howto/firmware.md` says how to put it onto a board.
//!
//! `no_std`, no allocation, no unsafe.
#![no_std]
#![forbid(unsafe_code)]

mod board;
pub mod example;
mod inbox;
mod outbox;
mod sensing;

pub use board::{Board, Drive, ImuReading, RotorReading};

use inbox::{Inbox, Refused};
use outbox::Outbox;
use sensing::Sensors;
use tilthex_core::{
    Error, Wrench,
    admittance::AdmittanceFilter,
    flight::{Command, Commanded, Flight, FlightParams, HostFacts, Measured, MotorCommand, Route, Telemetry},
    force_axes::ForceAxes,
    order_bounds::OrderBounds,
    supervisor::Phase,
    trajectory::Waypoint,
    types::{Matrix6, RotorVector, Vector6},
};
use tilthex_link::{
    Severity,
    onboard::{Answer, Facts, GoTo, Order, Part, REFUSED},
};

/// The motors must stand still for this time after a flight before the board restarts, s: the base reads how it ended.
const STANDS: f64 = 1.0;

/// Time between two texts about messages that are not carried out, s: a program that sends many must not fill the line.
const QUIET: f64 = 0.5;

/// Numbers that differ by less than this part are equal: messages carry rounded ones.
const ROUNDED: f64 = 1e-6;

/// Parameters of the firmware.
#[derive(Clone, Copy, Debug)]
pub struct FirmwareParams {
    /// The flight. It takes off only by order, whatever `take_off` says.
    pub flight: FlightParams,
    /// After this time without the operator, s, the vehicle holds, and later lands; 0 for never.
    pub operator_timeout: f64,
}

/// The firmware of a vehicle that flies itself.
///
/// ```
/// use tilthex_firmware::{Board, Firmware, FirmwareParams};
///
/// /// The program of a board. `wait` returns at the next tick; `restart` starts the board again.
/// fn fly(board: &mut impl Board, params: FirmwareParams, wait: impl Fn(), restart: impl Fn()) {
///     let Ok(mut firmware) = Firmware::new(params) else { return };
///     loop {
///         wait();
///         firmware.tick(board);
///         if firmware.finished() {
///             restart();
///         }
///     }
/// }
/// ```
#[derive(Clone, Debug)]
pub struct Firmware {
    params: FirmwareParams,
    flight: Flight,
    sensors: Sensors,
    inbox: Inbox,
    outbox: Outbox,
    admittance: AdmittanceFilter,
    /// The diagonal of the mass that is used from the next order for the damping on.
    mass: Vector6,
    bounds: OrderBounds,
    host: HostFacts,
    /// The operator whose orders are flown: when the base told something about the operator, s, and how long the operator had
    /// been silent then, s.
    operator: Option<(f64, f64)>,
    answer: Answer,
    out: Commanded,
    /// When the flight was over and the motors stood still, s.
    over: Option<f64>,
    /// When a text said last that a message is not carried out, s.
    complained: f64,
}

impl Firmware {
    /// The firmware of a board that was just powered.
    ///
    /// # Errors
    /// The first parameter that a block refuses.
    pub fn new(params: FirmwareParams) -> Result<Self, Error> {
        let params = FirmwareParams { flight: FlightParams { take_off: false, ..params.flight }, ..params };
        Ok(Self {
            flight: Flight::new(params.flight, None)?,
            sensors: Sensors::new(params.flight.vehicle.rotor_count())?,
            inbox: Inbox::new()?,
            outbox: Outbox::new(),
            admittance: AdmittanceFilter::new(params.flight.controller.admittance)?,
            mass: params.flight.controller.admittance.mass.diagonal(),
            bounds: OrderBounds::new(
                &params.flight.vehicle,
                &params.flight.controller,
                &params.flight.guidance.stream,
                &params.flight.watch,
            ),
            host: HostFacts::default(),
            operator: None,
            answer: Answer::Nothing,
            out: Commanded::default(),
            over: None,
            complained: f64::NEG_INFINITY,
            params,
        })
    }

    /// The flight.
    #[must_use]
    pub fn flight(&self) -> &Flight {
        &self.flight
    }

    /// The output of the last tick.
    #[must_use]
    pub fn output(&self) -> &Commanded {
        &self.out
    }

    /// The telemetry of the last tick.
    #[must_use]
    pub fn telemetry(&self) -> &Telemetry {
        &self.sensors.telemetry
    }

    /// Whether the flight has been over, or the order to land called it off before it began, and the motors have stood still
    /// for a while. Then the board's program restarts the board, which is ready for the next flight. After a kill, a person must
    /// do it. After a start that a fault called off it stays false: the vehicle takes a new order to take off.
    #[must_use]
    pub fn finished(&self) -> bool {
        self.over.is_some_and(|since| self.out.record.input.time - since >= STANDS)
    }

    /// Whether the flight is over, or was called off, and the motors stand still.
    fn stands(&self) -> bool {
        let supervisor = self.flight.supervisor();
        supervisor.phase() == Phase::Disarmed
            && (supervisor.landed() || self.host.land)
            && !supervisor.killed()
            && !self.sensors.telemetry.any_spinning()
    }

    /// One tick. Call it with the period of the control loop, 2 ms. It neither waits nor panics.
    pub fn tick(&mut self, board: &mut impl Board) {
        let micros = board.now_us();
        let now = micros as f64 * 1e-6;
        self.sensors.read(board, now);
        let before = self.flight.supervisor().phase();
        let received = self.inbox.read(board, micros, before);
        if received.ends() && before == Phase::Disarmed {
            self.flight.call_off();
        }
        // Where nothing was ordered, there is nothing to call off.
        let ordered = self.operator.is_some() || before != Phase::Disarmed;
        self.host.land |= received.land && ordered;
        self.host.kill |= received.kill;
        if let (Some(heard), Some(silence)) = (&mut self.operator, received.heartbeat) {
            *heard = (now, silence);
        }
        let order = received.order.filter(|(number, _)| self.answer.number() != *number);
        let command = order.and_then(|(number, order)| {
            if received.ends() {
                self.refuse(number, "an order to land or to stop came with it");
                return None;
            }
            self.obey(number, &order, now)
        });
        self.host.operator_silent = self.operator.is_some_and(|(at, silence)| {
            self.params.operator_timeout > 0.0 && now - at + silence > self.params.operator_timeout
        });
        let measured = Measured {
            time: now,
            telemetry: &self.sensors.telemetry,
            poses: received.poses(),
            command: command.as_ref(),
            host: self.host,
            known: None,
        };
        self.flight.tick(&measured, &mut self.out);
        self.drive(board);
        self.over = self.over.or(Some(now)).filter(|_| self.stands());
        if let (Some((number, _)), true) = (order, command.is_some() && self.flight.refused_order()) {
            self.refuse(number, "outside the geofence");
        }
        self.call_off_start(before);
        if let Some(refused) = received.refused.filter(|_| now - self.complained >= QUIET) {
            let reason = match refused {
                Refused::Motors => "refused: the vehicle flies by itself",
                Refused::Stop => "x in flight is refused; the order kill stops the motors",
            };
            self.outbox.say(Severity::Warning, &[reason]);
            self.complained = now;
        }
        let supervisor = self.flight.supervisor();
        let facts = Facts::default()
            .and_if(Facts::ESTIMATES, self.flight.estimator().is_initialized())
            .and_if(Facts::LANDED, supervisor.landed())
            .and_if(Facts::KILLED, supervisor.killed());
        let told = (facts, supervisor.ended_by().map(|fault| fault as u8), self.answer);
        self.outbox.speak(board, micros, &received, &self.sensors, &self.out.record, told);
    }

    /// A start that is called off ends the order to take off: nobody expects that motors start later, by themselves.
    fn call_off_start(&mut self, before: Phase) {
        let supervisor = self.flight.supervisor();
        let started = matches!(before, Phase::Starting | Phase::Grounded);
        if started && supervisor.phase() == Phase::Disarmed && !supervisor.killed() {
            self.flight.call_off();
            // After an order to land, the board restarts first.
            if !self.host.land {
                self.outbox.say(Severity::Warning, &["the start is called off; order the take-off again"]);
            }
        }
    }

    /// Answers an order, and returns the command to the flight if it is carried out.
    fn obey(&mut self, number: u8, order: &Order, now: f64) -> Option<Command> {
        match self.command(order) {
            Ok(command) => {
                self.answer = Answer::Accepted(number);
                // From now on the operator must be heard, if this order moves the vehicle or an earlier one has.
                if order.moves() || self.operator.is_some() {
                    self.operator = Some((now, 0.0));
                }
                command
            }
            Err(reason) => {
                self.refuse(number, reason);
                None
            }
        }
    }

    fn refuse(&mut self, number: u8, reason: &str) {
        self.answer = Answer::Refused(number);
        self.outbox.say(Severity::Warning, &[REFUSED, reason]);
    }

    /// The command to the flight that carries an order out, if it needs one, or why it cannot be carried out.
    fn command(&mut self, order: &Order) -> Result<Option<Command>, &'static str> {
        let supervisor = self.flight.supervisor();
        let phase = supervisor.phase();
        let flies = matches!(phase, Phase::Flying | Phase::Holding) && self.flight.on_mission();
        match order {
            Order::TakeOff if supervisor.killed() => Err("the motors were killed; restart the board"),
            Order::TakeOff if supervisor.landed() || self.host.land => Err("the last flight is not over"),
            Order::TakeOff if phase != Phase::Disarmed => Err("the vehicle has taken off already"),
            Order::TakeOff => Ok(Some(Command::TakeOff)),
            Order::Admittance(part, diagonal) => self.change(*part, diagonal),
            Order::Hold | Order::GoTo(_) | Order::ZeroBias if !flies => {
                Err("the vehicle takes no motions now")
            }
            Order::Hold => {
                let setpoint = &self.out.record.setpoint;
                let limits = self.params.flight.guidance.limits;
                let here = GoTo {
                    position_w: setpoint.position_w,
                    rotation_we: setpoint.rotation_we,
                    duration: 0.0,
                    limits,
                };
                Ok(Some(Command::Play(route(&here)?)))
            }
            Order::GoTo(place) => {
                let route = route(place)?;
                self.bounds.check_route(&route).map_err(|beyond| beyond.short())?;
                Ok(Some(Command::Play(route)))
            }
            Order::ZeroBias => Ok(Some(Command::ZeroBias)),
            // They are urgent, and do not come here.
            Order::Land | Order::Kill => Err("it has no number"),
        }
    }

    /// Changes a part of the admittance filter. A mass waits for its damping, so that no mass is used with a damping that is
    /// too weak for it. What stays as it is needs no check: it may have been configured.
    fn change(&mut self, part: Part, diagonal: &Vector6) -> Result<Option<Command>, &'static str> {
        let params = self.admittance.params();
        let matrices = [&params.mass, &params.damping, &params.stiffness];
        if matrices.iter().any(|matrix| **matrix != Matrix6::from_diagonal(&matrix.diagonal())) {
            return Err("the configured admittance is not diagonal");
        }
        let [mut mass, mut damping, mut stiffness] = matrices.map(Matrix6::diagonal);
        match part {
            Part::Mass => {
                if !alike(diagonal, &mass) {
                    self.bounds.check_mass(diagonal).map_err(|beyond| beyond.short())?;
                }
                self.mass = *diagonal;
                return Ok(None);
            }
            Part::Damping => {
                if !alike(diagonal, &damping) || !alike(&self.mass, &mass) {
                    self.bounds.check_damping(&self.mass, diagonal).map_err(|beyond| beyond.short())?;
                }
                (mass, damping) = (self.mass, *diagonal);
            }
            Part::Stiffness => stiffness = *diagonal,
        }
        let filter = self.admittance.with_diagonals(&mass, &damping, &stiffness);
        self.admittance = filter.map_err(|_| "such an admittance is not possible")?;
        Ok(Some(Command::SetAdmittance(self.admittance)))
    }

    /// Gives the rotors their set-points.
    fn drive(&self, board: &mut impl Board) {
        for rotor in 0..self.params.flight.vehicle.rotor_count() {
            board.drive(rotor, set_point(&self.out.motors, rotor));
        }
    }
}

/// The set-point of a rotor, from 0, in a command.
fn set_point(command: &MotorCommand, rotor: usize) -> Drive {
    let of = |speeds: &RotorVector| speeds.get(rotor).copied().unwrap_or(0.0);
    match command {
        MotorCommand::Alone(alone, speeds) if rotor == *alone => Drive::Start(of(speeds)),
        MotorCommand::Stop | MotorCommand::Kill | MotorCommand::Alone(..) => Drive::Stop,
        MotorCommand::Start(speeds) => Drive::Start(of(speeds)),
        MotorCommand::Turn(speeds) => Drive::Turn(of(speeds)),
    }
}

/// The route to a place.
fn route(place: &GoTo) -> Result<Route, &'static str> {
    let waypoint = Waypoint {
        position_w: place.position_w,
        rotation_we: place.rotation_we,
        wrench_w: Wrench::ZERO,
        force_axes: ForceAxes::NONE,
        duration: place.duration,
        hold: 0.0,
    };
    Route::new(&[waypoint], &place.limits).map_err(|_| "no such motion is possible")
}

/// Whether two diagonals are equal, but for the rounding in a message.
fn alike(one: &Vector6, other: &Vector6) -> bool {
    one.iter().zip(other.iter()).all(|(one, other)| (one - other).abs() <= ROUNDED * other.abs())
}
