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
