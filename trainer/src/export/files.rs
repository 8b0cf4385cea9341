//! Frames of a recording as image files.

use anyhow::Context as _;
use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder as _};
use imaging::{Image, encode_png_gray16, encode_png_rgb8};
use rayon::prelude::*;
use sequence::record::RecordKind;
use sequence::scan::{Damage, RecordPlace};
use sequence::{
    ColorEncoding, DepthSamples, FrameTimes, Recording, SequenceError, Streams, infrared_samples,
};

use super::OnProgress;

/// Frames that are decoded and encoded at a time, by all threads together.
const BATCH: usize = 32;

/// A stream of a recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum StreamKind {
    Depth,
    Color,
}

impl StreamKind {
    pub(crate) fn word(self) -> &'static str {
        match self {
            Self::Depth => "depth",
            Self::Color => "colour",
        }
    }
}

/// A frame as a file.
pub(crate) struct FrameFile {
    pub(crate) times: FrameTimes,
    pub(crate) bytes: Vec<u8>,
}

/// Makes files of frames.
pub(crate) struct FrameFiles<'a> {
    pub(crate) recording: &'a Recording,
    /// Millimetres of each shift, where the samples are shifts.
    table_mm: Option<Vec<u16>>,
    color_form: ColorForm,
}

/// How colour is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ColorForm {
    /// As the camera sent it.
    AsSent,
    /// As red, green, blue, for layouts that hold nothing else.
    Developed,
}

impl<'a> FrameFiles<'a> {
    /// Refuses shifts without a usable table: no other program could read them.
    pub(crate) fn new(recording: &'a Recording, color_form: ColorForm) -> anyhow::Result<Self> {
        let table_mm = recording
            .depth_camera()
            .shift_table_mm()
            .with_context(|| format!("{} cannot be exported", recording.path().display()))?;
        Ok(Self {
            recording,
            table_mm,
            color_form,
        })
    }

    /// Whether depth was converted from shifts.
    pub(crate) fn is_converted(&self) -> bool {
        self.table_mm.is_some()
    }

    /// The cameras as the files have them.
    pub(crate) fn streams(&self) -> Streams {
        let mut streams = self.recording.description().streams.clone();
        if self.is_converted() {
            streams.depth.depth_scale = 1e-3;
            streams.depth.samples = DepthSamples::Values;
        }
        if self.is_color_converted() {
            streams.color.encoding = ColorEncoding::Rgb8;
            streams.color.yuv = None;
        }
        streams
    }

    pub(crate) fn places(&self, kind: StreamKind) -> &'a [RecordPlace] {
        let description = self.recording.description();
        self.recording.contents().stream(match kind {
            StreamKind::Depth => description.depth_id,
            StreamKind::Color => description.color_id,
        })
    }

    /// Ending of a file's name.
    pub(crate) fn extension(&self, kind: StreamKind) -> &'static str {
        match (kind, self.recording.color_camera().encoding) {
            _ if self.is_color_converted() => "png",
            (StreamKind::Depth, _)
            | (_, ColorEncoding::Rgb8 | ColorEncoding::BayerGrbg | ColorEncoding::Infrared10) => {
                "png"
            }
            (_, ColorEncoding::Jpeg) => "jpg",
            (_, ColorEncoding::Uyvy | ColorEncoding::Yuyv) => "yuv",
        }
    }

    /// Encoding of the colour in the recording.
    pub(crate) fn encoding(&self) -> ColorEncoding {
        self.recording.color_camera().encoding
    }

    /// Whether colour was developed from what the camera sent.
    pub(crate) fn is_color_converted(&self) -> bool {
        let is_raw = !matches!(self.encoding(), ColorEncoding::Jpeg | ColorEncoding::Rgb8);
        is_raw && self.color_form == ColorForm::Developed
    }

    /// The file of a frame.
    pub(crate) fn file(
        &self,
        kind: StreamKind,
        place: &RecordPlace,
    ) -> Result<FrameFile, SequenceError> {
        let times = self.recording.frame(place)?.0;
        let bytes = match kind {
            StreamKind::Depth => encode_png_gray16(&self.depth(place)?)?,
            StreamKind::Color => self.color(place)?,
        };
        Ok(FrameFile { times, bytes })
    }

    /// Depth samples, of millimetres where they were shifts; 0 is no measurement.
    pub(crate) fn depth(&self, place: &RecordPlace) -> Result<Image<u16>, SequenceError> {
        let samples = self.recording.depth_frame(place)?;
        Ok(match &self.table_mm {
            None => samples,
            Some(table) => samples.map(|shift| table.get(usize::from(shift)).copied().unwrap_or(0)),
        })
    }

    fn color(&self, place: &RecordPlace) -> Result<Vec<u8>, SequenceError> {
        if self.is_color_converted() {
            return Ok(encode_png_rgb8(&self.recording.color_codes(place)?)?);
        }
        let frame = self.recording.color_frame(place)?;
        let camera = self.recording.color_camera();
        let (width, height) = (camera.intrinsics.width(), camera.intrinsics.height());
        match camera.encoding {
            ColorEncoding::Jpeg | ColorEncoding::Uyvy | ColorEncoding::Yuyv => Ok(frame),
            ColorEncoding::Rgb8 => {
                let pixels = frame.chunks_exact(3).map(|p| [p[0], p[1], p[2]]).collect();
                Ok(encode_png_rgb8(&Image::from_vec(width, height, pixels)?)?)
            }
            ColorEncoding::Infrared10 => Ok(encode_png_gray16(&infrared_samples(
                &frame, width, height,
            )?)?),
            ColorEncoding::BayerGrbg => {
                let mut bytes = Vec::new();
                PngEncoder::new(&mut bytes)
                    .write_image(&frame, width, height, ExtendedColorType::L8)
                    .map_err(std::io::Error::other)?;
                Ok(bytes)
            }
        }
    }
}

/// Makes something of each item by all threads, and writes it in order.
pub(crate) fn in_order<T: Sync, M: Send>(
    items: &[T],
    make: impl Fn(&T) -> M + Sync,
    mut write: impl FnMut(&T, M) -> anyhow::Result<()>,
    progress: OnProgress,
) -> anyhow::Result<()> {
    let mut done_count = 0;
    for batch in items.chunks(BATCH) {
        crate::interrupt::check()?;
        let made: Vec<M> = batch.par_iter().map(&make).collect();
        for (item, made) in batch.iter().zip(made) {
            write(item, made)?;
            done_count += 1;
            progress(done_count, items.len());
        }
    }
    Ok(())
}

/// The line that names a frame which could not be read.
pub(crate) fn lost_frame(kind: StreamKind, place: &RecordPlace, error: &SequenceError) -> String {
    format!("{} frame {}: {error}", kind.word(), place.label.number)
}

/// What was found damaged when the recording was opened, a line each, but for what costs nothing and for
/// frames that are still listed: those are met again when they are read.
pub(crate) fn damages(recording: &Recording) -> Vec<String> {
    let mut lines = Vec::new();
    for damage in &recording.contents().damages {
        match damage {
            Damage::Header { offset, bytes } => lines.push(format!(
                "{bytes} bytes at byte {offset} begin with no chunk; frames in them may be lost (`glintd verify` lists them)"
            )),
            Damage::Tail { offset, bytes } => lines.push(format!(
                "{bytes} bytes at byte {offset} were never sealed (`glintd recover` may save frames of them)"
            )),
            Damage::Record { offset, label } => {
                let places = recording.contents().stream(label.stream);
                let is_listed = places.iter().any(|place| place.offset == *offset);
                if !is_listed {
                    lines.push(lost_record(*offset, label.kind, label.number));
                }
            }
            Damage::FileHeader
            | Damage::CommitMark { .. }
            | Damage::Index { .. }
            | Damage::Padding { .. } => {}
        }
    }
    lines
}

fn lost_record(offset: u64, kind: u16, number: u64) -> String {
    match RecordKind::from_number(kind) {
        Some(RecordKind::Frame) => format!("frame {number} at byte {offset} is damaged"),
        Some(kind) => format!("a record at byte {offset} is damaged ({kind:?})"),
        None => format!("a record of kind {kind} at byte {offset} is damaged"),
    }
}
