//! What the user names as the source of frames.

use std::path::PathBuf;
use std::str::FromStr;

use ps1080::color::ColorFormat;
use ps1080::mode::Resolution;
use ps1080::samples::SampleFormat;

use crate::ps1080::modes::{ColorChoice, EmitterPlan, ExposurePlan, Wanted};

/// Where frames come from.
#[derive(Clone, Debug, PartialEq)]
pub enum SourceSpec {
    /// A recording in place of a camera: `replay:FILE[?speed=max|1|0.5][&loop]`.
    Replay(ReplaySpec),
    /// A PrimeSense camera: `ps1080[:SERIAL]` or `ps1080:/SYSFS-PATH`, and [`CAMERA_OPTIONS`] behind a `?`.
    Camera(CameraSpec),
    /// A camera or a `.oni` file behind OpenNI2: `openni2[:URI][?registration=on|off]`.
    #[cfg(feature = "openni2")]
    OpenNi2(OpenNi2Spec),
}

/// A device behind OpenNI2.
#[cfg(feature = "openni2")]
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct OpenNi2Spec {
    /// As OpenNI2 names it (`1d27/0601@1/7`), or a `.oni` file; any device when absent.
    pub uri: Option<String>,
    /// Asks a camera to warp depth to colour.
    pub is_registered: bool,
}

/// A recording that is played.
#[derive(Clone, Debug, PartialEq)]
pub struct ReplaySpec {
    /// The recording.
    pub path: PathBuf,
    /// How fast.
    pub speed: Speed,
    /// From the beginning again when it ends.
    pub repeats: bool,
}

/// How fast a recording is played.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Speed {
    /// As fast as the recorder can; the source waits, nothing is dropped.
    Max,
    /// Times the speed of the camera; frames come whether the recorder is ready or not.
    Times(f64),
}

/// A camera, and what is asked of it.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraSpec {
    /// Which one.
    pub which: WhichCamera,
    /// In which mode.
    pub wanted: Wanted,
}

/// Which camera.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum WhichCamera {
    /// The only one.
    Only,
    /// The one whose firmware says this serial number.
    Serial(String),
    /// The one that is plugged in here: a folder in /sys, as systemd gives it to a unit.
    Path(PathBuf),
}

impl std::fmt::Display for WhichCamera {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Only => f.write_str("the only one"),
            Self::Serial(serial) => write!(f, "of serial number {serial}"),
            Self::Path(path) => write!(f, "at {}", path.display()),
        }
    }
}

impl WhichCamera {
    /// For file names: the serial number or the port.
    pub fn file_name(&self) -> String {
        let place = match self {
            Self::Only => return "ps1080".to_owned(),
            Self::Serial(serial) => serial.as_str().into(),
            Self::Path(path) => path.file_name().unwrap_or_default().to_string_lossy(),
        };
        let is_plain =
            |character: char| character.is_ascii_alphanumeric() || "-.".contains(character);
        let plain: String = place
            .chars()
            .map(|character| if is_plain(character) { character } else { '_' })
            .collect();
        format!("ps1080-{plain}")
    }
}

/// A source that cannot be used, in a sentence.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "`{text}` is no source: {why}; write ps1080, ps1080:SERIAL, replay:FILE, replay:FILE?speed=max or replay:FILE?speed=0.5&loop"
)]
pub struct SourceSpecError {
    text: String,
    why: String,
}

/// Slowest and fastest replay.
const SPEEDS: std::ops::RangeInclusive<f64> = 0.01..=100.0;

/// What can be asked of a camera, for the help.
pub const CAMERA_OPTIONS: &str = "size=vga|qvga, fps=30|60, color=best|bayer|bayer-raw|yuv422|uyvy|yuyv|jpeg|infrared, emitter=on|off, depth=packed11|packed12|compressed|raw16, registration=off|on, close=off|on, exposure=lock|auto|N (with gain=N)";

impl FromStr for SourceSpec {
    type Err = SourceSpecError;

    fn from_str(text: &str) -> Result<Self, SourceSpecError> {
        let wrong = |why: String| SourceSpecError {
            text: text.to_owned(),
            why,
        };
        let (name, options) = text.rsplit_once('?').unwrap_or((text, ""));
        let options: Vec<&str> = options.split('&').filter(|text| !text.is_empty()).collect();
        match name.split_once(':') {
            Some(("replay", path)) => replay(path, &options).map(Self::Replay),
            None if name == "ps1080" => camera(WhichCamera::Only, &options).map(Self::Camera),
            Some(("ps1080", "")) => Err("no serial number and no path after the colon".to_owned()),
            Some(("ps1080", path)) if path.starts_with('/') => {
                camera(WhichCamera::Path(path.into()), &options).map(Self::Camera)
            }
            Some(("ps1080", serial)) => {
                camera(WhichCamera::Serial(serial.to_owned()), &options).map(Self::Camera)
            }
            #[cfg(feature = "openni2")]
            None if name == "openni2" => openni2(None, &options).map(Self::OpenNi2),
            #[cfg(feature = "openni2")]
            Some(("openni2", uri)) => openni2(Some(uri), &options).map(Self::OpenNi2),
            #[cfg(not(feature = "openni2"))]
            _ if name == "openni2" || name.starts_with("openni2:") => Err(
                "this glintd was built without OpenNI2 (cargo build --features openni2)".to_owned(),
            ),
            Some((kind, _)) => Err(format!("there is no kind `{kind}`")),
            None => Err("it has no kind".to_owned()),
        }
        .map_err(wrong)
    }
}

fn replay(path: &str, options: &[&str]) -> Result<ReplaySpec, String> {
    if path.is_empty() {
        return Err("it names no file".to_owned());
    }
    let mut spec = ReplaySpec {
        path: path.into(),
        speed: Speed::Times(1.0),
        repeats: false,
    };
    for option in options {
        match option.split_once('=') {
            Some(("speed", "max")) => spec.speed = Speed::Max,
            Some(("speed", number)) => {
                let times = number.parse().ok().filter(|times| SPEEDS.contains(times));
                spec.speed = Speed::Times(
                    times.ok_or_else(|| format!("speed is max or 0.01 to 100, not `{number}`"))?,
                );
            }
            None if *option == "loop" => spec.repeats = true,
            _ => return Err(format!("`{option}` is neither speed=… nor loop")),
        }
    }
    Ok(spec)
}

#[cfg(feature = "openni2")]
fn openni2(uri: Option<&str>, options: &[&str]) -> Result<OpenNi2Spec, String> {
    if uri.is_some_and(str::is_empty) {
        return Err("no device and no file after the colon".to_owned());
    }
    let mut spec = OpenNi2Spec {
        uri: uri.map(str::to_owned),
        is_registered: true,
    };
    for option in options {
        match *option {
            "registration=on" => spec.is_registered = true,
            "registration=off" => spec.is_registered = false,
            _ => {
                return Err(format!(
                    "`{option}` is not registration=on or registration=off"
                ));
            }
        }
    }
    Ok(spec)
}

fn camera(which: WhichCamera, options: &[&str]) -> Result<CameraSpec, String> {
    let mut wanted = Wanted::default();
    let (mut exposure, mut gain) = (None, None);
    let mut is_exposure_asked = false;
    for option in options {
        let (key, value) = option.split_once('=').unwrap_or((option, ""));
        let unknown = || format!("`{option}` is not one of: {CAMERA_OPTIONS}");
        is_exposure_asked |= matches!(key, "exposure" | "gain");
        let number = || value.parse::<u16>().map_err(|_| unknown());
        let switch = || match value {
            "on" => Ok(true),
            "off" => Ok(false),
            _ => Err(unknown()),
        };
        match (key, value) {
            ("size", "vga") => wanted = wanted.of_size(Resolution::Vga),
            ("size", "qvga") => wanted = wanted.of_size(Resolution::Qvga),
            ("fps", "30") => wanted.fps = 30,
            ("fps", "60") => wanted.fps = 60,
            ("color", _) => wanted.color = color(value).ok_or_else(unknown)?,
            ("depth", "raw16") => wanted.depth_format = SampleFormat::Raw16,
            ("depth", "packed11") => wanted.depth_format = SampleFormat::Packed11,
            ("depth", "packed12") => wanted.depth_format = SampleFormat::Packed12,
            ("depth", "compressed") => wanted.depth_format = SampleFormat::Compressed,
            ("registration", _) => wanted.is_registered = switch()?,
            ("close", _) => wanted.is_close = switch()?,
            ("emitter", "on") => wanted.emitter = EmitterPlan::On,
            ("emitter", "off") => wanted.emitter = EmitterPlan::Off,
            ("exposure", "lock") => wanted.exposure = ExposurePlan::Lock,
            ("exposure", "auto") => wanted.exposure = ExposurePlan::Auto,
            ("exposure", _) => exposure = Some(number()?),
            ("gain", _) => gain = Some(number()?),
            _ => return Err(unknown()),
        }
    }
    match (exposure, gain) {
        (Some(exposure), Some(gain)) => wanted.exposure = ExposurePlan::Manual { exposure, gain },
        (None, None) => {}
        _ => return Err("exposure=N and gain=N go together".to_owned()),
    }
    if is_exposure_asked && wanted.color == ColorChoice::Infrared {
        return Err("infrared has no exposure and no gain to set".to_owned());
    }
    match wanted.contradiction() {
        Some(why) => Err(why.to_owned()),
        None => Ok(CameraSpec { which, wanted }),
    }
}

fn color(word: &str) -> Option<ColorChoice> {
    Some(ColorChoice::Format(match word {
        "best" => return Some(ColorChoice::Best),
        "infrared" => return Some(ColorChoice::Infrared),
        "bayer" => ColorFormat::CompressedBayer,
        "bayer-raw" => ColorFormat::Bayer,
        "yuv422" => ColorFormat::CompressedYuv422,
        "uyvy" => ColorFormat::Uyvy,
        "yuyv" => ColorFormat::Yuyv,
        "jpeg" => ColorFormat::Jpeg,
        _ => return None,
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_are_read_and_unknown_ones_refused() {
        let Ok(SourceSpec::Replay(spec)) = "replay:a dir/x.glint?speed=0.5&loop".parse() else {
            panic!("not a replay");
        };
        assert_eq!(spec.path, PathBuf::from("a dir/x.glint"));
        assert_eq!((spec.speed, spec.repeats), (Speed::Times(0.5), true));
        let Ok(SourceSpec::Replay(spec)) = "replay:x.glint?speed=max".parse() else {
            panic!("not a replay");
        };
        assert_eq!((spec.speed, spec.repeats), (Speed::Max, false));
        for text in [
            "x.glint",
            "replay:",
            "camera:0",
            "replay:x?speed=0",
            "replay:x?speed=nan",
            "replay:x?fast",
            "ps1080:",
            "ps1081",
            "ps1080?size=xga",
            "ps1080?exposure=10",
            "ps1080?gain=x",
            "ps1080:7?color=rgb",
            "ps1080?emitter=dim",
            "ps1080?color=infrared&registration=on",
            "ps1080?color=infrared&fps=60",
            "ps1080?color=infrared&exposure=lock",
            "ps1080?color=infrared&exposure=30&gain=100",
            "openni2:?registration=on",
            "openni2?speed=max",
        ] {
            let error = text.parse::<SourceSpec>().unwrap_err().to_string();
            assert!(
                error.contains(text) && error.contains("speed=max"),
                "{error}"
            );
        }
    }

    #[cfg(feature = "openni2")]
    #[test]
    fn openni2_takes_any_device_or_the_one_that_is_named() {
        let spec = |text: &str| match text.parse() {
            Ok(SourceSpec::OpenNi2(spec)) => (spec.uri, spec.is_registered),
            other => panic!("{other:?}"),
        };
        assert_eq!(spec("openni2"), (None, true));
        let named = Some("1d27/0601@1/7".to_owned());
        assert_eq!(
            spec("openni2:1d27/0601@1/7?registration=off"),
            (named, false)
        );
    }

    #[test]
    fn a_camera_is_named_by_nothing_its_serial_or_its_place() {
        let camera = |text: &str| match text.parse() {
            Ok(SourceSpec::Camera(spec)) => spec,
            other => panic!("{other:?}"),
        };
        assert_eq!(camera("ps1080").which, WhichCamera::Only);
        assert_eq!(camera("ps1080").wanted, Wanted::default());
        let which = camera("ps1080:1206090000").which;
        assert_eq!(which, WhichCamera::Serial("1206090000".to_owned()));
        let path = "/sys/devices/pci0000:00/0000:00:14.0/usb1/1-2";
        let spec = camera(&format!("ps1080:{path}?size=qvga&exposure=30&gain=100"));
        assert_eq!(spec.which, WhichCamera::Path(path.into()));
        assert_eq!(spec.wanted.depth_resolution, Resolution::Qvga);
        let manual = ExposurePlan::Manual {
            exposure: 30,
            gain: 100,
        };
        assert_eq!(spec.wanted.exposure, manual);
        let wanted = camera("ps1080?color=infrared&emitter=off&size=qvga&fps=60").wanted;
        assert_eq!(
            (wanted.color, wanted.emitter),
            (ColorChoice::Infrared, EmitterPlan::Off)
        );
    }
}
