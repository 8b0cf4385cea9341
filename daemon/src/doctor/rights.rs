//! Rights to run before others and to stay in memory.

use super::{Finding, Identity, Roots, Severity, read};

/// Priority of the thread that reads from the camera, as the unit grants it.
const REALTIME_PRIORITY: u64 = 30;
/// Memory that a recorder may want to lock: pools and rings.
const LOCKED_BYTES: u64 = 256 << 20;

/// Limits of this process; they do not bind root.
pub fn examine(roots: &Roots, who: &Identity) -> Vec<Finding> {
    if who.user == 0 {
        let words = "root is not limited".to_owned();
        return vec![Finding::fine("real-time", words)];
    }
    let limits = read(&roots.proc.join("self/limits")).unwrap_or_default();
    let soft = |name: &str| -> Option<u64> {
        let line = limits.lines().find_map(|line| line.strip_prefix(name))?;
        let word = line.split_whitespace().next()?;
        if word == "unlimited" {
            Some(u64::MAX)
        } else {
            word.parse().ok()
        }
    };
    vec![
        match soft("Max realtime priority") {
            Some(priority) if priority >= REALTIME_PRIORITY => {
                Finding::fine("real-time", format!("priority up to {priority}"))
            }
            found => Finding::new(
                "real-time",
                Severity::Warning,
                format!(
                    "real-time priority up to {} instead of {REALTIME_PRIORITY}: a busy machine may delay the camera's thread",
                    found.unwrap_or_default()
                ),
                "echo '@capture - rtprio 30' | sudo tee /etc/security/limits.d/glint.conf, log in again; a unit: LimitRTPRIO=30",
            ),
        },
        match soft("Max locked memory") {
            Some(bytes) if bytes >= LOCKED_BYTES => {
                Finding::fine("locked-memory", "enough".to_owned())
            }
            found => Finding::new(
                "locked-memory",
                Severity::Note,
                format!(
                    "{} MB may be locked, {} MB are good on a machine that swaps",
                    found.unwrap_or_default() >> 20,
                    LOCKED_BYTES >> 20
                ),
                "echo '@capture - memlock 524288' | sudo tee -a /etc/security/limits.d/glint.conf, log in again; a unit: LimitMEMLOCK=512M",
            ),
        },
    ]
}
