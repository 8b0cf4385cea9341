//! Files of the rig, tools that may be absent, and a device tree that is made.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// The folder `udev` of the source tree.
pub(crate) fn udev_folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../udev")
}

pub(crate) fn udev_file(name: &str) -> String {
    std::fs::read_to_string(udev_folder().join(name)).unwrap()
}

pub(crate) fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Standard output and standard error.
pub(crate) fn all_words(output: &Output) -> String {
    text(&output.stdout) + &text(&output.stderr)
}

/// Whether a tool is there; says by name what is skipped.
pub(crate) fn has(tool: &str, skipped: &str) -> bool {
    let is_there = Command::new(tool).arg("--version").output().is_ok();
    if !is_there {
        println!("skipped {skipped}: no {tool}");
    }
    is_there
}

/// A camera with microphones and another device, as the kernel shows them in /sys.
pub(crate) struct Tree {
    folder: tempfile::TempDir,
}

/// Path of the camera in /sys; it has characters that systemd escapes.
pub(crate) const CAMERA: &str = "/sys/devices/pci0000:00/0000:00:14.0/usb1/1-2";
/// Its microphones.
pub(crate) const MICROPHONES: &str = "/sys/devices/pci0000:00/0000:00:14.0/usb1/1-2/1-2:1.1";
/// The interface of its pictures.
pub(crate) const PICTURES: &str = "/sys/devices/pci0000:00/0000:00:14.0/usb1/1-2/1-2:1.0";
/// A second camera behind the first one's hub.
pub(crate) const SECOND: &str = "/sys/devices/pci0000:00/0000:00:14.0/usb1/1-3/1-3.1";
/// A device of somebody else, with a sound interface.
pub(crate) const OTHER: &str = "/sys/devices/pci0000:00/0000:00:14.0/usb1/1-4";
/// Its sound interface.
pub(crate) const OTHER_SOUND: &str = "/sys/devices/pci0000:00/0000:00:14.0/usb1/1-4/1-4:1.0";

impl Tree {
    pub(crate) fn new() -> Self {
        let tree = Self {
            folder: tempfile::tempdir().unwrap(),
        };
        tree.device(CAMERA, "1d27", "0601", 5);
        tree.interface(PICTURES, "ff");
        tree.interface(MICROPHONES, "01");
        tree.device(SECOND, "1d27", "0609", 6);
        tree.device(OTHER, "046d", "0825", 7);
        tree.interface(OTHER_SOUND, "01");
        tree
    }

    pub(crate) fn folder(&self) -> &Path {
        self.folder.path()
    }

    /// What stands in the attribute `name` of `device`.
    pub(crate) fn attribute(&self, device: &str, name: &str) -> String {
        std::fs::read_to_string(self.place(device).join(name)).unwrap()
    }

    fn place(&self, device: &str) -> PathBuf {
        self.folder
            .path()
            .join(device.strip_prefix("/sys/").unwrap())
    }

    fn device(&self, path: &str, vendor: &str, product: &str, number: u32) {
        let uevent = format!(
            "MAJOR=189\nMINOR={}\nDEVNAME=bus/usb/001/{number:03}\nDEVTYPE=usb_device\n",
            number - 1
        );
        self.node(path, &uevent);
        self.write(path, "idVendor", vendor);
        self.write(path, "idProduct", product);
        self.write(path, "power/control", "au");
    }

    fn interface(&self, path: &str, class: &str) {
        self.node(path, "DEVTYPE=usb_interface\n");
        self.write(path, "bInterfaceClass", class);
        self.write(path, "authorized", "1");
    }

    fn node(&self, path: &str, uevent: &str) {
        let bus = self.folder.path().join("bus/usb");
        std::fs::create_dir_all(&bus).unwrap();
        std::fs::create_dir_all(self.place(path)).unwrap();
        let up = "../".repeat(path.split('/').count() - 2);
        std::os::unix::fs::symlink(up + "bus/usb", self.place(path).join("subsystem")).unwrap();
        self.write(path, "uevent", uevent);
    }

    fn write(&self, device: &str, name: &str, value: &str) {
        let path = self.place(device).join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, value).unwrap();
    }
}
