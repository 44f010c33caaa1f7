//! The flight log: MCAP files of protobuf messages that common viewers read.

mod black_box;
pub(crate) mod convert;
mod fields;
pub(crate) mod file;
mod flight_log;
pub mod messages;
mod reader;
mod scan;
mod unpack;
mod writer;

pub use black_box::BlackBox;
pub use convert::TickMessages;
pub use file::{LogFile, Whereabouts};
pub use flight_log::{Attachments, Epoch, FlightLog, fault_names};
pub use reader::LogReader;
pub use scan::{Channel, Cut};
pub use writer::{Index, LogWriter, Stamp, Topic};
