//! The unit, judged by systemd's own tools, which need no running systemd.

use std::process::Command;

use crate::machine::{CAMERA, SECOND, all_words, has, text, udev_file};

const UNIT: &str = "glintd@.service";
const PROGRAM: &str = "/usr/local/bin/glintd";
/// Exposure that is still fine, tenths.
const THRESHOLD: &str = "10";

/// The unit in a folder, with the program of this build in it.
fn copy() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let unit = udev_file(UNIT);
    assert!(unit.contains(&format!("ExecStart={PROGRAM} ")));
    let unit = unit.replace(PROGRAM, env!("CARGO_BIN_EXE_glintd"));
    std::fs::write(folder.path().join(UNIT), unit).unwrap();
    folder
}

#[test]
fn systemd_reads_the_unit_without_a_word() {
    if !has("systemd-analyze", "systemd_reads_the_unit_without_a_word") {
        return;
    }
    let folder = copy();
    let path = folder.path().join(UNIT);
    let verify = || {
        let verified = Command::new("systemd-analyze")
            .args(["verify", "--man=no"])
            .arg(&path)
            .output()
            .unwrap();
        (verified.status.success(), all_words(&verified))
    };
    assert_eq!(verify(), (true, String::new()));
    // An unknown key only makes it say something.
    let wrong = std::fs::read_to_string(&path)
        .unwrap()
        .replace("WatchdogSec", "WatchdogSecs");
    std::fs::write(&path, wrong).unwrap();
    assert!(verify().1.contains("WatchdogSecs"));
}

#[test]
fn the_sandbox_scores_under_one() {
    if !has("systemd-analyze", "the_sandbox_scores_under_one") {
        return;
    }
    let folder = copy();
    let judged = Command::new("systemd-analyze")
        .args(["security", "--offline=true", "--no-pager"])
        .arg(format!("--threshold={THRESHOLD}"))
        .arg(folder.path().join(UNIT))
        .output()
        .unwrap();
    let said = text(&judged.stdout);
    let verdict = said
        .lines()
        .find(|line| line.contains("Overall exposure level"))
        .unwrap_or_default();
    println!("{verdict}");
    assert!(judged.status.success(), "{}", all_words(&judged));
}

#[test]
fn the_instance_of_a_camera_gives_its_path_back() {
    if !has(
        "systemd-escape",
        "the_instance_of_a_camera_gives_its_path_back",
    ) {
        return;
    }
    let run = |arguments: &[&str]| {
        let output = Command::new("systemd-escape")
            .args(arguments)
            .output()
            .unwrap();
        assert!(output.status.success(), "{}", all_words(&output));
        text(&output.stdout).trim_end().to_owned()
    };
    let instances = [CAMERA, SECOND].map(|camera| {
        let unit = run(&["--path", "--template", UNIT, camera]);
        // What `%f` is in the unit.
        let instance = unit
            .strip_prefix("glintd@")
            .and_then(|rest| rest.strip_suffix(".service"))
            .unwrap();
        assert_eq!(run(&["--path", "--unescape", instance]), camera);
        unit
    });
    assert_ne!(instances[0], instances[1]);
    assert!(instances[0].ends_with("usb1-1\\x2d2.service"));
}

/// What the program relies on, and what it must not have.
#[test]
fn the_unit_is_pulled_in_by_the_device_only() {
    let unit = udev_file(UNIT);
    for line in [
        "BindsTo=%i.device",
        "After=%i.device",
        "Type=notify",
        "WatchdogSec=10",
        "SuccessExitStatus=3",
        "StateDirectory=glint",
        "DeviceAllow=char-usb_device rw",
        "RestrictAddressFamilies=AF_UNIX AF_NETLINK",
        "LimitRTPRIO=30",
        "LimitMEMLOCK=512M",
    ] {
        assert!(unit.lines().any(|stands| stands == line), "{line}");
    }
    for word in ["[Install]", "PrivateDevices=yes", "RestrictRealtime=yes"] {
        assert!(!unit.contains(word), "{word}");
    }
    assert!(unit.contains("glintd record ps1080:%f --config /etc/glint/glintd.toml"));
}
