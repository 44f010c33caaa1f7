//! The black box: keeps the last seconds of a flight in memory, and writes them to a separate file after a fault.

use std::{fs::File, io::BufWriter};

use mcap::{Compression, McapError, MessageStream, WriteOptions};

use super::{
    flight_log::{Attachments, CONFIG, Epoch, FlightLog},
    writer::Index,
};
use tilthex_sim::{Truth, feed::Tick};

/// Least time that is kept, s.
pub(super) const KEPT: f64 = 10.0;
/// The memory is a chain of logs of this length, s. The oldest log is dropped as a whole.
const SEGMENT: f64 = 0.5;
const FINISHED: usize = (KEPT / SEGMENT) as usize;

/// The last seconds of a flight.
pub struct BlackBox {
    finished: std::collections::VecDeque<Vec<u8>>,
    current: Option<(f64, FlightLog<Vec<u8>>)>,
    epoch: Epoch,
    rotor_count: usize,
    attachments: Attachments,
}

impl BlackBox {
    /// An empty memory.
    #[must_use]
    pub fn new(epoch: Epoch, rotor_count: usize, attachments: Attachments) -> Self {
        Self { finished: Default::default(), current: None, epoch, rotor_count, attachments }
    }

    fn log(&mut self, time: f64) -> Result<&mut FlightLog<Vec<u8>>, McapError> {
        if self.current.as_ref().is_some_and(|(begun, _)| time - begun >= SEGMENT) {
            self.close()?;
        }
        if self.current.is_none() {
            // If the memory is full, the newest log takes the memory of the oldest, so that it does not grow.
            let full = self.finished.len() > FINISHED;
            let mut room = if full { self.finished.pop_front().unwrap_or_default() } else { Vec::new() };
            room.clear();
            let log = FlightLog::new(room, Index::LeftOut, self.epoch, self.rotor_count, &self.attachments)?;
            self.current = Some((time, log));
        }
        match &mut self.current {
            Some((_, log)) => Ok(log),
            None => unreachable!("it was begun above"),
        }
    }

    fn close(&mut self) -> Result<(), McapError> {
        if let Some((_, log)) = self.current.take() {
            let mut segment = log.finish()?;
            segment.shrink_to(segment.len() + segment.len() / 16);
            self.finished.push_back(segment);
        }
        Ok(())
    }

    /// Keeps a tick.
    ///
    /// # Errors
    /// None in practice, because it writes to memory.
    pub fn tick(&mut self, tick: &Tick) -> Result<(), McapError> {
        self.log(tick.record.input.time)?.tick(tick)
    }

    /// Keeps a true state of the simulated vehicle.
    ///
    /// # Errors
    /// None in practice, because it writes to memory.
    pub fn truth(&mut self, time: f64, truth: &Truth) -> Result<(), McapError> {
        self.log(time)?.truth(time, truth)
    }

    /// Writes all that it keeps to a file.
    ///
    /// # Errors
    /// Errors of the file.
    pub fn dump(&mut self, file: File) -> Result<(), McapError> {
        self.close()?;
        let options = WriteOptions::new().compression(Some(Compression::Lz4));
        let mut out = options.create(BufWriter::new(file))?;
        out.attach(&mcap::Attachment {
            log_time: 0,
            create_time: 0,
            name: CONFIG.into(),
            media_type: "application/toml".into(),
            data: self.attachments.config.as_bytes().into(),
        })?;
        for segment in &self.finished {
            for message in MessageStream::new(segment)? {
                out.write(&message?)?;
            }
        }
        out.finish()?;
        Ok(())
    }
}
