//! The depth sensor: a projector beside a camera, shifts in eighths of a pixel, and what it cannot see.

use effects::{Effect, EffectSet};
use geometry::{DVec2, Intrinsics, Pose};
use glam::Vec3;
use imaging::Image;
use rayon::prelude::*;
use raytrace::{Ray, Scene};

use crate::material::Gloss;
use crate::random::{Purpose, Stream};
use crate::world::{SurfacePoint, World};

/// From depth to shift, with the constants that a PS1080 sends; lengths in mm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShiftModel {
    /// Distance of the reference plane.
    pub zero_plane_mm: f64,
    /// Size of a pixel at the reference plane.
    pub zero_plane_pixel_mm: f64,
    /// Distance from projector to camera.
    pub emitter_distance_mm: f64,
    /// Shifts a pixel of the sensor.
    pub coefficient: f64,
    /// Shift of the reference plane, pixels of the sensor.
    pub constant_shift: f64,
    /// What is subtracted, pixels of the sensor.
    pub offset_pixels: f64,
}

impl Default for ShiftModel {
    /// A measured Xtion.
    fn default() -> Self {
        Self {
            zero_plane_mm: 1200.0,
            zero_plane_pixel_mm: 1.052,
            emitter_distance_mm: 75.0,
            coefficient: 4.0,
            constant_shift: 200.0,
            offset_pixels: 0.375,
        }
    }
}

/// Largest shift: 11 bits, and the last means no measurement.
const LARGEST_SHIFT: f64 = 2046.0;

impl ShiftModel {
    /// The shift of a depth in metres, not rounded: similar triangles from the reference plane.
    pub fn shift(&self, depth: f64) -> f64 {
        let along = self.emitter_distance_mm * (1.0 - self.zero_plane_mm / (1000.0 * depth));
        let pixels = along / self.zero_plane_pixel_mm;
        (self.coefficient * self.constant_shift).floor()
            + self.coefficient * (pixels + self.offset_pixels)
    }
}

/// The depth camera.
#[derive(Clone, Debug)]
pub struct DepthSensor {
    /// Size, focal length, centre.
    pub intrinsics: Intrinsics,
    /// Depth to shift.
    pub shift: ShiftModel,
    /// Deviation of the disparity, shifts.
    pub noise_shifts: f32,
    /// Nearest depth, metres.
    pub nearest: f32,
    /// Farthest depth, metres.
    pub farthest: f32,
}

/// Correlation length of the noise, pixels of a VGA frame.
const NOISE_PIXELS: f32 = 4.0;
/// Cosine to the normal below which the pattern is too stretched to be found (77 degrees).
const LEAST_COSINE: f32 = 0.225;
/// A mirror this close to sending the projector's light into the camera blinds it, cosine of 3 degrees.
const GLARE_COSINE: f32 = 0.9986;
/// Gloss of at most this width glares.
const GLARE_ALPHA: f32 = 0.15;
/// Shifts between neighbours above which both may be lost.
const EDGE_SHIFTS: f32 = 24.0;
/// Share of pixels at an edge that are lost.
const EDGE_LOSS: f32 = 0.6;

impl DepthSensor {
    /// Shifts of a frame; 0 = no measurement. `scene` is what the sensor meets: the world's own, or one with its
    /// vertices displaced. Noise and the losses at edges fall away with the effect `noise`.
    pub fn measure(
        &self,
        world: &World,
        scene: &Scene,
        world_from_camera: &Pose,
        effects: EffectSet,
        seed: u64,
        frame: u64,
    ) -> Image<u16> {
        let (width, height) = (self.intrinsics.width(), self.intrinsics.height());
        let exact = self.exact_shifts(world, scene, world_from_camera);
        let noise = effects
            .contains(Effect::Noise)
            .then(|| self.noise(seed, frame));
        Image::from_fn(width, height, |x, y| {
            let shift = exact.at(x, y);
            if shift == 0.0 {
                return 0;
            }
            let Some(noise) = &noise else {
                return shift.round() as u16;
            };
            if self.is_edge(&exact, x, y) {
                let pixel = u64::from(y) * u64::from(width) + u64::from(x);
                let mut random = Stream::new(seed, Purpose::DepthHoles, frame, pixel);
                if random.unit() < EDGE_LOSS {
                    return 0;
                }
            }
            let shift = f64::from(shift + noise.at(x, y) * self.noise_shifts);
            shift.round().clamp(1.0, LARGEST_SHIFT) as u16
        })
    }

    /// Shifts without noise, not rounded; 0 where the sensor sees nothing.
    fn exact_shifts(&self, world: &World, scene: &Scene, pose: &Pose) -> Image<f32> {
        let (width, height) = (self.intrinsics.width(), self.intrinsics.height());
        let rows: Vec<Vec<f32>> = (0..height)
            .into_par_iter()
            .map(|y| {
                (0..width)
                    .map(|x| self.exact_shift(world, scene, pose, x, y).unwrap_or(0.0))
                    .collect()
            })
            .collect();
        Image::from_vec(width, height, rows.concat()).expect("one value a pixel")
    }

    fn exact_shift(
        &self,
        world: &World,
        scene: &Scene,
        pose: &Pose,
        x: u32,
        y: u32,
    ) -> Option<f32> {
        let pixel = DVec2::new(f64::from(x), f64::from(y));
        let ahead = self.intrinsics.camera_from_pixel(pixel)?;
        let ahead = ahead / ahead.z;
        let eye = pose.translation().as_vec3();
        let ray = Ray::new(eye, pose.transform_vector(ahead).as_vec3());
        let hit = scene.closest(&ray)?;
        // z along the axis: the direction has z = 1 in the camera's axes.
        let point = world.point_at(&ray, &hit);
        let depth = if std::ptr::eq(scene, world.scene()) {
            point.distance
        } else {
            hit.t
        };
        if !(self.nearest..=self.farthest).contains(&depth) {
            return None;
        }
        let emitter_metres = self.shift.emitter_distance_mm / 1000.0;
        let emitter = pose.transform_point(glam::DVec3::new(-emitter_metres, 0.0, 0.0));
        let to_eye = -ray.direction.normalize();
        let is_hidden = self.is_hidden(world, scene, &point, to_eye, emitter.as_vec3());
        (!is_hidden).then(|| self.shift.shift(f64::from(depth)).clamp(1.0, LARGEST_SHIFT) as f32)
    }

    /// Whether the pattern does not reach the point or is not found there.
    fn is_hidden(
        &self,
        world: &World,
        scene: &Scene,
        point: &SurfacePoint,
        to_eye: Vec3,
        emitter: Vec3,
    ) -> bool {
        let to_emitter = emitter - point.position;
        let distance = to_emitter.length();
        let to_emitter = to_emitter / distance.max(1e-6);
        if point.normal.dot(to_eye) < LEAST_COSINE || point.normal.dot(to_emitter) < LEAST_COSINE {
            return true;
        }
        let object = &world.objects[usize::from(point.object)];
        if let Some((_, gloss)) = object.material.gloss(point.position - object.anchor)
            && glares(&gloss, point.normal, to_eye, to_emitter)
        {
            return true;
        }
        let mut shadow = World::leaving(point, to_emitter);
        // A displaced surface lies off the exact one.
        shadow.least = 2e-3;
        shadow.greatest = distance;
        scene.is_blocked(&shadow)
    }

    fn is_edge(&self, shifts: &Image<f32>, x: u32, y: u32) -> bool {
        let own = shifts.at(x, y);
        [(1, 0), (-1, 0), (0, 1), (0, -1)].iter().any(|(dx, dy)| {
            shifts
                .get(i64::from(x) + dx, i64::from(y) + dy)
                .is_some_and(|other| other == 0.0 || (other - own).abs() > EDGE_SHIFTS)
        })
    }

    /// Smooth noise with deviation 1: normal numbers on a lattice, between them bilinear and scaled back.
    fn noise(&self, seed: u64, frame: u64) -> Image<f32> {
        let spacing = (NOISE_PIXELS * self.intrinsics.width() as f32 / 640.0).max(1.0);
        let (width, height) = (self.intrinsics.width(), self.intrinsics.height());
        let columns = (width as f32 / spacing) as u32 + 2;
        let lattice = Image::from_fn(columns, (height as f32 / spacing) as u32 + 2, |x, y| {
            let knot = u64::from(y) * u64::from(columns) + u64::from(x);
            Stream::new(seed, Purpose::DepthNoise, frame, knot).normal()
        });
        Image::from_fn(width, height, |x, y| {
            let (fx, fy) = (x as f32 / spacing, y as f32 / spacing);
            let (x0, y0) = (fx as u32, fy as u32);
            let (tx, ty) = (fx - x0 as f32, fy - y0 as f32);
            let weights = [
                (1.0 - tx) * (1.0 - ty),
                tx * (1.0 - ty),
                (1.0 - tx) * ty,
                tx * ty,
            ];
            let knots = [(x0, y0), (x0 + 1, y0), (x0, y0 + 1), (x0 + 1, y0 + 1)];
            let value: f32 = weights
                .iter()
                .zip(knots)
                .map(|(weight, (kx, ky))| weight * lattice.at(kx, ky))
                .sum();
            let power: f32 = weights.iter().map(|weight| weight * weight).sum();
            value / power.sqrt()
        })
    }
}

/// Whether the gloss sends the projector's light into the camera.
fn glares(gloss: &Gloss, normal: Vec3, to_eye: Vec3, to_emitter: Vec3) -> bool {
    let half = (to_eye + to_emitter).normalize_or(normal);
    gloss.alpha <= GLARE_ALPHA && half.dot(normal) > GLARE_COSINE
}
