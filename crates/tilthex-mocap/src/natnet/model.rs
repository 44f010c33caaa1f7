//! Model definitions: names and ids of the captured rigid bodies.

use super::{
    super::{Malformed, bytes::Reader},
    MessageId, Version, end_packet, start_packet,
};

/// A rigid body of a model definition.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BodyName<'a> {
    /// Its name.
    pub name: &'a [u8],
    /// Its id in frames.
    pub id: i32,
}

/// A model definition, as an iterator over its rigid bodies. At the first description that it cannot read, it returns an
/// error and ends.
#[derive(Clone, Copy, Debug)]
pub struct ModelDef<'a> {
    reader: Reader<'a>,
    remaining: usize,
    version: Version,
}

impl<'a> ModelDef<'a> {
    /// Begins to read a payload in the layout of a version.
    ///
    /// # Errors
    /// If it has no number of descriptions.
    pub fn new(payload: &'a [u8], version: Version) -> Result<Self, Malformed> {
        let mut reader = Reader::new(payload);
        let remaining = reader.count().ok_or(Malformed("number of descriptions"))?;
        Ok(Self { reader, remaining, version })
    }

    /// Begins to read a payload in the layout of a version or, if that does not fit to the last byte, in the first other
    /// layout that fits: a server can be set to send an older version.
    ///
    /// # Errors
    /// If no layout fits: the part that does not have the layout of `version`.
    pub fn new_either(payload: &'a [u8], version: Version) -> Result<Self, Malformed> {
        let others = [Version::V4_1, Version::V4_0, Version::V3_0];
        let fitting = |version: Version| Self::new(payload, version).ok().filter(|models| models.fits());
        core::iter::once(version)
            .chain(others)
            .find_map(fitting)
            .map_or_else(|| Self::whole(payload, version), Ok)
    }

    /// Begins to read a payload in the layout of a version, with or without bytes after its last description.
    fn whole(payload: &'a [u8], version: Version) -> Result<Self, Malformed> {
        let models = Self::new(payload, version)?;
        let mut read = models;
        read.find_map(Result::err).map_or(Ok(models), Err)
    }

    /// Whether every description can be read and no bytes follow the last one.
    fn fits(&self) -> bool {
        let mut models = *self;
        models.by_ref().all(|body| body.is_ok()) && models.reader.rest().is_empty()
    }

    /// Reads one description. The inner option is `None` if it does not describe a rigid body.
    fn description(&mut self) -> Option<Option<BodyName<'a>>> {
        let kind = self.reader.i32()?;
        if self.version.has_sizes() {
            let size = self.reader.count()?;
            let mut description = Reader::new(self.reader.bytes(size)?);
            return if kind == 1 { body_name(&mut description).map(Some) } else { Some(None) };
        }
        let reader = &mut self.reader;
        match kind {
            0 => {
                reader.text()?;
                skip_texts(reader)?;
            }
            1 => return self.rigid_body().map(Some),
            2 => {
                reader.text()?;
                reader.i32()?;
                for _ in 0..reader.count()? {
                    self.rigid_body()?;
                }
            }
            3 => {
                reader.i32()?;
                reader.text()?;
                // Width, length, origin, calibration (12x12), four corners, two types.
                reader.skip(2 + 3 + 144 + 12 + 2, 4)?;
                skip_texts(reader)?;
            }
            4 => {
                reader.i32()?;
                reader.text()?;
                reader.text()?;
                reader.skip(2, 4)?;
                skip_texts(reader)?;
            }
            5 => {
                reader.text()?;
                reader.skip(3 + 4, 4)?;
            }
            _ => return None,
        }
        Some(None)
    }

    /// Reads a complete rigid body of a version in which descriptions do not announce their sizes.
    fn rigid_body(&mut self) -> Option<BodyName<'a>> {
        let reader = &mut self.reader;
        let body = body_name(reader)?;
        // The parent and the offset from it, then the position and label of each marker.
        reader.skip(1 + 3, 4)?;
        let markers = reader.count()?;
        reader.skip(markers, 12 + 4)?;
        if self.version.major >= 4 {
            for _ in 0..markers {
                reader.text()?;
            }
        }
        Some(body)
    }
}

fn body_name<'a>(reader: &mut Reader<'a>) -> Option<BodyName<'a>> {
    Some(BodyName { name: reader.text()?, id: reader.i32()? })
}

fn skip_texts(reader: &mut Reader<'_>) -> Option<()> {
    for _ in 0..reader.count()? {
        reader.text()?;
    }
    Some(())
}

impl<'a> Iterator for ModelDef<'a> {
    type Item = Result<BodyName<'a>, Malformed>;

    fn next(&mut self) -> Option<Self::Item> {
        while self.remaining > 0 {
            self.remaining -= 1;
            match self.description() {
                Some(Some(body)) => return Some(Ok(body)),
                Some(None) => {}
                None => {
                    self.remaining = 0;
                    return Some(Err(Malformed("description")));
                }
            }
        }
        None
    }
}

/// Writes a model definition of rigid bodies without markers or parents.
/// Returns its length, bytes; 0 if it does not fit.
#[must_use = "the length says what to send"]
pub fn write_model_def(out: &mut [u8], bodies: &[BodyName<'_>], version: Version) -> usize {
    let mut writer = start_packet(out, MessageId::ModelDef);
    writer.i32(bodies.len() as i32);
    for body in bodies {
        writer.i32(1);
        let size_at = writer.position();
        if version.has_sizes() {
            writer.i32(0);
        }
        let start = writer.position();
        writer.put(body.name);
        writer.zeros(1);
        writer.i32(body.id);
        writer.i32(-1);
        writer.f32s(&[0.0; 3]);
        if version >= Version::V4_2 {
            writer.f32s(&[0.0, 0.0, 0.0, 1.0]);
        }
        writer.i32(0);
        if version.has_sizes() {
            let size = (writer.position() - start) as i32;
            writer.patch(size_at, &size.to_le_bytes());
        }
    }
    end_packet(writer)
}
