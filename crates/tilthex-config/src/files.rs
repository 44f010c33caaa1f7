//! Opens files for reading and writing. Pipes and devices are refused, because they could block the program for ever.

use std::{
    fs::{self, File, FileType},
    io::{self, Error, ErrorKind, Read},
    os::unix::fs::FileTypeExt,
    path::Path,
};

/// Largest text that is read, bytes. A longer file is not a configuration.
const MAX_TEXT: u64 = 4 << 20;

/// Opens a file to read it.
///
/// # Errors
/// Errors of the kernel, or it is not a file.
pub fn open(path: &Path) -> io::Result<File> {
    check(path)?;
    File::open(path)
}

/// Reads a text file.
///
/// # Errors
/// Errors of the kernel, or it is not a file, not a text, or too long.
pub fn read_text(path: &Path) -> io::Result<String> {
    let mut text = String::new();
    open(path)?.take(MAX_TEXT + 1).read_to_string(&mut text).map_err(|e| match e.kind() {
        ErrorKind::InvalidData => Error::new(e.kind(), "it is not a text (UTF-8)"),
        _ => e,
    })?;
    if text.len() as u64 > MAX_TEXT {
        return Err(Error::new(ErrorKind::InvalidData, format!("it is longer than {MAX_TEXT} bytes")));
    }
    Ok(text)
}

/// Refuses a path that exists but is not a file, or is a symbolic link to such a path.
///
/// # Errors
/// Errors of the kernel, for example if nothing exists at the path, or it is not a file.
pub fn check(path: &Path) -> io::Result<()> {
    let kind = fs::metadata(path)?.file_type();
    if kind.is_file() {
        return Ok(());
    }
    let found = name(kind);
    Err(Error::new(ErrorKind::InvalidInput, format!("it is {found}; expected a file")))
}

fn name(kind: FileType) -> &'static str {
    if kind.is_dir() {
        "a directory"
    } else if kind.is_fifo() {
        "a pipe"
    } else if kind.is_socket() {
        "a socket"
    } else {
        "a device"
    }
}
