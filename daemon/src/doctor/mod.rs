//! What stands between a machine and a good recording, each with the command that mends it.
//!
//! [`usb`] camera, node, drivers, speed, power, memory · [`rules`] udev · [`disk`] with the pattern in which recordings
//! are written · [`load`] what a pair of frames costs this processor, and who else wants it · [`rights`] real time and
//! locked memory. Nothing here changes anything but the disk check, which writes a file and removes it.

pub mod disk;
pub mod load;
pub mod rights;
pub mod rules;
pub mod usb;

use std::fmt;
use std::path::{Path, PathBuf};

use serde::Serialize;

use crate::clock::HostClock;

/// Where the machine shows itself; tests show made trees.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Roots {
    /// `/sys`.
    pub sys: PathBuf,
    /// `/proc`.
    pub proc: PathBuf,
    /// `/dev`.
    pub dev: PathBuf,
    /// Folders of udev's rules.
    pub rules: Vec<PathBuf>,
}

impl Default for Roots {
    fn default() -> Self {
        let rules = ["/etc", "/run", "/usr/local/lib", "/usr/lib", "/lib"];
        Self {
            sys: "/sys".into(),
            proc: "/proc".into(),
            dev: "/dev".into(),
            rules: rules
                .map(|folder| Path::new(folder).join("udev/rules.d"))
                .into(),
        }
    }
}

/// Who would record.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Identity {
    /// User.
    pub user: u32,
    /// All groups.
    pub groups: Vec<u32>,
}

impl Identity {
    /// Whoever runs this.
    pub fn own() -> Self {
        let mut groups: Vec<u32> = rustix::process::getgroups()
            .unwrap_or_default()
            .iter()
            .map(|group| group.as_raw())
            .collect();
        groups.push(rustix::process::getegid().as_raw());
        Self {
            user: rustix::process::geteuid().as_raw(),
            groups,
        }
    }
}

/// How bad something is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Severity {
    /// As it should be.
    Fine,
    /// Good to know.
    Note,
    /// Frames may be lost.
    Warning,
    /// No recording, or none without losses.
    Bad,
}

impl fmt::Display for Severity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Fine => "fine",
            Self::Note => "note",
            Self::Warning => "warning",
            Self::Bad => "BAD",
        })
    }
}

/// What one check found.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Finding {
    /// Which check.
    pub check: &'static str,
    /// How bad it is.
    pub severity: Severity,
    /// What was found.
    pub words: String,
    /// The command that mends it, or what to do.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mend: Option<String>,
}

impl Finding {
    /// All is well.
    pub(crate) fn fine(check: &'static str, words: String) -> Self {
        Self {
            check,
            severity: Severity::Fine,
            words,
            mend: None,
        }
    }

    /// Something to mend.
    pub(crate) fn new(
        check: &'static str,
        severity: Severity,
        words: String,
        mend: impl Into<String>,
    ) -> Self {
        Self {
            check,
            severity,
            words,
            mend: Some(mend.into()),
        }
    }
}

/// All checks. Recordings would go to `folder`.
pub fn examine(roots: &Roots, who: &Identity, folder: &Path, clock: HostClock) -> Vec<Finding> {
    let cameras = usb::cameras(roots);
    let mut findings = usb::examine(roots, who, &cameras);
    findings.extend(rules::examine(roots));
    findings.push(disk::examine(folder, clock.monotonic, None));
    findings.extend(load::examine(roots));
    findings.extend(rights::examine(roots, who));
    findings
}

/// The text of a small file of the kernel, without white space around it.
pub(crate) fn read(path: &Path) -> Option<String> {
    let text = std::fs::read_to_string(path).ok()?;
    Some(text.trim().to_owned())
}
