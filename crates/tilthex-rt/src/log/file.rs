//! The file of a log. It replaces another file only if this is allowed, belongs to one flight, and reports if it is moved or
//! deleted.

use std::{
    fs::{self, File},
    io::ErrorKind,
    os::unix::fs::MetadataExt,
    path::{Path, PathBuf},
};

use rustix::{
    fs::{FlockOperation, flock},
    io::Errno,
};

use tilthex_config::files;

use crate::Failure;

/// Largest number of names that are tried to find one that does not exist.
const MAX_REPORTS: u32 = 10_000;

/// The open file of a log.
#[derive(Debug)]
pub struct LogFile {
    file: File,
    path: PathBuf,
}

/// The place of a log's file while it is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Whereabouts {
    /// It has its name.
    InPlace,
    /// It was deleted: nothing will be left of it.
    Deleted,
    /// It has another name.
    Moved,
}

impl LogFile {
    /// A file that is already open, and its name.
    #[must_use]
    pub fn new(file: File, path: PathBuf) -> Self {
        Self { file, path }
    }

    /// Tests whether a log may be written to a path, without writing it.
    ///
    /// # Errors
    /// One sentence: what exists at this path.
    pub fn check(path: &Path, overwrite: bool) -> Result<(), Failure> {
        if fs::symlink_metadata(path).is_err() {
            // The file or its folder does not exist. If it is the folder, `create` reports it.
            return Ok(());
        }
        match files::check(path) {
            Ok(()) if overwrite => Ok(()),
            Ok(()) => Err(exists(path, "exists")),
            Err(e) if e.kind() == ErrorKind::NotFound => {
                Err(exists(path, "is a symbolic link to a file that does not exist"))
            }
            Err(e) => Err(refused(path, &e)),
        }
    }

    /// Creates a log, or empties an existing one if that is allowed, and locks it.
    ///
    /// # Errors
    /// One sentence: the file exists, another program writes it, or it cannot be written.
    pub fn create(path: &Path, overwrite: bool) -> Result<Self, Failure> {
        Self::check(path, overwrite)?;
        let mut options = File::options();
        options.write(true);
        let there = fs::symlink_metadata(path).is_ok();
        if !there {
            options.create_new(true);
        }
        let file = options.open(path).map_err(|e| match e.kind() {
            ErrorKind::AlreadyExists => exists(path, "exists"),
            _ => refused(path, &e),
        })?;
        // If the file system has no locks, the vehicle flies without this test.
        if let Err(Errno::WOULDBLOCK) = flock(&file, FlockOperation::NonBlockingLockExclusive) {
            return Err(refused(path, &"another program writes its log there"));
        }
        if there {
            file.set_len(0).map_err(|e| refused(path, &e))?;
        }
        Ok(Self { file, path: path.into() })
    }

    /// Creates a new file. If the name exists, a number is added to it before the ending.
    ///
    /// # Errors
    /// Errors of the kernel.
    pub fn create_beside(path: &Path) -> std::io::Result<(File, PathBuf)> {
        let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let numbered = (2..MAX_REPORTS).map(|n| path.with_file_name(format!("{stem}-{n}.mcap")));
        let mut taken = None;
        for path in std::iter::once(path.to_path_buf()).chain(numbered) {
            match File::options().write(true).create_new(true).open(&path) {
                Ok(file) => return Ok((file, path)),
                Err(e) if e.kind() == ErrorKind::AlreadyExists => taken = Some(e),
                Err(e) => return Err(e),
            }
        }
        Err(taken.unwrap_or_else(|| ErrorKind::AlreadyExists.into()))
    }

    /// Its name.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Another handle of the file, for writing.
    ///
    /// # Errors
    /// Errors of the kernel.
    pub fn handle(&self) -> std::io::Result<File> {
        self.file.try_clone()
    }

    /// Its present place.
    #[must_use]
    pub fn whereabouts(&self) -> Whereabouts {
        let Ok(own) = self.file.metadata() else { return Whereabouts::InPlace };
        if own.nlink() == 0 {
            return Whereabouts::Deleted;
        }
        let same = |there: fs::Metadata| (there.dev(), there.ino()) == (own.dev(), own.ino());
        if fs::metadata(&self.path).is_ok_and(same) { Whereabouts::InPlace } else { Whereabouts::Moved }
    }
}

fn exists(path: &Path, how: &str) -> Failure {
    Failure::usage(format!(
        "the log {} {how}; name a file that does not exist with --log, or allow with --overwrite to replace it",
        path.display()
    ))
}

/// Why a log cannot be written.
pub(crate) fn refused(path: &Path, why: &dyn std::fmt::Display) -> Failure {
    Failure::usage(format!(
        "the log {} cannot be written: {why}; name a file in a writable place with --log",
        path.display()
    ))
}
