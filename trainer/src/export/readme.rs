//! README.txt of an export: units, axes, times, and what is not carried over.

use sequence::{ColorEncoding, StreamTiming};

use crate::import::rig::PoseCamera;

use super::files::{FrameFiles, StreamKind};
use super::poses::ExportPoses;

/// A README that is being written.
pub(crate) struct Readme {
    text: String,
}

impl Readme {
    pub(crate) fn new(title: &str, files: &FrameFiles) -> Self {
        let recording = files.recording;
        let name = recording.path().file_name().unwrap_or_default();
        let id: String = recording
            .file_id()
            .0
            .iter()
            .map(|byte| format!("{byte:02x}"))
            .collect();
        let text = format!(
            "{title}\n\nMade by glint {} from {} (id {id}, written by {}).\n",
            env!("CARGO_PKG_VERSION"),
            name.display(),
            recording.description().writer,
        );
        Self { text }
    }

    pub(crate) fn heading(&mut self, heading: &str) {
        self.text.push_str(&format!("\n{heading}\n"));
    }

    pub(crate) fn line(&mut self, line: &str) {
        self.text.push_str(&format!("- {line}\n"));
    }

    /// Units, axes, direction of the poses (of `camera`), base of the times, scale of the depth.
    pub(crate) fn common(&mut self, files: &FrameFiles, poses: &ExportPoses, camera: PoseCamera) {
        let recording = files.recording;
        let streams = files.streams();
        self.heading("Units and axes");
        self.line("metres, seconds; camera axes x right, y down, z forward; pixel (0, 0) is the centre of the first pixel");
        self.depth(files);
        if streams.depth.is_registered {
            self.line("depth pixels are colour pixels: the device has registered them");
        } else {
            let t = streams.color_from_depth.translation();
            let q = streams.color_from_depth.rotation();
            self.line(&format!(
                "depth is NOT registered to colour: x_color = R x_depth + t with t = ({}, {}, {}) m, quaternion x y z w ({}, {}, {}, {})",
                t.x, t.y, t.z, q.x, q.y, q.z, q.w
            ));
        }
        self.color(files);
        self.poses(poses, camera);
        self.heading("Times");
        self.line("device time in seconds; its zero is the source's (for TUM's own data and for imports of it: 1970)");
        self.line(&format!(
            "depth: {}; colour: {}",
            rate(&streams.depth_timing),
            rate(&streams.color_timing)
        ));
        self.heading("What the recording says of itself");
        for kind in [StreamKind::Depth, StreamKind::Color] {
            let places = files.places(kind);
            let repeat_count = places.iter().filter(|place| place.is_repeat()).count();
            self.line(&format!(
                "{}: {} frames, {repeat_count} of them repeat the one before",
                kind.word(),
                places.len()
            ));
        }
        let gaps = &recording.contents().gaps;
        let missing_count: u64 = gaps
            .iter()
            .map(|gap| gap.count)
            .fold(0, u64::saturating_add);
        self.line(&format!(
            "{} gaps with {missing_count} missing frames",
            gaps.len()
        ));
        if recording.contents().end.is_none() {
            self.line("the recording was never closed");
        }
    }

    fn depth(&mut self, files: &FrameFiles) {
        let depth = files.streams().depth;
        let how = if files.is_converted() {
            "millimetres from the sensor's shifts by the device's table; the shifts are not carried over"
        } else {
            "the samples of the recording, unchanged"
        };
        self.line(&format!(
            "depth: PNG of 16 bits, sample x {} = metres along z ({} units a metre; TUM's own data have 5000, 7-Scenes 1000): {how}",
            depth.depth_scale,
            1.0 / depth.depth_scale
        ));
        self.line(&format!(
            "depth samples 0 and 65535 are no measurement, nor is what lies outside {} to {} m",
            depth.depth_range.start(),
            depth.depth_range.end()
        ));
    }

    fn color(&mut self, files: &FrameFiles) {
        let line = match files.extension(StreamKind::Color) {
            _ if files.is_color_converted() => match files.encoding() {
                ColorEncoding::BayerGrbg => {
                    "colour: PNG of 8 bits, developed: the recording's Bayer mosaic interpolated in linear radiance and encoded by the camera's own response again; of each pixel one channel is the sensor's sample, two are interpolated; saturation spreads by 2 pixels (`--to folder` writes the mosaic as it is)"
                }
                ColorEncoding::Infrared10 => {
                    "colour: none; PNG of 8 bits with three equal channels: infrared as the depth camera sees it, the upper 8 of 10 bits (`--to folder` writes all of them)"
                }
                _ => {
                    "colour: PNG of 8 bits, developed: red, green, blue of the recording's YUV 4:2:2, chroma interpolated, clamped to 0 to 255 (`--to folder` writes the samples as they are)"
                }
            },
            "jpg" => "colour: JPEG, the bytes of the recording",
            "yuv" => {
                "colour: raw YUV 4:2:2 as the device sent it, rows without padding; size and order are in frames.json"
            }
            _ if files.encoding() == ColorEncoding::Rgb8 => {
                "colour: PNG, the samples of the recording"
            }
            _ if files.encoding() == ColorEncoding::Infrared10 => {
                "colour: none; infrared as the depth camera sees it, 0 to 1023 as PNG of 16 bits grey"
            }
            _ => "colour: the raw Bayer mosaic (green red / blue green) as PNG of 8 bits grey",
        };
        self.line(line);
    }

    fn poses(&mut self, poses: &ExportPoses, camera: PoseCamera) {
        match poses.name() {
            Some(name) => self.line(&format!(
                "poses: set `{name}`, of the {} camera; world from camera (a point of the camera's axes to the world's), quaternions are x y z w",
                camera_word(camera)
            )),
            None => self.line("poses: none"),
        }
        for note in poses.notes() {
            self.line(note);
        }
    }

    pub(crate) fn missing(&mut self, missing: &[String]) {
        if missing.is_empty() {
            return;
        }
        self.heading("Damaged in the recording, so missing here");
        for line in missing {
            self.line(line);
        }
    }

    pub(crate) fn text(self) -> String {
        self.text
    }
}

/// "depth", "colour".
pub(crate) fn camera_word(camera: PoseCamera) -> &'static str {
    match camera {
        PoseCamera::Depth => StreamKind::Depth.word(),
        PoseCamera::Color => StreamKind::Color.word(),
    }
}

fn rate(timing: &StreamTiming) -> String {
    match timing.rate_hz {
        Some(rate_hz) => format!("{rate_hz} Hz promised"),
        None => "no rate promised".to_owned(),
    }
}
