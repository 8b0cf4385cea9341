//! What the training frames say about the surface: colours of vertices, and pixels that reflect.

use std::sync::atomic::{AtomicUsize, Ordering};

use effects::{Counters, Effect, EffectSet};
use geometry::{Intrinsics, Pose};
use glam::Vec3;
use imaging::{Corrector, Radiance, Response, Vignetting, develop};
use rayon::prelude::*;
use raytrace::{Hit, NO_TRIANGLE, VisibilityBuffer, visibility_buffer};
use sequence::{ColorEncoding, Recording};

use super::geometry::{depth_of, depth_tolerance};
use super::poses::{PosedFrame, without_repeats};
pub use super::surface::{Mirrored, MirroredRay, Surface, hit_at};

/// The colour camera of a recording, ready to correct and to encode.
pub struct ColorView {
    /// Intrinsics.
    pub camera: Intrinsics,
    /// Codes to radiance and back.
    pub corrector: Corrector,
    /// Colour camera from depth camera.
    pub color_from_depth: Pose,
}

/// A pixel of the object that reflects.
#[derive(Clone, Copy, Debug)]
pub struct ObjectPixel {
    /// Triangle and barycentric weights of what it sees.
    pub hit: Hit,
    /// Unit mirrored direction, world axes.
    pub reflected: Vec3,
    /// Cosine between normal and outgoing direction.
    pub cosine: f32,
    /// Whether the mirrored ray meets the surface again; never where visibility is not computed.
    pub is_blocked: bool,
    /// Where it does, where first bounces are computed.
    pub first_bounce: Option<Hit>,
    /// Linear radiance.
    pub linear: [f32; 3],
    /// Clipped channels, one bit each.
    pub clipped: u8,
    /// Base weight.
    pub weight: f32,
    /// Segment.
    pub segment: u16,
}

/// The colour of the surface at the vertex nearest to a pixel.
#[derive(Clone, Copy, Debug)]
pub struct VertexSample {
    /// The vertex.
    pub vertex: u32,
    /// Frame of the recording.
    pub frame: u32,
    /// Linear radiance.
    pub linear: [f32; 3],
    /// Whether any channel is clipped.
    pub saturated: bool,
}

/// All that one frame says.
#[derive(Clone, Debug, Default)]
pub struct FrameObservations {
    /// Frame of the recording.
    pub frame: u32,
    /// Pixels that reflect, in scan order.
    pub pixels: Vec<ObjectPixel>,
    /// Second mirrored directions that leave the scene: position among `pixels`, in order. Only where specular first
    /// bounces are computed.
    pub second: Vec<(u32, Vec3)>,
    /// Colours of vertices, in scan order.
    pub samples: Vec<VertexSample>,
    /// What was computed.
    pub counters: Counters,
    /// Pixels of the object that were looked at.
    pub object_count: usize,
    /// Of these, lost to silhouettes, slant or unsure normals.
    pub dropped_count: usize,
}

/// What all frames say.
#[derive(Clone, Debug, Default)]
pub struct Observations {
    /// In the order of the frames, without those whose colour repeats the frame before.
    pub frames: Vec<FrameObservations>,
    /// Frames that were left out for that.
    pub repeated_frame_count: usize,
}

/// Which pixels are used, and what is computed for them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PixelRules {
    /// The effects that are computed.
    pub effects: EffectSet,
    /// Whether anything may be specular: else pixels are not mirrored at all.
    pub is_specular: bool,
    /// Every how many pixels in x and y, with an offset that cycles over frames.
    pub stride: u32,
    /// Smallest cosine between normal and outgoing direction.
    pub least_cosine: f32,
    /// Pixels of silhouette that are left out.
    pub erosion: u32,
    /// Largest standard deviation of a normal, radians.
    pub largest_normal_sigma: f32,
}

impl Default for PixelRules {
    fn default() -> Self {
        Self {
            effects: EffectSet::all(),
            is_specular: true,
            stride: 2,
            least_cosine: 0.2,
            erosion: 2,
            largest_normal_sigma: 8.0_f32.to_radians(),
        }
    }
}

/// Weight of a pixel next to an edge of visibility: the model is least sure there (hard-cases H03).
const VISIBILITY_EDGE_WEIGHT: f32 = 0.25;

impl ColorView {
    /// From the description in a recording.
    pub fn new(recording: &Recording) -> Self {
        Self::with_effects(recording, EffectSet::all())
    }

    /// The same with the camera's response and vignetting corrected only where they are among the effects.
    pub fn with_effects(recording: &Recording, effects: EffectSet) -> Self {
        let description = recording.color_camera();
        let camera = description.intrinsics;
        let response = if effects.contains(Effect::Response) {
            description.response()
        } else {
            Response::identity()
        };
        let vignetting = if effects.contains(Effect::Vignetting) {
            description.vignetting()
        } else {
            Vignetting::none()
        };
        let corrector = Corrector::new(
            &response,
            &vignetting,
            camera.width(),
            camera.height(),
            description.relative_exposure,
        );
        Self {
            camera,
            corrector,
            color_from_depth: recording.color_from_depth(),
        }
    }

    /// The colour camera's pose in the surface's axes, from the pose of the depth camera.
    pub fn surface_from_color(&self, surface: &Surface, world_from_depth: &Pose) -> Pose {
        Pose::from_translation(-surface.origin)
            * *world_from_depth
            * self.color_from_depth.inverse()
    }

    /// Linear radiance of a frame, developed where it is a mosaic or YUV.
    pub fn radiance(&self, recording: &Recording, index: usize) -> anyhow::Result<Radiance> {
        let camera = recording.color_camera();
        Ok(match camera.encoding {
            ColorEncoding::Jpeg | ColorEncoding::Rgb8 => {
                let codes = recording.color(index)?;
                let is_subsampled = recording.color_is_subsampled(index)?;
                self.corrector.correct(&codes, is_subsampled)
            }
            // Of infrared the layout is refused.
            ColorEncoding::BayerGrbg
            | ColorEncoding::Uyvy
            | ColorEncoding::Yuyv
            | ColorEncoding::Infrared10 => {
                let frame = recording.color_raw(index)?;
                develop::radiance(&self.corrector, camera.layout()?, &frame, false)?
            }
        })
    }
}

/// Looks at all frames, in parallel over frames; colour that repeats the frame before is left out.
pub fn observe(
    recording: &Recording,
    view: &ColorView,
    surface: &Surface,
    normal_sigma: &[f32],
    frames: &[PosedFrame],
    rules: &PixelRules,
    progress: &(dyn Fn(usize, usize) + Sync),
) -> anyhow::Result<Observations> {
    let (frames, repeated_frame_count) =
        without_repeats(frames, |index| recording.color_is_repeat(index));
    let done = AtomicUsize::new(0);
    let observed: anyhow::Result<Vec<FrameObservations>> = frames
        .par_iter()
        .enumerate()
        .map(|(position, frame)| {
            let result = observe_frame(
                recording,
                view,
                surface,
                normal_sigma,
                frame,
                position as u32,
                rules,
            );
            progress(done.fetch_add(1, Ordering::Relaxed) + 1, frames.len());
            result
        })
        .collect();
    Ok(Observations {
        frames: observed?,
        repeated_frame_count,
    })
}

fn observe_frame(
    recording: &Recording,
    view: &ColorView,
    surface: &Surface,
    normal_sigma: &[f32],
    frame: &PosedFrame,
    position: u32,
    rules: &PixelRules,
) -> anyhow::Result<FrameObservations> {
    let radiance = view.radiance(recording, frame.index)?;
    let depth = depth_of(recording, frame.index)?;
    let pose = view.surface_from_color(surface, &frame.world_from_camera);
    let buffer = visibility_buffer(
        &surface.scene,
        &surface.positions,
        &surface.triangles,
        &view.camera,
        &pose,
    );
    let (width, height) = (view.camera.width(), view.camera.height());
    let eye = pose.translation().as_vec3();
    let marks_saturation = rules.effects.contains(Effect::Saturation);
    let mut result = FrameObservations {
        frame: frame.index as u32,
        ..FrameObservations::default()
    };
    let offset = (
        position % rules.stride,
        (position / rules.stride) % rules.stride,
    );
    let grid_width = width.div_ceil(rules.stride) as usize;
    let grid_height = height.div_ceil(rules.stride) as usize;
    // Per grid cell: 0 = no reflecting pixel, 1 = free view, 2 = first bounce.
    let mut visibility = vec![0_u8; grid_width * grid_height];
    let mut cells = Vec::new();
    for (row, y) in (offset.1..height)
        .step_by(rules.stride as usize)
        .enumerate()
    {
        for (column, x) in (offset.0..width).step_by(rules.stride as usize).enumerate() {
            let index = (y * width + x) as usize;
            let Some(hit) = hit_at(&buffer, index) else {
                continue;
            };
            if radiance.invalid.at(x, y)
                || !agrees_with_depth(surface, view, recording, &depth, &hit, &pose)
            {
                continue;
            }
            let linear = radiance.linear.at(x, y);
            let saturated = marks_saturation && radiance.saturated.at(x, y);
            let [a, b, c] = surface.triangles[hit.triangle as usize];
            let nearest = if hit.u + hit.v < 0.5 {
                a
            } else if hit.u > hit.v {
                b
            } else {
                c
            };
            let sure = is_interior(&buffer, surface, x, y, rules.erosion);
            if sure {
                result.samples.push(VertexSample {
                    vertex: nearest,
                    frame: result.frame,
                    linear,
                    saturated,
                });
            }
            let segment = surface.segment(hit.triangle);
            if segment == 0 {
                continue;
            }
            result.object_count += 1;
            let normal_is_sure = [a, b, c].iter().all(|&v| {
                normal_sigma
                    .get(v as usize)
                    .is_none_or(|&s| s <= rules.largest_normal_sigma)
            });
            let mirrored = (sure && normal_is_sure && rules.is_specular)
                .then(|| surface.mirror_ray(&hit, eye, rules.least_cosine));
            let Some(mirrored) = mirrored.flatten() else {
                result.dropped_count += 1;
                continue;
            };
            let met = follow(surface, &mirrored, rules.effects, &mut result.counters);
            visibility[row * grid_width + column] = 1 + u8::from(met.is_blocked);
            cells.push((row, column));
            if let Some(direction) = met.second {
                result.second.push((result.pixels.len() as u32, direction));
            }
            result.pixels.push(ObjectPixel {
                hit,
                reflected: mirrored.ray.direction,
                cosine: mirrored.cosine,
                is_blocked: met.is_blocked,
                first_bounce: met.first_bounce,
                linear,
                clipped: if saturated { 0b111 } else { 0 },
                weight: 1.0,
                segment,
            });
        }
    }
    result.counters.add_bytes(
        Effect::FirstBounceSpecular,
        std::mem::size_of_val(result.second.as_slice()),
    );
    for (pixel, &(row, column)) in result.pixels.iter_mut().zip(&cells) {
        let own = visibility[row * grid_width + column];
        let neighbours = [
            (row.wrapping_sub(1), column),
            (row + 1, column),
            (row, column.wrapping_sub(1)),
            (row, column + 1),
        ];
        let at_edge = neighbours.iter().any(|&(r, c)| {
            r < grid_height && c < grid_width && {
                let other = visibility[r * grid_width + c];
                other != 0 && other != own
            }
        });
        if at_edge {
            pixel.weight = VISIBILITY_EDGE_WEIGHT;
        }
    }
    Ok(result)
}

/// What a mirrored ray met, as far as the effects ask.
struct Met {
    is_blocked: bool,
    first_bounce: Option<Hit>,
    second: Option<Vec3>,
}

/// Follows a mirrored ray as far as the effects ask: not at all, to whether anything is there, to what it is, or to
/// where that mirrors it.
fn follow(
    surface: &Surface,
    mirrored: &MirroredRay,
    effects: EffectSet,
    counters: &mut Counters,
) -> Met {
    let mut met = Met {
        is_blocked: false,
        first_bounce: None,
        second: None,
    };
    if !effects.contains(Effect::Visibility) {
        return met;
    }
    if !effects.contains(Effect::FirstBounce) {
        counters.rays_occlusion += 1;
        met.is_blocked = surface.scene.is_blocked(&mirrored.ray);
        return met;
    }
    counters.rays_closest += 1;
    met.first_bounce = surface.scene.closest(&mirrored.ray);
    met.is_blocked = met.first_bounce.is_some();
    counters.first_bounce_pixels += u64::from(met.is_blocked);
    if effects.contains(Effect::FirstBounceSpecular)
        && let Some(bounce) = &met.first_bounce
        && surface.segment(bounce.triangle) != 0
    {
        counters.rays_occlusion += 1;
        met.second = surface.second_mirror(bounce, mirrored.ray.origin);
    }
    met
}

/// Whether the depth image, where it measured, saw the same surface: something in front (a hand) or a
/// misplaced surface is no evidence.
fn agrees_with_depth(
    surface: &Surface,
    view: &ColorView,
    recording: &Recording,
    depth: &imaging::DepthImage,
    hit: &Hit,
    surface_from_color: &Pose,
) -> bool {
    let point = surface.interpolate(&surface.positions, hit).as_dvec3();
    let in_depth = view
        .color_from_depth
        .inverse()
        .transform_point(surface_from_color.inverse().transform_point(point));
    let camera = &recording.depth_camera().intrinsics;
    let Some((x, y)) = camera
        .pixel_from_camera(in_depth)
        .and_then(|pixel| camera.contains(pixel))
    else {
        return true;
    };
    let measured = depth.at(x, y);
    let expected = in_depth.z as f32;
    !imaging::is_measured(measured)
        || (measured - expected).abs() <= 3.0 * depth_tolerance(expected)
}

/// Whether all pixels within `radius` (eight directions, at `radius` and half of it) see the same segment
/// without a jump in depth.
fn is_interior(buffer: &VisibilityBuffer, surface: &Surface, x: u32, y: u32, radius: u32) -> bool {
    let (width, height) = (i64::from(buffer.width), i64::from(buffer.height));
    let index = (y * buffer.width + x) as usize;
    let segment = surface.segment(buffer.triangle[index]);
    let depth = buffer.depth[index];
    let r = i64::from(radius);
    for (dx, dy) in [
        (r, 0),
        (-r, 0),
        (0, r),
        (0, -r),
        (r, r),
        (-r, r),
        (r, -r),
        (-r, -r),
        (1, 0),
        (0, 1),
    ] {
        let (nx, ny) = (i64::from(x) + dx, i64::from(y) + dy);
        if nx < 0 || ny < 0 || nx >= width || ny >= height {
            return false;
        }
        let neighbour = (ny * width + nx) as usize;
        let triangle = buffer.triangle[neighbour];
        // A slope of 80 degrees at VGA moves depth by about 1 % a pixel.
        let jump = (buffer.depth[neighbour] - depth).abs() > 0.012 * depth * radius.max(1) as f32;
        if triangle == NO_TRIANGLE || surface.segment(triangle) != segment || jump {
            return false;
        }
    }
    true
}
