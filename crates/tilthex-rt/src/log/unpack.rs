//! Unpacks chunks, to at most the size that they announce.

use std::io::Read;

use super::fields::ChunkRecord;

/// Largest chunk that is unpacked, bytes. A log of tilthex-rt has chunks of half a MiB.
const MAX_CHUNK: u64 = 64 << 20;

/// Unpacks a chunk and compares its checksum.
///
/// # Errors
/// What is wrong with it: the part of a sentence that follows its place in the file.
pub(super) fn unpack(chunk: &ChunkRecord<'_>) -> Result<Vec<u8>, String> {
    if chunk.size > MAX_CHUNK {
        return Err(format!("it announces {} unpacked bytes; expected at most {MAX_CHUNK}", chunk.size));
    }
    let unpacked = match chunk.compression {
        "" => Ok(chunk.packed.to_vec()),
        "lz4" => lz4::Decoder::new(chunk.packed).and_then(|reader| read(reader, chunk.size)),
        "zstd" => zstd::Decoder::new(chunk.packed).and_then(|reader| read(reader, chunk.size)),
        other => {
            return Err(format!("it is compressed with \"{}\"; expected lz4 or zstd", other.escape_debug()));
        }
    };
    let unpacked = unpacked.map_err(|e| format!("it cannot be unpacked ({} {e})", chunk.compression))?;
    if unpacked.len() as u64 != chunk.size {
        let more = if unpacked.len() as u64 > chunk.size { "more" } else { "fewer" };
        return Err(format!("it unpacks to {more} than the {} bytes that it announces", chunk.size));
    }
    // 0 means that there is no checksum.
    if chunk.check_sum != 0 && crc32fast::hash(&unpacked) != chunk.check_sum {
        return Err("its checksum does not match".into());
    }
    Ok(unpacked)
}

/// Reads at most one byte more than expected, so that a chunk that is too long is noticed but not kept.
fn read(reader: impl Read, size: u64) -> std::io::Result<Vec<u8>> {
    let mut unpacked = Vec::new();
    reader.take(size + 1).read_to_end(&mut unpacked)?;
    Ok(unpacked)
}
