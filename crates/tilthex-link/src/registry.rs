//! The list of all links, one line for each.

use crate::{FrameLengths, InertialDue, LinkParams, Outgoing, Severity, Text, VehicleLink};
use core::fmt;
use tilthex_core::{
    Error,
    flight::{MotorCommand, Telemetry},
};

/// Makes [`LinkKind`], [`Link`] and [`Complaint`] from a list of `Name => "key", "vehicles with this link", "what a vehicle does in
/// flight when no messages arrive any more", host type`.
macro_rules! links {
    ($($(#[$doc:meta])* $kind:ident => $name:literal, $vehicles:literal, $alone:literal, $host:ty;)+) => {
        /// The link that a vehicle speaks.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum LinkKind {
            $($(#[$doc])* $kind,)+
        }

        impl LinkKind {
            /// Every link.
            pub const ALL: &[Self] = &[$(Self::$kind),+];

            /// Its name in a configuration.
            #[must_use]
            pub const fn name(self) -> &'static str {
                match self {
                    $(Self::$kind => $name,)+
                }
            }

            /// The vehicles with this link, in words.
            #[must_use]
            pub const fn vehicles(self) -> &'static str {
                match self {
                    $(Self::$kind => $vehicles,)+
                }
            }

            /// What its vehicle does in flight when no messages arrive any more, in words.
            #[must_use]
            pub const fn alone(self) -> &'static str {
                match self {
                    $(Self::$kind => $alone,)+
                }
            }
        }

        /// The host's end of any link.
        #[derive(Clone, Debug)]
        #[allow(clippy::large_enum_variant)] // there is one link in a program; a box would allocate
        pub enum Link {
            $($(#[$doc])* $kind($host),)+
        }

        impl Link {
            /// A link that has received no byte, for a vehicle with `rotor_count` rotors.
            ///
            /// # Errors
            /// If the link refuses the period of a stream.
            pub fn new(kind: LinkKind, params: LinkParams, rotor_count: usize) -> Result<Self, Error> {
                match kind {
                    $(LinkKind::$kind => <$host>::new(params, rotor_count).map(Self::$kind),)+
                }
            }
        }

        /// Why any link is not ready, as a sentence for the operator.
        #[derive(Clone, Copy, Debug, PartialEq)]
        pub enum Complaint {
            $($(#[$doc])* $kind(<$host as VehicleLink>::Complaint),)+
        }

        impl fmt::Display for Complaint {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                match self { $(Self::$kind(complaint) => complaint.fmt(f),)+ }
            }
        }

        impl VehicleLink for Link {
            type Complaint = Complaint;

            fn look(&mut self, bytes: &[u8]) -> InertialDue {
                match self { $(Self::$kind(link) => link.look(bytes),)+ }
            }
            fn receive(&mut self, bytes: &[u8], now: f64) -> &Telemetry {
                match self { $(Self::$kind(link) => link.receive(bytes, now),)+ }
            }
            fn telemetry(&self) -> &Telemetry {
                match self { $(Self::$kind(link) => link.telemetry(),)+ }
            }
            fn text(&self) -> Option<(Severity, Text)> {
                match self { $(Self::$kind(link) => link.text(),)+ }
            }
            fn command(&mut self, command: &MotorCommand, now: f64, out: &mut Outgoing) {
                match self { $(Self::$kind(link) => link.command(command, now, out),)+ }
            }
            fn frames(&self) -> FrameLengths {
                match self { $(Self::$kind(link) => link.frames(),)+ }
            }
            fn refused(&self) -> bool {
                match self { $(Self::$kind(link) => link.refused(),)+ }
            }
            fn part(&mut self, out: &mut Outgoing) {
                match self { $(Self::$kind(link) => link.part(out),)+ }
            }
            fn complaint(&self) -> Option<Complaint> {
                match self { $(Self::$kind(link) => link.complaint().map(Complaint::$kind),)+ }
            }
        }
    };
}

links! {
    /// The serial protocol of the Telekyb3 family.
    Tk3 => "tk3", "mkfl, flymu, chimera or teensy with a version",
        "falls back to its lowest speeds after 0.5 s and stops its motors 10 s later", crate::tk3::Host;
    /// PX4 over uXRCE-DDS.
    Px4 => "px4", "a PX4 whose uxrce_dds_client is started for this line",
        "executes PX4's failsafe for the loss of the offboard mode (COM_OF_LOSS_T, COM_OBL_RC_ACT)", crate::px4::Host;
}
