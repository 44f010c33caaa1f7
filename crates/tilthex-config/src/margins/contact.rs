//! Stable contact: the stiffnesses of an elastic environment at which contact of the tool is stable.

use super::model::{LoopModel, Matrix, Number, real, unstable};
use tilthex_core::{Matrix6, Vector3, types::Vector6};

/// The largest stiffness that is examined, N/m and N m/rad.
const STIFFEST: f64 = 1e6;
/// Each apparent mass that is tried, divided by the one before; and the smallest, divided by the configured one.
const SMALLER: f64 = 0.9;
const SMALLEST: f64 = 1e-3;

/// An elastic environment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Contact {
    /// How it holds the tool.
    pub hold: Hold,
    /// Its damping divided by its stiffness, s; 0 is the worst.
    pub damping_time: f64,
}

/// How an environment holds the tool.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Hold {
    /// The tip pushes against a surface without friction. The vector is the surface's normal, world.
    Along(Vector3),
    /// The environment resists turning of the tool about this axis, world, while a spring (N/m) and a damper (N s/m) hold
    /// its tip.
    About(Vector3, [f64; 2]),
}

/// Stiffnesses at which contact is stable.
#[derive(Clone, Debug, PartialEq)]
pub struct StiffnessRange {
    /// Ranges from and to, N/m or N m/rad, rising. A range that ends at 1e6 (the largest that is examined) has no end.
    pub stable: Vec<(f64, f64)>,
}

impl StiffnessRange {
    /// The stiffness up to which all contact is stable, N/m or N m/rad; 0 if no contact is.
    #[must_use]
    pub fn border(&self) -> f64 {
        self.stable.first().map_or(0.0, |(from, to)| if *from == 0.0 { *to } else { 0.0 })
    }

    /// Whether contact of this stiffness is stable.
    #[must_use]
    pub fn holds(&self, stiffness: f64) -> bool {
        self.stable.iter().any(|(from, to)| (*from..*to).contains(&stiffness))
    }
}

impl Contact {
    /// A surface without damping and friction, with the normal `normal_w` (world).
    #[must_use]
    pub fn along(normal_w: Vector3) -> Self {
        Self { hold: Hold::Along(normal_w), damping_time: 0.0 }
    }
}

impl LoopModel {
    /// The stiffnesses of an environment at which contact is stable.
    #[must_use]
    pub fn contact(&self, contact: Contact) -> StiffnessRange {
        // A point contact exerts only a force. The small torque that is observed with it stays in the dead zone.
        let turns = matches!(contact.hold, Hold::About(..)) || self.params.torque_dead_zone == 0.0;
        let (direction, tip) = match contact.hold {
            Hold::Along(n) => (Vector6::new(n.x, n.y, n.z, 0.0, 0.0, 0.0), [0.0; 2]),
            Hold::About(n, tip) => (Vector6::new(0.0, 0.0, 0.0, n.x, n.y, n.z), tip),
        };
        let direction = direction.normalize().map(|x| Number::new(x, 0.0));
        let holds = real(&Matrix6::from_diagonal(&Vector6::new(1.0, 1.0, 1.0, 0.0, 0.0, 0.0)));
        let model = self.with_springs();
        // The tool's response to the environment, and the characteristic function without the environment.
        let value = |frequency: f64| {
            let at = model.at(frequency, [true, turns]);
            let free = model.compliance(&at)?;
            let with_tip = Matrix::identity() + free * holds * (at.s * tip[1] + tip[0]);
            let answer = (direction.transpose() * with_tip.try_inverse()? * free * direction)[(0, 0)];
            let characteristic = model.characteristic(&at, true) * with_tip.determinant();
            Some((answer * (at.s * contact.damping_time + 1.0), characteristic))
        };
        let found = model.frequencies().filter_map(|frequency| Some((frequency, value(frequency)?)));
        let (answers, characteristic): (Vec<_>, Vec<_>) = found.map(|(w, (a, c))| (a, (w, c))).unzip();
        let one = Number::new(1.0, 0.0);
        let poles = unstable(&characteristic, |frequency| value(frequency).map_or(one, |found| found.1));
        ranges(poles, &answers)
    }

    /// The worst direction and its stiffness range, of the 13 axes through a cube's faces, edges and corners.
    #[must_use]
    pub fn worst_contact(&self, damping_time: f64) -> (Vector3, StiffnessRange) {
        let steps = [-1.0, 0.0, 1.0];
        let all = steps.iter().flat_map(|x| steps.iter().flat_map(move |y| steps.map(|z| [*x, *y, z])));
        let half = all.filter(|d| d.iter().find(|x| **x != 0.0).is_some_and(|x| *x > 0.0));
        let found = half.map(|d| {
            let direction = Vector3::from(d).normalize();
            (direction, self.contact(Contact { hold: Hold::Along(direction), damping_time }))
        });
        found
            .min_by(|a, b| a.1.border().total_cmp(&b.1.border()))
            .unwrap_or((Vector3::z(), StiffnessRange { stable: Vec::new() }))
    }

    /// The least apparent mass, kg, along a world axis (0, 1, 2) with which contact along this axis is stable at every
    /// stiffness up to `stiffness`, N/m. `damping_time` is that of the environment, s. The mass is reduced from the
    /// configured one; the filter's damping stays. Infinite if contact with the configured mass is not stable; 0 if it is
    /// stable with every mass down to a thousandth of it.
    #[must_use]
    pub fn least_apparent_mass(&self, axis: usize, stiffness: f64, damping_time: f64) -> f64 {
        let mut direction = Vector3::zeros();
        direction[axis] = 1.0;
        let contact = Contact { hold: Hold::Along(direction), damping_time };
        let configured = self.params.admittance.mass[(axis, axis)];
        let suffices = |mass: f64| {
            let mut model = self.clone();
            model.params.admittance.mass[(axis, axis)] = mass;
            model.contact(contact).border() >= stiffness
        };
        let (mut mass, mut least) = (configured, f64::INFINITY);
        while mass > SMALLEST * configured {
            if !suffices(mass) {
                return least;
            }
            least = mass;
            mass *= SMALLER;
        }
        0.0
    }

    /// The same model with a very weak spring added. A filter without springs drifts, and this pole at zero would count as
    /// unstable although it has nothing to do with contact.
    fn with_springs(&self) -> Self {
        let mut model = self.clone();
        let stiffness = &mut model.params.admittance.stiffness;
        for i in 0..6 {
            stiffness[(i, i)] += 1e-3;
        }
        model
    }
}

/// The stable ranges, from the number of unstable poles without the environment and the tool's response over the
/// frequency: a spring k puts a pair of poles on the imaginary axis at the frequency at which the response is -1/k.
fn ranges(mut unstable: usize, answers: &[Number]) -> StiffnessRange {
    let mut borders: Vec<(f64, bool)> = answers
        .windows(2)
        .filter(|w| (w[0].im > 0.0) != (w[1].im > 0.0))
        .filter_map(|w| {
            let re = w[0].re + (w[1].re - w[0].re) * w[0].im / (w[0].im - w[1].im);
            // If the response crosses the real axis upwards, a stiffer spring moves the pair to the right.
            (re < 0.0).then_some((-1.0 / re, w[1].im > w[0].im))
        })
        .filter(|(stiffness, _)| *stiffness < STIFFEST)
        .collect();
    borders.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (mut stable, mut from) = (Vec::new(), (unstable == 0).then_some(0.0));
    for (stiffness, rises) in borders {
        unstable = if rises { unstable + 2 } else { unstable.saturating_sub(2) };
        match (from, unstable) {
            (Some(begin), 1..) => {
                stable.push((begin, stiffness));
                from = None;
            }
            (None, 0) => from = Some(stiffness),
            _ => {}
        }
    }
    stable.extend(from.map(|begin| (begin, STIFFEST)));
    StiffnessRange { stable }
}
