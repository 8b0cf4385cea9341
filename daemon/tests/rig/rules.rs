//! The rules, read by udev itself: `udevadm test` in a name space of its own, where our rules and a made device tree lie
//! over this machine's.

use std::path::{Path, PathBuf};
use std::process::Command;

use crate::machine::{
    CAMERA, MICROPHONES, OTHER, OTHER_SOUND, PICTURES, SECOND, Tree, all_words, has, udev_folder,
};

const RULES: &str = "59-glint.rules";

/// A folder of rules in place of /etc/udev/rules.d.
fn rules_folder(rules: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join(RULES), rules).unwrap();
    folder
}

fn own_rules() -> String {
    crate::machine::udev_file(RULES)
}

/// What udev says of `device`; `None` where this user may not make a name space or udev accepts no made tree.
fn tested(rules: &Path, tree: &Tree, device: &str) -> Option<String> {
    // A rig has the group; where it is absent udev would complain of it.
    let script = "mkdir -p /etc/udev/rules.d 2>/dev/null; \
        mount --bind \"$1\" /etc/udev/rules.d && mount --bind \"$2\" /sys && \
        { mount --bind \"$3\" /etc/group || exit 99; } && \
        SYSTEMD_DEVICE_VERIFY_SYSFS=0 exec udevadm test --action=add \"$4\" || exit 99";
    let groups = tree.folder().join("group");
    let known = std::fs::read_to_string("/etc/group").unwrap_or_default();
    std::fs::write(&groups, format!("{known}capture:x:64999:\n")).unwrap();
    let run = |flags: &str| {
        Command::new("unshare")
            .args([flags, "sh", "-c", script, "sh"])
            .args([rules, tree.folder(), &groups])
            .arg(device)
            .output()
    };
    ["-m", "-rm"]
        .into_iter()
        .filter_map(|flags| run(flags).ok())
        .find(|output| output.status.success())
        .map(|output| all_words(&output))
}

/// As [`tested`] with the rules that are shipped; says what is skipped.
fn shipped(tree: &Tree, device: &str, skipped: &str) -> Option<String> {
    if !has("udevadm", skipped) {
        return None;
    }
    let rules = rules_folder(&own_rules());
    let said = tested(rules.path(), tree, device);
    if said.is_none() {
        println!("skipped {skipped}: udev takes no made device tree here; it waits for the guest");
    }
    said
}

fn complaints(said: &str) -> Vec<&str> {
    said.lines()
        .filter(|line| line.contains(RULES) && !line.starts_with("Reading rules file"))
        .collect()
}

#[test]
fn udev_reads_the_rules_without_a_word() {
    let tree = Tree::new();
    let Some(said) = shipped(&tree, CAMERA, "udev_reads_the_rules_without_a_word") else {
        return;
    };
    assert!(said.contains(&format!("Reading rules file: /etc/udev/rules.d/{RULES}")));
    // What a rule does is said with its line; what is wrong has other words.
    let wrong: Vec<&str> = complaints(&said)
        .into_iter()
        .filter(|line| {
            !["MODE", "GROUP", "ATTR", "group id", "mode"]
                .iter()
                .any(|word| line.contains(word))
        })
        .collect();
    assert_eq!(wrong, [""; 0], "{said}");
    for word in ["Invalid", "invalid", "Unknown", "ignoring", "Failed to"] {
        let lines: Vec<&str> = complaints(&said)
            .into_iter()
            .filter(|line| line.contains(word))
            .collect();
        assert_eq!(lines, [""; 0], "{word}");
    }
}

#[test]
fn a_wrong_rule_would_be_seen() {
    let tree = Tree::new();
    if shipped(&tree, CAMERA, "a_wrong_rule_would_be_seen").is_none() {
        return;
    }
    let rules = rules_folder(&own_rules().replace("TEST==", "TESST=="));
    let said = tested(rules.path(), &tree, CAMERA).unwrap();
    assert!(
        complaints(&said).iter().any(|line| line.contains("TESST")),
        "{said}"
    );
}

#[test]
fn a_camera_starts_its_recorder_and_stays_awake() {
    let tree = Tree::new();
    for camera in [CAMERA, SECOND] {
        let Some(said) = shipped(
            &tree,
            camera,
            "a_camera_starts_its_recorder_and_stays_awake",
        ) else {
            return;
        };
        for line in ["SYSTEMD_WANTS=glintd@.service", "TAGS=:systemd:"] {
            assert!(said.lines().any(|said| said == line), "{line} in {said}");
        }
        assert!(tree.attribute(camera, "power/control").starts_with("on"));
    }
}

#[test]
fn nothing_else_starts_one() {
    let tree = Tree::new();
    for device in [PICTURES, MICROPHONES, OTHER, OTHER_SOUND] {
        let Some(said) = shipped(&tree, device, "nothing_else_starts_one") else {
            return;
        };
        assert!(!said.contains("SYSTEMD_WANTS"), "{device}: {said}");
    }
}

#[test]
fn no_driver_gets_the_microphones_and_others_keep_theirs() {
    let tree = Tree::new();
    for device in [PICTURES, MICROPHONES, OTHER_SOUND] {
        let skipped = "no_driver_gets_the_microphones_and_others_keep_theirs";
        if shipped(&tree, device, skipped).is_none() {
            return;
        }
    }
    let authorized = |device: &str| tree.attribute(device, "authorized");
    assert_eq!(
        [PICTURES, MICROPHONES, OTHER_SOUND].map(authorized),
        ["1", "0", "1"]
    );
}

#[test]
fn the_rules_come_before_those_that_open_cameras_to_everybody() {
    let name = |path: PathBuf| path.file_name().unwrap().to_str().unwrap().to_owned();
    let rules: Vec<String> = std::fs::read_dir(udev_folder())
        .unwrap()
        .map(|entry| name(entry.unwrap().path()))
        .filter(|name| name.ends_with(".rules"))
        .collect();
    assert_eq!(rules, [RULES]);
    assert!(*RULES < *"60-libopenni2-0.rules");
    let text = own_rules();
    assert!(text.contains("MODE:=\"0660\", GROUP:=\"capture\""));
    assert_eq!(text.matches("0500|0600|0601|0609").count(), 2);
    // udev does not report every label that is missing.
    for jump in text.split("GOTO=\"").skip(1) {
        let label = jump.split('"').next().unwrap();
        assert_eq!(
            text.matches(&format!("LABEL=\"{label}\"")).count(),
            1,
            "{label}"
        );
    }
}
