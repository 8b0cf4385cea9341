//! From pictures to the network's input: mask, crop, range.

use imaging::{Image, Mask};

use super::PerceptualError;

/// Smallest side of a picture: the second pooling of a smaller one has no pixel.
pub const SMALLEST_SIDE: u32 = 31;

/// Pixels around the mask's box that stay in the crop.
pub const CROP_MARGIN: u32 = 16;

/// What stands outside the mask, in both pictures.
const OUTSIDE: f32 = 0.5;

/// How far an encoded value may lie outside [0, 1]: rounding, not another scale.
const RANGE_SLACK: f32 = 1e-3;

/// The mean and the spread that the published network takes from 2v − 1, RGB.
const SHIFT: [f32; 3] = [-0.030, -0.088, -0.188];
const SCALE: [f32; 3] = [0.458, 0.448, 0.450];

/// A box of pixels; the ends are excluded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CropBox {
    /// First column.
    pub x0: u32,
    /// First row.
    pub y0: u32,
    /// Column after the last.
    pub x1: u32,
    /// Row after the last.
    pub y1: u32,
}

impl CropBox {
    /// The box of a mask with `margin` pixels around it, cut at the image's border; `None` of an empty mask.
    pub fn around(mask: &Mask, margin: u32) -> Option<Self> {
        let mut found: Option<Self> = None;
        for y in 0..mask.height() {
            let row = mask.row(y);
            let Some(first) = row.iter().position(|&inside| inside) else {
                continue;
            };
            let last = row.iter().rposition(|&inside| inside).unwrap_or(first);
            let (x0, x1) = (first as u32, last as u32 + 1);
            let area = found.get_or_insert(Self {
                x0,
                y0: y,
                x1,
                y1: y + 1,
            });
            area.x0 = area.x0.min(x0);
            area.x1 = area.x1.max(x1);
            area.y1 = y + 1;
        }
        found.map(|area| Self {
            x0: area.x0.saturating_sub(margin),
            y0: area.y0.saturating_sub(margin),
            x1: area.x1.saturating_add(margin).min(mask.width()),
            y1: area.y1.saturating_add(margin).min(mask.height()),
        })
    }

    /// The part of an image inside the box.
    ///
    /// # Panics
    /// When the box reaches beyond the image.
    pub fn of<T: Copy>(&self, image: &Image<T>) -> Image<T> {
        Image::from_fn(self.x1 - self.x0, self.y1 - self.y0, |x, y| {
            image.at(self.x0 + x, self.y0 + y)
        })
    }
}

/// A picture as the network takes it: three planes (channel, row, column), normalised.
#[derive(Clone, Debug)]
pub struct NetworkInput {
    pub(super) width: u32,
    pub(super) height: u32,
    pub(super) planes: Vec<f32>,
}

impl NetworkInput {
    /// A whole picture, encoded RGB in [0, 1]. Refuses sides below [`SMALLEST_SIDE`] and values outside.
    pub fn whole(picture: &Image<[f32; 3]>) -> Result<Self, PerceptualError> {
        Self::prepared(picture, None)
    }

    /// The masked part of a picture: grey 0.5 outside the mask, cropped to the mask's box and [`CROP_MARGIN`]
    /// around it, never resized. `None` of an empty mask; refusals as [`NetworkInput::whole`], for the crop.
    pub fn masked(picture: &Image<[f32; 3]>, mask: &Mask) -> Result<Option<Self>, PerceptualError> {
        let sizes = [
            (picture.width(), picture.height()),
            (mask.width(), mask.height()),
        ];
        if sizes[0] != sizes[1] {
            return Err(PerceptualError::SizeMismatch {
                left: sizes[0],
                right: sizes[1],
            });
        }
        let Some(area) = CropBox::around(mask, CROP_MARGIN) else {
            return Ok(None);
        };
        Self::prepared(&area.of(picture), Some(&area.of(mask))).map(Some)
    }

    fn prepared(picture: &Image<[f32; 3]>, mask: Option<&Mask>) -> Result<Self, PerceptualError> {
        let (width, height) = (picture.width(), picture.height());
        if width < SMALLEST_SIDE || height < SMALLEST_SIDE {
            return Err(PerceptualError::TooSmall { width, height });
        }
        let plane = width as usize * height as usize;
        let mut planes = vec![0.0; 3 * plane];
        for y in 0..height {
            for (x, &color) in picture.row(y).iter().enumerate() {
                let inside = mask.is_none_or(|mask| mask.row(y)[x]);
                let color = if inside { color } else { [OUTSIDE; 3] };
                for (channel, value) in color.into_iter().enumerate() {
                    if !(-RANGE_SLACK..=1.0 + RANGE_SLACK).contains(&value) {
                        let x = x as u32;
                        return Err(PerceptualError::ValueOutOfRange { x, y, value });
                    }
                    planes[channel * plane + y as usize * width as usize + x] =
                        (2.0 * value - 1.0 - SHIFT[channel]) / SCALE[channel];
                }
            }
        }
        Ok(Self {
            width,
            height,
            planes,
        })
    }
}
