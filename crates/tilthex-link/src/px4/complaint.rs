//! Sentences for the operator that say why the link is not ready.

use super::{esc_status::EscStatus, topics::Topic};
use core::fmt;

/// Why the link is not ready.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Complaint {
    /// PX4 does not publish the topic.
    Missing(Topic),
    /// A topic arrives at too low a rate.
    Slow {
        /// The topic.
        topic: Topic,
        /// Its rate, Hz.
        found: f64,
        /// The expected rate, Hz.
        expected: f64,
    },
    /// The messages of the topic have a form that the link does not know.
    Unreadable(Topic),
    /// PX4 does not subscribe to the topic.
    Unwanted(Topic),
    /// PX4 is armed, and this link has not armed it.
    Armed,
}

impl fmt::Display for Complaint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        const FILE: &str = "src/modules/uxrce_dds_client/dds_topics.yaml";
        let add = |f: &mut fmt::Formatter<'_>, topic: Topic, to: &str| {
            write!(
                f,
                "add to `{to}` in PX4's {FILE} the two lines `- topic: {}` and `type: {}`, and build PX4 again",
                topic.name(),
                topic.kind()
            )
        };
        match *self {
            Self::Missing(topic) => {
                write!(f, "PX4 does not publish {}; the link needs it: ", topic.name())?;
                add(f, topic, "publications:")
            }
            Self::Unwanted(topic) => {
                write!(f, "PX4 does not subscribe to {}; the link needs it: ", topic.name())?;
                add(f, topic, "subscriptions:")
            }
            Self::Slow { topic, found, expected } => {
                write!(
                    f,
                    "{} arrives at {found:.0} Hz; expected {expected:.0} Hz: in PX4's {FILE} write `rate_limit: 1000.` below \
                     `type: {}` (before version 1.16: set UXRCE_DEFAULT_POLL_RATE to 1), and build PX4 again; use a faster line; \
                     or lower the rate in [link]",
                    topic.name(),
                    topic.kind()
                )?;
                let parameter =
                    if topic == Topic::SensorCombined { "; IMU_INTEG_RATE must be as high" } else { "" };
                f.write_str(parameter)
            }
            Self::Armed => f.write_str(
                "PX4 is armed, and a pilot or PX4 itself may fly the vehicle; expected a disarmed vehicle: land it and disarm it",
            ),
            Self::Unreadable(topic) => write!(
                f,
                "the messages of {} do not have the form of PX4 1.15 and 1.16 (in these versions esc_status has {} bytes): use one of \
                 these versions",
                topic.name(),
                EscStatus::LENGTH
            ),
        }
    }
}
