//! The vehicle, its base, and the line between them.

use std::{collections::VecDeque, sync::OnceLock};

use tilthex_config::{Config, VehicleSection};
use tilthex_core::{PoseSample, flight::Record, supervisor::Phase};
use tilthex_link::{
    Outgoing,
    onboard::{Base, BaseParams, Event, Order, ToVehicle},
    tk3::MAX_FRAME,
};
use tilthex_sim::{
    Own, Simulation, SimulationParams,
    onboard::{Onboard, firmware_params},
};

/// The base's clock when the vehicle was powered, s.
const EPOCH: f64 = 5000.0;
/// Delay of a pose, s.
const LATENCY: f64 = 0.008;

pub(crate) fn config() -> Config {
    Config::default_for(VehicleSection::preset("tilt-hex").expect("a preset"))
}

/// The vehicle, the base, and the line between them.
#[derive(Clone)]
pub(crate) struct World {
    pub(crate) simulation: Simulation<Own, Onboard>,
    pub(crate) base: Base,
    poses: VecDeque<PoseSample>,
    ticks: u64,
    /// Whether the line transports nothing.
    pub(crate) cut: bool,
    /// Whether motion capture sends nothing.
    pub(crate) blind: bool,
    /// How long the operator has been silent, s.
    pub(crate) silence: f64,
    pub(crate) records: Vec<Record>,
    pub(crate) texts: Vec<String>,
    pub(crate) answers: Vec<bool>,
}

impl World {
    pub(crate) fn new() -> Self {
        let config = config();
        let vehicle = *config.vehicle().vehicle();
        let params = SimulationParams::new(vehicle);
        let board = Onboard::new(firmware_params(&config).unwrap(), params.firmware.battery).unwrap();
        let base = Base::new(BaseParams {
            rotor_count: vehicle.rotor_count(),
            tool: *vehicle.tool(),
            record_period_us: 20_000,
            battery_period_us: 1_000_000,
        });
        Self {
            simulation: Simulation::with_board(params, board),
            base: base.unwrap(),
            poses: VecDeque::new(),
            ticks: 0,
            cut: false,
            blind: false,
            silence: 0.0,
            records: Vec::new(),
            texts: Vec::new(),
            answers: Vec::new(),
        }
    }

    pub(crate) fn now(&self) -> f64 {
        EPOCH + self.simulation.now() as f64 * 1e-6
    }

    /// 2 ms: one tick of the firmware, and one of the base.
    pub(crate) fn tick(&mut self) {
        let mut bytes = Vec::new();
        for _ in 0..2 {
            self.simulation.advance(&mut bytes);
        }
        let now = self.now();
        self.ticks += 1;
        if self.ticks.is_multiple_of(5) && !self.blind {
            let (position_w, rotation_wr) = self.simulation.captured_pose();
            let arrival = now + LATENCY;
            self.poses.push_back(PoseSample {
                time: now,
                arrival,
                position_w,
                rotation_wr,
                tracking_valid: true,
            });
        }
        if self.cut {
            self.poses.clear();
            return;
        }
        let Self { base, poses, records, texts, answers, .. } = self;
        let mut tell = |event| match event {
            Event::Record(record) => records.push(record),
            Event::Text(_, text) => texts.push(text.to_string()),
            Event::Answered(_, accepted) => answers.push(accepted),
            Event::Unanswered(order) => panic!("no answer to {order:?}"),
            Event::Restarted(_) => texts.push("restarted".into()),
            Event::WrongPeriods(periods) => texts.push(format!("{periods:?}")),
        };
        base.receive(&bytes, now, &mut tell);
        let mut out = Outgoing::default();
        while poses.front().is_some_and(|pose| pose.arrival <= now) {
            base.pose(&poses.pop_front().unwrap(), now, &mut out);
        }
        base.talk(now, self.silence, &mut out, &mut tell);
        self.simulation.receive(out.bytes(), &mut Vec::new());
    }

    /// Messages for the vehicle that arrive together.
    pub(crate) fn send(&mut self, messages: &[ToVehicle]) {
        for message in messages {
            let mut bytes = [0; MAX_FRAME];
            let length = message.encode(&mut bytes);
            self.simulation.receive(&bytes[..length], &mut Vec::new());
        }
    }

    pub(crate) fn run(&mut self, seconds: f64) {
        for _ in 0..(500.0 * seconds) as usize {
            self.tick();
        }
    }

    pub(crate) fn until(&mut self, seconds: f64, mut done: impl FnMut(&Self) -> bool) {
        let end = self.now() + seconds;
        while !done(self) {
            self.tick();
            assert!(self.now() < end, "{:?} {:?}", self.phase(), self.texts);
        }
    }

    /// The record on the vehicle.
    pub(crate) fn record(&self) -> &Record {
        &self.simulation.firmware().firmware().output().record
    }

    pub(crate) fn phase(&self) -> Phase {
        self.record().phase
    }

    pub(crate) fn on_mission(&self) -> bool {
        self.phase() == Phase::Flying && self.simulation.firmware().firmware().flight().on_mission()
    }

    pub(crate) fn order(&mut self, order: Order) {
        let now = self.now();
        assert!(self.base.order(order, now), "{order:?}");
    }

    pub(crate) fn landed(&mut self) {
        self.until(30.0, |world| world.phase() == Phase::Disarmed);
        self.run(0.2);
        assert!(self.simulation.stands() && !self.simulation.firmware().any_spins());
    }

    /// Hovers, and has learnt its bias.
    pub(crate) fn hover() -> Self {
        static HOVER: OnceLock<World> = OnceLock::new();
        HOVER
            .get_or_init(|| {
                let mut world = Self::new();
                world.until(5.0, |world| world.base.flight().is_some());
                world.run(1.0);
                world.order(Order::TakeOff);
                world.until(30.0, Self::on_mission);
                world
            })
            .clone()
    }
}
