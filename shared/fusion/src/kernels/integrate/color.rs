//! Colour of a block's voxels: linear radiance in 16-bit fixed point beside the distances.

use imaging::LinearPixel;

use crate::volume::key::BLOCK_VOXELS;

/// Steps of a stored colour weight per observation at the reference depth.
pub(super) const WEIGHT_STEPS: f32 = 256.0;
/// Largest stored colour weight, in [`WEIGHT_STEPS`]: 32 observations. What shines looks different from
/// elsewhere, and tracking wants what was seen of late.
pub(super) const WEIGHT_CAP: f32 = 32.0 * WEIGHT_STEPS;
/// Bit of a stored weight: the colour comes from saturated samples alone and is a lower bound.
pub const SATURATED: u16 = 1 << 15;

/// Linear radiance of 8³ voxels, x fastest, and what it rests on.
///
/// A block has colour only near its surface. The average moves by at least one step towards each sample that
/// differs, so it never stalls, whatever its weight (hard-cases D03).
#[derive(Clone)]
#[repr(C, align(64))]
pub struct ColorBlock {
    /// Red, green, blue in units of 1 / [`imaging::RADIANCE_ONE`].
    pub channels: [[u16; BLOCK_VOXELS]; 3],
    /// Weight in 1/256 of an observation at the reference depth, up to the cap; 0 = no colour. Bit
    /// [`SATURATED`] marks a lower bound.
    pub weight: [u16; BLOCK_VOXELS],
}

impl ColorBlock {
    /// A block without colour.
    pub const EMPTY: Self = Self {
        channels: [[0; BLOCK_VOXELS]; 3],
        weight: [0; BLOCK_VOXELS],
    };

    /// Linear radiance of a voxel and whether it is a lower bound; `None` without colour.
    #[inline]
    pub fn radiance(&self, voxel: usize) -> Option<([f32; 3], bool)> {
        let weight = self.weight[voxel];
        let [red, green, blue] = [0, 1, 2].map(|channel| self.channels[channel][voxel]);
        let pixel = LinearPixel([red, green, blue, 0]);
        (weight != 0).then(|| (pixel.radiance(), weight & SATURATED != 0))
    }

    /// Averages `pixel`, an observation of `weight`, into a voxel. A saturated sample says only that the
    /// radiance is higher: it counts while there is none better, and the first better one replaces it.
    #[inline]
    pub(super) fn blend(&mut self, voxel: usize, pixel: LinearPixel, weight: f32) {
        let stored = self.weight[voxel];
        let (stored_weight, is_bound) = (stored & !SATURATED, stored & SATURATED != 0);
        let is_better = stored_weight != 0 && !is_bound;
        if !pixel.is_valid() || (pixel.is_saturated() && is_better) {
            return;
        }
        let is_replaced = is_bound && !pixel.is_saturated();
        let kept = if is_replaced {
            0.0
        } else {
            f32::from(stored_weight)
        };
        let added = (weight * WEIGHT_STEPS + 0.5).floor().clamp(1.0, WEIGHT_CAP);
        let share = added / (kept + added);
        for (channel, &code) in self.channels.iter_mut().zip(&pixel.0) {
            let stored = f32::from(channel[voxel]);
            let difference = f32::from(code) - stored;
            // Away from zero: rounding to nearest would stop at half a step over the share. Both codes are
            // whole numbers and the share is at most 1, so this never passes the sample.
            let step = (difference.abs() * share).ceil().copysign(difference);
            channel[voxel] = (stored + step) as u16;
        }
        let flag = if pixel.is_saturated() { SATURATED } else { 0 };
        self.weight[voxel] = (kept + added).min(WEIGHT_CAP) as u16 | flag;
    }
}

/// A registered colour image, and how near to the surface it counts.
#[derive(Clone, Copy)]
pub struct ColorView<'a> {
    /// One per pixel of the depth image.
    pub pixels: &'a [LinearPixel],
    /// Largest distance to the observed surface, in truncations, below 1.
    pub reach: f32,
}
