//! The flight log: MCAP files of protobuf messages that common viewers read.

mod black_box;
mod fields;
pub(crate) mod file;
mod flight_log;
pub(crate) mod messages;
mod reader;
mod scan;
pub(crate) mod schema;
mod unpack;
mod value;
#[rustfmt::skip]
mod values;
mod viewers;
mod writer;

pub use black_box::BlackBox;
pub use file::{LogFile, Whereabouts};
pub use flight_log::{Attachments, Epoch, FlightLog, TickMessage, fault_names, tick_messages};
pub use reader::LogReader;
pub use scan::{Channel, Cut};
pub use schema::{DescribedChannel, DescribedField, described};
pub use writer::{Index, LogWriter, Topic};
