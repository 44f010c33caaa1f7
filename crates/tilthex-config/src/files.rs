//! Files that are read and written: files only, never a pipe or a device, which could hold the program up for ever.

use std::{
    fs::{self, File, FileType},
    io::{self, Error, ErrorKind, Read},
    os::unix::fs::FileTypeExt,
    path::Path,
};

/// Largest text that is read: more is no configuration, bytes.
const MAX_TEXT: u64 = 4 << 20;

/// Opens a file to read it.
///
/// # Errors
/// The kernel's, or that it is no file.
pub fn open(path: &Path) -> io::Result<File> {
    check(path)?;
    File::open(path)
}

/// Reads a text.
///
/// # Errors
/// The kernel's, that it is no file, no text, or too long for one.
pub fn read_text(path: &Path) -> io::Result<String> {
    let mut text = String::new();
    open(path)?.take(MAX_TEXT + 1).read_to_string(&mut text).map_err(|e| match e.kind() {
        ErrorKind::InvalidData => Error::new(e.kind(), "it is no text (UTF-8)"),
        _ => e,
    })?;
    if text.len() as u64 > MAX_TEXT {
        return Err(Error::new(ErrorKind::InvalidData, format!("it is longer than {MAX_TEXT} bytes")));
    }
    Ok(text)
}

/// Refuses a path that exists but is no file, also behind symbolic links.
///
/// # Errors
/// The kernel's where nothing is there, or that it is no file.
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
