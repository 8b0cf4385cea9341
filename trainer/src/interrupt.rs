//! SIGINT and SIGTERM between steps: what is finished stays, the rest is not written.

use std::sync::Arc;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering};

static INTERRUPTED: OnceLock<Arc<AtomicBool>> = OnceLock::new();

/// The user asked to stop.
#[derive(Debug, thiserror::Error)]
#[error(
    "stopped by a signal: the outputs of finished stages are in the folder, the rest was not written"
)]
pub struct Interrupted;

/// Listens from now on. A second signal ends the program at once.
pub fn listen() -> std::io::Result<()> {
    let flag = Arc::clone(INTERRUPTED.get_or_init(|| Arc::new(AtomicBool::new(false))));
    for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
        signal_hook::flag::register_conditional_shutdown(signal, 130, Arc::clone(&flag))?;
        signal_hook::flag::register(signal, Arc::clone(&flag))?;
    }
    Ok(())
}

/// Errors once a signal came.
pub fn check() -> Result<(), Interrupted> {
    let stopped = INTERRUPTED
        .get()
        .is_some_and(|flag| flag.load(Ordering::Relaxed));
    if stopped { Err(Interrupted) } else { Ok(()) }
}
