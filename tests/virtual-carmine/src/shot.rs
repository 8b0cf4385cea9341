//! What a stream sends: mode, and the way from a picture to its bytes on the wire.

use ps1080::color::{ColorFormat, encode_color};
use ps1080::mode::Resolution;
use ps1080::samples::{InfraredRows, NO_SHIFT, SampleFormat, encode_samples};
use ps1080::stream::Padding;

use crate::faults::Deviation;
use crate::film::{ColorLayout, Film};

/// All that decides the bytes of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum Shot {
    Depth {
        format: SampleFormat,
        resolution: Resolution,
        is_mirrored: bool,
        is_registered: bool,
        before: u16,
        after: u16,
        /// The emitter is on.
        is_lit: bool,
    },
    Infrared {
        resolution: Resolution,
        rows: u16,
        /// The emitter is on.
        is_lit: bool,
    },
    Color {
        format: ColorFormat,
        resolution: Resolution,
        is_mirrored: bool,
    },
}

impl Shot {
    pub(crate) fn infrared(resolution: Resolution, rows: InfraredRows, is_lit: bool) -> Self {
        Self::Infrared {
            resolution,
            rows: rows.sent,
            is_lit,
        }
    }

    pub(crate) fn padding(self) -> Padding {
        match self {
            Self::Depth { before, after, .. } => Padding { before, after },
            _ => Padding::default(),
        }
    }

    /// Payload of frame `index`; `None` where the film has no such picture.
    pub(crate) fn develop(
        self,
        film: &mut dyn Film,
        index: u64,
        deviation: Option<Deviation>,
    ) -> Option<Vec<u8>> {
        match self {
            Self::Depth {
                format, resolution, ..
            } => {
                let codes = self.depth_codes(film, index)?;
                let width = usize::from(resolution.size().0);
                let mut payload = vec![0; format.max_bytes(codes.len(), width)];
                let length = encode_samples(format, &codes, width, &mut payload).ok()?;
                payload.truncate(length);
                if deviation == Some(Deviation::NibbleOrder) && format != SampleFormat::Raw16 {
                    payload
                        .iter_mut()
                        .for_each(|byte| *byte = byte.rotate_left(4));
                }
                Some(payload)
            }
            Self::Infrared {
                resolution,
                rows,
                is_lit,
            } => infrared(film, index, resolution, rows, is_lit),
            Self::Color {
                format,
                resolution,
                is_mirrored,
            } => color(film, index, format, resolution, is_mirrored, deviation),
        }
    }

    fn depth_codes(self, film: &mut dyn Film, index: u64) -> Option<Vec<u16>> {
        let Self::Depth {
            format,
            resolution,
            is_mirrored,
            is_registered,
            before,
            after,
            is_lit,
        } = self
        else {
            return None;
        };
        let (width, height) = resolution.size();
        let (width, height) = (usize::from(width), usize::from(height));
        let mut codes = vec![0; width * height];
        if !film.depth(index, resolution, is_registered, &mut codes) {
            return None;
        }
        if !is_lit {
            codes.fill(NO_SHIFT);
        }
        for row in codes.chunks_mut(width) {
            if is_mirrored {
                row.reverse();
            }
            row.iter_mut()
                .for_each(|code| *code = (*code).min(format.max_code()));
        }
        let end = codes.len().checked_sub(usize::from(after))?;
        codes.truncate(end);
        codes.drain(..usize::from(before).min(end));
        Some(codes)
    }
}

fn infrared(
    film: &mut dyn Film,
    index: u64,
    resolution: Resolution,
    rows: u16,
    is_lit: bool,
) -> Option<Vec<u8>> {
    let (width, height) = resolution.size();
    let count = usize::from(width) * usize::from(height);
    let mut samples = vec![0; count];
    if !film.infrared(index, resolution, is_lit, &mut samples) {
        return None;
    }
    // Rows below the picture carry nothing; a sensor with fewer rows sends fewer.
    samples.resize(usize::from(width) * usize::from(rows), 0);
    let format = SampleFormat::Packed10;
    let mut payload = vec![0; format.max_bytes(samples.len(), usize::from(width))];
    let length = encode_samples(format, &samples, usize::from(width), &mut payload).ok()?;
    payload.truncate(length);
    Some(payload)
}

fn color(
    film: &mut dyn Film,
    index: u64,
    format: ColorFormat,
    resolution: Resolution,
    is_mirrored: bool,
    deviation: Option<Deviation>,
) -> Option<Vec<u8>> {
    let mut frame = Vec::new();
    if !film.color(index, resolution, layout(format), &mut frame) {
        return None;
    }
    let Some(line_bytes) = format.line_bytes(resolution.size().0) else {
        return Some(frame);
    };
    let is_yuv = layout(format) == ColorLayout::Uyvy;
    if is_mirrored {
        mirror(&mut frame, line_bytes, is_yuv);
    }
    if is_yuv && deviation == Some(Deviation::ChromaSwapped) {
        frame.chunks_exact_mut(4).for_each(|pair| pair.swap(0, 2));
    }
    if format == ColorFormat::Yuyv {
        frame.chunks_exact_mut(2).for_each(|bytes| bytes.swap(0, 1));
    }
    // A frame that is one long line never begins anew.
    let encoded_line = if deviation == Some(Deviation::PredictorsKept) {
        frame.len()
    } else {
        line_bytes
    };
    let mut payload = vec![0; format.max_bytes(frame.len(), line_bytes)];
    let length = encode_color(format, &frame, encoded_line, &mut payload).ok()?;
    payload.truncate(length);
    Some(payload)
}

fn layout(format: ColorFormat) -> ColorLayout {
    match format {
        ColorFormat::CompressedBayer | ColorFormat::Bayer => ColorLayout::Bayer,
        ColorFormat::CompressedYuv422 | ColorFormat::Uyvy | ColorFormat::Yuyv => ColorLayout::Uyvy,
        ColorFormat::Jpeg | ColorFormat::Jpeg420 | ColorFormat::JpegMono => ColorLayout::Jpeg,
    }
}

/// Left becomes right. A mosaic keeps the order of its two columns, as nobody reports another order of colours.
fn mirror(frame: &mut [u8], line_bytes: usize, is_yuv: bool) {
    for line in frame.chunks_exact_mut(line_bytes) {
        let unit = if is_yuv { 4 } else { 2 };
        line.reverse();
        // The bytes of a unit are reversed too: back, but for the two Y, which change places.
        for bytes in line.chunks_exact_mut(unit) {
            bytes.reverse();
            if is_yuv {
                bytes.swap(1, 3);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mirrored_pairs_keep_their_chroma() {
        let mut frame = [1, 2, 3, 4, 5, 6, 7, 8];
        mirror(&mut frame, 8, true);
        assert_eq!(frame, [5, 8, 7, 6, 1, 4, 3, 2]);
        let mut mosaic = [1, 2, 3, 4];
        mirror(&mut mosaic, 4, false);
        assert_eq!(mosaic, [3, 4, 1, 2]);
    }
}
