//! Sentences for a person: why the link is not ready.

use super::{esc_status::EscStatus, topics::Topic};
use core::fmt;

/// Why the link is not ready.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Complaint {
    /// PX4 does not send the topic at all.
    Missing(Topic),
    /// It arrives too rarely.
    Slow {
        /// The topic.
        topic: Topic,
        /// How often it arrives, Hz.
        found: f64,
        /// How often it is expected, Hz.
        expected: f64,
    },
    /// Its messages have another form than the link knows.
    Unreadable(Topic),
    /// PX4 does not take the topic.
    Unwanted(Topic),
    /// PX4 is armed, and not by this link.
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
                write!(f, "PX4 does not send {}; expected it: ", topic.name())?;
                add(f, topic, "publications:")
            }
            Self::Unwanted(topic) => {
                write!(f, "PX4 does not take {}; expected it to: ", topic.name())?;
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
                "PX4 is armed, and a pilot or PX4 itself may fly the vehicle; expected it disarmed: land it and disarm it",
            ),
            Self::Unreadable(topic) => write!(
                f,
                "the messages of {} do not have the form of PX4 1.14 to 1.16 (in these versions esc_status has {} bytes): use one of \
                 these versions",
                topic.name(),
                EscStatus::LENGTH
            ),
        }
    }
}
