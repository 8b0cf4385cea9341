//! Images into the recording, in the order of their times; what repeats is found on the way.

use std::path::Path;

use geometry::Intrinsics;
use imaging::{
    Image, decode_jpeg, decode_png_gray16, decode_png_mosaic8, decode_png_rgb8, metres_from_raw,
};
use rayon::prelude::*;
use sequence::codecs::DepthCodec;
use sequence::encode::{ColorStreamEncoder, DepthStreamEncoder};
use sequence::{
    COLOR_STREAM, ColorEncoding, DEPTH_STREAM, FrameTimes, Gap, GapCause, RecordingWriter,
    SequenceError, Streams,
};

use super::checks::median_code;
use super::error::{ImportError, read_file};
use super::report::DepthReport;
use super::source::{Source, SourceImage, StreamImage};

/// Images that are read and decoded at a time, by all threads together.
const BATCH: usize = 32;

/// Decodes a depth image and refuses another size than the camera's.
pub(crate) fn depth_codes(
    path: &Path,
    bytes: &[u8],
    streams: &Streams,
) -> Result<Image<u16>, ImportError> {
    let codes = decode_png_gray16(bytes).map_err(|source| ImportError::Image {
        path: path.to_path_buf(),
        source,
    })?;
    require_size(path, "depth", &codes, &streams.depth.intrinsics)?;
    Ok(codes)
}

/// What the colour encoder takes: the file itself for JPEG and YUV, the samples for PNG.
fn color_frame(path: &Path, file: Vec<u8>, streams: &Streams) -> Result<Vec<u8>, ImportError> {
    let camera = &streams.color.intrinsics;
    let unfit = |source| ImportError::Image {
        path: path.to_path_buf(),
        source,
    };
    match streams.color.encoding {
        ColorEncoding::Jpeg => {
            // Decoded too, so that what is written can be read.
            let decoded = decode_jpeg(&file).map_err(unfit)?;
            require_size(path, "color", &decoded, camera)?;
            Ok(file)
        }
        ColorEncoding::Rgb8 => {
            let decoded = decode_png_rgb8(&file).map_err(unfit)?;
            require_size(path, "color", &decoded, camera)?;
            Ok(decoded.pixels().as_flattened().to_vec())
        }
        ColorEncoding::BayerGrbg => {
            let mosaic = decode_png_mosaic8(&file).map_err(unfit)?;
            require_size(path, "color", &mosaic, camera)?;
            Ok(mosaic.pixels().to_vec())
        }
        ColorEncoding::Infrared10 => {
            let infrared = decode_png_gray16(&file).map_err(unfit)?;
            require_size(path, "color", &infrared, camera)?;
            let samples = infrared.pixels().iter();
            Ok(samples.flat_map(|sample| sample.to_le_bytes()).collect())
        }
        ColorEncoding::Uyvy | ColorEncoding::Yuyv => {
            // 16384 pixels a side at most: in range.
            let expected = 2 * camera.width() as usize * camera.height() as usize;
            if file.len() == expected {
                return Ok(file);
            }
            Err(ImportError::RawSize {
                path: path.to_path_buf(),
                bytes: file.len(),
                expected,
            })
        }
    }
}

fn require_size<T>(
    path: &Path,
    stream: &'static str,
    image: &Image<T>,
    camera: &Intrinsics,
) -> Result<(), ImportError> {
    if (image.width(), image.height()) == (camera.width(), camera.height()) {
        return Ok(());
    }
    Err(ImportError::ImageSize {
        path: path.to_path_buf(),
        stream,
        width: image.width(),
        height: image.height(),
        camera_width: camera.width(),
        camera_height: camera.height(),
    })
}

/// An image that was read and decoded.
pub(crate) enum Loaded {
    Depth(Image<u16>),
    Color(Vec<u8>),
    /// Bytes that are no image, and why: a gap of the recording.
    Damaged(String),
}

/// Reads and decodes an image of a folder.
pub(crate) fn load_file(
    source: &Source,
    image: StreamImage,
    streams: &Streams,
) -> Result<Loaded, ImportError> {
    let path = &source.image(image).path;
    let file = read_file(path)?;
    match image {
        StreamImage::Depth(_) => depth_codes(path, &file, streams).map(Loaded::Depth),
        StreamImage::Color(_) => color_frame(path, file, streams).map(Loaded::Color),
    }
}

/// Copies all images, which `load` reads and decodes; `progress(done, of)` is called after each.
pub(crate) fn copy_images(
    source: &Source,
    streams: &Streams,
    load: &(dyn Fn(StreamImage) -> Result<Loaded, ImportError> + Sync),
    writer: &mut RecordingWriter,
    progress: &mut dyn FnMut(usize, usize),
) -> anyhow::Result<Copied> {
    let mut copier = Copier::new(streams, &source.gaps)?;
    let order = source.in_order_of_time();
    let mut done_count = 0;
    for batch in order.chunks(BATCH) {
        crate::interrupt::check()?;
        let loaded: Vec<Result<Loaded, ImportError>> =
            batch.par_iter().map(|image| load(*image)).collect();
        for (image, loaded) in batch.iter().zip(loaded) {
            // In order: the first bad image is the one reported, whatever thread met another.
            match loaded? {
                Loaded::Damaged(why) => copier.skip(writer, *image, source.image(*image), why)?,
                loaded => copier.write(writer, source.image(*image), loaded)?,
            }
            done_count += 1;
            progress(done_count, order.len());
        }
    }
    copier.write_gaps(writer, DEPTH_STREAM, u64::MAX)?;
    copier.write_gaps(writer, COLOR_STREAM, u64::MAX)?;
    Ok(copier.copied)
}

/// What was counted while images were copied.
pub(crate) struct Copied {
    depth: DepthReport,
    histogram: Vec<u64>,
    /// Depth images that equal the one before, sample by sample.
    pub(crate) repeated_depth: Repeats,
    /// Colour images that equal the one before (JPEG: byte for byte).
    pub(crate) repeated_color: Repeats,
    /// Images that were no images, a line each.
    pub(crate) damaged: Vec<String>,
}

/// Images that equal the one before.
#[derive(Default)]
pub(crate) struct Repeats {
    pub(crate) count: usize,
    /// Their numbers in the folder, of those that have one.
    pub(crate) numbers: Vec<u32>,
}

impl Repeats {
    fn add(&mut self, image: &SourceImage) {
        self.count += 1;
        self.numbers.extend(image.number);
    }
}

impl Copied {
    pub(crate) fn depth_report(&self, scale: f64) -> DepthReport {
        DepthReport {
            median_m: median_code(&self.histogram).map_or(0.0, |code| code * scale),
            code_0_count: self.histogram[0],
            code_65535_count: self.histogram[usize::from(u16::MAX)],
            ..self.depth
        }
    }
}

/// Both streams as far as they are written.
struct Copier<'a> {
    streams: &'a Streams,
    depth_encoder: DepthStreamEncoder,
    color_encoder: ColorStreamEncoder,
    previous_depth: Option<Image<u16>>,
    previous_color: Option<Vec<u8>>,
    /// Gaps of each stream that were not written yet.
    depth_gaps: &'a [Gap],
    color_gaps: &'a [Gap],
    copied: Copied,
}

impl<'a> Copier<'a> {
    /// `gaps` by stream and number.
    fn new(streams: &'a Streams, gaps: &'a [Gap]) -> Result<Self, SequenceError> {
        let depth_count = gaps.partition_point(|gap| gap.stream == DEPTH_STREAM);
        let (depth_gaps, color_gaps) = gaps.split_at(depth_count);
        Ok(Self {
            streams,
            depth_encoder: DepthStreamEncoder::new(streams, DepthCodec::Dense)?,
            color_encoder: ColorStreamEncoder::new(streams)?,
            previous_depth: None,
            previous_color: None,
            depth_gaps,
            color_gaps,
            copied: Copied {
                depth: DepthReport::default(),
                histogram: vec![0; 1 << 16],
                repeated_depth: Repeats::default(),
                repeated_color: Repeats::default(),
                damaged: Vec::new(),
            },
        })
    }

    fn write(
        &mut self,
        writer: &mut RecordingWriter,
        image: &SourceImage,
        loaded: Loaded,
    ) -> Result<(), SequenceError> {
        match loaded {
            Loaded::Depth(codes) => self.write_depth(writer, image, codes)?,
            Loaded::Color(frame) => self.write_color(writer, image, frame)?,
            // Whoever calls has skipped these.
            Loaded::Damaged(_) => {}
        }
        writer.seal_if_due(image.times.device_nanos)
    }

    /// Writes a gap in place of an image.
    fn skip(
        &mut self,
        writer: &mut RecordingWriter,
        place: StreamImage,
        image: &SourceImage,
        why: String,
    ) -> Result<(), SequenceError> {
        let (stream, name) = match place {
            StreamImage::Depth(_) => (DEPTH_STREAM, "depth"),
            StreamImage::Color(_) => (COLOR_STREAM, "colour"),
        };
        let number = image.times.number;
        self.write_gaps(writer, stream, number)?;
        self.copied
            .damaged
            .push(format!("{name} frame {number}: {why}"));
        writer.write_gap(&Gap {
            stream,
            first_number: number,
            count: 1,
            from_nanos: None,
            to_nanos: None,
            cause: Some(GapCause::Damaged),
            note: why,
        })
    }

    fn write_depth(
        &mut self,
        writer: &mut RecordingWriter,
        image: &SourceImage,
        codes: Image<u16>,
    ) -> Result<(), SequenceError> {
        let is_repeat = self.previous_depth.as_ref() == Some(&codes);
        self.write_gaps(writer, DEPTH_STREAM, image.times.number)?;
        let (payload, table) = self.depth_encoder.encode(codes.pixels())?;
        if let Some(table) = table {
            writer.write_table(DEPTH_STREAM, table)?;
        }
        let times = FrameTimes {
            is_repeat,
            ..image.times
        };
        writer.write_frame(DEPTH_STREAM, &times, payload)?;
        if is_repeat {
            self.copied.repeated_depth.add(image);
        }
        self.count(&codes);
        self.previous_depth = Some(codes);
        Ok(())
    }

    fn write_color(
        &mut self,
        writer: &mut RecordingWriter,
        image: &SourceImage,
        frame: Vec<u8>,
    ) -> Result<(), SequenceError> {
        let is_repeat = self.previous_color.as_ref() == Some(&frame);
        self.write_gaps(writer, COLOR_STREAM, image.times.number)?;
        let payload = self.color_encoder.encode(&frame)?;
        let times = FrameTimes {
            is_repeat,
            ..image.times
        };
        writer.write_frame(COLOR_STREAM, &times, payload)?;
        if is_repeat {
            self.copied.repeated_color.add(image);
        }
        self.previous_color = Some(frame);
        Ok(())
    }

    /// The gaps of a stream that come before frame `number`.
    fn write_gaps(
        &mut self,
        writer: &mut RecordingWriter,
        stream: u16,
        number: u64,
    ) -> Result<(), SequenceError> {
        let gaps = match stream {
            DEPTH_STREAM => &mut self.depth_gaps,
            _ => &mut self.color_gaps,
        };
        while let Some((gap, rest)) = gaps.split_first() {
            if gap.first_number >= number {
                break;
            }
            writer.write_gap(gap)?;
            *gaps = rest;
        }
        Ok(())
    }

    fn count(&mut self, codes: &Image<u16>) {
        for code in codes.pixels() {
            self.copied.histogram[usize::from(*code)] += 1;
        }
        let camera = &self.streams.depth;
        let (_, counts) = metres_from_raw(codes, camera.depth_scale, camera.depth_range.clone());
        self.copied.depth.measured_count += counts.measured_count;
        self.copied.depth.out_of_range_count += counts.out_of_range_count;
    }
}
