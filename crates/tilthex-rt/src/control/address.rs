//! The address of the control socket, and the two kinds of connections to it.

use std::{
    fs, io,
    net::{IpAddr, Shutdown, SocketAddr, TcpListener, TcpStream},
    os::unix::{
        fs::FileTypeExt,
        net::{UnixListener, UnixStream},
    },
    path::{Path, PathBuf},
    time::Duration,
};

use rustix::{fs::Mode, process::umask};

use crate::Failure;

/// The default address of the control socket.
pub const DEFAULT_ADDRESS: &str = "127.0.0.1:7410";

/// An address at which the control socket may listen.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Address {
    Tcp(SocketAddr),
    Unix(PathBuf),
}

impl Address {
    /// Reads `ADDRESS:PORT` or `unix:PATH`.
    ///
    /// # Errors
    /// One sentence: it is not an address, it means every network, or other computers can reach it without a token.
    pub(super) fn parse(text: &str, has_token: bool) -> Result<Self, Failure> {
        if let Some(path) = text.strip_prefix("unix:") {
            return match path {
                "" => Err(refuse(text, &"it names no path")),
                path => Ok(Self::Unix(path.into())),
            };
        }
        let address: SocketAddr =
            text.parse().map_err(|_| refuse(text, &"it is not an address with a port"))?;
        let ip: IpAddr = address.ip().to_canonical();
        if ip.is_unspecified() {
            return Err(refuse(text, &"it means every network of this computer"));
        }
        if !ip.is_loopback() && !has_token {
            return Err(refuse(
                text,
                &"other computers could fly the vehicle without a token; name one with --control-token-file",
            ));
        }
        Ok(Self::Tcp(address))
    }

    /// Listens at the address.
    ///
    /// # Errors
    /// One sentence: the address does not belong to this computer, or is in use.
    pub(super) fn listen(&self) -> Result<Listener, Failure> {
        let listener = match self {
            Self::Tcp(address) => TcpListener::bind(address).map(Listener::Tcp),
            Self::Unix(path) => listen_at(path).map(|listener| Listener::Unix(listener, path.clone())),
        };
        let name = match self {
            Self::Tcp(address) => address.to_string(),
            Self::Unix(path) => format!("unix:{}", path.display()),
        };
        let listener = listener.map_err(|e| refuse(&name, &e))?;
        listener.set_nonblocking().map_err(|e| refuse(&name, &e))?;
        Ok(listener)
    }
}

fn refuse(address: &str, why: &dyn std::fmt::Display) -> Failure {
    Failure::usage(format!(
        "the control socket cannot listen at {address}: {why}; name an address of this computer and a free port, such \
         as {DEFAULT_ADDRESS}, or unix:PATH"
    ))
}

/// A Unix socket to which only this user may connect. Replaces a socket that a killed program left.
fn listen_at(path: &Path) -> io::Result<UnixListener> {
    let left = fs::symlink_metadata(path).is_ok_and(|found| found.file_type().is_socket());
    if left && UnixStream::connect(path).is_err() {
        fs::remove_file(path)?;
    }
    let before = umask(Mode::RWXG | Mode::RWXO | Mode::XUSR);
    let listener = UnixListener::bind(path);
    umask(before);
    listener
}

/// Accepts connections. A Unix socket is removed when this is dropped.
#[derive(Debug)]
pub(super) enum Listener {
    Tcp(TcpListener),
    Unix(UnixListener, PathBuf),
}

impl Listener {
    fn set_nonblocking(&self) -> io::Result<()> {
        match self {
            Self::Tcp(listener) => listener.set_nonblocking(true),
            Self::Unix(listener, _) => listener.set_nonblocking(true),
        }
    }

    /// The address at which it listens.
    pub(super) fn name(&self) -> io::Result<String> {
        match self {
            Self::Tcp(listener) => listener.local_addr().map(|address| address.to_string()),
            Self::Unix(_, path) => Ok(format!("unix:{}", path.display())),
        }
    }

    /// Accepts a waiting connection. Also returns the name of the client.
    pub(super) fn accept(&self) -> io::Result<(Stream, String)> {
        match self {
            Self::Tcp(listener) => {
                let (stream, peer) = listener.accept()?;
                stream.set_nodelay(true)?;
                Ok((Stream::Tcp(stream), peer.to_string()))
            }
            Self::Unix(listener, _) => {
                let (stream, _) = listener.accept()?;
                Ok((Stream::Unix(stream), "a client of the Unix socket".into()))
            }
        }
    }
}

impl Drop for Listener {
    fn drop(&mut self) {
        if let Self::Unix(_, path) = self {
            let _ = fs::remove_file(path);
        }
    }
}

/// A connection.
#[derive(Debug)]
pub(super) enum Stream {
    Tcp(TcpStream),
    Unix(UnixStream),
}

impl Stream {
    /// Sets the longest time for which a write waits.
    pub(super) fn set_blocking(&self, write: Duration) -> io::Result<()> {
        match self {
            Self::Tcp(s) => s.set_nonblocking(false).and_then(|()| s.set_write_timeout(Some(write))),
            Self::Unix(s) => s.set_nonblocking(false).and_then(|()| s.set_write_timeout(Some(write))),
        }
    }

    /// Sets the longest time for which a read waits.
    pub(super) fn set_patience(&self, read: Duration) -> io::Result<()> {
        match self {
            Self::Tcp(stream) => stream.set_read_timeout(Some(read)),
            Self::Unix(stream) => stream.set_read_timeout(Some(read)),
        }
    }

    /// Another handle on the same connection.
    pub(super) fn try_clone(&self) -> io::Result<Self> {
        match self {
            Self::Tcp(stream) => stream.try_clone().map(Self::Tcp),
            Self::Unix(stream) => stream.try_clone().map(Self::Unix),
        }
    }

    /// Ends the connection, also for a thread that reads from it.
    pub(super) fn shut(&self) {
        let _ = match self {
            Self::Tcp(stream) => stream.shutdown(Shutdown::Both),
            Self::Unix(stream) => stream.shutdown(Shutdown::Both),
        };
    }
}

impl io::Read for Stream {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        match self {
            Self::Tcp(stream) => stream.read(bytes),
            Self::Unix(stream) => stream.read(bytes),
        }
    }
}

impl io::Write for Stream {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match self {
            Self::Tcp(stream) => stream.write(bytes),
            Self::Unix(stream) => stream.write(bytes),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::PermissionsExt;

    #[test]
    fn only_this_computer_may_connect_without_a_token() {
        for good in ["127.0.0.1:0", "[::1]:7410", "127.9.9.9:1", "[::ffff:127.0.0.1]:7410", "unix:/tmp/s"] {
            assert!(Address::parse(good, false).is_ok(), "{good}");
        }
        for (bad, why) in [
            ("192.168.1.2:7410", "--control-token-file"),
            ("[::ffff:192.168.1.2]:7410", "--control-token-file"),
            ("[2001:db8::1]:7410", "--control-token-file"),
            ("0.0.0.0:7410", "every network"),
            ("[::]:7410", "every network"),
            ("[::ffff:0.0.0.0]:7410", "every network"),
            ("localhost", "not an address"),
            ("unix:", "names no path"),
        ] {
            let refused = Address::parse(bad, false).expect_err(bad);
            assert!(refused.message.contains(why), "{bad}: {refused}");
        }
        assert!(Address::parse("192.168.1.2:7410", true).is_ok());
        assert!(Address::parse("[::ffff:0.0.0.0]:7410", true).is_err(), "every network is never meant");
    }

    #[test]
    fn a_unix_socket_is_this_users_alone_and_goes_with_its_program() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("control");
        let address = Address::Unix(path.clone());
        {
            let _first = address.listen().expect("free");
            assert_eq!(fs::metadata(&path).expect("there").permissions().mode() & 0o777, 0o600);
            assert!(address.listen().is_err(), "somebody listens there");
        }
        assert!(!path.exists());
        // A killed program leaves a socket at which no program listens.
        drop(UnixListener::bind(&path).expect("free"));
        assert!(path.exists());
        drop(address.listen().expect("replaced"));
        fs::write(&path, "precious").expect("written");
        assert!(address.listen().is_err());
        assert_eq!(fs::read_to_string(&path).expect("kept"), "precious");
    }
}
