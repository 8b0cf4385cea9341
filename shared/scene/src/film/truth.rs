//! What is true of a frame: light apart, surfaces, mirrored rays, at the pixels' centres.

use geometry::{DVec2, Pose};
use glam::Vec3;
use imaging::{Image, LinearImage};
use rayon::prelude::*;

use super::Film;
use crate::transport::Transport;

/// What a pixel's centre of the colour camera sees, without lens, noise and response.
#[derive(Clone, Debug)]
pub struct FrameTruth {
    /// Object, from 1; 0 = background.
    pub object: Image<u8>,
    /// Gloss: 0 = none, else 1 + its number within the object.
    pub material: Image<u8>,
    /// Whether the pixel shows a glossy target.
    pub mask: Image<bool>,
    /// z along the axis, metres; 0 = nothing.
    pub depth: Image<f32>,
    /// Unit normal in world axes facing the eye; zero = nothing.
    pub normal: Image<[f32; 3]>,
    /// D: matte radiance.
    pub diffuse: LinearImage,
    /// S: mirrored radiance, F included; black where nothing is glossy.
    pub specular: LinearImage,
    /// V: whether the exactly mirrored ray meets nothing.
    pub visible: Image<bool>,
    /// FBI: matte radiance of what the mirrored ray meets; black where it meets nothing.
    pub first_bounce: LinearImage,
    /// The direction of the mirrored ray; zero where nothing is glossy.
    pub mirrored: Image<[f32; 3]>,
}

impl Film {
    /// The direction past everything that the pixel position `at` of frame `index` mirrors on a glossy target.
    pub fn mirrored_to_the_sky(&self, index: u32, at: DVec2) -> Option<Vec3> {
        let ray = self.ray_through(&self.color_pose(self.seconds(index)), at.to_array());
        let point = self.world.closest(&ray)?;
        if !self.world.objects[usize::from(point.object)].is_target {
            return None;
        }
        let transport = self.transport(ray.origin);
        let mirror = transport.mirror_ray(&point, -ray.direction)?;
        (!self.world.scene().is_blocked(&mirror)).then_some(mirror.direction)
    }

    /// The truth of frame `index` at the pixel centres of the colour camera, at the middle of the exposure. Mirrored
    /// light is the mean of `paths` paths; without any it stays black.
    pub fn truth(&self, index: u32, paths: u32) -> FrameTruth {
        let (width, height) = (
            self.color.intrinsics.width(),
            self.color.intrinsics.height(),
        );
        let pose = self.color_pose(self.seconds(index));
        let rows: Vec<Vec<PixelTruth>> = (0..height)
            .into_par_iter()
            .map(|y| {
                let mut transport = self.transport(pose.translation().as_vec3());
                (0..width)
                    .map(|x| self.pixel_truth(&mut transport, &pose, index, [x, y], paths))
                    .collect()
            })
            .collect();
        let pixels: Vec<PixelTruth> = rows.concat();
        FrameTruth::from_pixels(width, height, &pixels)
    }

    fn pixel_truth(
        &self,
        transport: &mut Transport<'_>,
        pose: &Pose,
        index: u32,
        pixel: [u32; 2],
        paths: u32,
    ) -> PixelTruth {
        let ray = self.ray_through(pose, pixel.map(f64::from));
        let Some(point) = self.world.closest(&ray) else {
            return PixelTruth::default();
        };
        let along = pose.inverse().transform_point(point.position.as_dvec3());
        let mut truth = PixelTruth {
            object: point.object as u8 + 1,
            depth: along.z as f32,
            normal: point.normal.to_array(),
            diffuse: transport.matte(&point),
            ..PixelTruth::default()
        };
        let Some((number, _, normal)) = transport.gloss(&point) else {
            return truth;
        };
        truth.normal = normal.to_array();
        truth.material = number + 1;
        truth.mask = self.world.objects[usize::from(point.object)].is_target;
        if let Some(mirror) = transport.mirror_ray(&point, -ray.direction) {
            truth.mirrored = mirror.direction.to_array();
            match self.world.closest(&mirror) {
                Some(met) => truth.first_bounce = transport.matte(&met),
                None => truth.visible = true,
            }
        }
        for path in 0..paths {
            // Beyond the paths of the frame itself.
            let mut random = self.path_random(index, pixel, (1 << 20) + path);
            let value = transport.leaving(&point, -ray.direction, &mut random);
            for (sum, (value, matte)) in truth
                .specular
                .iter_mut()
                .zip(value.iter().zip(truth.diffuse))
            {
                *sum += (value - matte) / paths as f32;
            }
        }
        truth
    }
}

/// One pixel of [`FrameTruth`].
#[derive(Clone, Copy, Debug, Default)]
struct PixelTruth {
    object: u8,
    material: u8,
    mask: bool,
    depth: f32,
    normal: [f32; 3],
    diffuse: [f32; 3],
    specular: [f32; 3],
    visible: bool,
    first_bounce: [f32; 3],
    mirrored: [f32; 3],
}

impl FrameTruth {
    fn from_pixels(width: u32, height: u32, pixels: &[PixelTruth]) -> Self {
        fn image<T: Clone>(
            width: u32,
            height: u32,
            pixels: &[PixelTruth],
            of: impl Fn(&PixelTruth) -> T,
        ) -> Image<T> {
            Image::from_vec(width, height, pixels.iter().map(of).collect())
                .expect("one value a pixel")
        }
        Self {
            object: image(width, height, pixels, |p| p.object),
            material: image(width, height, pixels, |p| p.material),
            mask: image(width, height, pixels, |p| p.mask),
            depth: image(width, height, pixels, |p| p.depth),
            normal: image(width, height, pixels, |p| p.normal),
            diffuse: image(width, height, pixels, |p| p.diffuse),
            specular: image(width, height, pixels, |p| p.specular),
            visible: image(width, height, pixels, |p| p.visible),
            first_bounce: image(width, height, pixels, |p| p.first_bounce),
            mirrored: image(width, height, pixels, |p| p.mirrored),
        }
    }
}
