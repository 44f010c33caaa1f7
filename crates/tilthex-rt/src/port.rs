//! The serial port. It is opened exclusively, in raw mode and without delay. Reads and writes never wait.

use std::{
    fmt, fs, io,
    net::SocketAddr,
    os::{
        fd::{AsFd, BorrowedFd, OwnedFd},
        unix::net::UnixStream,
    },
    path::{Path, PathBuf},
};

use rustix::{
    fs::{Mode, OFlags},
    io::Errno,
    termios::OptionalActions,
};
use serialport::SerialPort;

use crate::{Failure, datagrams::Datagrams, ports, sys};

/// Longest time for which an adapter may hold bytes back, ms.
const LONGEST_LATENCY_MS: u32 = 1;

/// Prefix of a name that is a socket instead of a device.
pub const SOCKET: &str = "unix:";
/// Prefix of a name that is an address for datagrams.
pub const DATAGRAMS: &str = "udp:";

/// The two kinds of lines.
#[derive(Debug)]
#[allow(clippy::large_enum_variant)] // there is one line in a program
enum Line {
    /// A device or a socket that transports bytes.
    Bytes(OwnedFd),
    /// Datagrams of DDS-XRCE.
    Datagrams(Datagrams),
}

/// An open serial port, pseudo-terminal or socket.
#[derive(Debug)]
pub struct Port {
    line: Line,
    path: PathBuf,
    short_writes: u64,
}

/// The result of a write.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Written {
    /// The line took every byte.
    Whole,
    /// The line is full: the rest of the frame was dropped, and this was counted.
    Short,
    /// The other end is gone.
    Gone,
}

impl Port {
    /// Opens a device by its path or by the serial number of its USB adapter, or the socket of a simulated vehicle
    /// (`unix:PATH`). With `baud` 0 the speed stays as it is.
    ///
    /// # Errors
    /// One sentence: the port does not exist, is in use or is not a terminal, the user has no right to open it, it cannot
    /// have this speed, or its adapter holds bytes back.
    pub fn open(name: &str, baud: u32) -> Result<Self, Failure> {
        if let Some(path) = name.strip_prefix(SOCKET) {
            return Self::connect(Path::new(path));
        }
        if let Some(address) = name.strip_prefix(DATAGRAMS) {
            return Self::listen(address);
        }
        let path = ports::resolve(name, &ports::there())?;
        let refuse =
            |what: &str, e: &dyn fmt::Display| Failure::link(format!("{}: {what}: {e}", path.display()));
        let speed = present_speed(&path)?;
        // The crate cannot leave the speed unchanged. The present speed is therefore set again.
        let speed = if baud > 0 { baud } else { speed };
        let port = serialport::new(path.to_string_lossy(), speed).open_native().map_err(|e| {
            if e.kind() == serialport::ErrorKind::NoDevice {
                ports::cannot_open(&path, Errno::BUSY)
            } else {
                refuse(&format!("cannot be set raw at {speed} baud"), &e)
            }
        })?;
        port.clear(serialport::ClearBuffer::All).map_err(|e| refuse("cannot be flushed", &e))?;
        // The loop uses the bare descriptor, because the crate's reads and writes wait in `poll` and in the kernel.
        let fd = sys::descriptor(port);
        rustix::fs::fcntl_setfl(&fd, OFlags::NONBLOCK)
            .map_err(|e| refuse("cannot be read without waiting", &e))?;
        // The crate offers neither of these two. A driver without the flag does not hold bytes back; one that does shows
        // it in latency_timer.
        let _ = sys::set_low_latency(fd.as_fd());
        check_latency(&path, Path::new("/sys"))?;
        Ok(Self { line: Line::Bytes(fd), path, short_writes: 0 })
    }

    /// Connects to a simulated vehicle that listens at a socket. Bytes then do not pass through a terminal's work queue.
    fn connect(path: &Path) -> Result<Self, Failure> {
        let stream = UnixStream::connect(path).map_err(|e| {
            Failure::link(format!(
                "{}: no simulated vehicle listens there: {e}; start tilthex-sim with --socket first",
                path.display()
            ))
        })?;
        Self::of_stream(stream, path).map_err(|e| Failure::link(format!("{}: {e}", path.display())))
    }

    /// A port on one end of a connected socket.
    ///
    /// # Errors
    /// Errors of the kernel.
    pub fn of_stream(stream: UnixStream, path: &Path) -> io::Result<Self> {
        stream.set_nonblocking(true)?;
        Ok(Self { line: Line::Bytes(stream.into()), path: path.into(), short_writes: 0 })
    }

    /// Receives datagrams at an address.
    fn listen(address: &str) -> Result<Self, Failure> {
        let refuse = |e: &dyn fmt::Display| {
            Failure::link(format!(
                "no datagrams can be received at {address}: {e}; name an address of this computer and a free port"
            ))
        };
        let line = Datagrams::listen(address.parse().map_err(|e| refuse(&e))?).map_err(|e| refuse(&e))?;
        Ok(Self {
            line: Line::Datagrams(line),
            path: format!("{DATAGRAMS}{address}").into(),
            short_writes: 0,
        })
    }

    /// Exchanges datagrams with the agent at an address, for a simulated vehicle.
    ///
    /// # Errors
    /// Errors of the kernel.
    pub fn to_agent(agent: SocketAddr) -> io::Result<Self> {
        let line = Line::Datagrams(Datagrams::to(agent)?);
        Ok(Self { line, path: format!("{DATAGRAMS}{agent}").into(), short_writes: 0 })
    }

    /// A pseudo-terminal: its controlling end, and the path of its other end. `serialport` can only create a pair with both
    /// ends locked, and another program could not open the other end.
    ///
    /// # Errors
    /// Errors of the kernel.
    pub fn pseudo_terminal() -> io::Result<(Self, PathBuf)> {
        use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
        let fd = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC)?;
        grantpt(&fd)?;
        unlockpt(&fd)?;
        let name = ptsname(&fd, Vec::new())?;
        let mut settings = rustix::termios::tcgetattr(&fd)?;
        settings.make_raw();
        rustix::termios::tcsetattr(&fd, OptionalActions::Now, &settings)?;
        rustix::fs::fcntl_setfl(&fd, OFlags::NONBLOCK)?;
        let path = PathBuf::from(name.to_string_lossy().into_owned());
        Ok((Self { line: Line::Bytes(fd), path: path.clone(), short_writes: 0 }, path))
    }

    /// Reads the bytes that have arrived, at most as many as `buffer` holds. Returns `None` if the other end is gone. Never
    /// waits; safe in the loop.
    ///
    /// A `read` of a terminal without input waits in the kernel, even if it is non-blocking, until the work queue that moves
    /// the bytes has run (`n_tty_read`, `tty_buffer_flush_work`). The queue has ordinary priority, so that this takes up to a
    /// second beside other load. The port therefore asks the kernel first how many bytes have arrived.
    pub fn read(&mut self, buffer: &mut [u8]) -> Option<usize> {
        let fd = match &mut self.line {
            Line::Bytes(fd) => fd,
            Line::Datagrams(line) => return Some(line.read(buffer)),
        };
        let there = match rustix::io::ioctl_fionread(&*fd) {
            Ok(0) | Err(Errno::INTR) => return Some(0),
            Ok(count) => buffer.len().min(usize::try_from(count).unwrap_or(usize::MAX)),
            Err(_) => return None,
        };
        match rustix::io::read(&*fd, buffer.get_mut(..there).unwrap_or_default()) {
            Ok(0) => None,
            Ok(n) => Some(n),
            Err(Errno::AGAIN | Errno::INTR) => Some(0),
            Err(_) => None,
        }
    }

    /// Writes `bytes` in one call. Never waits; safe in the loop.
    pub fn write(&mut self, bytes: &[u8]) -> Written {
        let written = match &mut self.line {
            Line::Bytes(fd) => rustix::io::write(&*fd, bytes),
            Line::Datagrams(line) => {
                let written = line.write(bytes);
                self.short_writes += u64::from(written == Written::Short);
                return written;
            }
        };
        match written {
            Ok(n) if n == bytes.len() => Written::Whole,
            Ok(_) | Err(Errno::AGAIN | Errno::INTR) => {
                self.short_writes += 1;
                Written::Short
            }
            Err(_) => Written::Gone,
        }
    }

    /// Number of writes of which the line took only a part.
    #[must_use]
    pub fn short_writes(&self) -> u64 {
        self.short_writes
    }

    /// The path of the device.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }
}

impl AsFd for Port {
    fn as_fd(&self) -> BorrowedFd<'_> {
        match &self.line {
            Line::Bytes(fd) => fd.as_fd(),
            Line::Datagrams(line) => line.as_fd(),
        }
    }
}

/// The present speed of a terminal; 38400 if the speed is not a number.
fn present_speed(path: &Path) -> Result<u32, Failure> {
    let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::NONBLOCK | OFlags::CLOEXEC;
    let fd = rustix::fs::open(path, flags, Mode::empty()).map_err(|e| ports::cannot_open(path, e))?;
    if !rustix::termios::isatty(&fd) {
        return Err(Failure::link(format!(
            "{} is not a serial port; expected a terminal device such as /dev/ttyUSB0",
            path.display()
        )));
    }
    let settings = rustix::termios::tcgetattr(&fd)
        .map_err(|e| Failure::link(format!("{}: its settings cannot be read: {e}", path.display())))?;
    Ok(Some(settings.output_speed()).filter(|speed| *speed > 0).unwrap_or(38_400))
}

/// The delay of an FTDI adapter, ms, and the file that sets it; `None` for other devices.
pub(crate) fn latency_timer(path: &Path, sys: &Path) -> Option<(PathBuf, u32)> {
    let device = fs::canonicalize(path).ok()?;
    let file = sys.join("class/tty").join(device.file_name()?).join("device/latency_timer");
    let ms = fs::read_to_string(&file).ok()?.trim().parse().ok()?;
    Some((file, ms))
}

fn check_latency(path: &Path, sys: &Path) -> Result<(), Failure> {
    match latency_timer(path, sys) {
        Some((file, ms)) if ms > LONGEST_LATENCY_MS => Err(Failure::link(format!(
            "{} holds bytes back for {ms} ms; expected at most {LONGEST_LATENCY_MS} ms: run `echo 1 | sudo tee {}`",
            path.display(),
            file.display()
        ))),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::os::unix::fs::symlink;

    fn read_all(port: &mut Port, want: usize) -> Vec<u8> {
        let mut got = Vec::new();
        let mut buffer = [0; 256];
        while got.len() < want {
            let n = port.read(&mut buffer).expect("the other end is there");
            got.extend_from_slice(&buffer[..n]);
        }
        got
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(32))]
        #[test]
        fn every_byte_passes_unchanged_both_ways(bytes in prop::collection::vec(any::<u8>(), 1..256)) {
            let (mut master, path) = Port::pseudo_terminal().expect("a pseudo-terminal");
            let mut slave = Port::open(path.to_str().expect("plain"), 500_000).expect("opens");
            prop_assert_eq!(master.write(&bytes), Written::Whole);
            prop_assert_eq!(&read_all(&mut slave, bytes.len()), &bytes);
            prop_assert_eq!(slave.write(&bytes), Written::Whole);
            prop_assert_eq!(&read_all(&mut master, bytes.len()), &bytes);
        }
    }

    #[test]
    fn an_empty_line_reads_nothing_and_a_full_one_is_counted() {
        let (_master, path) = Port::pseudo_terminal().expect("a pseudo-terminal");
        let mut slave = Port::open(path.to_str().expect("plain"), 0).expect("opens");
        assert_eq!(slave.read(&mut [0; 16]), Some(0));
        while slave.write(&[0x55; 64]) == Written::Whole {}
        assert_eq!(slave.short_writes(), 1);
    }

    /// Number of calls of `read` by this thread.
    fn reads() -> u64 {
        let counts = fs::read_to_string("/proc/thread-self/io").expect("a kernel that counts");
        let line = counts.lines().find_map(|line| line.strip_prefix("syscr: ")).expect("counted");
        line.parse().expect("a number")
    }

    #[test]
    fn a_socket_is_a_line_like_any_other() {
        let folder = tempfile::tempdir().expect("a directory");
        let path = folder.path().join("vehicle");
        let listener = std::os::unix::net::UnixListener::bind(&path).expect("bound");
        let name = format!("unix:{}", path.display());
        let mut host = Port::open(&name, 500_000).expect("connects");
        let mut vehicle = Port::of_stream(listener.accept().expect("a guest").0, &path).expect("opens");
        assert_eq!(host.read(&mut [0; 16]), Some(0));
        assert_eq!((vehicle.write(b"^I$"), host.write(b"^?$")), (Written::Whole, Written::Whole));
        assert_eq!(read_all(&mut host, 3), b"^I$");
        assert_eq!(read_all(&mut vehicle, 3), b"^?$");
        while host.write(&[0x55; 4096]) == Written::Whole {}
        assert_eq!(host.short_writes(), 1);
        drop(vehicle);
        assert_eq!(host.write(b"^?$"), Written::Gone);
        drop(listener);
        let message = Port::open(&name, 0).expect_err("nobody listens").message;
        assert!(message.contains("--socket"), "{message}");
    }

    #[test]
    fn an_empty_line_is_not_read() {
        let (mut master, path) = Port::pseudo_terminal().expect("a pseudo-terminal");
        let mut slave = Port::open(path.to_str().expect("plain"), 0).expect("opens");
        let of_counting = reads();
        let of_counting = reads() - of_counting;
        let before = reads();
        for _ in 0..1000 {
            assert_eq!(slave.read(&mut [0; 16]), Some(0));
        }
        assert_eq!(reads() - before, of_counting, "a read of an empty terminal waits in the kernel");
        assert_eq!(master.write(b"^I$"), Written::Whole);
        assert_eq!(read_all(&mut slave, 3), b"^I$");
    }

    #[test]
    fn a_pulled_port_is_seen_on_both_calls() {
        let (master, path) = Port::pseudo_terminal().expect("a pseudo-terminal");
        let mut slave = Port::open(path.to_str().expect("plain"), 0).expect("opens");
        drop(master);
        assert_eq!(slave.read(&mut [0; 16]), None);
        assert_eq!(slave.write(b"^?$"), Written::Gone);
    }

    #[test]
    fn what_can_not_be_opened_is_said_in_one_sentence() {
        let (_master, path) = Port::pseudo_terminal().expect("a pseudo-terminal");
        let path = path.to_str().expect("plain");
        let _held = Port::open(path, 0).expect("opens");
        let message = |name: &str| Port::open(name, 0).expect_err("cannot be opened").message;
        assert!(message(path).contains("in use"), "{}", message(path));
        assert!(message("/dev/no-such-port").contains("does not exist"));
        assert!(message("/dev/null").contains("is not a serial port"));
        assert!(message("FT-NOT-THERE").contains("\"FT-NOT-THERE\""));
    }

    #[test]
    fn a_speed_of_zero_leaves_the_line_as_it_is() {
        let (_master, path) = Port::pseudo_terminal().expect("a pseudo-terminal");
        let path = path.to_str().expect("plain");
        drop(Port::open(path, 57_600).expect("opens"));
        assert_eq!(present_speed(Path::new(path)).expect("a terminal"), 57_600);
        drop(Port::open(path, 0).expect("opens"));
        assert_eq!(present_speed(Path::new(path)).expect("a terminal"), 57_600);
    }

    #[test]
    fn slow_adapters_are_refused() {
        let sys = tempfile::tempdir().expect("a directory");
        let port = sys.path().join("devices/usb1/1-2/1-2:1.0/ttyUSB7");
        fs::create_dir_all(&port).expect("made");
        fs::create_dir_all(sys.path().join("class/tty/ttyUSB7")).expect("made");
        symlink(&port, sys.path().join("class/tty/ttyUSB7/device")).expect("linked");
        let device = sys.path().join("ttyUSB7");
        fs::write(&device, "").expect("written");
        assert!(check_latency(&device, sys.path()).is_ok(), "no timer, no delay");
        fs::write(port.join("latency_timer"), "16\n").expect("written");
        let message = check_latency(&device, sys.path()).expect_err("too slow").message;
        assert!(message.contains("16 ms") && message.contains("echo 1 | sudo tee"), "{message}");
        fs::write(port.join("latency_timer"), "1\n").expect("written");
        assert!(check_latency(&device, sys.path()).is_ok());
    }
}
