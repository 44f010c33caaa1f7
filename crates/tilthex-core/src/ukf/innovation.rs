//! The innovation of a measured pose, and its effect on mean and covariance.

use super::{
    UkfState,
    matrix::{Column, LANES},
    sigma::{ACCELEROMETER_BIAS, GYRO_BIAS, POSITION, ROTATION, VELOCITY, part},
};
use crate::{
    so3,
    types::{Matrix3, Vector3},
};

/// The difference between a measurement and its prediction, prepared for the correction.
#[derive(Clone, Copy, Debug)]
pub struct Innovation<const M: usize> {
    /// Measured minus predicted, SI units.
    pub residual: [f64; M],
    /// Its predicted standard deviations.
    pub deviation: [f64; M],
    /// Whitened: `L^-1 y` with `L L^T` the covariance of the innovation. Its squared norm is chi-square with `M`
    /// degrees of freedom; that of its first `m` entries is chi-square with `m`.
    pub whitened: [f64; M],
    gains: [Column; M],
}

impl<const M: usize> Innovation<M> {
    /// Normalised innovation squared of the first `m` entries.
    #[must_use]
    pub fn squared(&self, m: usize) -> f64 {
        self.whitened.iter().take(m).map(|x| x * x).sum()
    }
}

/// Covariance of a measured pose of the IMU: (position, rotation), m and rad, world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseNoise([[f64; 6]; 6]);

impl PoseNoise {
    /// The covariance for a captured body that is measured with the deviations `position` (m) and `rotation` (rad)
    /// per axis, and whose origin is at `offset_w` from the IMU. An error in rotation moves the IMU on that lever
    /// arm.
    #[must_use]
    pub fn new(position: f64, rotation: f64, offset_w: &Vector3) -> Self {
        let variance = rotation * rotation;
        // p_I = p_C - exp(n) R c: the error of p_I is n_p + hat(R c) n.
        let arm = so3::hat(offset_w);
        let arm_squared = variance * arm * arm.transpose();
        let cross = variance * arm;
        let mut noise = [[0.0; 6]; 6];
        for j in 0..3 {
            for i in 0..3 {
                let same = if i == j { 1.0 } else { 0.0 };
                noise[j][i] = arm_squared[(i, j)] + same * position * position;
                noise[j][i + 3] = cross[(j, i)];
                noise[j + 3][i] = cross[(i, j)];
                noise[j + 3][i + 3] = same * variance;
            }
        }
        Self(noise)
    }

    /// With all deviations multiplied by `factor`.
    #[must_use]
    pub fn scaled(&self, factor: f64) -> Self {
        Self(self.0.map(|row| row.map(|x| x * factor * factor)))
    }
}

impl UkfState {
    /// Whitens `y`, the measured minus the predicted values of the error-state entries `rows`, measured with `noise`
    /// (lower triangle).
    fn innovation<const M: usize>(
        &self,
        rows: [usize; M],
        y: &[f64; M],
        noise: &[[f64; M]; M],
    ) -> Option<Innovation<M>> {
        let p = &self.covariance;
        let mut gains = [[0.0; LANES]; M];
        let (mut whitened, mut deviation) = ([0.0; M], [0.0; M]);
        let mut l = [[0.0; M]; M];
        // Indices are limited to their range, because the optimiser cannot prove the range of a caller's rows.
        for (j, row) in rows.iter().enumerate() {
            let mut column = p.whole_column(*row);
            let mut s: [f64; M] =
                core::array::from_fn(|i| column[rows[i].min(LANES - 1)] + noise[j.min(i)][j.max(i)]);
            let entry = s[j];
            deviation[j] = libm::sqrt(entry);
            let mut e = y[j];
            for k in 0..j {
                let factor = l[k][j];
                for (x, g) in column.iter_mut().zip(&gains[k]) {
                    *x -= factor * g;
                }
                for (x, g) in s.iter_mut().zip(&l[k]) {
                    *x -= factor * g;
                }
                e -= factor * whitened[k];
            }
            if !(s[j] > 1e-15 * entry && s[j].is_finite()) {
                return None;
            }
            let scale = 1.0 / libm::sqrt(s[j]);
            l[j] = s.map(|x| x * scale);
            gains[j] = column.map(|x| x * scale);
            whitened[j] = e * scale;
        }
        let finite = whitened.iter().all(|x| x.is_finite());
        finite.then_some(Innovation { residual: *y, deviation, whitened, gains })
    }

    /// The innovation of a pose of the IMU, measured with `noise`; the first three entries are those of the position.
    /// None if it is not finite.
    #[must_use]
    pub fn pose_innovation(
        &self,
        position_w: &Vector3,
        rotation_wi: &Matrix3,
        noise: &PoseNoise,
    ) -> Option<Innovation<6>> {
        let dp = position_w - self.mean.position_w;
        let dr = so3::log(&(rotation_wi * self.mean.rotation_wi.transpose()));
        let rows = [POSITION, POSITION + 1, POSITION + 2, ROTATION, ROTATION + 1, ROTATION + 2];
        self.innovation(rows, &[dp.x, dp.y, dp.z, dr.x, dr.y, dr.z], &noise.0)
    }

    /// The innovation of a position of the IMU, measured with this variance per axis.
    #[must_use]
    pub fn position_innovation(&self, position_w: &Vector3, variance: f64) -> Option<Innovation<3>> {
        let dp = position_w - self.mean.position_w;
        let noise = [[variance, 0.0, 0.0], [0.0, variance, 0.0], [0.0, 0.0, variance]];
        self.innovation([POSITION, POSITION + 1, POSITION + 2], &[dp.x, dp.y, dp.z], &noise)
    }

    /// Corrects mean and covariance with an innovation.
    pub fn apply<const M: usize>(&mut self, innovation: &Innovation<M>) {
        let mut step = [0.0; LANES];
        for (gain, e) in innovation.gains.iter().zip(&innovation.whitened) {
            for (x, g) in step.iter_mut().zip(gain) {
                *x += e * g;
            }
        }
        self.covariance.downdate(&innovation.gains);
        let mean = &mut self.mean;
        mean.gyro_bias_i += part(&step, GYRO_BIAS);
        mean.accelerometer_bias_i += part(&step, ACCELEROMETER_BIAS);
        mean.velocity_w += part(&step, VELOCITY);
        mean.position_w += part(&step, POSITION);
        mean.rotation_wi = so3::exp(&part(&step, ROTATION)) * mean.rotation_wi;
        self.make_definite();
    }
}
