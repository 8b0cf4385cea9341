//! Which cameras are plugged in.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail};
use ps1080::usb::{PRODUCT_IDS, VENDOR_ID};
use rusb::{Context, Device, UsbContext as _};
use serde::Serialize;

use super::transport::{LibusbTransport, error_of};
use crate::ps1080::Camera;
use crate::ps1080::session::Session;
use crate::ps1080::usb::UsbError;
use crate::source_spec::{CameraSpec, WhichCamera};

/// Where the kernel shows its USB devices.
const SYSFS_DEVICES: &str = "/sys/bus/usb/devices";

/// A camera that is plugged in.
#[derive(Clone, Debug, Serialize)]
pub struct Found {
    /// What it is called.
    pub product: String,
    /// Vendor and product.
    pub usb_id: String,
    /// Serial number by its firmware; empty where it has none or was not asked.
    pub serial: String,
    /// Version of the firmware; empty where it was not asked.
    pub firmware: String,
    /// Bus number.
    pub bus: u8,
    /// Address on the bus: another one each time it is plugged in.
    pub address: u8,
    /// Where it is plugged in: stays the same.
    pub path: String,
    /// `low`, `full`, `high` (480 Mbit/s, what it needs), `super` or `unknown`.
    pub speed: String,
    /// Why it cannot be asked.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub problem: Option<String>,
}

/// A camera, for libusb and for people.
struct Plugged {
    device: Device<Context>,
    found: Found,
}

/// Looks without opening any.
///
/// # Errors
/// When libusb cannot begin.
fn find() -> anyhow::Result<Vec<Plugged>> {
    let context = Context::new()
        .context("libusb cannot begin (a sandbox must allow the address family AF_NETLINK)")?;
    let mut cameras = Vec::new();
    for device in context
        .devices()
        .context("the USB devices cannot be listed")?
        .iter()
    {
        let Ok(descriptor) = device.device_descriptor() else {
            continue;
        };
        let product_id = descriptor.product_id();
        if descriptor.vendor_id() != VENDOR_ID || !PRODUCT_IDS.contains(&product_id) {
            continue;
        }
        let found = Found {
            product: product_name(product_id).to_owned(),
            usb_id: format!("{VENDOR_ID:04x}:{product_id:04x}"),
            serial: String::new(),
            firmware: String::new(),
            bus: device.bus_number(),
            address: device.address(),
            path: path_of(&device),
            speed: speed_name(device.speed()).to_owned(),
            problem: None,
        };
        cameras.push(Plugged { device, found });
    }
    cameras.sort_by_key(|camera| (camera.found.bus, camera.found.address));
    Ok(cameras)
}

/// Looks, and asks each for its firmware and serial number.
///
/// # Errors
/// As [`find`].
pub fn list() -> anyhow::Result<Vec<Found>> {
    Ok(find()?.into_iter().map(Plugged::asked).collect())
}

impl Plugged {
    /// With firmware and serial number, where it answers.
    fn asked(self) -> Found {
        let mut found = self.found.clone();
        match self.ask() {
            Ok((firmware, serial)) => (found.firmware, found.serial) = (firmware, serial),
            Err(error) => found.problem = Some(format!("{error:#}")),
        }
        found
    }

    fn ask(&self) -> anyhow::Result<(String, String)> {
        let mut session = Session::new(Box::new(self.open()?));
        let version = session.ask_version()?;
        let firmware = version.firmware;
        let serial = session.ask_serial(firmware)?;
        Ok((format!("{firmware} ({:?})", version.hardware()), serial))
    }

    fn open(&self) -> anyhow::Result<LibusbTransport> {
        let place = &self.found.path;
        LibusbTransport::open(&self.device).map_err(|error| match error {
            UsbError::Access => anyhow::anyhow!(
                "{place}: no right to open the camera; install the udev rule, or be in its group"
            ),
            UsbError::Busy => {
                anyhow::anyhow!("{place}: another program uses the camera; end it first")
            }
            UsbError::Gone => anyhow::anyhow!(
                "{place}: the camera is gone, or a sandbox hides it (PrivateDevices=yes, no DeviceAllow=)"
            ),
            error => anyhow::anyhow!(
                "{place}: the camera cannot be opened: {error} (a sandbox without DeviceAllow=char-usb_device rw?)"
            ),
        })
    }
}

/// Opens the camera that `spec` names, and configures it.
///
/// # Errors
/// No such camera, or more than one; one that cannot be opened or cannot do what is wanted.
pub fn open_camera(spec: &CameraSpec) -> anyhow::Result<Camera> {
    let camera = choose(find()?, &spec.which)?;
    let usb = Box::new(camera.open()?);
    let Found { product, path, .. } = camera.found;
    Camera::open(usb, spec.wanted, &product, &path).with_context(|| path.clone())
}

fn choose(cameras: Vec<Plugged>, which: &WhichCamera) -> anyhow::Result<Plugged> {
    let places = || -> Vec<String> {
        let places = cameras.iter().map(|camera| camera.found.path.clone());
        places.collect()
    };
    if cameras.is_empty() {
        bail!("no PrimeSense camera is plugged in; `glintd doctor` looks for the reason");
    }
    let place = match which {
        WhichCamera::Only if cameras.len() > 1 => bail!(
            "{} cameras are plugged in; name one: {}",
            cameras.len(),
            places()
                .iter()
                .map(|place| format!("ps1080:{place}"))
                .collect::<Vec<_>>()
                .join(", ")
        ),
        WhichCamera::Only => Some(0),
        WhichCamera::Path(path) => {
            let (bus, address) = bus_and_address(path)?;
            cameras
                .iter()
                .position(|camera| (camera.found.bus, camera.found.address) == (bus, address))
        }
        WhichCamera::Serial(serial) => cameras
            .iter()
            .position(|camera| camera.ask().is_ok_and(|(_, asked)| asked == *serial)),
    };
    match place.and_then(|place| cameras_at(cameras, place)) {
        Some(camera) => Ok(camera),
        None => bail!("no camera is {which}; `glintd list` shows those that are plugged in"),
    }
}

fn cameras_at(cameras: Vec<Plugged>, place: usize) -> Option<Plugged> {
    cameras.into_iter().nth(place)
}

/// What the kernel says of the device at `path`, a folder in /sys: its address changes whenever it is plugged in.
fn bus_and_address(path: &Path) -> anyhow::Result<(u8, u8)> {
    let number = |name: &str| -> anyhow::Result<u8> {
        let path = path.join(name);
        let text = std::fs::read_to_string(&path).with_context(|| {
            format!(
                "{}: no USB device is there; `glintd list` shows paths",
                path.display()
            )
        })?;
        let parsed = text.trim().parse();
        parsed.with_context(|| format!("{}: `{}` is no number", path.display(), text.trim()))
    };
    Ok((number("busnum")?, number("devnum")?))
}

/// The device's folder in /sys, where there is one.
fn path_of(device: &Device<Context>) -> String {
    let ports = device.port_numbers().map_err(error_of).unwrap_or_default();
    let ports: Vec<String> = ports.iter().map(u8::to_string).collect();
    let name = format!("{}-{}", device.bus_number(), ports.join("."));
    let link = PathBuf::from(SYSFS_DEVICES).join(&name);
    match link.canonicalize() {
        Ok(path) if !ports.is_empty() => path.display().to_string(),
        _ => format!("usb {}:{}", device.bus_number(), device.address()),
    }
}

fn product_name(product_id: u16) -> &'static str {
    match product_id {
        0x0500 => "PrimeSense sensor",
        0x0600 | 0x0601 => "ASUS Xtion Pro",
        _ => "PrimeSense Carmine",
    }
}

fn speed_name(speed: rusb::Speed) -> &'static str {
    match speed {
        rusb::Speed::Low => "low",
        rusb::Speed::Full => "full",
        rusb::Speed::High => "high",
        rusb::Speed::Super | rusb::Speed::SuperPlus => "super",
        _ => "unknown",
    }
}
