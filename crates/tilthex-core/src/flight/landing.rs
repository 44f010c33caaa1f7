//! The end of a descent: whether the ground stops it, and how a vehicle that does not come down is forced down.
//!
//! Missing thrust does not show the ground, because everything that pushes the tool upwards causes it too. Therefore
//! the vehicle is unloaded first: its rotors carry less and less of the weight, by command and not by control. A
//! vehicle that stands on the ground stays at its place; a vehicle in the air moves, and continues to fly.

use super::{forced_descent::Forced, rest::Rest};
use crate::types::Vector3;

/// Something must carry this part of the weight before the vehicle is unloaded.
const SHARE: f64 = 0.3;
/// A descent is blocked where the vehicle does not sink at this part of the commanded speed, for the first of BLOCKED, s, or
/// for the second where it is higher than the ground that it took off from.
const FOLLOWS: f64 = 0.3;
const BLOCKED: (f64, f64) = (0.2, 1.0);
/// A vehicle lies still if it is not faster than this, m/s, for this time, s.
pub(super) const STILL: (f64, f64) = (0.3, 0.2);
/// A force that is felt for this time, s, carries, however the vehicle moves: a vehicle that has toppled, or comes
/// down without a rotor, bounces.
const FELT: (f64, f64) = (0.5, 0.1);
/// If pose and speed are known, a vehicle that has toppled must be slower than this, m/s, for this time, s. A push
/// can carry it as well, but then it moves.
const LIES_STILL: (f64, f64) = (0.12, 0.25);

/// Parts of the weight that the rotors carry at the begin and at the end of unloading.
pub(super) const LOADS: (f64, f64) = (0.7, 0.05);
/// Unloading takes this long, s; at the end the vehicle stays unloaded for this long, s, and for this long where
/// it is higher than the ground that it took off from.
const UNLOAD: f64 = 0.6;
const UNLOADED: (f64, f64) = (0.2, 1.5);
/// A vehicle that stands changes its speed by less than this, m/s, and the cosine of its tilt by less than this.
const STANDS: (f64, f64) = (0.15, 0.02);
/// A vehicle that has toppled does not lie on the ground if it is higher than the first of these above the ground of its
/// take-off, m; one that is upright does not stand there without all of its rotors if it is higher than the second.
const LIES: (f64, f64) = (0.05, -0.05);
/// A descent fails if something other than the ground has stopped it this often.
pub(super) const ATTEMPTS: u32 = 4;

/// Rotors that do not carry a vehicle let it fall within this time, s.
const RESTS: f64 = 0.3;

/// Measurements that show the ground.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Seen {
    /// The part of the weight that the rotors do not carry, N.
    pub(super) missing: f64,
    /// External force by the accelerometer, N, world; `None` if it is not known.
    pub(super) observed_w: Option<Vector3>,
    /// Specific force that the accelerometer feels, m/s^2, robot, and the angular rate, rad/s; `None` if they are not known.
    pub(super) felt: Option<(Vector3, f64)>,
    /// Commanded speed of the descent, m/s; `None` if the descent goes by thrust alone.
    pub(super) sinks: Option<f64>,
    /// Speed upwards, m/s. If no speed is known, its changes are still right.
    pub(super) velocity: f64,
    /// Speed in any direction, m/s.
    pub(super) speed: f64,
    /// Cosine of the tilt.
    pub(super) upright: f64,
    /// Smallest possible height above the place of the take-off, m: the estimate minus three deviations.
    pub(super) above: Option<f64>,
    /// Whether the vehicle has tilted beyond its limit. Then the vertical of the estimate may be wrong too.
    pub(super) toppled: bool,
    /// Whether it comes down without a rotor that a hover needs.
    pub(super) adrift: bool,
    /// Whether the vehicle must come down at any cost.
    pub(super) forced: bool,
    /// Whether poses show the place and the speed.
    pub(super) placed: bool,
    /// Whether the estimate is unusable: no vehicle in a room can move like this.
    pub(super) hopeless: bool,
    /// No place in the room is higher than this above the ground, m.
    pub(super) room: f64,
}

/// Smallest and largest upward force of the rotors, N.
pub(super) type Lift = [f64; 2];

/// No limit of the control laws.
pub(super) const FREE: Lift = [f64::NEG_INFINITY, f64::INFINITY];

/// The result of a tick of a descent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Verdict {
    /// Descend with this lift.
    On(Lift),
    /// Something other than the ground stopped the descent: continue to fly from here.
    Resume,
    /// The ground carries the vehicle.
    Down,
}

/// The state of an unloading.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Unloading {
    time: f64,
    velocity: f64,
    upright: f64,
}

/// A descent.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Landing {
    rest: Rest,
    still: f64,
    felt: f64,
    /// The same since the vehicle has toppled or lost a rotor; and for how long it has been standing so.
    lying: (f64, f64),
    /// For how long it has stood at the height of the ground, s.
    at_rest: f64,
    unloading: Option<Unloading>,
    attempts: u32,
    /// Set when it is forced down, or comes down by thrust alone.
    forced: Option<Forced>,
}

impl Landing {
    /// How often something other than the ground has stopped it.
    pub(super) fn attempts(&self) -> u32 {
        self.attempts
    }

    /// One tick of a vehicle with a weight, N.
    pub(super) fn step(&mut self, seen: &Seen, weight: f64, dt: f64) -> Verdict {
        let rests = self.rest.step(seen, dt);
        if self.lies(seen, weight, rests, dt) {
            return Verdict::Down;
        }
        // Without a speed only the force shows the ground, and only where the rotors carry less than the weight.
        if seen.forced || seen.sinks.is_none() && !seen.placed {
            return self.force(seen, weight, rests, dt);
        }
        self.forced = None;
        if seen.toppled || seen.adrift {
            self.unloading = None;
            return Verdict::On(FREE);
        }
        let elsewhere = seen.above.is_some_and(|above| above > 0.0);
        let Some(mut unloading) = self.unloading else {
            if self.blocked(seen, weight, elsewhere, dt) {
                self.unloading =
                    Some(Unloading { time: 0.0, velocity: seen.velocity, upright: seen.upright });
            }
            return Verdict::On(FREE);
        };
        unloading.time += dt;
        let (change, tilt) = STANDS;
        let moved = (seen.velocity - unloading.velocity).abs() > change;
        if moved || unloading.upright - seen.upright > tilt {
            self.begin_again();
            return Verdict::Resume;
        }
        self.unloading = Some(unloading);
        let (on_the_ground, on_something) = UNLOADED;
        if unloading.time > UNLOAD + if elsewhere { on_something } else { on_the_ground } {
            return Verdict::Down;
        }
        let (first, last) = LOADS;
        let load = (first + (last - first) * (unloading.time / UNLOAD).min(1.0)) * weight;
        Verdict::On([load, load])
    }

    fn begin_again(&mut self) {
        *self = Self { attempts: self.attempts.saturating_add(1), ..Self::default() };
    }

    /// Whether something stops the descent. It shows by the speed, and by the force that carries the vehicle instead
    /// of its rotors: missing thrust (this needs no accelerometer) or a force that is felt. Without a speed, it shows
    /// by the force alone.
    fn blocked(&mut self, seen: &Seen, weight: f64, elsewhere: bool, dt: f64) -> bool {
        let feels = seen.observed_w.is_some_and(|force| force.z > SHARE * weight);
        self.felt = (self.felt + if feels { dt } else { -dt }).max(0.0);
        let lasts = self.felt > FELT.0;
        let Some(sinks) = seen.sinks else { return lasts };
        let carried = feels || seen.missing > SHARE * weight;
        let stopped = sinks > 0.0 && seen.velocity > -FOLLOWS * sinks && seen.velocity < STILL.0;
        self.still = if carried && stopped { self.still + dt } else { 0.0 };
        // A vehicle that bounces on the ground, on its tool for example, is not still; and without poses the speed may be
        // wrong.
        let bounces = lasts && (!seen.placed || seen.above.is_some_and(|above| above <= 0.0));
        bounces || self.still > if elsewhere { BLOCKED.1 } else { BLOCKED.0 }
    }

    /// Whether a vehicle that is not upright, or cannot be kept upright, lies on the ground. It cannot be unloaded to
    /// find out.
    fn lies(&mut self, seen: &Seen, weight: f64, rests: Option<bool>, dt: f64) -> bool {
        if !(seen.toppled || seen.adrift) {
            self.lying = (0.0, 0.0);
            return false;
        }
        let highest = if seen.toppled { LIES.0 } else { LIES.1 };
        if seen.above.is_some_and(|above| above > highest) {
            return false;
        }
        // Without a pose the vertical is not known, and the speed may be wrong. With a pose, a sideways force is not the ground.
        let known = seen.toppled && seen.above.is_some();
        let lost = seen.toppled && !known;
        let slow = seen.velocity.abs() < if known { LIES_STILL.0 } else { STILL.0 };
        let slow = rests.filter(|_| lost).unwrap_or(slow);
        let carried = |force: Vector3| if lost { force.norm() } else { force.z };
        let feels = seen.observed_w.is_some_and(|force| carried(force) > SHARE * weight);
        let feels = feels && (slow || seen.adrift && !seen.toppled);
        let (felt, still) = &mut self.lying;
        *felt = (*felt + if feels { dt } else { -dt }).max(0.0);
        // Without a pose thrust may be missing because the vertical is wrong; then the force must show it, too.
        let shown = *felt > 0.0 || !lost || rests.is_none();
        let stands = seen.missing > SHARE * weight && slow && shown;
        *still = if stands { *still + dt } else { 0.0 };
        let (felt_for, still_for) = if known { (LIES_STILL.1, LIES_STILL.1) } else { (FELT.1, STILL.1) };
        *felt > felt_for || *still > still_for
    }

    /// Whether the vehicle stands at the height of the ground although its rotors do not carry it, for example because no
    /// command reaches them. In the air it would fall.
    fn rests(&mut self, seen: &Seen, weight: f64, dt: f64) -> bool {
        let at_the_ground = seen.above.is_some_and(|above| above <= LIES.1);
        let rests = seen.missing > SHARE * weight && at_the_ground && seen.velocity.abs() < STILL.0;
        self.at_rest = if rests { self.at_rest + dt } else { 0.0 };
        self.at_rest > RESTS
    }

    /// Changes the thrust until the vehicle comes down.
    fn force(&mut self, seen: &Seen, weight: f64, rests: Option<bool>, dt: f64) -> Verdict {
        if self.rests(seen, weight, dt) {
            return Verdict::Down;
        }
        let forced = self.forced.get_or_insert_with(|| Forced::begin(seen));
        let (carried, down) = forced.step(seen, weight, rests, dt);
        if down { Verdict::Down } else { Verdict::On([f64::NEG_INFINITY, carried * weight]) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::GRAVITY;

    const WEIGHT: f64 = 20.0;
    const DT: f64 = 2e-3;
    const AIR: Seen = Seen {
        missing: 0.0,
        observed_w: Some(Vector3::new(0.0, 0.0, 0.0)),
        felt: Some((Vector3::new(0.0, 0.0, GRAVITY), 0.0)),
        sinks: Some(0.25),
        velocity: -0.25,
        speed: 0.25,
        upright: 1.0,
        above: None,
        toppled: false,
        adrift: false,
        forced: false,
        placed: true,
        hopeless: false,
        room: 3.0,
    };

    /// The verdict on a descent of up to 10 s, and its time, s; `seen` gives the measurements by time, s, and lift.
    fn run(seen: impl Fn(f64, Lift) -> Seen) -> (Verdict, f64) {
        let (mut landing, mut lift) = (Landing::default(), FREE);
        for k in 0..5000 {
            let time = f64::from(k) * DT;
            match landing.step(&seen(time, lift), WEIGHT, DT) {
                Verdict::On(next) => lift = next,
                other => return (other, time),
            }
        }
        (Verdict::On(lift), 10.0)
    }

    #[test]
    fn what_stays_while_it_is_unloaded_stands() {
        let stands = |_, _| Seen { missing: 10.0, velocity: 0.0, ..AIR };
        let (verdict, time) = run(stands);
        assert!(verdict == Verdict::Down && (0.9..1.2).contains(&time), "{verdict:?} {time}");
        // Without a speed, by the force.
        for sinks in [None, Some(0.25)] {
            let felt = Some(Vector3::new(0.0, 0.0, 10.0));
            let blind = |_, _| Seen { observed_w: felt, sinks, placed: false, ..AIR };
            assert_eq!(run(blind).0, Verdict::Down);
        }
        assert_eq!(run(|_, _| AIR), (Verdict::On(FREE), 10.0));
        // Not so soon where the ground should not be.
        let (verdict, time) = run(|time, lift| Seen { above: Some(0.4), ..stands(time, lift) });
        assert!(verdict == Verdict::Down && time > 3.0, "{verdict:?} {time}");
    }

    #[test]
    fn what_stands_without_a_known_speed_is_unloaded_and_what_falls_is_not() {
        let blind = Seen { sinks: None, placed: false, velocity: -3.0, ..AIR };
        // The ground carries what the rotors do not.
        let stands = |_, [_, most]: Lift| {
            let carried = most.min(0.85 * WEIGHT);
            Seen { observed_w: Some(Vector3::new(0.0, 0.0, WEIGHT - carried)), ..blind }
        };
        let (verdict, time) = run(stands);
        assert!(verdict == Verdict::Down && time < 5.0, "{verdict:?} {time}");
        let (verdict, _) = run(|_, _| blind);
        assert!(matches!(verdict, Verdict::On([_, most]) if most < 0.2 * WEIGHT), "{verdict:?}");
    }

    #[test]
    fn what_is_pushed_up_in_the_air_moves_when_it_is_unloaded() {
        for push in 4..20 {
            let push = f64::from(push);
            let speed = core::cell::Cell::new(0.0);
            let pushed = |_, [least, most]: Lift| {
                let carried = if least == most { most } else { WEIGHT - push };
                speed.set(if least == most {
                    speed.get() + (carried + push - WEIGHT) * 0.5 * DT
                } else {
                    0.0
                });
                let observed_w = Some(Vector3::new(0.0, 0.0, push));
                Seen { missing: WEIGHT - carried, observed_w, sinks: None, velocity: speed.get(), ..AIR }
            };
            assert_ne!(run(pushed).0, Verdict::Down, "{push} N");
        }
    }

    #[test]
    fn what_has_toppled_lies_where_it_feels_the_ground_and_only_there() {
        let felt = Some(Vector3::new(10.0, 0.0, 0.0));
        let lies = Seen { observed_w: felt, toppled: true, velocity: 3.0, ..AIR };
        let (verdict, time) = run(|_, _| lies);
        assert!(verdict == Verdict::Down && time < 1.5, "{verdict:?} {time}");
        // In the air a push turns it, or is not its weight.
        let air = |force: f64, turning| Some((Vector3::new(force, 0.0, 0.0), turning));
        for felt in [air(GRAVITY, 2.0), air(0.88 * GRAVITY, 0.0)] {
            assert_ne!(run(|_, _| Seen { felt, ..lies }).0, Verdict::Down);
            let forced = Seen { forced: true, hopeless: true, felt, ..lies };
            assert_ne!(run(|_, _| forced).0, Verdict::Down);
        }
        // In a hover with a wrong vertical thrust seems to be missing, and nothing is felt.
        let hover = Seen { toppled: true, missing: 0.6 * WEIGHT, velocity: -1.0, ..AIR };
        assert_ne!(run(|_, _| hover).0, Verdict::Down);
        // Samples that are missing now and then, and the bias of an accelerometer, hide no rest.
        let biased = air(GRAVITY + 1.0, 0.0);
        let still = |time: f64, _| Seen { felt: biased.filter(|_| time % 0.1 > 0.01), ..lies };
        assert_eq!(run(still).0, Verdict::Down);
        assert_ne!(run(|_, _| Seen { above: Some(0.5), ..lies }).0, Verdict::Down);
        // Where up is known, a push aside is no ground.
        let pushed = Seen { above: Some(-0.2), ..lies };
        assert_ne!(run(|_, _| pushed).0, Verdict::Down);
        let carried = Some(Vector3::new(3.0, 0.0, 15.0));
        assert_ne!(run(|_, _| Seen { observed_w: carried, ..pushed }).0, Verdict::Down, "it moves");
        let still = Seen { observed_w: carried, velocity: 0.1, ..pushed };
        assert_eq!(run(|_, _| still).0, Verdict::Down);
    }

    #[test]
    fn what_has_fallen_is_down_before_commands_reach_its_rotors_again() {
        let fell = Seen { forced: true, missing: 15.0, velocity: 0.0, above: Some(-0.1), ..AIR };
        let (verdict, time) = run(|_, _| fell);
        assert!(verdict == Verdict::Down && time < 0.5, "{verdict:?} {time}");
        for flies in [
            Seen { missing: 2.0, velocity: -0.5, ..fell },
            Seen { above: Some(0.01), velocity: -0.5, ..fell },
            Seen { velocity: -0.5, ..fell },
        ] {
            assert_ne!(run(|_, _| flies).0, Verdict::Down, "{flies:?}");
        }
    }

    #[test]
    fn what_has_lost_a_rotor_is_down_at_the_height_of_the_ground_only() {
        let carried = Some(Vector3::new(0.0, 0.0, 15.0));
        let adrift =
            |above| Seen { adrift: true, observed_w: carried, velocity: 0.0, above: Some(above), ..AIR };
        assert_eq!(run(|_, _| adrift(-0.08)).0, Verdict::Down);
        assert_eq!(run(|_, _| adrift(0.02)).0, Verdict::On(FREE));
    }

    #[test]
    fn what_does_not_sink_is_brought_down_with_less_and_less() {
        let (verdict, _) = run(|_, _| Seen { forced: true, velocity: 0.5, ..AIR });
        assert!(matches!(verdict, Verdict::On([_, most]) if most < 0.1 * WEIGHT), "{verdict:?}");
        let falls = |_, _| Seen { forced: true, velocity: -0.7, above: Some(1.0), ..AIR };
        assert!(matches!(run(falls).0, Verdict::On([_, most]) if most > 0.9 * WEIGHT));
    }

    #[test]
    fn what_is_carried_away_does_not_lie() {
        let held = Seen { forced: true, velocity: 0.0, above: Some(1.0), ..AIR };
        assert_ne!(run(|_, _| Seen { speed: 1.5, ..held }).0, Verdict::Down);
    }

    #[test]
    fn what_stands_is_unloaded_though_its_speed_says_that_it_falls() {
        // The ground carries what the rotors do not, while the speed, without poses, drifts away.
        for drift in [-0.2, -0.5, -2.0, 0.1] {
            let stands = |time, [_, most]: Lift| {
                let force_w = Vector3::new(0.0, 0.0, WEIGHT - most.min(WEIGHT));
                Seen { forced: true, velocity: -1.5 + drift * time, observed_w: Some(force_w), ..AIR }
            };
            assert_eq!(run(stands).0, Verdict::Down, "{drift}");
        }
        // An impossible speed is no reason to carry more: the vehicle may lie upside down while the estimate falls.
        let cannot_be = |_, _| Seen { forced: true, velocity: -20.0, hopeless: true, ..AIR };
        assert!(matches!(run(cannot_be).0, Verdict::On([_, most]) if most < 0.1 * WEIGHT));
        // In the air nothing is felt.
        let falls = |_, _| Seen { forced: true, velocity: -0.7, ..AIR };
        assert!(matches!(run(falls).0, Verdict::On([_, most]) if most > 0.5 * WEIGHT));
    }
}
