//! The configuration: a small TOML file.

use std::path::{Path, PathBuf};

use ps1080::mode::CameraMode;
use ps1080::stream::Padding;
use serde::Deserialize;
use virtual_carmine::{Faults, Film, Personality, RecordingFilm, TestPattern, VirtualCarmine};

/// Environment variable with the path of the file.
pub const CONFIG_VARIABLE: &str = "GLINT_VIRTUAL_CAMERAS";

/// Which cameras there are.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Config {
    /// Where counters are written when a camera is closed, unplugged, or the library is left: JSON.
    pub log: Option<PathBuf>,
    /// The cameras, in the order of the list of devices.
    pub camera: Vec<CameraConfig>,
}

/// One camera.
#[derive(Clone, Debug, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CameraConfig {
    /// See [`Personality::named`].
    pub personality: String,
    /// Seed of the test pattern that is filmed.
    pub pattern_seed: u64,
    /// Frames after which the pattern repeats.
    pub pattern_cycle: u64,
    /// A recording that is filmed instead.
    pub recording: Option<PathBuf>,
    /// Number of the bus.
    pub bus: u8,
    /// Ports from the root hub to the camera.
    pub ports: Vec<u8>,
    /// Speed, as libusb numbers it: 2 full, 3 high, 4 super.
    pub speed: i32,
    /// Whether opening it is forbidden.
    pub is_forbidden: bool,
    /// Whether another program holds interface 0.
    pub is_busy: bool,
    /// Whether a driver of the kernel holds interface 0 until it is detached.
    pub has_kernel_driver: bool,
    /// Whether its flash is damaged.
    pub is_safe_mode: bool,
    /// Instead of the personality's number.
    pub packet_bytes: Option<usize>,
    /// Instead of the personality's number.
    pub fifo_bytes: Option<usize>,
    /// Instead of the personality's number.
    pub skew_nanos: Option<i64>,
    /// Instead of the personality's number.
    pub synced_skew_nanos: Option<i64>,
    /// Pixels that are not sent while the camera registers: before the others, after them.
    pub padding: Option<[u16; 2]>,
    /// What goes wrong.
    pub faults: Faults,
}

impl Default for CameraConfig {
    fn default() -> Self {
        Self {
            personality: "carmine-1.09".to_owned(),
            pattern_seed: 1,
            pattern_cycle: 8,
            recording: None,
            bus: 1,
            ports: vec![2],
            speed: 3,
            is_forbidden: false,
            is_busy: false,
            has_kernel_driver: false,
            is_safe_mode: false,
            packet_bytes: None,
            fifo_bytes: None,
            skew_nanos: None,
            synced_skew_nanos: None,
            padding: None,
            faults: Faults::default(),
        }
    }
}

impl Config {
    /// Of the text of a file.
    ///
    /// # Errors
    /// What is no TOML, and unknown keys.
    pub fn parse(text: &str) -> Result<Self, toml::de::Error> {
        toml::from_str(text)
    }

    /// Of the file that the environment names; no cameras where it names none.
    ///
    /// # Errors
    /// One sentence about a file that cannot be read or understood.
    pub(crate) fn from_environment() -> Result<Self, String> {
        let Some(path) = std::env::var_os(CONFIG_VARIABLE) else {
            return Ok(Self::default());
        };
        let path = Path::new(&path);
        let text = std::fs::read_to_string(path)
            .map_err(|error| format!("{}: {error}", path.display()))?;
        Self::parse(&text).map_err(|error| format!("{}: {error}", path.display()))
    }
}

impl CameraConfig {
    /// The camera.
    ///
    /// # Errors
    /// One sentence about an unknown personality or a recording that cannot be filmed.
    pub fn build(&self) -> Result<VirtualCarmine, String> {
        let named = Personality::named(&self.personality);
        let mut unit = named.ok_or_else(|| format!("no personality {}", self.personality))?;
        if self.is_safe_mode {
            unit.mode = CameraMode::Safe;
        }
        unit.packet_bytes = self.packet_bytes.unwrap_or(unit.packet_bytes);
        unit.fifo_bytes = self.fifo_bytes.unwrap_or(unit.fifo_bytes);
        unit.skew_nanos = self.skew_nanos.unwrap_or(unit.skew_nanos);
        unit.synced_skew_nanos = self.synced_skew_nanos.unwrap_or(unit.synced_skew_nanos);
        if let Some([before, after]) = self.padding {
            unit.padding = Padding { before, after };
        }
        let film: Box<dyn Film> = match &self.recording {
            None => Box::new(TestPattern::with_cycle(
                self.pattern_seed,
                self.pattern_cycle,
            )),
            Some(path) => Box::new(
                RecordingFilm::open(path)
                    .map_err(|error| format!("{}: {error}", path.display()))?,
            ),
        };
        Ok(VirtualCarmine::new(unit, film, self.faults.clone()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unknown_keys_are_refused() {
        assert!(Config::parse("[[camera]]\nfautls = 1").is_err());
        assert!(Config::parse("[[camera]]\n[camera.faults]\nseeed = 1").is_err());
    }

    #[test]
    fn an_empty_camera_is_a_whole_one() {
        let config = Config::parse("[[camera]]\n[[camera]]\nis_busy = true").unwrap();
        assert!(config.camera[0].build().is_ok() && config.camera[1].is_busy);
        let unknown = CameraConfig {
            personality: "kinect".to_owned(),
            ..CameraConfig::default()
        };
        assert!(unknown.build().is_err());
    }
}
