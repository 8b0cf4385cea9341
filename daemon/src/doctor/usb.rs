//! The camera on the bus.

use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};

use ps1080::usb::{PRODUCT_IDS, VENDOR_ID};

use super::{Finding, Identity, Roots, Severity, read};
use crate::ps1080::usb::QueueShape;

/// Bits a second that a camera needs of its bus, in millions: USB 2.
const NEEDED_MBPS: f64 = 480.0;
/// Of which a camera at VGA uses most: two do not fit one bus.
const CAMERAS_A_BUS: usize = 1;
/// Bytes of a megabyte, as the kernel counts them here.
const MEGABYTE: usize = 1 << 20;

/// A camera as the kernel shows it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CameraFolder {
    /// Its folder in /sys.
    pub path: PathBuf,
    /// Name there, such as 1-2.
    pub name: String,
    /// Bus and address.
    pub place: (u8, u8),
}

/// The cameras that are plugged in.
pub fn cameras(roots: &Roots) -> Vec<CameraFolder> {
    let folder = roots.sys.join("bus/usb/devices");
    let mut cameras: Vec<CameraFolder> = std::fs::read_dir(&folder)
        .into_iter()
        .flatten()
        .filter_map(|entry| {
            let path = entry.ok()?.path();
            let id = |name: &str| u16::from_str_radix(&read(&path.join(name))?, 16).ok();
            let number = |name: &str| read(&path.join(name))?.parse().ok();
            let is_camera = id("idVendor")? == VENDOR_ID && PRODUCT_IDS.contains(&id("idProduct")?);
            is_camera.then_some(())?;
            Some(CameraFolder {
                name: path.file_name()?.to_string_lossy().into_owned(),
                place: (number("busnum")?, number("devnum")?),
                path,
            })
        })
        .collect();
    cameras.sort_by(|a, b| a.name.cmp(&b.name));
    cameras
}

/// All that concerns USB.
pub fn examine(roots: &Roots, who: &Identity, cameras: &[CameraFolder]) -> Vec<Finding> {
    if cameras.is_empty() {
        let ids: Vec<String> = PRODUCT_IDS
            .iter()
            .map(|id| format!("{VENDOR_ID:04x}:{id:04x}"))
            .collect();
        return vec![
            Finding::new(
                "camera",
                Severity::Bad,
                format!("no camera is plugged in (looked for {})", ids.join(", ")),
                "plug it in; `lsusb -d 1d27:` shows whether the machine sees it; try another cable or port",
            ),
            memory(roots, 1),
        ];
    }
    let mut findings = Vec::new();
    for camera in cameras {
        findings.push(Finding::fine(
            "camera",
            format!("{} is plugged in", camera.name),
        ));
        findings.push(node(roots, who, camera));
        findings.push(claim(camera));
        findings.extend(audio(camera));
        findings.push(speed(camera));
        findings.push(autosuspend(camera));
    }
    findings.extend(shared_bus(cameras));
    findings.push(memory(roots, cameras.len()));
    findings
}

/// Rights to open the device.
fn node(roots: &Roots, who: &Identity, camera: &CameraFolder) -> Finding {
    let (bus, address) = camera.place;
    let path = roots.dev.join(format!("bus/usb/{bus:03}/{address:03}"));
    let Ok(metadata) = std::fs::metadata(&path) else {
        return Finding::new(
            "node",
            Severity::Bad,
            format!("{} is not there", path.display()),
            "in a container or unit, let it see the device: --device, or PrivateDevices=no and DeviceAllow=char-usb_device rw",
        );
    };
    let bits = metadata.mode() & 0o777;
    let class = if who.user == 0 {
        6
    } else if metadata.uid() == who.user {
        bits >> 6
    } else if who.groups.contains(&metadata.gid()) {
        bits >> 3
    } else {
        bits
    };
    let words = format!(
        "{} has mode {bits:03o}, user {}, group {}",
        path.display(),
        metadata.uid(),
        metadata.gid()
    );
    if class & 6 == 6 {
        return Finding::fine("node", words);
    }
    Finding::new(
        "node",
        Severity::Bad,
        format!("{words}: it cannot be opened for reading and writing"),
        "sudo udev/install.sh && sudo usermod -aG capture $USER, log in again, plug the camera in again",
    )
}

/// Who has interface 0.
fn claim(camera: &CameraFolder) -> Finding {
    let name = format!("{}:1.0", camera.name);
    match driver(camera, 0) {
        None => Finding::fine("interface", format!("nobody has claimed {name}")),
        Some(driver) if driver == "usbfs" => Finding::new(
            "interface",
            Severity::Bad,
            format!("another program has claimed {name}"),
            format!(
                "end it; who it is: sudo fuser -v /dev/bus/usb/{:03}/{:03}",
                camera.place.0, camera.place.1
            ),
        ),
        Some(driver) => Finding::new(
            "interface",
            Severity::Bad,
            format!("the kernel's driver {driver} has claimed {name}"),
            format!("echo {name} | sudo tee /sys/bus/usb/drivers/{driver}/unbind"),
        ),
    }
}

/// The microphones' driver: some cameras no longer answer after it has failed.
fn audio(camera: &CameraFolder) -> Option<Finding> {
    let (number, driver) = (1..8).find_map(|number| Some((number, driver(camera, number)?)))?;
    let name = format!("{}:1.{number}", camera.name);
    Some(Finding::new(
        "audio",
        Severity::Warning,
        format!(
            "{driver} has claimed the microphones ({name}); some cameras no longer answer once it fails"
        ),
        format!(
            "sudo udev/install.sh, whose rule keeps it away; now: echo {name} | sudo tee /sys/bus/usb/drivers/{driver}/unbind"
        ),
    ))
}

fn driver(camera: &CameraFolder, interface: u8) -> Option<String> {
    let name = format!("{}:1.{interface}", camera.name);
    let beside = camera.path.parent().unwrap_or(Path::new("/")).join(&name);
    let places = [camera.path.join(&name), beside];
    let link = places
        .iter()
        .find_map(|place| std::fs::read_link(place.join("driver")).ok())?;
    Some(link.file_name()?.to_string_lossy().into_owned())
}

fn speed(camera: &CameraFolder) -> Finding {
    let text = read(&camera.path.join("speed")).unwrap_or_default();
    let version = read(&camera.path.join("version")).unwrap_or_default();
    match text.parse::<f64>() {
        Ok(speed) if speed >= NEEDED_MBPS => Finding::fine(
            "speed",
            format!("{}: {speed} Mbit/s, USB {version}", camera.name),
        ),
        Ok(speed) => Finding::new(
            "speed",
            Severity::Bad,
            format!(
                "{}: {speed} Mbit/s; the camera needs {NEEDED_MBPS}",
                camera.name
            ),
            "use a USB 2 or 3 port of the machine itself and another cable, no old hub; then: cat /sys/bus/usb/devices/*/speed",
        ),
        Err(_) => Finding::new(
            "speed",
            Severity::Note,
            format!("{}: the kernel does not say the speed", camera.name),
            "lsusb -t shows it",
        ),
    }
}

fn autosuspend(camera: &CameraFolder) -> Finding {
    let path = camera.path.join("power/control");
    match read(&path).as_deref() {
        Some("on") => Finding::fine("autosuspend", format!("{}: off", camera.name)),
        Some(other) => Finding::new(
            "autosuspend",
            Severity::Warning,
            format!(
                "{}: power/control is `{other}`: the camera may be put to sleep before it is opened",
                camera.name
            ),
            format!(
                "echo on | sudo tee /sys/bus/usb/devices/{}/power/control",
                camera.name
            ),
        ),
        None => Finding::new(
            "autosuspend",
            Severity::Note,
            format!("{}: power/control cannot be read", camera.name),
            format!("cat {}", path.display()),
        ),
    }
}

/// Cameras that share one bus do not get what they need.
fn shared_bus(cameras: &[CameraFolder]) -> Option<Finding> {
    let on_bus = |bus: u8| cameras.iter().filter(move |camera| camera.place.0 == bus);
    let bus = cameras
        .iter()
        .map(|camera| camera.place.0)
        .find(|bus| on_bus(*bus).count() > CAMERAS_A_BUS)?;
    let names: Vec<&str> = on_bus(bus).map(|camera| camera.name.as_str()).collect();
    Some(Finding::new(
        "bandwidth",
        Severity::Warning,
        format!(
            "{} share bus {bus}: each needs most of one",
            names.join(" and ")
        ),
        "plug one into a port of another controller; lsusb -t shows which is which",
    ))
}

/// Memory that the kernel grants to transfers of all programs.
fn memory(roots: &Roots, camera_count: usize) -> Finding {
    let shape = QueueShape::default();
    let needed = camera_count * 2 * shape.bulk_transfers * shape.bulk_bytes;
    let needed_mb = needed.div_ceil(MEGABYTE);
    let path = roots.sys.join("module/usbcore/parameters/usbfs_memory_mb");
    let granted: Option<usize> = read(&path).and_then(|text| text.parse().ok());
    match granted {
        // 0 is no limit.
        Some(granted_mb) if granted_mb == 0 || granted_mb >= 2 * needed_mb => Finding::fine(
            "usbfs-memory",
            format!("{granted_mb} MB are granted, {needed_mb} MB needed"),
        ),
        Some(granted_mb) => Finding::new(
            "usbfs-memory",
            if granted_mb < needed_mb {
                Severity::Bad
            } else {
                Severity::Warning
            },
            format!("{granted_mb} MB are granted to all USB programs, {needed_mb} MB needed"),
            "echo 64 | sudo tee /sys/module/usbcore/parameters/usbfs_memory_mb; for good: usbcore.usbfs_memory_mb=64 on the kernel's command line",
        ),
        None => Finding::new(
            "usbfs-memory",
            Severity::Note,
            format!("{} cannot be read", path.display()),
            "nothing, where this is a container: look at it on the host",
        ),
    }
}
