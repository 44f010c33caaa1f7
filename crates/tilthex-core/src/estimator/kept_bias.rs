//! The bias of the gyro while a model replaces the gyro.
//!
//! During this time, the entry of the gyro bias in the filter holds the error of the model's rate, which poses
//! correct. It says nothing about the gyro. When the gyro is used again, its own bias is restored.

use super::{Head, Quality};
use crate::{
    types::Vector3,
    ukf::{GyroBias, Navigation},
};

/// The bias of the gyro if the state does not hold it: mean and deviation. Single precision, because every checkpoint
/// has a copy.
#[derive(Clone, Copy, Debug)]
pub(super) struct KeptBias(Option<[f32; 4]>);

impl KeptBias {
    pub(super) const NONE: Self = Self(None);

    /// Whether a model replaces the gyro.
    pub(super) fn is_some(&self) -> bool {
        self.0.is_some()
    }

    /// The bias of the gyro, rad/s, IMU axes, if the state does not hold it.
    pub(super) fn mean_i(&self) -> Option<Vector3> {
        self.0.map(|[x, y, z, _]| Vector3::new(x.into(), y.into(), z.into()))
    }

    /// Before a sample is applied: keeps the bias of the gyro, or returns it when it is used again.
    fn pass(&mut self, quality: Quality, now: impl FnOnce() -> GyroBias) -> Option<GyroBias> {
        if quality.is_modelled() {
            self.0.get_or_insert_with(|| {
                let GyroBias { mean_i, deviation } = now();
                [mean_i.x, mean_i.y, mean_i.z, deviation].map(|x| x as f32)
            });
            return None;
        }
        let [x, y, z, deviation] = self.0.take()?.map(f64::from);
        Some(GyroBias { mean_i: Vector3::new(x, y, z), deviation })
    }

    /// As [`pass`](Self::pass), for the mean only.
    pub(super) fn pass_mean(&mut self, quality: Quality, mean: &mut Navigation) {
        if let Some(bias) = self.pass(quality, || GyroBias { mean_i: mean.gyro_bias_i, deviation: 0.0 }) {
            mean.gyro_bias_i = bias.mean_i;
        }
    }
}

impl Head {
    /// Keeps or restores the bias of the filter before the next sample.
    pub(super) fn pass_bias(&mut self, quality: Quality) {
        if let Some(bias) = self.kept_bias.pass(quality, || self.state.gyro_bias()) {
            self.state.set_gyro_bias(&bias);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        GRAVITY,
        estimator::{Estimator, EstimatorParams},
        types::{Matrix3, PoseSample},
    };

    /// The bias that was learnt is there again when the gyro returns, also if the motion was doubted meanwhile.
    #[test]
    fn a_doubted_motion_leaves_the_bias() {
        let (place_w, level) = (Vector3::new(0.0, 0.0, 1.0), Matrix3::identity());
        let bias = Vector3::new(0.02, -0.01, 0.015);
        let mut estimator = Estimator::new(EstimatorParams::default()).unwrap();
        estimator.initialize(0.0, &place_w, &level).unwrap();
        let force = GRAVITY * Vector3::z();
        let mut time = 0.0;
        let mut go =
            |estimator: &mut Estimator, quality, gyro: &Vector3, rotation_wr: Matrix3, ticks: usize| {
                for k in 0..ticks {
                    time += 0.002;
                    estimator.predict_as(quality, time, gyro, &force);
                    if k % 5 == 0 {
                        let pose = PoseSample {
                            time,
                            arrival: time,
                            position_w: place_w,
                            rotation_wr,
                            tracking_valid: true,
                        };
                        estimator.update_pose(&pose);
                    }
                }
            };
        go(&mut estimator, Quality::Measured, &bias, level, 4000);
        let before = estimator.navigation().gyro_bias_i;
        assert!((before - bias).norm() < 5e-3, "{before}");
        // The model turns, and the frozen poses do not: the model's rate seems to have a large error.
        go(&mut estimator, Quality::Modelled, &Vector3::new(0.0, 0.4, 0.0), level, 300);
        assert!((estimator.navigation().gyro_bias_i - before).norm() > 0.1);
        assert!((estimator.own_gyro_bias() - before).norm() < 1e-6);
        estimator.doubt_motion();
        go(&mut estimator, Quality::Modelled, &Vector3::zeros(), level, 2);
        go(&mut estimator, Quality::Measured, &bias, level, 2);
        let after = estimator.navigation().gyro_bias_i;
        assert!((after - before).norm() < 5e-3, "{before} {after}");
    }
}
