//! Development for training and for pictures.

use rayon::prelude::*;

use super::bands::BAND_ROWS;
use super::layout::ColorLayout;
use super::live::invalid_of;
use super::marks::{MarkRule, marks_of};
use super::mosaic::{Mosaic, MosaicRows};
use crate::error::ImagingError;
use crate::image::{Image, LinearImage, Rgb8Image};
use crate::kernels::Level;
use crate::radiance::{Corrector, Radiance};
use crate::response::Response;
use crate::vignetting::Vignetting;

/// Linear radiance of a raw frame of `layout`, as [`Corrector::correct`] gives it of codes: same masks, same rules.
/// `chroma_subsampled` is of [`ColorLayout::Rgb8`] alone (see [`super::Developer::develop`]). Of a mosaic, pixels
/// within [`crate::radiance::CHROMA_REACH`] of an invalid one are invalid too.
///
/// # Errors
/// [`ImagingError::FrameBytes`] and [`ImagingError::FrameSize`] for a frame that the corrector's camera did not send.
pub fn radiance(
    corrector: &Corrector,
    layout: ColorLayout,
    frame: &[u8],
    chroma_subsampled: bool,
) -> Result<Radiance, ImagingError> {
    let (width, height) = (corrector.width(), corrector.height());
    layout.check(frame, width, height)?;
    if layout != ColorLayout::BayerGrbg {
        let codes = codes_of_rows(layout, frame, width, height)?;
        let is_rgb = layout == ColorLayout::Rgb8;
        let mut radiance = corrector.correct(&codes, is_rgb && chroma_subsampled);
        if !is_rgb {
            let marks = marks_of(layout, frame, width, height);
            for (saturated, &marked) in radiance
                .saturated
                .pixels_mut()
                .iter_mut()
                .zip(marks.pixels())
            {
                *saturated |= marked;
            }
        }
        return Ok(radiance);
    }
    let mut linear = linear_of_mosaic(corrector, frame);
    let invalid = invalid_of(corrector);
    for (pixel, &invalid) in linear.pixels_mut().iter_mut().zip(invalid.pixels()) {
        if invalid {
            *pixel = [0.0; 3];
        }
    }
    Ok(Radiance {
        linear,
        saturated: marks_of(layout, frame, width, height),
        invalid,
    })
}

/// 8-bit codes of red, green, blue of a raw frame, for pictures and for formats that know nothing else.
///
/// Of a mosaic: interpolated in linear radiance, then encoded by the same `response`, so that the sampled colour of
/// every pixel is the sensor's own code. Of YUV: the codes that its samples stand for, clamped to [0, 255].
///
/// # Errors
/// [`ImagingError::FrameBytes`] and [`ImagingError::FrameSize`] for a frame of another size.
pub fn codes(
    response: &Response,
    layout: ColorLayout,
    frame: &[u8],
    width: u32,
    height: u32,
) -> Result<Rgb8Image, ImagingError> {
    layout.check(frame, width, height)?;
    if layout != ColorLayout::BayerGrbg {
        return codes_of_rows(layout, frame, width, height);
    }
    // Fall-off changes little from pixel to pixel: interpolation needs no correction of it.
    let corrector = Corrector::new(response, &Vignetting::none(), width, height, 1.0);
    Ok(linear_of_mosaic(&corrector, frame).map(|linear| {
        let code = |channel: usize| response.code(linear[channel], channel).round();
        // Codes are 0 to 255 and not NaN.
        std::array::from_fn(|channel| code(channel) as u8)
    }))
}

/// Codes of a layout whose pixels have all three; the frame's length is checked.
fn codes_of_rows(
    layout: ColorLayout,
    frame: &[u8],
    width: u32,
    height: u32,
) -> Result<Rgb8Image, ImagingError> {
    let MarkRule::Yuv(converter, order) = MarkRule::of(layout) else {
        return Image::from_vec(width, height, frame.as_chunks().0.to_vec());
    };
    let mut codes = Image::new(width, height, [0; 3]);
    let row_bytes = 2 * width as usize;
    let level = Level::detect();
    codes
        .pixels_mut()
        .par_chunks_mut(width as usize)
        .zip(frame.par_chunks(row_bytes))
        .for_each(|(codes, samples)| converter.rgb_row(level, order, samples, codes));
    Ok(codes)
}

fn linear_of_mosaic(corrector: &Corrector, codes: &[u8]) -> LinearImage {
    let mosaic = Mosaic {
        codes,
        width: corrector.width() as usize,
        height: corrector.height() as usize,
        linear_of_code: corrector.linear_of_code(),
        factor: corrector.reciprocal().pixels(),
    };
    let mut linear = Image::new(corrector.width(), corrector.height(), [0.0; 3]);
    let width = mosaic.width;
    linear
        .pixels_mut()
        .par_chunks_mut(BAND_ROWS * width)
        .enumerate()
        .for_each(|(band, pixels)| {
            let first = band * BAND_ROWS;
            let rows = first..first + pixels.len() / width;
            let mut scratch = MosaicRows::new(width);
            scratch.for_each(Level::detect(), &mosaic, rows, |y, [red, green, blue]| {
                let row = &mut pixels[(y - first) * width..][..width];
                for (x, pixel) in row.iter_mut().enumerate() {
                    *pixel = [red[x], green[x], blue[x]];
                }
            });
        });
    linear
}
