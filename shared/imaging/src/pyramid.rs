//! Half-size images: depth that is never invented, colour that never mixes in masked pixels.
//!
//! Coarse pixel (x, y) covers the fine pixels (2x, 2y) to (2x + 1, 2y + 1); its centre lies at fine position
//! (2x + ½, 2y + ½). So focal lengths halve and a principal point c becomes (c + ½)/2 − ½. The last column or
//! row of an odd size is dropped.

use crate::depth::{NO_DEPTH, is_measured};
use crate::error::ImagingError;
use crate::image::{DepthImage, Image, LinearImage, Mask};

/// How far apart two depths of one surface may be: `floor` + `per_square_metre` · depth².
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DepthTolerance {
    /// Tolerance at depth 0, metres.
    pub floor: f32,
    /// Growth with the square of the depth, 1/metres.
    pub per_square_metre: f32,
}

impl DepthTolerance {
    /// The tolerance at `depth` metres.
    #[inline]
    pub fn at(&self, depth: f32) -> f32 {
        self.floor + self.per_square_metre * depth * depth
    }
}

impl Default for DepthTolerance {
    /// Three standard deviations of a PrimeSense sensor: one disparity step of 2.89e-3 z² metres
    /// (hard-cases B02; rounding σ = step/√12, about as much again from the pattern), and 1 mm for rounding
    /// to millimetres.
    fn default() -> Self {
        Self {
            floor: 0.001,
            per_square_metre: 3.0 * 1.2e-3,
        }
    }
}

/// Half-size depth: the mean of those of the four samples that agree with the best supported one.
///
/// The centre is the sample within whose tolerance most of the four lie (of equals the nearest to the
/// camera); the output is the mean of those. No measurement in, no measurement out; a step edge gives one of
/// its sides, never a depth between (hard-cases B04).
pub fn half_depth(depth: &DepthImage, tolerance: DepthTolerance) -> DepthImage {
    Image::from_fn(depth.width() / 2, depth.height() / 2, |x, y| {
        let block = block_of(depth, x, y);
        masked_mean(block, tolerance)
    })
}

/// `depth` and its half sizes, `level_count` images in all (at least one); stops early when a side would
/// vanish.
pub fn depth_pyramid(
    depth: DepthImage,
    level_count: usize,
    tolerance: DepthTolerance,
) -> Vec<DepthImage> {
    let mut levels = vec![depth];
    while levels.len() < level_count {
        let finest = &levels[levels.len() - 1];
        if finest.width() < 2 || finest.height() < 2 {
            break;
        }
        let half = half_depth(finest, tolerance);
        levels.push(half);
    }
    levels
}

/// Half-size colour: the mean of those of the four pixels that `excluded` does not mark. Where it marks all
/// four the output is black and excluded. Refuses a mask of another size.
pub fn half_color(
    color: &LinearImage,
    excluded: &Mask,
) -> Result<(LinearImage, Mask), ImagingError> {
    color.require_same_size(excluded)?;
    let (width, height) = (color.width() / 2, color.height() / 2);
    let mut half_excluded = Image::new(width, height, false);
    let half = Image::from_fn(width, height, |x, y| {
        let mut sum = [0.0_f32; 3];
        let mut count = 0.0_f32;
        for (pixel, excluded) in block_of(color, x, y)
            .into_iter()
            .zip(block_of(excluded, x, y))
        {
            if !excluded {
                sum = std::array::from_fn(|channel| sum[channel] + pixel[channel]);
                count += 1.0;
            }
        }
        if count == 0.0 {
            *half_excluded.at_mut(x, y) = true;
            return [0.0; 3];
        }
        sum.map(|value| value / count)
    });
    Ok((half, half_excluded))
}

fn block_of<T: Copy>(image: &Image<T>, x: u32, y: u32) -> [T; 4] {
    let left = 2 * x as usize;
    let (top, bottom) = (image.row(2 * y), image.row(2 * y + 1));
    [top[left], top[left + 1], bottom[left], bottom[left + 1]]
}

fn masked_mean(block: [f32; 4], tolerance: DepthTolerance) -> f32 {
    let (mut count, mut sum) = (0.0, 0.0_f64);
    for (depth, agrees) in block.into_iter().zip(agreeing(block, tolerance)) {
        if agrees {
            sum += f64::from(depth);
            count += 1.0;
        }
    }
    if count > 0.0 {
        (sum / count) as f32
    } else {
        NO_DEPTH
    }
}

/// Which of four samples (metres) are one surface: those within the tolerance of the sample that most of them
/// agree with, of equals the nearest to the camera. None where nothing is measured.
pub fn agreeing(block: [f32; 4], tolerance: DepthTolerance) -> [bool; 4] {
    let mut best = (0, f32::INFINITY, [false; 4]);
    for center in block.into_iter().filter(|&d| is_measured(d)) {
        let reach = tolerance.at(center);
        let agrees = block.map(|d| is_measured(d) && (d - center).abs() <= reach);
        // `count` is 0 when the tolerance is not a number: then nothing is averaged and nothing invented.
        let count = agrees.iter().filter(|&&agrees| agrees).count();
        if count > best.0 || (count == best.0 && count > 0 && center < best.1) {
            best = (count, center, agrees);
        }
    }
    best.2
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flat_patch_is_averaged_and_a_hole_left_out() {
        let depth =
            Image::from_vec(4, 2, vec![1.0, 1.002, 0.0, 0.0, 1.001, 0.0, 0.0, f32::NAN]).unwrap();
        let half = half_depth(&depth, DepthTolerance::default());
        assert!((half.at(0, 0) - 1.001).abs() < 1e-6);
        assert_eq!(half.at(1, 0), NO_DEPTH);
    }

    #[test]
    fn two_against_two_gives_the_nearer_side() {
        let depth = Image::from_vec(2, 2, vec![2.0, 0.6, 2.0, 0.6]).unwrap();
        assert_eq!(half_depth(&depth, DepthTolerance::default()).at(0, 0), 0.6);
    }

    #[test]
    fn a_pyramid_ends_at_one_pixel() {
        let sizes: Vec<_> = depth_pyramid(Image::new(13, 9, 1.0), 8, DepthTolerance::default())
            .iter()
            .map(|level| (level.width(), level.height()))
            .collect();
        assert_eq!(sizes, [(13, 9), (6, 4), (3, 2), (1, 1)]);
    }

    #[test]
    fn excluded_colour_does_not_bleed() {
        let color = Image::from_vec(2, 2, vec![[1.0; 3], [0.2; 3], [0.4; 3], [9.0; 3]]).unwrap();
        let excluded = Image::from_vec(2, 2, vec![true, false, false, true]).unwrap();
        let (half, mask) = half_color(&color, &excluded).unwrap();
        assert!((half.at(0, 0)[1] - 0.3).abs() < 1e-6);
        assert!(!mask.at(0, 0));
        let (half, mask) = half_color(&color, &Image::new(2, 2, true)).unwrap();
        assert_eq!((half.at(0, 0), mask.at(0, 0)), ([0.0; 3], true));
        assert!(half_color(&color, &Image::new(1, 2, true)).is_err());
    }
}
