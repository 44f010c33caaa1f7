//! The same laws with other gains.

use super::{Controller, ControllerParams};
use crate::{
    Error,
    pose_control::{PoseController, PoseGains},
    wrench_observer::{ObserverGains, WrenchObserver},
};

impl Controller {
    /// The same laws with other gains of pose controller and observer.
    ///
    /// # Errors
    /// The first gain that a block refuses.
    pub(crate) fn with_gains(&self, pose: PoseGains, observer: ObserverGains) -> Result<Self, Error> {
        Ok(Self {
            pose: PoseController::new(pose)?,
            observer: WrenchObserver::new(&self.vehicle, observer)?,
            params: ControllerParams { pose, observer, ..self.params },
            ..*self
        })
    }
}
