//! The live path: fixed-point radiance and half-size grey in one pass, nothing allocated per frame.

use super::bands::{BAND_ROWS, Band};
use super::layout::ColorLayout;
use super::marks::{MarkRule, Marks};
use super::mosaic::{Mosaic, MosaicRows};
use crate::error::ImagingError;
use crate::image::Image;
use crate::kernels::Level;
use crate::kernels::demosaic::pack_row;
use crate::kernels::develop::{CodeLanes, grey_row, linear_row};
use crate::linear_pixel::{LinearPixel, RADIANCE_ONE};
use crate::radiance::{CHROMA_REACH, Corrector, SATURATION_CODE, dilated};

/// Develops frame after frame of one colour camera. All memory is taken when it is made.
///
/// Same bits for any number of threads and on every machine: both SIMD levels agree exactly.
pub struct Developer {
    layout: ColorLayout,
    width: usize,
    height: usize,
    level: Level,
    lanes: Box<CodeLanes>,
    linear_of_code: Box<[[f32; 256]; 3]>,
    /// 1 / vignetting, 0 = invalid; in units of the fixed point where codes go straight to pixels.
    factor: Vec<f32>,
    /// Flags of a mosaic's pixels before saturation; empty for other layouts.
    validity: Vec<u8>,
    rule: MarkRule,
    marks: Marks,
    scratch: Vec<BandScratch>,
}

/// Working memory of a band.
struct BandScratch {
    codes: Vec<[u8; 3]>,
    flags: Vec<u8>,
    mosaic: Option<MosaicRows>,
}

impl std::fmt::Debug for Developer {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self {
            layout,
            width,
            height,
            level,
            ..
        } = self;
        write!(
            formatter,
            "Developer({layout:?}, {width}x{height}, {level:?})"
        )
    }
}

impl Developer {
    /// For frames of `layout` with the size, response, vignetting and exposure of `corrector`.
    ///
    /// # Errors
    /// [`ImagingError::FrameSize`] for empty frames and odd widths of YUV 4:2:2.
    pub fn new(corrector: &Corrector, layout: ColorLayout) -> Result<Self, ImagingError> {
        Self::with_level(corrector, layout, Level::detect())
    }

    /// The same with chosen instructions; those that the machine lacks become scalar.
    ///
    /// # Errors
    /// As [`Developer::new`].
    pub fn with_level(
        corrector: &Corrector,
        layout: ColorLayout,
        level: Level,
    ) -> Result<Self, ImagingError> {
        let (width, height) = (corrector.width(), corrector.height());
        layout.check_size(width, height)?;
        let is_mosaic = layout == ColorLayout::BayerGrbg;
        let unit = if is_mosaic {
            1.0
        } else {
            f32::from(RADIANCE_ONE)
        };
        let band = || BandScratch {
            codes: match layout {
                ColorLayout::Uyvy(_) | ColorLayout::Yuyv(_) => vec![[0; 3]; width as usize],
                ColorLayout::Rgb8 | ColorLayout::BayerGrbg => Vec::new(),
            },
            flags: vec![0; width as usize],
            mosaic: is_mosaic.then(|| MosaicRows::new(width as usize)),
        };
        Ok(Self {
            layout,
            width: width as usize,
            height: height as usize,
            level: if level.is_usable() {
                level
            } else {
                Level::Scalar
            },
            lanes: lanes_of(corrector),
            linear_of_code: Box::new(*corrector.linear_of_code()),
            factor: corrector
                .reciprocal()
                .pixels()
                .iter()
                .map(|f| f * unit)
                .collect(),
            validity: if is_mosaic {
                validity_of(corrector)
            } else {
                Vec::new()
            },
            rule: MarkRule::of(layout),
            marks: Marks::new(width, height),
            scratch: (0..(height as usize).div_ceil(BAND_ROWS))
                .map(|_| band())
                .collect(),
        })
    }

    /// Columns of the frames.
    pub fn width(&self) -> u32 {
        self.width as u32
    }

    /// Rows of the frames.
    pub fn height(&self) -> u32 {
        self.height as u32
    }

    /// Develops `frame` into one pixel each, and into half-size linear luminance: mean of the valid, unsaturated
    /// ones of 2x2 pixels by the weights 0.2126, 0.7152, 0.0722, 1.0 = white level, 0 = none of them counts.
    ///
    /// `chroma_subsampled` says of [`ColorLayout::Rgb8`] that it was decoded from 4:2:0 or 4:2:2 (a JPEG), so that
    /// marks of saturation grow; the other layouts say so themselves. Radiance above 4 stays at 4.
    ///
    /// # Errors
    /// [`ImagingError::FrameBytes`] for a frame of another length; [`ImagingError::PixelCount`] unless `pixels` has
    /// width · height and `grey` ⌊width/2⌋ · ⌊height/2⌋ places.
    pub fn develop(
        &mut self,
        frame: &[u8],
        chroma_subsampled: bool,
        pixels: &mut [LinearPixel],
        grey: &mut [f32],
    ) -> Result<(), ImagingError> {
        let (width, height) = (self.width(), self.height());
        self.layout.check(frame, width, height)?;
        require_count(pixels.len(), width, height)?;
        require_count(grey.len(), width / 2, height / 2)?;
        let marks_grow = chroma_subsampled || self.layout != ColorLayout::Rgb8;
        if marks_grow {
            self.marks.set(self.level, self.rule, frame);
        }
        let mut scratch = std::mem::take(&mut self.scratch);
        let all = Band {
            rows: 0..self.height,
            width: self.width,
            pixels,
            grey,
        };
        let this = &*self;
        all.for_each(&mut scratch, &|band, scratch: &mut BandScratch| {
            this.develop_band(frame, marks_grow, band, scratch);
        });
        self.scratch = scratch;
        Ok(())
    }

    fn develop_band(&self, frame: &[u8], marks_grow: bool, band: Band, scratch: &mut BandScratch) {
        let Band {
            rows, pixels, grey, ..
        } = band;
        let mut output = BandOutput {
            developer: self,
            first_row: rows.start,
            pixels,
            grey,
        };
        let BandScratch {
            codes,
            flags,
            mosaic,
        } = scratch;
        if let Some(mosaic_rows) = mosaic {
            let mosaic = Mosaic {
                codes: frame,
                width: self.width,
                height: self.height,
                linear_of_code: &self.linear_of_code,
                factor: &self.factor,
            };
            mosaic_rows.for_each(self.level, &mosaic, rows, |y, rgb| {
                output.mosaic_row(y, rgb, flags);
            });
            return;
        }
        let row_bytes = frame.len() / self.height;
        for y in rows {
            let samples = &frame[y * row_bytes..][..row_bytes];
            let codes: &[[u8; 3]] = match self.rule {
                MarkRule::Yuv(converter, order) => {
                    converter.rgb_row(self.level, order, samples, codes);
                    codes
                }
                MarkRule::Rgb8 | MarkRule::Bayer => samples.as_chunks().0,
            };
            output.code_row(y, codes, marks_grow, flags);
        }
    }
}

/// Where the rows of a band go.
struct BandOutput<'a> {
    developer: &'a Developer,
    first_row: usize,
    pixels: &'a mut [LinearPixel],
    grey: &'a mut [f32],
}

impl BandOutput<'_> {
    fn code_row(&mut self, y: usize, codes: &[[u8; 3]], marks_grow: bool, flags: &mut [u8]) {
        let Developer {
            level,
            width,
            lanes,
            factor,
            marks,
            ..
        } = self.developer;
        let row = &mut self.pixels[(y - self.first_row) * width..][..*width];
        linear_row(*level, lanes, codes, &factor[y * width..][..*width], row);
        if marks_grow {
            let mut has_any = false;
            flags.fill(0);
            marks.for_each_near(y, |marked| {
                has_any = true;
                for (flag, &marked) in flags.iter_mut().zip(marked) {
                    *flag |= u8::from(marked);
                }
            });
            if has_any {
                for (pixel, &flag) in row.iter_mut().zip(flags.iter()) {
                    // An invalid pixel stays without flags.
                    pixel.0[3] |= (pixel.0[3] & u16::from(flag)) << 1;
                }
            }
        }
        self.grey_below(y);
    }

    fn mosaic_row(&mut self, y: usize, rgb: [&[f32]; 3], flags: &mut [u8]) {
        let Developer {
            level,
            width,
            validity,
            marks,
            ..
        } = self.developer;
        flags.copy_from_slice(&validity[y * width..][..*width]);
        marks.for_each_near(y, |marked| {
            for (flags, &marked) in flags.iter_mut().zip(marked) {
                *flags |= (*flags & u8::from(marked)) << 1;
            }
        });
        let row = &mut self.pixels[(y - self.first_row) * width..][..*width];
        pack_row(*level, rgb, flags, row);
        self.grey_below(y);
    }

    /// Grey of rows y − 1 and y once both are there.
    fn grey_below(&mut self, y: usize) {
        let width = self.developer.width;
        let row = y - self.first_row;
        let half = width / 2;
        if row.is_multiple_of(2) || half == 0 {
            return;
        }
        let (above, below) = self.pixels[(row - 1) * width..][..2 * width].split_at(width);
        let grey = &mut self.grey[row / 2 * half..][..half];
        grey_row(self.developer.level, above, below, grey);
    }
}

fn require_count(count: usize, width: u32, height: u32) -> Result<(), ImagingError> {
    let expected = u64::from(width) * u64::from(height);
    if count as u64 == expected {
        return Ok(());
    }
    Err(ImagingError::PixelCount {
        width,
        height,
        expected,
        got: count as u64,
    })
}

fn lanes_of(corrector: &Corrector) -> Box<CodeLanes> {
    let mut lanes: Box<CodeLanes> = Box::new([[[0.0; 4]; 256]; 3]);
    let tables = corrector.linear_of_code();
    for (channel, (lanes, table)) in lanes.iter_mut().zip(tables).enumerate() {
        for (code, (entry, &linear)) in lanes.iter_mut().zip(table).enumerate() {
            entry[channel] = linear;
            entry[3] = if code >= usize::from(SATURATION_CODE) {
                2.0
            } else {
                0.0
            };
            entry[3] += if channel == 0 { 1.0 } else { 0.0 };
        }
    }
    lanes
}

/// Flag "valid" of each pixel of a mosaic: a pixel next to one without a factor takes its colour from there.
pub(super) fn invalid_of(corrector: &Corrector) -> Image<bool> {
    dilated(
        &corrector.reciprocal().map(|factor| factor == 0.0),
        CHROMA_REACH,
    )
}

fn validity_of(corrector: &Corrector) -> Vec<u8> {
    let invalid = invalid_of(corrector);
    invalid
        .pixels()
        .iter()
        .map(|&invalid| u8::from(!invalid))
        .collect()
}
