//! VRPN trackers over TCP, client and server. Vicon Tracker, Qualisys, NOKOV and Motive are such servers. Both sides first
//! send a cookie, then messages. A message is a header of 24 bytes, big-endian, and a payload padded to a multiple of 8
//! bytes. The server chooses the ids of senders and types, and announces the name of each id.

use super::{
    Malformed,
    bytes::{Reader, Writer},
};

/// The port of a VRPN server.
pub const PORT: u16 = 3883;
/// The bytes that both sides send first.
pub const COOKIE: [u8; 24] = *b"vrpn: ver. 07.38  0\0\0\0\0\0";
/// The type of a tracker's pose.
pub const POSE_TYPE: &[u8] = b"vrpn_Tracker Pos_Quat";
/// Longest message that is read, bytes. Longer messages are skipped.
pub const MAX_MESSAGE: usize = 512;
/// Largest plausible length of a message, bytes. If a message announces more, the stream is not VRPN.
const MAX_LENGTH: usize = 1 << 20;

const HEADER: usize = 24;
const SENDER_DESCRIPTION: i32 = -1;
const TYPE_DESCRIPTION: i32 = -2;

/// Checks the other side's cookie.
///
/// # Errors
/// If it is not a cookie, or its major version is not 7.
pub fn check_cookie(cookie: &[u8; COOKIE.len()]) -> Result<(), Malformed> {
    // "vrpn: ver. 07": the minor version may differ.
    let significant = COOKIE.iter().zip(cookie).take(13).all(|(ours, theirs)| ours == theirs);
    significant.then_some(()).ok_or(Malformed("VRPN cookie"))
}

/// A message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Message<'a> {
    /// Its time on the sender's clock: seconds, and microseconds to be added.
    pub time: (u32, u32),
    /// Id of its sender.
    pub sender: i32,
    /// Id of its type. Ids below 0 belong to the protocol itself.
    pub kind: i32,
    /// Its content, without padding.
    pub payload: &'a [u8],
}

/// A tracker's pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrackerPose {
    /// The sensor of the tracker.
    pub sensor: i32,
    /// Position, m, in the capture system's axes.
    pub position: [f64; 3],
    /// Rotation, as a quaternion x, y, z, w.
    pub quaternion_xyzw: [f64; 4],
}

/// Announces the name of an id.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Description<'a> {
    /// Of a sender, such as a tracker.
    Sender(i32, &'a [u8]),
    /// Of a type of message.
    Type(i32, &'a [u8]),
}

impl<'a> Message<'a> {
    /// The time, s, on the sender's clock.
    #[must_use]
    pub fn seconds(&self) -> f64 {
        f64::from(self.time.0) + 1e-6 * f64::from(self.time.1)
    }

    /// The name that the message announces, if it announces one.
    #[must_use]
    pub fn description(&self) -> Option<Description<'a>> {
        let (length, text) = self.payload.split_first_chunk()?;
        let length = usize::try_from(i32::from_be_bytes(*length)).ok()?;
        let name = text.get(..length)?.split(|&byte| byte == 0).next()?;
        match self.kind {
            SENDER_DESCRIPTION => Some(Description::Sender(self.sender, name)),
            TYPE_DESCRIPTION => Some(Description::Type(self.sender, name)),
            _ => None,
        }
    }

    /// The payload as a tracker's pose.
    ///
    /// # Errors
    /// If its length is not that of a pose.
    pub fn pose(&self) -> Result<TrackerPose, Malformed> {
        let mut reader = Reader::new(self.payload);
        let mut read = || {
            let sensor = reader.array().map(i32::from_be_bytes)?;
            reader.skip(1, 4)?;
            let mut numbers = [0.0; 7];
            for number in &mut numbers {
                *number = reader.array().map(f64::from_be_bytes)?;
            }
            let [px, py, pz, x, y, z, w] = numbers;
            let pose = TrackerPose { sensor, position: [px, py, pz], quaternion_xyzw: [x, y, z, w] };
            reader.rest().is_empty().then_some(pose)
        };
        read().ok_or(Malformed("tracker pose"))
    }
}

const fn padded(length: usize) -> usize {
    length.next_multiple_of(8)
}

/// Finds the messages in a stream of bytes, one byte at a time. The stream begins after the cookie.
#[derive(Clone, Debug)]
pub struct Decoder {
    buffer: [u8; MAX_MESSAGE],
    filled: usize,
    /// Number of bytes of this message that are still missing; `None` until its length is known.
    missing: Option<usize>,
    skipped: u32,
}

impl Default for Decoder {
    fn default() -> Self {
        Self { buffer: [0; MAX_MESSAGE], filled: 0, missing: None, skipped: 0 }
    }
}

impl Decoder {
    /// Takes the next byte, and returns the message if the byte completes one.
    ///
    /// # Errors
    /// If a message has an impossible length: the start of messages is lost, or the stream is not VRPN.
    pub fn push(&mut self, byte: u8) -> Result<Option<Message<'_>>, Malformed> {
        if let Some(slot) = self.buffer.get_mut(self.filled) {
            *slot = byte;
        }
        self.filled += 1;
        let missing = match self.missing {
            Some(missing) => missing - 1,
            None if self.filled < 4 => return Ok(None),
            None => {
                let length = self.length();
                if !(HEADER..=MAX_LENGTH).contains(&length) {
                    *self = Self { skipped: self.skipped, ..Self::default() };
                    return Err(Malformed("VRPN message length"));
                }
                padded(length) - 4
            }
        };
        self.missing = Some(missing);
        if missing > 0 {
            return Ok(None);
        }
        let whole = self.filled <= MAX_MESSAGE;
        self.filled = 0;
        self.missing = None;
        if !whole {
            self.skipped = self.skipped.saturating_add(1);
            return Ok(None);
        }
        Ok(self.message())
    }

    /// Number of messages that were longer than [`MAX_MESSAGE`].
    #[must_use]
    pub fn skipped(&self) -> u32 {
        self.skipped
    }

    fn length(&self) -> usize {
        let [a, b, c, d, ..] = self.buffer;
        u32::from_be_bytes([a, b, c, d]) as usize
    }

    fn message(&self) -> Option<Message<'_>> {
        let mut reader = Reader::new(self.buffer.get(..self.length())?);
        let mut word = || reader.array::<4>();
        word()?;
        let time = (u32::from_be_bytes(word()?), u32::from_be_bytes(word()?));
        let sender = i32::from_be_bytes(word()?);
        let kind = i32::from_be_bytes(word()?);
        word()?;
        Some(Message { time, sender, kind, payload: reader.rest() })
    }
}

/// Writes a message with a sequence number, padded.
/// Returns its length, bytes; 0 if it does not fit.
#[must_use = "the length says what to send"]
pub fn write_message(out: &mut [u8], message: &Message<'_>, sequence: u32) -> usize {
    let mut writer = Writer::new(out);
    let length = HEADER + message.payload.len();
    let words = [
        length as u32,
        message.time.0,
        message.time.1,
        message.sender.cast_unsigned(),
        message.kind.cast_unsigned(),
        sequence,
    ];
    words.iter().for_each(|word| writer.put(&word.to_be_bytes()));
    writer.put(message.payload);
    writer.zeros(padded(length) - length);
    writer.finish()
}

/// Writes a message that announces the name of an id. The name is cut to 99 bytes.
/// Returns the message's length, bytes; 0 if it does not fit.
#[must_use = "the length says what to send"]
pub fn write_description(out: &mut [u8], description: &Description<'_>, sequence: u32) -> usize {
    let (kind, id, name) = match *description {
        Description::Sender(id, name) => (SENDER_DESCRIPTION, id, name),
        Description::Type(id, name) => (TYPE_DESCRIPTION, id, name),
    };
    let mut payload = [0; 4 + 100];
    let name = name.get(..99).unwrap_or(name);
    let mut writer = Writer::new(&mut payload);
    writer.put(&(name.len() as u32 + 1).to_be_bytes());
    writer.put(name);
    writer.zeros(1);
    let length = writer.finish();
    let payload = payload.get(..length).unwrap_or(&[]);
    write_message(out, &Message { time: (0, 0), sender: id, kind, payload }, sequence)
}

/// Writes a tracker's pose as a message, with its time (s, us) and the ids of its sender and its type.
/// Returns its length, bytes; 0 if it does not fit.
#[must_use = "the length says what to send"]
pub fn write_pose(
    out: &mut [u8],
    (sender, kind): (i32, i32),
    time: (u32, u32),
    pose: &TrackerPose,
    sequence: u32,
) -> usize {
    let mut payload = [0; 64];
    let mut writer = Writer::new(&mut payload);
    writer.put(&pose.sensor.to_be_bytes());
    writer.zeros(4);
    pose.position.iter().chain(&pose.quaternion_xyzw).for_each(|number| writer.put(&number.to_be_bytes()));
    write_message(out, &Message { time, sender, kind, payload: &payload }, sequence)
}
