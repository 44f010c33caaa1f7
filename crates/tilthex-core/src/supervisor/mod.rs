//! The supervisor: the phase of the flight, and the reaction to faults.
//!
//! In flight the strongest reactions are to land and to descend. Motors stop only on the ground, by the operator's order `kill`, or
//! just after a lift-off that goes wrong, when a stop does less harm than flying.

pub mod faults;
pub mod limits;

pub use faults::{COUNT, Fault, FaultSet, LIFT_OFF_FAULTS, Reaction, Row, Sentence, TABLE};

/// The phases of a flight.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(u8)]
pub enum Phase {
    /// Motors off.
    #[default]
    Disarmed,
    /// Motors are being started, one by one.
    Starting,
    /// All motors spin; on the ground.
    Grounded,
    /// Take-off, hover, mission.
    Flying,
    /// The mission is held.
    Holding,
    /// The vehicle descends.
    Landing,
    /// The vehicle descends without a position.
    Emergency,
}

impl Phase {
    /// All phases, in the order of their numbers in logs and on lines. Numbers never change.
    pub const ALL: [Self; 7] = [
        Self::Disarmed,
        Self::Starting,
        Self::Grounded,
        Self::Flying,
        Self::Holding,
        Self::Landing,
        Self::Emergency,
    ];

    /// Whether the vehicle is off the ground.
    #[must_use]
    pub fn in_flight(self) -> bool {
        matches!(self, Self::Flying | Self::Holding | Self::Landing | Self::Emergency)
    }

    /// Its name.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Disarmed => "disarmed",
            Self::Starting => "starting",
            Self::Grounded => "grounded",
            Self::Flying => "flying",
            Self::Holding => "holding",
            Self::Landing => "landing",
            Self::Emergency => "emergency",
        }
    }
}

/// The facts that the phases depend on, besides faults.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Facts {
    /// The vehicle is identified and its streams run.
    pub link_ready: bool,
    /// The estimator is initialised and its biases are known.
    pub estimate_ready: bool,
    /// Every motor spins.
    pub all_spinning: bool,
    /// The ramp from the lowest speeds has ended.
    pub ramp_done: bool,
    /// The vehicle stands on the ground.
    pub touchdown: bool,
    /// A take-off is ordered.
    pub take_off: bool,
    /// The operator's order `kill`.
    pub kill: bool,
    /// The fault just after lift-off for which stopping the motors does less harm than flying.
    pub abort: Option<Fault>,
}

/// The phase of a flight and its faults, from tick to tick.
///
/// ```
/// use tilthex_core::supervisor::{Facts, Fault, FaultSet, Phase, Supervisor};
///
/// let mut supervisor = Supervisor::in_flight();
/// let facts = Facts { link_ready: true, estimate_ready: true, all_spinning: true, ..Facts::default() };
/// assert_eq!(supervisor.step(FaultSet::NONE, &facts, 0.002), Phase::Flying);
/// // The pose is lost: the mission waits, and the vehicle holds its place.
/// let mut conditions = FaultSet::NONE;
/// conditions.insert_if(Fault::PoseLost, true);
/// assert_eq!(supervisor.step(conditions, &facts, 0.002), Phase::Holding);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Supervisor {
    phase: Phase,
    active: FaultSet,
    seen: FaultSet,
    /// The conditions that held in the last tick.
    held: FaultSet,
    /// For how long each condition has held (positive) or, while its fault is active, has been absent (negative), s.
    timers: [f64; COUNT],
    counts: [u32; COUNT],
    landed: bool,
    killed: bool,
    ended_by: Option<Fault>,
}

impl Default for Supervisor {
    fn default() -> Self {
        Self {
            phase: Phase::Disarmed,
            active: FaultSet::NONE,
            seen: FaultSet::NONE,
            held: FaultSet::NONE,
            timers: [0.0; COUNT],
            counts: [0; COUNT],
            landed: false,
            killed: false,
            ended_by: None,
        }
    }
}

impl Supervisor {
    /// The supervisor of a vehicle that already flies.
    #[must_use]
    pub fn in_flight() -> Self {
        Self { phase: Phase::Flying, ..Self::default() }
    }

    /// The phase.
    #[must_use]
    pub fn phase(&self) -> Phase {
        self.phase
    }

    /// Active faults.
    #[must_use]
    pub fn active(&self) -> FaultSet {
        self.active
    }

    /// All faults since the start of the flight.
    #[must_use]
    pub fn seen(&self) -> FaultSet {
        self.seen
    }

    /// How often each fault has begun, in the order of [`TABLE`].
    #[must_use]
    pub fn counts(&self) -> &[u32; COUNT] {
        &self.counts
    }

    /// Whether the vehicle flew and stands again, motors off.
    #[must_use]
    pub fn landed(&self) -> bool {
        self.landed
    }

    /// Whether the motors were stopped by the operator's kill. They do not start again.
    #[must_use]
    pub fn killed(&self) -> bool {
        self.killed
    }

    /// The fault that ended the flight, or that refused it.
    #[must_use]
    pub fn ended_by(&self) -> Option<Fault> {
        self.ended_by
    }

    /// Faults that now keep the motors from starting.
    #[must_use]
    pub fn refusals(&self) -> FaultSet {
        let mut set = FaultSet::NONE;
        for row in self.active.rows() {
            set.insert_if(row.fault, row.on_ground == Reaction::Refuse);
        }
        set
    }

    /// One tick of `dt` s: takes the fault conditions that hold in it, and the other facts that the phase depends on.
    /// Returns the phase after it.
    pub fn step(&mut self, conditions: FaultSet, facts: &Facts, dt: f64) -> Phase {
        self.time_faults(conditions, dt);
        let worst = self.active.rows().map(|row| row.in_flight).max().unwrap_or(Reaction::Note);
        let refusal = self.refusals();
        if facts.kill || self.killed {
            self.landed |= self.phase.in_flight();
            self.killed = true;
            self.ended_by = Some(Fault::Operator);
            self.phase = Phase::Disarmed;
            return self.phase;
        }
        if let Some(fault) = facts.abort.filter(|_| self.phase.in_flight()) {
            self.landed = true;
            self.ended_by = Some(fault);
            self.phase = Phase::Disarmed;
            return self.phase;
        }
        let before = self.phase;
        self.phase = match before {
            Phase::Disarmed if self.landed => Phase::Disarmed,
            Phase::Disarmed => {
                let ready = facts.take_off && facts.link_ready && facts.estimate_ready;
                if ready && refusal.is_empty() { Phase::Starting } else { Phase::Disarmed }
            }
            Phase::Starting | Phase::Grounded if !refusal.is_empty() => {
                self.ended_by = refusal.rows().next().map(|row| row.fault);
                Phase::Disarmed
            }
            Phase::Starting if facts.all_spinning => Phase::Grounded,
            // The vehicle does not take off if a fault would hold it in the air.
            Phase::Grounded if facts.ramp_done && worst < Reaction::Hold => Phase::Flying,
            Phase::Starting | Phase::Grounded => before,
            Phase::Flying | Phase::Holding => match worst {
                Reaction::Note | Reaction::Refuse => Phase::Flying,
                Reaction::Hold => Phase::Holding,
                Reaction::Land => Phase::Landing,
                Reaction::Descend => Phase::Emergency,
            },
            Phase::Landing | Phase::Emergency if facts.touchdown => {
                self.landed = true;
                Phase::Disarmed
            }
            Phase::Landing | Phase::Emergency => {
                if worst == Reaction::Descend {
                    Phase::Emergency
                } else {
                    Phase::Landing
                }
            }
        };
        let begins_to_land = matches!(self.phase, Phase::Landing | Phase::Emergency)
            && matches!(before, Phase::Flying | Phase::Holding);
        if begins_to_land {
            self.ended_by = self.active.rows().find(|row| row.in_flight == worst).map(|row| row.fault);
        }
        // An ordered landing that went wrong did not end as it was ordered.
        if self.ended_by == Some(Fault::Operator) && self.phase.in_flight() {
            let wrong = |row: &&Row| row.fault != Fault::Operator && row.in_flight >= Reaction::Land;
            self.ended_by = self.active.rows().find(wrong).map(|row| row.fault).or(self.ended_by);
        }
        self.phase
    }

    fn time_faults(&mut self, conditions: FaultSet, dt: f64) {
        // The timers of all others are zero.
        let timed = FaultSet(conditions.0 | self.active.0 | self.held.0);
        for row in timed.rows() {
            let number = row.fault as usize;
            let (Some(timer), Some(count)) = (self.timers.get_mut(number), self.counts.get_mut(number))
            else {
                continue;
            };
            let was = self.active.contains(row.fault);
            if conditions.contains(row.fault) {
                *timer = timer.max(0.0) + dt;
                if !was && *timer >= row.after {
                    self.active.insert_if(row.fault, true);
                    self.seen.insert_if(row.fault, true);
                    *count = count.saturating_add(1);
                }
            } else {
                *timer = timer.min(0.0) - dt;
                if !was || -*timer >= row.over {
                    self.active.remove(row.fault);
                    *timer = 0.0;
                }
            }
        }
        self.held = conditions;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::vec::Vec;

    const READY: Facts = Facts {
        link_ready: true,
        estimate_ready: true,
        all_spinning: true,
        ramp_done: true,
        touchdown: false,
        take_off: true,
        kill: false,
        abort: None,
    };

    fn flying() -> Supervisor {
        let mut s = Supervisor::default();
        for _ in 0..3 {
            s.step(FaultSet::NONE, &READY, 0.002);
        }
        assert_eq!(s.phase(), Phase::Flying);
        s
    }

    #[test]
    fn every_fault_has_its_reaction_in_flight() {
        for row in &TABLE {
            let mut s = flying();
            let mut set = FaultSet::NONE;
            set.insert_if(row.fault, true);
            let ticks = (row.after / 0.002) as usize + 2;
            for _ in 0..ticks {
                s.step(set, &READY, 0.002);
            }
            let expected = match row.in_flight {
                Reaction::Note | Reaction::Refuse => Phase::Flying,
                Reaction::Hold => Phase::Holding,
                Reaction::Land => Phase::Landing,
                Reaction::Descend => Phase::Emergency,
            };
            assert_eq!(s.phase(), expected, "{}", row.name);
            assert_eq!(s.counts()[row.fault as usize], 1, "{}", row.name);
        }
    }

    #[test]
    fn a_hold_ends_with_its_fault_and_a_landing_does_not() {
        let mut s = flying();
        let mut lost = FaultSet::NONE;
        lost.insert_if(Fault::PoseLost, true);
        s.step(lost, &READY, 0.002);
        assert_eq!(s.phase(), Phase::Holding);
        for _ in 0..120 {
            s.step(FaultSet::NONE, &READY, 0.002);
        }
        assert_eq!(s.phase(), Phase::Flying);
        lost.insert_if(Fault::PoseLostLong, true);
        s.step(lost, &READY, 0.002);
        for _ in 0..1000 {
            s.step(FaultSet::NONE, &READY, 0.002);
        }
        assert_eq!(s.phase(), Phase::Landing);
        assert_eq!(s.ended_by(), Some(Fault::PoseLostLong));
    }

    #[test]
    fn a_kill_is_for_good_in_every_phase() {
        let kill = Facts { kill: true, ..READY };
        let mut s = Supervisor::default();
        for aloft in [false, false, false, true] {
            let mut killed = s;
            assert_eq!(killed.step(FaultSet::NONE, &kill, 0.002), Phase::Disarmed);
            for _ in 0..10 {
                assert_eq!(killed.step(FaultSet::NONE, &READY, 0.002), Phase::Disarmed);
            }
            assert!(killed.killed());
            assert_eq!(killed.landed(), aloft);
            s.step(FaultSet::NONE, &READY, 0.002);
        }
    }

    proptest! {
        #[test]
        fn motors_never_stop_in_the_air(conditions in prop::collection::vec((0u64..1 << COUNT, 1usize..200), 1..30)) {
            let mut s = flying();
            for (bits, ticks) in conditions {
                for _ in 0..ticks {
                    let phase = s.step(FaultSet(bits), &READY, 0.002);
                    prop_assert!(phase.in_flight(), "{phase:?}");
                }
            }
            let down = Facts { touchdown: true, ..READY };
            let phases: Vec<_> = (0..3).map(|_| s.step(FaultSet(1 << Fault::Operator as u8), &down, 0.002)).collect();
            prop_assert_eq!(*phases.last().unwrap(), Phase::Disarmed);
            prop_assert!(s.landed());
        }
    }
}
