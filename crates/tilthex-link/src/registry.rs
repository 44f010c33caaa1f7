//! The list of all links, one entry for each.

#[cfg(feature = "board")]
use crate::board::{Board, BoardParams, Measurements, Micros, Noted};
use crate::{FrameLengths, InertialDue, LinkParams, Outgoing, Severity, Text, VehicleLink};
use core::fmt;
use tilthex_core::{
    Error,
    flight::{MotorCommand, Telemetry},
};
#[cfg(feature = "board")]
use {
    alloc::vec::Vec,
    tilthex_core::{RotorVector, Vehicle},
};

/// Makes [`LinkKind`], [`Link`], [`Complaint`] and [`LinkBoard`] from a list of `Name => "key", "vehicles with this link",
/// "what a vehicle does in flight when no messages arrive any more", host type, board type`.
macro_rules! links {
    ($($(#[$doc:meta])* $kind:ident => $name:literal, $vehicles:literal, $alone:literal, $host:ty, $board:ty;)+) => {
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

        /// The board's end of any link, for a simulated vehicle.
        #[cfg(feature = "board")]
        #[derive(Clone, Debug)]
        #[allow(clippy::large_enum_variant)] // as for `Link`
        pub enum LinkBoard {
            $($(#[$doc])* $kind($board),)+
        }

        #[cfg(feature = "board")]
        impl LinkBoard {
            /// A board that was just powered, for the rotors of a vehicle.
            #[must_use]
            pub fn new(kind: LinkKind, vehicle: &Vehicle, params: BoardParams) -> Self {
                match kind {
                    $(LinkKind::$kind => Self::$kind(<$board>::new(vehicle, params.into())),)+
                }
            }
        }

        #[cfg(feature = "board")]
        impl Board for LinkBoard {
            fn receive(&mut self, bytes: &[u8], now: Micros, out: &mut Vec<u8>) {
                match self { $(Self::$kind(board) => board.receive(bytes, now, out),)+ }
            }
            fn advance(
                &mut self,
                now: Micros,
                dt: f64,
                true_speeds: &RotorVector,
                measure: impl FnOnce() -> Measurements,
                out: &mut Vec<u8>,
            ) {
                match self { $(Self::$kind(board) => board.advance(now, dt, true_speeds, measure, out),)+ }
            }
            fn commands(&self) -> RotorVector {
                match self { $(Self::$kind(board) => board.commands(),)+ }
            }
            fn noted(&self) -> Noted {
                match self { $(Self::$kind(board) => board.noted(),)+ }
            }
        }
    };
}

links! {
    /// The serial protocol of the Telekyb3 family.
    Tk3 => "tk3", "mkfl, flymu, chimera or teensy with a version",
        "falls back to its lowest speeds after 0.5 s and stops its motors 10 s later", crate::tk3::Host,
        crate::tk3::board::Firmware;
    /// PX4 over uXRCE-DDS.
    Px4 => "px4", "a PX4 whose uxrce_dds_client is started for this line",
        "executes PX4's failsafe for the loss of the offboard mode (COM_OF_LOSS_T, COM_OBL_RC_ACT)", crate::px4::Host,
        crate::px4::board::Client;
}
