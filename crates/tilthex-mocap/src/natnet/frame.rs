//! NatNet frames: the data of one moment.

use super::{
    super::{
        Malformed,
        bytes::{Reader, Writer},
    },
    MessageId, Version, end_packet, start_packet,
};

/// Bytes of a rigid body.
const BODY: usize = 38;
/// Bytes of a labelled marker.
const LABELLED_MARKER: usize = 26;
/// Bytes of a marker's position.
const POSITION: usize = 12;
/// Bit that is set if the rigid body was tracked in this frame.
const TRACKING_VALID: u16 = 1;
/// Bit that is set if the list of captured models has changed.
const MODELS_CHANGED: u16 = 2;

/// A rigid body in a frame, in the capture system's axes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RigidBody {
    /// Its id, see [`super::BodyName`].
    pub id: i32,
    /// Position, m, in the capture system's axes.
    pub position: [f32; 3],
    /// Rotation, as a quaternion x, y, z, w.
    pub quaternion_xyzw: [f32; 4],
    /// Mean error of its markers, m.
    pub mean_error: f32,
    /// Whether it was tracked in this frame.
    pub tracking_valid: bool,
}

/// The times at which a frame was taken, received and sent.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FrameTimes {
    /// Time since the capture began, s.
    pub timestamp: f64,
    /// The middle of the exposure, ticks of the server's clock; 0 if the cameras do not send it.
    pub mid_exposure: u64,
    /// Time at which the server had received the cameras' data, ticks of its clock.
    pub received: u64,
    /// Time at which it sent the frame, ticks of its clock.
    pub transmitted: u64,
}

/// A frame of data.
#[derive(Clone, Copy, Debug)]
pub struct Frame<'a> {
    /// Its number.
    pub number: i32,
    /// Its times.
    pub times: FrameTimes,
    /// Whether the list of captured models has changed.
    pub models_changed: bool,
    bodies: &'a [[u8; BODY]],
}

impl<'a> Frame<'a> {
    /// Reads the complete payload, in the layout of a version.
    ///
    /// # Errors
    /// The section that does not have this layout: it ends at a wrong place, or bytes remain after the last one.
    pub fn parse(payload: &'a [u8], version: Version) -> Result<Self, Malformed> {
        let mut reader = Reader::new(payload);
        let number = reader.i32().ok_or(Malformed("frame number"))?;
        let sections = if version.has_sizes() { sized_sections } else { plain_sections };
        let bodies = sections(&mut reader).ok_or(Malformed("list of sections"))?;
        let (times, parameters) = suffix(reader, version).ok_or(Malformed("frame suffix"))?;
        Ok(Self { number, times, models_changed: parameters & MODELS_CHANGED != 0, bodies })
    }

    /// Reads the payload in the layout of a version or, if that does not fit, in the other layout: a server can be set to
    /// send an older version. Returns the version that fits.
    ///
    /// # Errors
    /// The section that does not have the layout of `version`.
    pub fn parse_either(payload: &'a [u8], version: Version) -> Result<(Self, Version), Malformed> {
        let other = if version.has_sizes() { Version::V3_0 } else { Version::V4_1 };
        Self::parse(payload, version)
            .map(|frame| (frame, version))
            .or_else(|refusal| Self::parse(payload, other).map(|frame| (frame, other)).map_err(|_| refusal))
    }

    /// The rigid bodies.
    pub fn bodies(&self) -> impl Iterator<Item = RigidBody> + use<'a> {
        self.bodies.iter().filter_map(|body| rigid_body(&mut Reader::new(body)))
    }

    /// The rigid body with an id.
    #[must_use]
    pub fn body(&self, id: i32) -> Option<RigidBody> {
        self.bodies().find(|body| body.id == id)
    }
}

fn rigid_body(reader: &mut Reader<'_>) -> Option<RigidBody> {
    Some(RigidBody {
        id: reader.i32()?,
        position: reader.f32s()?,
        quaternion_xyzw: reader.f32s()?,
        mean_error: reader.f32s::<1>()?[0],
        tracking_valid: reader.u16()? & TRACKING_VALID != 0,
    })
}

/// The rigid bodies of versions before 4.1: every section must be read to find its end.
fn plain_sections<'a>(reader: &mut Reader<'a>) -> Option<&'a [[u8; BODY]]> {
    for _ in 0..reader.count()? {
        reader.text()?;
        skip_array(reader, POSITION)?;
    }
    skip_array(reader, POSITION)?;
    let count = reader.count()?;
    let bodies = reader.bytes(count.checked_mul(BODY)?)?.as_chunks().0;
    for _ in 0..reader.count()? {
        reader.i32()?;
        skip_array(reader, BODY)?;
    }
    skip_array(reader, LABELLED_MARKER)?;
    // Force plates, then devices. Each of them has an id and channels with samples.
    for _ in 0..2 {
        for _ in 0..reader.count()? {
            reader.i32()?;
            for _ in 0..reader.count()? {
                skip_array(reader, 4)?;
            }
        }
    }
    Some(bodies)
}

/// The rigid bodies of version 4.1 and later: sections announce their sizes and are skipped.
fn sized_sections<'a>(reader: &mut Reader<'a>) -> Option<&'a [[u8; BODY]]> {
    // Marker sets and legacy markers.
    sized_section(reader)?;
    sized_section(reader)?;
    let (count, bytes) = sized_section(reader)?;
    let (bodies, []) = bytes.as_chunks() else { return None };
    // Skeletons, assets, labelled markers, force plates, devices.
    for _ in 0..5 {
        sized_section(reader)?;
    }
    (bodies.len() == count).then_some(bodies)
}

fn sized_section<'a>(reader: &mut Reader<'a>) -> Option<(usize, &'a [u8])> {
    let count = reader.count()?;
    let size = reader.count()?;
    Some((count, reader.bytes(size)?))
}

fn skip_array(reader: &mut Reader<'_>, size: usize) -> Option<()> {
    let count = reader.count()?;
    reader.skip(count, size)
}

/// The times and parameters. No bytes may remain after them.
fn suffix(mut reader: Reader<'_>, version: Version) -> Option<(FrameTimes, u16)> {
    // Time code and sub-frame.
    reader.skip(2, 4)?;
    let times = FrameTimes {
        timestamp: reader.f64()?,
        mid_exposure: reader.u64()?,
        received: reader.u64()?,
        transmitted: reader.u64()?,
    };
    if version.has_sizes() {
        // Precision time, whole and fraction.
        reader.skip(2, 4)?;
    }
    let parameters = reader.u16()?;
    reader.u32()?;
    reader.rest().is_empty().then_some((times, parameters))
}

/// Writes a frame of rigid bodies in the layout of a version.
/// Returns its length, bytes; 0 if it does not fit.
#[must_use = "the length says what to send"]
pub fn write_frame(
    out: &mut [u8],
    number: i32,
    bodies: &[RigidBody],
    times: &FrameTimes,
    version: Version,
) -> usize {
    let sized = version.has_sizes();
    let mut writer = start_packet(out, MessageId::Frame);
    let empty_sections = |writer: &mut Writer<'_>, count: usize| {
        // A count of 0 and, in version 4.1 and later, a size of 0.
        writer.zeros(count * if sized { 8 } else { 4 });
    };
    writer.i32(number);
    empty_sections(&mut writer, 2);
    writer.i32(bodies.len() as i32);
    if sized {
        writer.i32((bodies.len() * BODY) as i32);
    }
    for body in bodies {
        writer.i32(body.id);
        writer.f32s(&body.position);
        writer.f32s(&body.quaternion_xyzw);
        writer.f32s(&[body.mean_error]);
        writer.put(&u16::from(body.tracking_valid).to_le_bytes());
    }
    // Skeletons, [assets], labelled markers, force plates, devices; then time code and sub-frame.
    empty_sections(&mut writer, if sized { 5 } else { 4 });
    writer.zeros(8);
    writer.put(&times.timestamp.to_le_bytes());
    for ticks in [times.mid_exposure, times.received, times.transmitted] {
        writer.put(&ticks.to_le_bytes());
    }
    if sized {
        writer.zeros(8);
    }
    // Parameters, and the end mark.
    writer.zeros(2 + 4);
    end_packet(writer)
}
