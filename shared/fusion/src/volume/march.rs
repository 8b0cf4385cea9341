//! The march along one ray, a look at a time.

use glam::Vec3A;

use super::allocate::whole_below;
use super::key::{BLOCK_EDGE, BLOCK_SHIFT};
use super::sampler::Sampler;
use crate::kernels::field::FieldSample;
use crate::kernels::integrate::Block;
use crate::kernels::prefetch::prefetch;

/// Share of the distance that the field promises which a step uses (hard-cases D16).
const STEP_SHARE: f32 = 0.8;
/// Shortest step, in voxels.
const SHORTEST_STEP: f32 = 0.7;
/// Voxels by which a crossing may lie outside its two samples, which are those of the nearest voxels: off by
/// up to 0.87 voxels across the surface, so by five times that along a ray that meets it at 10 degrees.
const CROSSING_SLACK: f32 = 4.0;
/// Most corrections of a crossing.
pub(super) const MOST_CORRECTIONS: usize = 4;
/// Slope, in truncations per voxel times truncation voxels, below which it says nothing (D15).
const LEAST_GRADIENT: f32 = 1e-3;

/// Lengths of a march along one ray, metres of z.
#[derive(Clone, Copy)]
pub(super) struct March {
    /// Distance that a value of 1 promises.
    pub(super) truncation: f32,
    /// The same in voxels.
    pub(super) truncation_voxels: f32,
    /// Depths that the volume takes.
    pub(super) nearest: f32,
    pub(super) farthest: f32,
    pub(super) min_weight: f32,
    /// Correction, in voxels, below which the next one is left out.
    pub(super) small_correction: f32,
}

/// One ray: a point at depth z is `eye + z · slope`, in voxels.
#[derive(Clone, Copy)]
pub(super) struct Ray {
    eye: Vec3A,
    slope: Vec3A,
    /// Metres of z per voxel of way.
    z_per_voxel: f32,
}

impl Ray {
    #[inline]
    pub(super) fn at(&self, z: f32) -> Vec3A {
        self.eye + z * self.slope
    }

    #[inline]
    pub(super) fn new(eye: Vec3A, slope: Vec3A) -> Self {
        Self {
            eye,
            slope,
            z_per_voxel: slope.length_recip(),
        }
    }
}

/// A march along one ray.
pub(super) struct Walk<'a> {
    pub(super) ray: Ray,
    /// Column, and row of the band.
    pub(super) pixel: (usize, usize),
    /// Where it stands, metres of z.
    pub(super) z: f32,
    /// Where its range ends.
    pub(super) farthest: f32,
    /// Metres of z per voxel along x, y, z.
    z_per_axis: Vec3A,
    /// Depth and value of the sample before, where it lies in front of a surface.
    before: Option<(f32, f32)>,
    next: Next<'a>,
}

/// What a walk looks at in its next turn; it was fetched in the last.
enum Next<'a> {
    /// A voxel of a block.
    Voxel(&'a Block, usize),
    /// A crossing between two samples (depth and value).
    Crossing([(f32, f32); 2]),
}

/// What a turn came to.
pub(super) enum Turn {
    /// There is more to look at.
    Ahead,
    /// The ray meets nothing.
    Past,
    /// Depth and field of the first crossing from free space to behind a surface.
    Surface(f32, FieldSample),
}

impl<'a> Walk<'a> {
    /// A walk that has not begun.
    pub(super) fn at(ray: Ray, pixel: (usize, usize)) -> Self {
        Self {
            ray,
            pixel,
            z: 0.0,
            farthest: 0.0,
            z_per_axis: ray.slope.recip(),
            before: None,
            next: Next::Crossing([(0.0, 0.0); 2]),
        }
    }

    pub(super) fn turn(&mut self, sampler: &mut Sampler<'a>, march: &March) -> Turn {
        let shortest = SHORTEST_STEP * self.ray.z_per_voxel;
        match self.next {
            Next::Voxel(block, voxel) => {
                let tsdf = block.tsdf[voxel];
                let here = (self.z, tsdf);
                self.z += (STEP_SHARE * march.truncation * tsdf.abs()).max(shortest);
                if !tsdf.is_sign_negative() {
                    self.before = Some(here);
                } else if let Some(before) = self.before.take() {
                    let guess = crossing(before, here);
                    sampler.neighbourhood(self.ray.at(guess)).fetch();
                    self.next = Next::Crossing([before, here]);
                    return Turn::Ahead;
                }
            }
            Next::Crossing([before, behind]) => {
                let slack = CROSSING_SLACK * self.ray.z_per_voxel;
                let approach = Approach {
                    ray: self.ray,
                    z: crossing(before, behind),
                    limits: [before.0 - slack, behind.0 + slack],
                };
                if let Some((z, sample)) = approach.arrive(sampler, march) {
                    return Turn::Surface(z, sample);
                }
            }
        }
        if self.seek(sampler) {
            Turn::Ahead
        } else {
            Turn::Past
        }
    }

    /// Goes on to the next place that lies in a block and fetches its voxel; `false` beyond the range.
    pub(super) fn seek(&mut self, sampler: &mut Sampler<'a>) -> bool {
        let shortest = SHORTEST_STEP * self.ray.z_per_voxel;
        while self.z < self.farthest {
            // The nearest voxel: half a voxel off at most, and the crossing is refined.
            let point = self.ray.at(self.z) + 0.5;
            let voxel = whole_below(point);
            if let Some(block) = sampler.block(voxel.map(|v| v >> BLOCK_SHIFT)) {
                let [x, y, z] = voxel.map(|v| v as usize % BLOCK_EDGE);
                let index = x | y << BLOCK_SHIFT | z << (2 * BLOCK_SHIFT);
                prefetch(&block.tsdf, index);
                self.next = Next::Voxel(block, index);
                return true;
            }
            self.before = None;
            let first = voxel.map(|v| (v >> BLOCK_SHIFT << BLOCK_SHIFT) as f32);
            self.z += self
                .z_to_border(point - Vec3A::from_array(first))
                .max(shortest);
        }
        false
    }

    /// Metres of z to the border of a block from a place `within` it, voxels.
    #[inline]
    fn z_to_border(&self, within: Vec3A) -> f32 {
        let ahead = Vec3A::splat(BLOCK_EDGE as f32) - within;
        let ahead = Vec3A::select(self.z_per_axis.cmpge(Vec3A::ZERO), ahead, -within);
        // Parallel to a side the way is infinite, and along it no number, which a minimum drops.
        let [x, y, z] = (ahead * self.z_per_axis).to_array();
        x.min(y).min(z)
    }
}

/// Where the line through two samples (depth and value) crosses zero.
fn crossing((z_before, tsdf_before): (f32, f32), (z_behind, tsdf_behind): (f32, f32)) -> f32 {
    z_before + (z_behind - z_before) * tsdf_before / (tsdf_before - tsdf_behind)
}

/// A place near a crossing, on its way to the zero of the trilinear field.
#[derive(Clone, Copy)]
pub(super) struct Approach {
    pub(super) ray: Ray,
    /// Where it is, metres of z.
    pub(super) z: f32,
    /// Where it may go.
    pub(super) limits: [f32; 2],
}

/// What a correction came to.
pub(super) enum Corrected {
    /// The next one would not show.
    Arrived,
    /// There is more to correct.
    Ahead,
    /// This is no surface.
    Astray,
}

impl Approach {
    /// Nowhere.
    pub(super) const NONE: Self = Self {
        ray: Ray {
            eye: Vec3A::ZERO,
            slope: Vec3A::ZERO,
            z_per_voxel: 0.0,
        },
        z: 0.0,
        limits: [0.0; 2],
    };

    /// Moves by one Newton step from `sample`, the field at where it is.
    #[inline]
    pub(super) fn correct(&mut self, sample: &FieldSample, march: &March) -> Corrected {
        let gradient = sample.gradient;
        // Change of the value per metre of z: falls where the ray enters a surface.
        let fall = -gradient.dot(self.ray.slope);
        let is_slope = gradient.length() * march.truncation_voxels > LEAST_GRADIENT;
        if !(fall > 0.0) || !is_slope || !(sample.weight > 0.0) {
            return Corrected::Astray;
        }
        let longest = 2.0 * self.ray.z_per_voxel;
        let correction = (sample.tsdf / fall).clamp(-longest, longest);
        self.z += correction;
        if !(self.z >= self.limits[0] && self.z <= self.limits[1]) {
            Corrected::Astray
        } else if correction.abs() < march.small_correction * self.ray.z_per_voxel {
            Corrected::Arrived
        } else {
            Corrected::Ahead
        }
    }

    /// Depth and field of the zero; `None` when it is no surface.
    fn arrive(mut self, sampler: &mut Sampler<'_>, march: &March) -> Option<(f32, FieldSample)> {
        let mut sample = [FieldSample::NONE];
        for _ in 0..MOST_CORRECTIONS {
            let point = sampler.neighbourhood(self.ray.at(self.z));
            sampler.sample_all(&[point], march.min_weight, &mut sample);
            match self.correct(&sample[0], march) {
                Corrected::Arrived => return Some((self.z, sample[0])),
                Corrected::Ahead => {}
                Corrected::Astray => return None,
            }
        }
        None
    }
}
