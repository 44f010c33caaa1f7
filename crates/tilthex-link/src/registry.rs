//! The links there are: one line each.

use crate::{FrameLengths, InertialDue, LinkParams, Outgoing, Severity, Text, VehicleLink, tk3};
use tilthex_core::{
    Error,
    flight::{MotorCommand, Telemetry},
};

/// Makes [`LinkKind`] and [`Link`] from a list of `Name => "key", host type`.
macro_rules! links {
    ($($(#[$doc:meta])* $kind:ident => $name:literal, $host:ty;)+) => {
        /// Which link a vehicle speaks.
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
        }

        /// The host's end of any link.
        #[derive(Clone, Debug)]
        pub enum Link {
            $($(#[$doc])* $kind($host),)+
        }

        impl Link {
            /// A link over which nothing came yet, for a vehicle with `rotor_count` rotors.
            ///
            /// # Errors
            /// A stream period that cannot be.
            pub fn new(kind: LinkKind, params: LinkParams, rotor_count: usize) -> Result<Self, Error> {
                match kind {
                    $(LinkKind::$kind => <$host>::new(params, rotor_count).map(Self::$kind),)+
                }
            }
        }

        impl VehicleLink for Link {
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
        }
    };
}

links! {
    /// The serial protocol of the Telekyb3 family.
    Tk3 => "tk3", tk3::Host;
}
