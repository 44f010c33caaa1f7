//! The flight log: MCAP files of protobuf messages that common viewers read.

mod black_box;
pub(crate) mod convert;
mod flight_log;
pub mod messages;
mod reader;
mod writer;

pub use black_box::BlackBox;
pub use convert::TickMessages;
pub use flight_log::{Attachments, Epoch, FlightLog, fault_names};
pub use reader::LogReader;
pub use writer::{Index, LogWriter, Stamp, Topic};
