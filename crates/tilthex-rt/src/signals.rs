//! SIGINT, SIGTERM and SIGHUP as a flag that any thread can read.

use std::sync::{Arc, atomic::AtomicBool};

use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};

use crate::Failure;

/// A flag that each of the three sets.
///
/// # Errors
/// Where the kernel refuses a handler.
pub(crate) fn flag() -> Result<Arc<AtomicBool>, Failure> {
    let flag = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM, SIGHUP] {
        signal_hook::flag::register(signal, Arc::clone(&flag))
            .map_err(|e| Failure::usage(format!("signal {signal} can not be handled: {e}")))?;
    }
    Ok(flag)
}
