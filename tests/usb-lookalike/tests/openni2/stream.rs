//! Runs the client in a process of its own, with the look-alike in front of libusb.

use std::path::PathBuf;
use std::process::Command;

use serde_json::Value;
use usb_lookalike::config::CONFIG_VARIABLE;
use usb_lookalike::library;

use crate::{CYCLE, SEED};

/// Exit code of the client where there is no OpenNI2.
const NOT_INSTALLED: i32 = 3;

/// As much as a busy machine may let lie: pixels are judged here, not haste.
const FIFO_BYTES: usize = 64 << 20;

/// What is streamed.
#[derive(Clone, Debug)]
pub(crate) struct Setting {
    pub(crate) personality: &'static str,
    pub(crate) streams: Vec<&'static str>,
    /// Of each stream.
    pub(crate) frame_count: usize,
    /// More lines of the camera's configuration.
    pub(crate) camera: String,
    /// Whether the device is closed in the end, so that there is a log.
    pub(crate) does_close: bool,
    /// Whether the camera is asked to register depth to colour.
    pub(crate) registers: bool,
    /// Whether the camera is asked to switch its emitter off.
    pub(crate) is_dark: bool,
}

/// A frame as OpenNI2 decoded it.
#[derive(Clone, Debug)]
pub(crate) struct Frame {
    pub(crate) sensor: u64,
    pub(crate) micros: u64,
    /// Frames a second that were asked for.
    pub(crate) fps: u64,
    pub(crate) data: Vec<u8>,
}

pub(crate) struct Outcome {
    pub(crate) frames: Vec<Frame>,
    /// The camera's own account; null where the device was not closed.
    pub(crate) log: Value,
}

impl Outcome {
    /// The frames of one sensor.
    pub(crate) fn from(&self, sensor: u64) -> Vec<Frame> {
        let frames = self.frames.iter();
        frames
            .filter(|frame| frame.sensor == sensor)
            .cloned()
            .collect()
    }
}

/// Streams; `None` where there is no OpenNI2.
pub(crate) fn stream(setting: &Setting) -> Option<Outcome> {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| -> PathBuf { folder.path().join(name) };
    library::put_into(folder.path()).unwrap();
    let config = format!(
        "log = {:?}\n[[camera]]\npersonality = {:?}\npattern_seed = {SEED}\npattern_cycle = {CYCLE}\nfifo_bytes = {FIFO_BYTES}\n{}",
        path("log.json"),
        setting.personality,
        setting.camera
    );
    std::fs::write(path("cameras.toml"), config).unwrap();
    let mut command = Command::new(env!("CARGO_BIN_EXE_openni2-stream"));
    command.args(setting.does_close.then_some("--close"));
    command.args(setting.registers.then_some("--register"));
    command.args(setting.is_dark.then_some("--dark"));
    let output = command
        .arg(setting.frame_count.to_string())
        .arg(path("frames"))
        .args(&setting.streams)
        .env("LD_LIBRARY_PATH", folder.path())
        .env(CONFIG_VARIABLE, path("cameras.toml"))
        .output()
        .unwrap();
    if output.status.code() == Some(NOT_INSTALLED) {
        return None;
    }
    assert!(
        output.status.success(),
        "{setting:?}: {}",
        String::from_utf8_lossy(&output.stderr)
    );
    // All streams of a setting have one rate.
    let fps = setting.streams[0].rsplit(':').next().unwrap();
    let fps = fps.parse().unwrap();
    let frames = parse(&std::fs::read(path("frames")).unwrap(), fps);
    let log = std::fs::read_to_string(path("log.json"));
    let log = log.map_or(Value::Null, |text| serde_json::from_str(&text).unwrap());
    Some(Outcome { frames, log })
}

fn parse(mut bytes: &[u8], fps: u64) -> Vec<Frame> {
    let mut frames = Vec::new();
    while let Some((head, rest)) = bytes.split_first_chunk::<32>() {
        let number = |at: usize| u64::from_le_bytes(head[at..at + 8].try_into().unwrap());
        let (data, rest) = rest.split_at(number(24) as usize);
        frames.push(Frame {
            sensor: number(0),
            micros: number(16),
            fps,
            data: data.to_vec(),
        });
        bytes = rest;
    }
    frames
}
