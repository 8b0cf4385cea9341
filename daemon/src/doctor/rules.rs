//! The rules of udev.

use std::path::PathBuf;

use super::{Finding, Roots, Severity, read};

/// Rules that open every camera to everybody, of Debian's OpenNI2.
const OPEN_RULES: &str = "libopenni2";
/// How glint's rules are called.
const OWN_RULES: &str = "glint";
const INSTALL: &str = "sudo udev/install.sh && sudo udevadm control --reload && sudo udevadm trigger --subsystem-match=usb";

/// Whether glint's rules are there, and come before others that would decide.
pub fn examine(roots: &Roots) -> Vec<Finding> {
    let files = files_of(roots);
    let named = |word: &str| {
        files
            .iter()
            .find(|path| name_of(path).contains(word) && mentions_cameras(path))
    };
    let own = named(OWN_RULES);
    let other = named(OPEN_RULES);
    let mut findings = vec![match own {
        Some(path) => Finding::fine("udev-rule", format!("{} is installed", path.display())),
        None => Finding::new(
            "udev-rule",
            Severity::Warning,
            "glint's udev rule is not installed: plugging a camera in starts nothing, and only root can open it"
                .to_owned(),
            INSTALL,
        ),
    }];
    if let Some(other) = other
        && own.is_none_or(|own| name_of(own) > name_of(other))
    {
        findings.push(Finding::new(
            "udev-rule",
            Severity::Warning,
            format!(
                "{} comes first and opens every camera to everybody: the first `:=` wins",
                other.display()
            ),
            INSTALL,
        ));
    }
    findings
}

fn files_of(roots: &Roots) -> Vec<PathBuf> {
    let entries = roots
        .rules
        .iter()
        .flat_map(|folder| std::fs::read_dir(folder).into_iter().flatten());
    let mut files: Vec<PathBuf> = entries
        .filter_map(|entry| Some(entry.ok()?.path()))
        .filter(|path| {
            path.extension()
                .is_some_and(|extension| extension == "rules")
        })
        .collect();
    files.sort();
    files
}

fn name_of(path: &std::path::Path) -> String {
    path.file_name()
        .unwrap_or_default()
        .to_string_lossy()
        .into_owned()
}

fn mentions_cameras(path: &std::path::Path) -> bool {
    read(path).is_some_and(|text| text.contains("1d27"))
}
