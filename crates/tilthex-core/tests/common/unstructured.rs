//! The filter's prediction with every sigma point evaluated: what the filter's
//! structure must equal, and the price that it saves. Shared by tests and benchmarks.
use nalgebra::{SMatrix, SVector};
use tilthex_core::{
    GRAVITY, Vector3, so3,
    ukf::{Covariance, Navigation, ProcessNoise},
};

pub type Error = SVector<f64, 15>;

/// Which points, with their weights.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Points {
    /// A pair on every axis and the centre: 31.
    Pairs,
    /// A regular simplex on a sphere and the centre: 17 (Julier 2003, in the equal-weight form).
    Simplex,
}

fn part(error: &Error, first: usize) -> Vector3 {
    error.fixed_rows::<3>(first).into_owned()
}

pub fn retract(mean: &Navigation, e: &Error) -> Navigation {
    Navigation {
        position_w: mean.position_w + part(e, 0),
        velocity_w: mean.velocity_w + part(e, 3),
        rotation_wi: so3::exp(&part(e, 6)) * mean.rotation_wi,
        gyro_bias_i: mean.gyro_bias_i + part(e, 9),
        accelerometer_bias_i: mean.accelerometer_bias_i + part(e, 12),
    }
}

pub fn difference(a: &Navigation, b: &Navigation) -> Error {
    let mut e = Error::zeros();
    e.fixed_rows_mut::<3>(0).copy_from(&(a.position_w - b.position_w));
    e.fixed_rows_mut::<3>(3).copy_from(&(a.velocity_w - b.velocity_w));
    e.fixed_rows_mut::<3>(6).copy_from(&so3::log(&(a.rotation_wi * b.rotation_wi.transpose())));
    e.fixed_rows_mut::<3>(9).copy_from(&(a.gyro_bias_i - b.gyro_bias_i));
    e.fixed_rows_mut::<3>(12).copy_from(&(a.accelerometer_bias_i - b.accelerometer_bias_i));
    e
}

pub fn model(x: &Navigation, gyro: &Vector3, force: &Vector3, dt: f64) -> Navigation {
    let turned = x.rotation_wi * so3::exp(&((gyro - x.gyro_bias_i) * dt));
    let a = 0.5 * (x.rotation_wi + turned) * (force - x.accelerometer_bias_i) - Vector3::z() * GRAVITY;
    Navigation {
        position_w: x.position_w + x.velocity_w * dt + 0.5 * dt * dt * a,
        velocity_w: x.velocity_w + dt * a,
        rotation_wi: turned,
        ..*x
    }
}

/// The points of the unit covariance about the origin, without the centre.
fn unit_points(points: Points) -> Vec<Error> {
    match points {
        Points::Pairs => {
            (0..15).flat_map(|j| [1.0, -1.0].map(|sign| Error::ith(j, sign * 15f64.sqrt()))).collect()
        }
        Points::Simplex => (0..16)
            .map(|k| {
                Error::from_fn(|j, _| {
                    // Vertices of a regular simplex with unit covariance.
                    let scale = (16.0 / ((j + 1) * (j + 2)) as f64).sqrt();
                    if k < j + 1 {
                        -scale
                    } else if k == j + 1 {
                        scale * (j + 1) as f64
                    } else {
                        0.0
                    }
                })
            })
            .collect(),
    }
}

/// Square of the points' scale.
const ALPHA_SQUARED: f64 = 0.2;

/// The order in which the covariance is factored: gyro bias, rotation, accelerometer bias, velocity, position.
const ORDER: [usize; 15] = [9, 10, 11, 6, 7, 8, 12, 13, 14, 3, 4, 5, 0, 1, 2];

pub fn predict(
    points: Points,
    mean: &Navigation,
    covariance: &Covariance,
    noise: &ProcessNoise,
    (gyro, force): (&Vector3, &Vector3),
    dt: f64,
) -> (Navigation, Covariance) {
    let ordered = Covariance::from_fn(|i, j| covariance[(ORDER[i], ORDER[j])]);
    let l = ordered.cholesky().expect("positive definite").l();
    let next = model(mean, gyro, force, dt);
    let unit = unit_points(points);
    let moved: Vec<Error> = unit
        .iter()
        .map(|u| {
            let inner = l * u * ALPHA_SQUARED.sqrt();
            let mut e = Error::zeros();
            for i in 0..15 {
                e[ORDER[i]] = inner[i];
            }
            difference(&model(&retract(mean, &e), gyro, force, dt), &next)
        })
        .collect();
    let weight = 1.0 / (ALPHA_SQUARED * unit.len() as f64);
    let centre = moved.iter().sum::<Error>() * weight;
    // The centre moves to zero; beta = 2.
    let mut p = (1.0 - 1.0 / ALPHA_SQUARED + 3.0 - ALPHA_SQUARED) * centre * centre.transpose();
    for e in &moved {
        let d = e - centre;
        p += weight * d * d.transpose();
    }
    (next, p + process_noise(noise, dt))
}

fn process_noise(noise: &ProcessNoise, dt: f64) -> SMatrix<f64, 15, 15> {
    let mut q = SMatrix::<f64, 15, 15>::zeros();
    for i in 0..3 {
        let a = noise.accelerometer.powi(2);
        q[(i, i)] = a * dt.powi(3) / 3.0;
        q[(i, 3 + i)] = a * dt * dt / 2.0;
        q[(3 + i, i)] = a * dt * dt / 2.0;
        q[(3 + i, 3 + i)] = a * dt;
        q[(6 + i, 6 + i)] = noise.gyro.powi(2) * dt;
        q[(9 + i, 9 + i)] = noise.gyro_bias.powi(2) * dt;
        q[(12 + i, 12 + i)] = noise.accelerometer_bias.powi(2) * dt;
    }
    q
}
