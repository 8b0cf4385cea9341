//! From codes to linear radiance in one pass, and the forward model back to codes.

use rayon::prelude::*;

use crate::error::ImagingError;
use crate::image::{Image, LinearImage, Mask, Rgb8Image};
use crate::response::Response;
use crate::vignetting::Vignetting;

/// Raw codes from here on count as saturated: JPEG ringing and demosaicing pull clipped pixels below 255.
pub const SATURATION_CODE: u8 = 250;

/// How far chroma subsampling and demosaicing carry the colour of a clipped pixel, pixels (hard-cases B07).
pub const CHROMA_REACH: u32 = 2;

/// A frame in linear radiance with what is known about its pixels.
#[derive(Debug, Clone, PartialEq)]
pub struct Radiance {
    /// Linear radiance, 1.0 = the white level; 0 where `invalid`.
    pub linear: LinearImage,
    /// The radiance is at least what `linear` says: a raw code of any channel reached
    /// [`SATURATION_CODE`], here or within the reach of chroma.
    pub saturated: Mask,
    /// The lens passes too little light here, or there is no code.
    pub invalid: Mask,
}

/// The correction of a colour camera: linear = inverse response(code) / vignetting / relative exposure.
/// Tables made once, one pass per frame.
#[derive(Debug, Clone)]
pub struct Corrector {
    response: Response,
    /// Radiance of a code at factor 1, relative exposure divided out.
    linear_of_code: [[f32; 256]; 3],
    /// vignetting · relative exposure; 0 = invalid.
    attenuation: Image<f32>,
    /// 1 / vignetting; 0 = invalid.
    reciprocal: Image<f32>,
}

impl Corrector {
    /// For frames of `width` x `height` pixels. `relative_exposure` is this stream's exposure over the
    /// recording's; one that is not a positive number makes every pixel invalid.
    pub fn new(
        response: &Response,
        vignetting: &Vignetting,
        width: u32,
        height: u32,
        relative_exposure: f32,
    ) -> Self {
        let usable = relative_exposure.is_normal() && relative_exposure > 0.0;
        let exposure = if usable { relative_exposure } else { 0.0 };
        let factors = vignetting.table(width, height);
        let linear_of_code = std::array::from_fn(|channel| {
            response
                .table(channel)
                .map(|linear| if usable { linear / exposure } else { 0.0 })
        });
        Self {
            response: response.clone(),
            linear_of_code,
            attenuation: factors.map(|factor| factor * exposure),
            reciprocal: factors.map(|factor| {
                if usable && factor > 0.0 {
                    1.0 / factor
                } else {
                    0.0
                }
            }),
        }
    }

    /// Width of the frames in pixels.
    pub fn width(&self) -> u32 {
        self.attenuation.width()
    }

    /// Height of the frames in pixels.
    pub fn height(&self) -> u32 {
        self.attenuation.height()
    }

    /// vignetting · relative exposure of each pixel, 0 = invalid. The noise of a corrected pixel is that of
    /// its code divided by this, so its square is the pixel's weight (hard-cases B05).
    pub fn attenuation(&self) -> &Image<f32> {
        &self.attenuation
    }

    /// Radiance of each code of red, green, blue at factor 1, relative exposure divided out.
    pub(crate) fn linear_of_code(&self) -> &[[f32; 256]; 3] {
        &self.linear_of_code
    }

    /// 1 / vignetting of each pixel; 0 = invalid.
    pub(crate) fn reciprocal(&self) -> &Image<f32> {
        &self.reciprocal
    }

    /// Codes to linear radiance.
    ///
    /// Saturation is marked on the raw codes before any arithmetic; with `chroma_subsampled` (4:2:0, 4:2:2)
    /// the mark grows by [`CHROMA_REACH`] pixels in both directions. A frame of another size than the
    /// corrector's gives an image of the corrector's size in which every pixel is invalid: use
    /// [`Corrector::check`] where that has to be an error.
    pub fn correct(&self, codes: &Rgb8Image, chroma_subsampled: bool) -> Radiance {
        let (width, height) = (self.width(), self.height());
        let mut radiance = Radiance {
            linear: Image::new(width, height, [0.0; 3]),
            saturated: Image::new(width, height, false),
            invalid: Image::new(width, height, true),
        };
        if !self.attenuation.same_size(codes) || width == 0 {
            return radiance;
        }
        let row = width as usize;
        radiance
            .linear
            .pixels_mut()
            .par_chunks_mut(row)
            .zip(radiance.saturated.pixels_mut().par_chunks_mut(row))
            .zip(radiance.invalid.pixels_mut().par_chunks_mut(row))
            .zip(codes.pixels().par_chunks(row))
            .zip(self.reciprocal.pixels().par_chunks(row))
            .for_each(|((((linear, saturated), invalid), codes), reciprocal)| {
                self.correct_row(codes, reciprocal, linear, saturated, invalid);
            });
        if chroma_subsampled {
            radiance.saturated = dilated(&radiance.saturated, CHROMA_REACH);
        }
        radiance
    }

    /// Refuses a frame of another size than the corrector's.
    pub fn check(&self, codes: &Rgb8Image) -> Result<(), ImagingError> {
        self.attenuation.require_same_size(codes)
    }

    fn correct_row(
        &self,
        codes: &[[u8; 3]],
        reciprocal: &[f32],
        linear: &mut [[f32; 3]],
        saturated: &mut [bool],
        invalid: &mut [bool],
    ) {
        let [red, green, blue] = &self.linear_of_code;
        let outputs = linear.iter_mut().zip(saturated).zip(invalid);
        for ((((linear, saturated), invalid), code), &reciprocal) in
            outputs.zip(codes).zip(reciprocal)
        {
            let [r, g, b] = *code;
            *saturated = r.max(g).max(b) >= SATURATION_CODE;
            *invalid = reciprocal == 0.0;
            *linear = [
                red[usize::from(r)] * reciprocal,
                green[usize::from(g)] * reciprocal,
                blue[usize::from(b)] * reciprocal,
            ];
        }
    }

    /// The forward model: the continuous codes in [0, 255] that the camera gives for `linear` radiance at
    /// pixel (x, y), with vignetting, exposure, response and clipping. An invalid pixel gives the codes of
    /// no light; NaN gives NaN.
    ///
    /// # Panics
    /// When (x, y) lies outside the image.
    #[inline]
    pub fn encode(&self, x: u32, y: u32, linear: [f32; 3]) -> [f32; 3] {
        let attenuation = self.attenuation.at(x, y);
        std::array::from_fn(|channel| self.response.code(linear[channel] * attenuation, channel))
    }
}

/// `mask` grown by `reach` pixels in x and y (a square, so diagonal neighbours count).
pub fn dilated(mask: &Mask, reach: u32) -> Mask {
    let (width, height) = (mask.width(), mask.height());
    let mut along_x = Image::new(width, height, false);
    for y in 0..height {
        spread(mask.row(y), along_x.row_mut(y), reach as usize);
    }
    let mut result = Image::new(width, height, false);
    for y in 0..height {
        let row = along_x.row(y);
        if !row.contains(&true) {
            continue;
        }
        for near in y.saturating_sub(reach)..height.min(y.saturating_add(reach).saturating_add(1)) {
            for (target, &marked) in result.row_mut(near).iter_mut().zip(row) {
                *target |= marked;
            }
        }
    }
    result
}

fn spread(row: &[bool], target: &mut [bool], reach: usize) {
    for x in (0..row.len()).filter(|&x| row[x]) {
        let end = row.len().min(x.saturating_add(reach).saturating_add(1));
        target[x.saturating_sub(reach)..end].fill(true);
    }
}

#[cfg(test)]
mod tests {
    use geometry::DVec2;

    use super::*;

    fn corrector() -> Corrector {
        let lens = Vignetting::even_polynomial(DVec2::new(15.5, 11.5), 20.0, [-0.52, 0.19, -0.04])
            .unwrap();
        Corrector::new(&Response::gamma(2.2).unwrap(), &lens, 32, 24, 0.8)
    }

    #[test]
    fn encoding_undoes_the_correction() {
        let corrector = corrector();
        let codes = Image::from_fn(32, 24, |x, y| {
            [(7 * x) as u8, (9 * y) as u8, (x + y + 1) as u8]
        });
        let radiance = corrector.correct(&codes, false);
        for y in 0..24 {
            for x in 0..32 {
                let back = corrector.encode(x, y, radiance.linear.at(x, y));
                for (code, back) in codes.at(x, y).into_iter().zip(back) {
                    assert!(
                        (f32::from(code) - back).abs() < 1e-2,
                        "({x}, {y}): {code} came back as {back}"
                    );
                }
            }
        }
    }

    #[test]
    fn a_frame_of_another_size_is_masked() {
        let corrector = corrector();
        let codes = Image::new(33, 24, [128_u8; 3]);
        assert!(corrector.check(&codes).is_err());
        let radiance = corrector.correct(&codes, true);
        assert_eq!(radiance.linear.width(), 32);
        assert!(radiance.invalid.pixels().iter().all(|&v| v));
    }

    #[test]
    fn an_exposure_that_is_no_number_leaves_nothing_valid() {
        for exposure in [0.0, -1.0, f32::NAN, f32::INFINITY, 1e-40] {
            let corrector =
                Corrector::new(&Response::identity(), &Vignetting::none(), 4, 3, exposure);
            let radiance = corrector.correct(&Image::new(4, 3, [200; 3]), false);
            assert!(radiance.invalid.pixels().iter().all(|&v| v));
            assert!(radiance.linear.pixels().iter().flatten().all(|&v| v == 0.0));
        }
    }

    #[test]
    fn dilation_covers_a_square_and_stops_at_the_border() {
        let mut mask = Image::new(7, 6, false);
        *mask.at_mut(0, 0) = true;
        *mask.at_mut(5, 4) = true;
        let grown = dilated(&mask, 2);
        for y in 0..6_u32 {
            for x in 0..7_u32 {
                let expected = (x <= 2 && y <= 2) || (x >= 3 && y >= 2);
                assert_eq!(grown.at(x, y), expected, "({x}, {y})");
            }
        }
    }
}
