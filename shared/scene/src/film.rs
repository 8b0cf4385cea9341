//! Frames of a scene: what two cameras send. `truth` is what they cannot.

mod truth;

use effects::{Effect, EffectSet};
use geometry::{DVec2, DVec3, Intrinsics, Pose, rotation};
use glam::Vec3;
use imaging::{Image, LinearImage, Response};
use rayon::prelude::*;
use raytrace::{Hit, Ray, Scene};

use crate::catalogue;
use crate::design::Design;
use crate::environment::{Bars, Environment};
use crate::error::SceneError;
use crate::random::{Purpose, Stream};
use crate::sensor::{ColorSensor, DepthSensor, ShiftModel};
use crate::transport::{Operator, PathRandom, Transport, TransportCounts};
use crate::world::{LightQuality, SurfacePoint, World};

pub use truth::FrameTruth;

/// What a simulation is asked for.
#[derive(Clone, Debug)]
pub struct FilmOptions {
    /// Width of both images, pixels; the height is three quarters of it.
    pub width: u32,
    /// Frames in place of the scene's own number, over the same path.
    pub frame_count: Option<u32>,
    /// Seed of all noise.
    pub seed: u64,
    /// Effects in place of the scene's own.
    pub effects: Option<EffectSet>,
    /// A panorama in place of the room.
    pub environment: Option<LinearImage>,
    /// How carefully light is gathered.
    pub quality: LightQuality,
    /// Samples of a pixel, a square number.
    pub samples: u32,
    /// Paths of mirrored light a sample.
    pub paths: u32,
}

impl Default for FilmOptions {
    fn default() -> Self {
        Self {
            width: 640,
            frame_count: None,
            seed: 1,
            effects: None,
            environment: None,
            quality: LightQuality::default(),
            samples: 4,
            paths: 3,
        }
    }
}

/// Gamma of the simulated camera's response.
pub const GAMMA: f64 = 2.2;
/// Where the colour camera sits: 25 mm to the right of the depth camera.
const COLOR_FROM_DEPTH: DVec3 = DVec3::new(-0.025, 0.0, 0.0);
/// Focal length over width: 525 pixels at VGA.
const FOCAL_OVER_WIDTH: f64 = 525.0 / 640.0;
/// Up to this reflectance one path a sample is enough: a faint reflection has faint noise.
const FAINT_R0: f32 = 0.15;
/// From this width on a lobe sees several lamps at once, and three times the paths are taken.
const WIDE_ALPHA: f32 = 0.1;
/// What stands for the white level where nothing may clip.
const UNSATURATED: f32 = 0.9;

/// A scene ready to be filmed.
#[derive(Debug)]
pub struct Film {
    design: Design,
    world: World,
    /// What the depth sensor meets, where it is not the world's own mesh.
    displaced: Option<Scene>,
    color: ColorSensor,
    depth: DepthSensor,
    effects: EffectSet,
    options: FilmOptions,
    frame_count: u32,
}

/// What the two cameras send.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// Codes of a mosaic GRBG.
    pub mosaic: Image<u8>,
    /// Shifts of the depth sensor, 0 = no measurement.
    pub shifts: Image<u16>,
    /// What was computed for it.
    pub counts: TransportCounts,
}

impl Film {
    /// The scene `name`.
    ///
    /// # Errors
    /// An unknown name, an environment that is none, numbers out of range.
    pub fn new(name: &str, options: FilmOptions) -> Result<Self, SceneError> {
        Self::of(catalogue::design(name)?, options)
    }

    /// A scene of one's own.
    ///
    /// # Errors
    /// As [`Film::new`].
    pub fn of(design: Design, options: FilmOptions) -> Result<Self, SceneError> {
        let (width, height) = (options.width, options.width / 4 * 3);
        for (name, value, range, expected) in [
            (
                "the width",
                width,
                32..=1920,
                "a multiple of 4 from 32 to 1920",
            ),
            (
                "the number of samples",
                options.samples,
                1..=1024,
                "a square number from 1 to 1024",
            ),
            (
                "the number of paths",
                options.paths,
                1..=1024,
                "from 1 to 1024",
            ),
            (
                "the number of frames",
                options.frame_count.unwrap_or(100),
                4..=100_000,
                "from 4 to 100000",
            ),
        ] {
            let is_shaped = match name {
                "the width" => value % 4 == 0,
                "the number of samples" => value.isqrt() * value.isqrt() == value,
                _ => true,
            };
            if !range.contains(&value) || !is_shaped {
                return Err(SceneError::Value {
                    name,
                    value: f64::from(value),
                    expected,
                });
            }
        }
        let effects = options.effects.unwrap_or(design.effects);
        let environment = environment(&design, &options, effects)?;
        let world = World::new(
            design.things.clone(),
            environment,
            options.quality,
            design.path.seed,
        )?;
        let focal = FOCAL_OVER_WIDTH * f64::from(width);
        let center = DVec2::new(f64::from(width - 1), f64::from(height - 1)) * 0.5;
        let intrinsics = Intrinsics::pinhole(width, height, focal, focal, center.x, center.y)
            .map_err(|_| SceneError::Value {
                name: "the width",
                value: f64::from(width),
                expected: "that of a camera",
            })?;
        let displaced = displaced(&design, &world, options.seed)?;
        Ok(Self {
            color: ColorSensor {
                intrinsics,
                vignetting: design.vignetting(width, height),
                response: Response::gamma(GAMMA)?,
                noise: design.noise,
            },
            depth: DepthSensor {
                intrinsics,
                shift: ShiftModel::default(),
                noise_shifts: 0.96,
                nearest: 0.4,
                farthest: 3.5,
            },
            frame_count: options.frame_count.unwrap_or(design.split.count()),
            design,
            world,
            displaced,
            effects,
            options,
        })
    }

    /// The scene's description.
    pub fn design(&self) -> &Design {
        &self.design
    }

    /// Objects and light.
    pub fn world(&self) -> &World {
        &self.world
    }

    /// The colour camera.
    pub fn color(&self) -> &ColorSensor {
        &self.color
    }

    /// The depth camera.
    pub fn depth(&self) -> &DepthSensor {
        &self.depth
    }

    /// The colour camera seen from the depth camera.
    pub fn color_from_depth(&self) -> Pose {
        Pose::from_translation(COLOR_FROM_DEPTH)
    }

    /// What is simulated.
    pub fn effects(&self) -> EffectSet {
        self.effects
    }

    /// Number of frames.
    pub fn frame_count(&self) -> u32 {
        self.frame_count
    }

    /// Seconds on the path at which frame `index` is in the middle of its exposure.
    fn seconds(&self, index: u32) -> f64 {
        self.design.duration * f64::from(index) / f64::from(self.frame_count)
    }

    /// World from depth camera, exact.
    pub fn pose(&self, index: u32) -> Pose {
        self.design.path.pose(self.seconds(index))
    }

    /// World from depth camera as it is recorded: exact, or with the design's errors.
    pub fn recorded_pose(&self, index: u32) -> Pose {
        let exact = self.pose(index);
        if !self.effects.contains(Effect::PoseRefinement) {
            return exact;
        }
        let mut random = Stream::new(self.options.seed, Purpose::PoseNoise, u64::from(index), 0);
        let mut vector = |sigma: f64| {
            DVec3::new(
                f64::from(random.normal()),
                f64::from(random.normal()),
                f64::from(random.normal()),
            ) * sigma
        };
        let errors = &self.design.errors;
        let translation = exact.translation() + vector(errors.pose_translation);
        let rotation = exact.rotation() * rotation::exp(vector(errors.pose_rotation));
        Pose::new(rotation.normalize(), translation).unwrap_or(exact)
    }

    /// World from colour camera at a time on the path.
    fn color_pose(&self, seconds: f64) -> Pose {
        self.design.path.pose(seconds) * self.color_from_depth().inverse()
    }

    fn operator(&self, eye: Vec3) -> Option<Operator> {
        let center = self.design.path.center.as_vec3();
        let away = Vec3::new(eye.x - center.x, 0.0, eye.z - center.z).normalize_or(Vec3::Z);
        self.design.has_operator.then(|| Operator {
            head: eye + away * 0.35 - Vec3::Y * 0.05,
            radius: 0.2,
            radiance: [0.05, 0.045, 0.05],
        })
    }

    fn transport(&self, eye: Vec3) -> Transport<'_> {
        Transport {
            world: &self.world,
            effects: self.effects,
            operator: self.operator(eye),
            counts: TransportCounts::default(),
        }
    }

    /// Films frame `index`. The same bits for any number of threads.
    pub fn frame(&self, index: u32) -> Frame {
        let (light, counts) = self.light(index);
        let scene = self.displaced.as_ref().unwrap_or(self.world.scene());
        Frame {
            mosaic: self
                .color
                .expose(&light, self.effects, self.options.seed, u64::from(index)),
            shifts: self.depth.measure(
                &self.world,
                scene,
                &self.pose(index),
                self.effects,
                self.options.seed,
                u64::from(index),
            ),
            counts,
        }
    }

    /// Linear radiance of frame `index`, before the sensor.
    pub fn light(&self, index: u32) -> (LinearImage, TransportCounts) {
        let (width, height) = (
            self.color.intrinsics.width(),
            self.color.intrinsics.height(),
        );
        let rows: Vec<(Vec<[f32; 3]>, TransportCounts)> = (0..height)
            .into_par_iter()
            .map(|y| self.row(index, y))
            .collect();
        let mut counts = TransportCounts::default();
        let mut pixels = Vec::with_capacity((width * height) as usize);
        for (row, count) in rows {
            pixels.extend(row);
            counts += count;
        }
        let image = Image::from_vec(width, height, pixels).expect("one value a pixel");
        (image, counts)
    }

    fn row(&self, index: u32, y: u32) -> (Vec<[f32; 3]>, TransportCounts) {
        let width = self.color.intrinsics.width();
        let middle = self.seconds(index);
        let still = self.color_pose(middle);
        let mut transport = self.transport(still.translation().as_vec3());
        let mut rays = vec![Ray::new(Vec3::ZERO, Vec3::Z); width as usize];
        let mut hits = vec![Hit::MISS; width as usize];
        let mut sums = vec![[0.0_f64; 3]; width as usize];
        for sample in 0..self.options.samples {
            for (x, ray) in (0..width).zip(&mut rays) {
                *ray = self.view_ray(index, [x, y], sample, middle, &still);
            }
            self.world.scene().closest_batch(&rays, &mut hits);
            for (x, ((ray, hit), sum)) in (0..width).zip(rays.iter().zip(&hits).zip(&mut sums)) {
                let value = if hit.is_hit() {
                    let point = self.world.point_at(ray, hit);
                    self.surface(&mut transport, &point, ray, index, [x, y], sample)
                } else {
                    transport.background(ray.origin, ray.direction)
                };
                for (sum, value) in sum.iter_mut().zip(value) {
                    *sum += f64::from(value);
                }
            }
        }
        let count = f64::from(self.options.samples);
        let row = sums
            .into_iter()
            .map(|sum| sum.map(|value| (value / count) as f32))
            .collect();
        (row, transport.counts)
    }

    /// Mean over the paths of one sample.
    fn surface(
        &self,
        transport: &mut Transport<'_>,
        point: &SurfacePoint,
        ray: &Ray,
        index: u32,
        pixel: [u32; 2],
        sample: u32,
    ) -> [f32; 3] {
        let Some((_, gloss, _)) = transport.gloss(point) else {
            return transport.matte(point);
        };
        let is_faint = gloss.r0.iter().all(|&r0| r0 <= FAINT_R0);
        let paths = match (is_faint, gloss.alpha >= WIDE_ALPHA) {
            (true, _) => 1,
            (false, false) => self.options.paths,
            (false, true) => 3 * self.options.paths,
        };
        let mut sum = [0.0; 3];
        for path in 0..paths {
            let mut random = self.path_random(index, pixel, sample * paths + path);
            let value = transport.leaving(point, -ray.direction, &mut random);
            for (sum, value) in sum.iter_mut().zip(value) {
                *sum += value;
            }
        }
        sum.map(|value| value / paths as f32)
    }

    fn path_random(&self, index: u32, pixel: [u32; 2], path: u32) -> PathRandom {
        let item = self.item(pixel, 0);
        let stream = |purpose| Stream::new(self.options.seed, purpose, u64::from(index), item);
        PathRandom::new(path, stream(Purpose::Lobe), stream(Purpose::Environment))
    }

    /// Number of a sample of a pixel, unique in its frame.
    fn item(&self, [x, y]: [u32; 2], sample: u32) -> u64 {
        (u64::from(y) * u64::from(self.color.intrinsics.width()) + u64::from(x)) << 24
            | u64::from(sample)
    }

    /// The ray of a sample: within its part of the pixel, at its moment of the exposure.
    fn view_ray(&self, index: u32, pixel: [u32; 2], sample: u32, middle: f64, still: &Pose) -> Ray {
        let mut random = Stream::new(
            self.options.seed,
            Purpose::Lens,
            u64::from(index),
            self.item(pixel, sample),
        );
        let side = self.options.samples.isqrt().max(1);
        let cell = [sample % side, sample / side];
        let at: [f64; 2] = std::array::from_fn(|axis| {
            let inside = (f64::from(cell[axis]) + f64::from(random.unit())) / f64::from(side);
            f64::from(pixel[axis]) + inside - 0.5
        });
        let shutter = &self.design.shutter;
        let height = f64::from(self.color.intrinsics.height());
        let offset = shutter.readout * ((f64::from(pixel[1]) + 0.5) / height - 0.5)
            + shutter.exposure * (f64::from(random.unit()) - 0.5);
        if offset == 0.0 {
            self.ray_through(still, at)
        } else {
            self.ray_through(&self.color_pose(middle + offset), at)
        }
    }

    /// The unit ray through a pixel position of the colour camera.
    fn ray_through(&self, pose: &Pose, at: [f64; 2]) -> Ray {
        let ahead = self
            .color
            .intrinsics
            .camera_from_pixel(DVec2::from_array(at))
            .unwrap_or(DVec3::Z);
        Ray::new(
            pose.translation().as_vec3(),
            pose.transform_vector(ahead.normalize()).as_vec3(),
        )
    }

    /// Bar targets of the room, where the room is the light and has some.
    pub fn bars(&self) -> Option<&Bars> {
        let is_room = self.options.environment.is_none();
        self.design.room.bars.as_ref().filter(|_| is_room)
    }
}

/// The light of a design, or the one that was given.
fn environment(
    design: &Design,
    options: &FilmOptions,
    effects: EffectSet,
) -> Result<Environment, SceneError> {
    let limit = if effects.contains(Effect::Saturation) {
        f32::MAX
    } else {
        UNSATURATED
    };
    let environment = match &options.environment {
        Some(map) => Environment::from_panorama(&map.map(|value| value.map(|v| v.min(limit))))?,
        None => {
            // A texel is a quarter of the width of the finest bar; small pictures see no bar.
            let height = match options.width {
                320.. => 1024,
                160.. => 512,
                _ => 128,
            };
            let size = geometry::PanoramaSize::from_height(height).expect("rows of a panorama");
            // Bars are known to a sixteenth of a texel, furniture needs less.
            let fineness = if design.room.bars.is_some() { 4 } else { 2 };
            Environment::from_function(size, fineness, |direction| {
                design.room.radiance(direction).map(|v| v.min(limit))
            })
        }
    };
    Ok(match design.enclosure {
        Some(enclosure) => environment.enclosed(enclosure),
        None => environment,
    })
}

/// The mesh that the depth sensor meets, where the design displaces it.
fn displaced(design: &Design, world: &World, seed: u64) -> Result<Option<Scene>, SceneError> {
    let errors = &design.errors;
    if errors.mesh_noise == 0.0 && errors.mesh_scale.is_none() {
        return Ok(None);
    }
    let mesh = world.mesh();
    let center = design.path.center.as_vec3();
    let scale = errors.mesh_scale.unwrap_or(1.0);
    let positions: Vec<Vec3> = mesh
        .positions
        .iter()
        .zip(&mesh.normals)
        .enumerate()
        .map(|(vertex, (position, normal))| {
            let mut random = Stream::new(seed, Purpose::MeshNoise, 0, vertex as u64);
            center + scale * (*position - center) + *normal * errors.mesh_noise * random.normal()
        })
        .collect();
    Ok(Some(Scene::new(&positions, &mesh.triangles)?))
}
