//! Set-ups that are broken, made in a temporary tree: each is found, with the command that mends it.

use std::cell::Cell;
use std::fs;
use std::os::unix::fs::{PermissionsExt as _, symlink};
use std::path::Path;

use glintd::doctor::{Finding, Identity, Roots, Severity, disk, load, rights, rules, usb};
use sequence::SequenceError;
use sequence::file_layer::{FileLayer, WritePath, create};

/// A machine on which all is well, with one camera at 1-2.
struct Machine {
    folder: tempfile::TempDir,
    who: Identity,
}

/// A user who is in the group of the node.
fn member(folder: &Path) -> Identity {
    use std::os::unix::fs::MetadataExt as _;
    Identity {
        user: 12_345,
        groups: vec![fs::metadata(folder).unwrap().gid()],
    }
}

impl Machine {
    fn whole() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let machine = Self {
            who: member(folder.path()),
            folder,
        };
        let device = "sys/bus/usb/devices/1-2";
        for (name, text) in [
            ("idVendor", "1d27\n"),
            ("idProduct", "0601\n"),
            ("busnum", "1\n"),
            ("devnum", "5\n"),
            ("speed", "480\n"),
            ("version", " 2.00\n"),
            ("power/control", "on\n"),
        ] {
            machine.write(&format!("{device}/{name}"), text);
        }
        machine.write("sys/module/usbcore/parameters/usbfs_memory_mb", "16\n");
        machine.write("dev/bus/usb/001/005", "");
        machine.mode("dev/bus/usb/001/005", 0o660);
        machine.write(
            "rules/59-glint.rules",
            "ATTR{idVendor}==\"1d27\", GROUP:=\"capture\"\n",
        );
        machine.write("proc/loadavg", "0.10 0.20 0.30 1/100 999\n");
        machine.write("proc/stat", "cpu  1 2 3\ncpu0 1 2 3\ncpu1 1 2 3\nintr 0\n");
        machine.write(
            "proc/self/limits",
            "Limit                     Soft Limit           Hard Limit           Units     \n\
             Max locked memory         536870912            536870912            bytes     \n\
             Max realtime priority     30                   30                   \n",
        );
        machine
    }

    fn roots(&self) -> Roots {
        let at = |name: &str| self.folder.path().join(name);
        Roots {
            sys: at("sys"),
            proc: at("proc"),
            dev: at("dev"),
            rules: vec![at("rules")],
        }
    }

    fn write(&self, name: &str, text: &str) {
        let path = self.folder.path().join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, text).unwrap();
    }

    fn mode(&self, name: &str, mode: u32) {
        let path = self.folder.path().join(name);
        fs::set_permissions(path, fs::Permissions::from_mode(mode)).unwrap();
    }

    fn bind(&self, interface: &str, driver: &str) {
        let folder = self
            .folder
            .path()
            .join("sys/bus/usb/devices")
            .join(interface);
        fs::create_dir_all(&folder).unwrap();
        symlink(
            format!("../../../../bus/usb/drivers/{driver}"),
            folder.join("driver"),
        )
        .unwrap();
    }

    /// Everything but the measured checks.
    fn findings(&self) -> Vec<Finding> {
        let roots = self.roots();
        let mut findings = usb::examine(&roots, &self.who, &usb::cameras(&roots));
        findings.extend(rules::examine(&roots));
        findings.push(load::busy(&roots));
        findings.extend(rights::examine(&roots, &self.who));
        findings
    }

    /// The one finding that is not fine.
    fn complaint(&self) -> Finding {
        let findings = self.findings();
        let mut worse = findings
            .iter()
            .filter(|finding| finding.severity > Severity::Fine);
        match (worse.next(), worse.next()) {
            (Some(one), None) => one.clone(),
            _ => panic!("{findings:#?}"),
        }
    }
}

/// The only complaint is `check`, of this severity, and its mending command has these words.
fn assert_complaint(machine: &Machine, check: &str, severity: Severity, mend: &str) {
    let found = machine.complaint();
    assert_eq!(
        (found.check, found.severity),
        (check, severity),
        "{found:?}"
    );
    let command = found.mend.unwrap_or_default();
    assert!(command.contains(mend), "{command}");
}

#[test]
fn a_machine_on_which_all_is_well_gets_no_complaint() {
    let findings = Machine::whole().findings();
    assert!(findings.len() >= 9);
    assert!(
        findings
            .iter()
            .all(|finding| finding.severity == Severity::Fine && finding.mend.is_none()),
        "{findings:#?}"
    );
}

#[test]
fn a_node_without_rights_is_found() {
    let mut machine = Machine::whole();
    machine.who.groups.clear();
    assert_complaint(&machine, "node", Severity::Bad, "usermod -aG capture");
    let machine = Machine::whole();
    machine.mode("dev/bus/usb/001/005", 0o440);
    assert_complaint(&machine, "node", Severity::Bad, "udev/install.sh");
    let machine = Machine::whole();
    fs::remove_file(machine.folder.path().join("dev/bus/usb/001/005")).unwrap();
    assert_complaint(&machine, "node", Severity::Bad, "DeviceAllow");
}

#[test]
fn a_claimed_interface_is_found() {
    let machine = Machine::whole();
    machine.bind("1-2:1.0", "usbfs");
    assert_complaint(
        &machine,
        "interface",
        Severity::Bad,
        "fuser -v /dev/bus/usb/001/005",
    );
    let machine = Machine::whole();
    machine.bind("1-2:1.0", "gspca_kinect");
    assert_complaint(
        &machine,
        "interface",
        Severity::Bad,
        "echo 1-2:1.0 | sudo tee /sys/bus/usb/drivers/gspca_kinect/unbind",
    );
    let machine = Machine::whole();
    machine.bind("1-2:1.1", "snd-usb-audio");
    assert_complaint(&machine, "audio", Severity::Warning, "snd-usb-audio/unbind");
}

#[test]
fn a_slow_port_and_autosuspend_are_found() {
    let machine = Machine::whole();
    machine.write("sys/bus/usb/devices/1-2/speed", "12\n");
    assert_complaint(&machine, "speed", Severity::Bad, "USB 2 or 3 port");
    let machine = Machine::whole();
    machine.write("sys/bus/usb/devices/1-2/power/control", "auto\n");
    assert_complaint(
        &machine,
        "autosuspend",
        Severity::Warning,
        "echo on | sudo tee /sys/bus/usb/devices/1-2/power/control",
    );
}

#[test]
fn small_usbfs_memory_is_found() {
    let machine = Machine::whole();
    machine.write("sys/module/usbcore/parameters/usbfs_memory_mb", "1\n");
    assert_complaint(&machine, "usbfs-memory", Severity::Bad, "usbfs_memory_mb");
    // No limit.
    machine.write("sys/module/usbcore/parameters/usbfs_memory_mb", "0\n");
    let fine = |finding: &Finding| finding.severity == Severity::Fine;
    assert!(machine.findings().iter().all(fine));
}

#[test]
fn two_cameras_on_one_bus_are_found() {
    let machine = Machine::whole();
    for name in ["idVendor", "idProduct", "busnum", "speed", "power/control"] {
        let folder = machine.folder.path().join("sys/bus/usb/devices");
        let text = fs::read_to_string(folder.join("1-2").join(name)).unwrap();
        machine.write(&format!("sys/bus/usb/devices/1-3/{name}"), &text);
    }
    machine.write("sys/bus/usb/devices/1-3/devnum", "6\n");
    machine.write("dev/bus/usb/001/006", "");
    machine.mode("dev/bus/usb/001/006", 0o660);
    assert_complaint(
        &machine,
        "bandwidth",
        Severity::Warning,
        "another controller",
    );
}

#[test]
fn no_camera_is_found_and_another_device_is_none() {
    let machine = Machine::whole();
    machine.write("sys/bus/usb/devices/1-2/idProduct", "1280\n");
    assert_complaint(&machine, "camera", Severity::Bad, "lsusb");
}

#[test]
fn a_missing_rule_and_one_that_comes_first_are_found() {
    let machine = Machine::whole();
    fs::remove_file(machine.folder.path().join("rules/59-glint.rules")).unwrap();
    assert_complaint(&machine, "udev-rule", Severity::Warning, "udev/install.sh");
    let machine = Machine::whole();
    let open = "ATTRS{idVendor}==\"1d27\", MODE:=\"0666\"\n";
    machine.write("rules/40-libopenni2-0.rules", open);
    assert_complaint(&machine, "udev-rule", Severity::Warning, "udev/install.sh");
    let machine = Machine::whole();
    machine.write("rules/60-libopenni2-0.rules", open);
    let fine = |finding: &Finding| finding.severity == Severity::Fine;
    assert!(machine.findings().iter().all(fine));
}

#[test]
fn a_busy_processor_is_found() {
    let machine = Machine::whole();
    machine.write("proc/loadavg", "5.10 4.20 0.30 9/100 999\n");
    assert_complaint(&machine, "busy", Severity::Bad, "renice");
    machine.write("proc/loadavg", "1.90 4.20 0.30 9/100 999\n");
    assert_complaint(&machine, "busy", Severity::Warning, "renice");
}

#[test]
fn missing_real_time_rights_are_found() {
    let machine = Machine::whole();
    machine.write(
        "proc/self/limits",
        "Max locked memory         unlimited            unlimited            bytes     \n\
         Max realtime priority     0                    0                    \n",
    );
    assert_complaint(&machine, "real-time", Severity::Warning, "LimitRTPRIO=30");
}

thread_local! {
    /// What the clock of the test shows, nanoseconds, and how much a look at it takes.
    static CLOCK: Cell<(i64, i64)> = const { Cell::new((0, 0)) };
}

fn clock() -> i64 {
    let (now, step) = CLOCK.get();
    CLOCK.set((now + step, step));
    now
}

fn core_clock() -> u64 {
    clock().unsigned_abs()
}

#[test]
fn a_slow_disk_is_found() {
    let folder = tempfile::tempdir().unwrap();
    // The clock is looked at nine times: 90 pairs of 921 600 bytes, so 8 steps for 83 MB.
    for (step, severity) in [
        (1_000_000, Severity::Fine),
        (250_000_000, Severity::Warning),
        (600_000_000, Severity::Bad),
    ] {
        CLOCK.set((0, step));
        let found = disk::examine(folder.path(), clock, None);
        assert_eq!(found.severity, severity, "{found:?}");
        if severity > Severity::Fine {
            assert!(found.mend.unwrap().contains("iotop"));
        }
    }
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn a_folder_that_takes_no_file_is_found() {
    CLOCK.set((0, 1_000_000));
    let folder = tempfile::tempdir().unwrap();
    let absent = folder.path().join("absent");
    let found = disk::examine(&absent, clock, None);
    assert_eq!(found.severity, Severity::Bad, "{found:?}");
    let mut full = |path: &Path| -> Result<Box<dyn FileLayer>, SequenceError> {
        drop(create(path, WritePath::Pwrite)?);
        Err(std::io::Error::from(std::io::ErrorKind::StorageFull).into())
    };
    let found = disk::examine(folder.path(), clock, Some(&mut full));
    assert_eq!(found.severity, Severity::Bad, "{found:?}");
    assert!(found.mend.unwrap().contains("df -h"));
}

#[test]
fn a_slow_processor_is_found() {
    // Between begin and end the clock is looked at once: the step is what 20 pairs take.
    for (step, severity) in [
        (100_000_000, Severity::Fine),
        (300_000_000, Severity::Warning),
        (900_000_000, Severity::Bad),
    ] {
        CLOCK.set((0, step));
        let found = load::capture(core_clock);
        assert_eq!(found.severity, severity, "{found:?}");
    }
}
