//! What the training frames say about the surface: colours of vertices, and pixels that reflect.

use std::sync::atomic::{AtomicUsize, Ordering};

use geometry::{DVec3, Intrinsics, Pose};
use glam::Vec3;
use imaging::{Corrector, Radiance, develop};
use rayon::prelude::*;
use raytrace::{Hit, MirrorQuery, NO_TRIANGLE, Scene, VisibilityBuffer, visibility_buffer};
use sequence::{ColorEncoding, Recording};

use super::geometry::{depth_of, depth_tolerance};
use super::poses::{PosedFrame, without_repeats};

/// The fused surface with what is needed to shade it. Positions count from `origin`.
pub struct Surface {
    /// Vertex positions, metres.
    pub positions: Vec<Vec3>,
    /// Unit vertex normals.
    pub normals: Vec<Vec3>,
    /// Vertex indices.
    pub triangles: Vec<[u32; 3]>,
    /// Segment of every vertex, 0 = not the object.
    pub vertex_segment: Vec<u16>,
    /// World position of the mesh's zero.
    pub origin: DVec3,
    /// The ray tracer's view of it.
    pub scene: Scene,
    /// Start and least distance of mirrored rays.
    pub mirror: MirrorQuery,
}

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
    /// Where the mirrored ray meets the surface again, if it does.
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
    /// Colours of vertices, in scan order.
    pub samples: Vec<VertexSample>,
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

/// Which pixels are used.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PixelRules {
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
        let description = recording.color_camera();
        let camera = description.intrinsics;
        let corrector = Corrector::new(
            &description.response(),
            &description.vignetting(),
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
            ColorEncoding::BayerGrbg | ColorEncoding::Uyvy | ColorEncoding::Yuyv => {
                let frame = recording.color_raw(index)?;
                develop::radiance(&self.corrector, camera.layout()?, &frame, false)?
            }
        })
    }
}

impl Surface {
    /// The segment of a triangle: that of its vertices where they agree, else 0.
    pub fn segment(&self, triangle: u32) -> u16 {
        let [a, b, c] = self.triangles[triangle as usize].map(|v| self.vertex_segment[v as usize]);
        if a == b && b == c { a } else { 0 }
    }

    /// A per-vertex value at a hit.
    pub fn interpolate(&self, values: &[Vec3], hit: &Hit) -> Vec3 {
        let [a, b, c] = self.triangles[hit.triangle as usize].map(|v| values[v as usize]);
        a * (1.0 - hit.u - hit.v) + b * hit.u + c * hit.v
    }

    /// Unit geometric normal of a triangle, turned to the side of its vertex normals.
    pub fn geometric_normal(&self, triangle: u32) -> Vec3 {
        let [a, b, c] = self.triangles[triangle as usize].map(|v| self.positions[v as usize]);
        (b - a).cross(c - a).normalize_or_zero()
    }

    /// The mirrored direction and first bounce at a hit, seen from `eye` (surface axes); `None` where the
    /// interpolated normal faces away or is too slanted.
    pub fn mirror(&self, hit: &Hit, eye: Vec3, least_cosine: f32) -> Option<Mirrored> {
        let position = self.interpolate(&self.positions, hit);
        let shading_normal = self.interpolate(&self.normals, hit).try_normalize()?;
        let outgoing = (eye - position).try_normalize()?;
        let cosine = shading_normal.dot(outgoing);
        let geometric_normal = self.geometric_normal(hit.triangle);
        if cosine < least_cosine || geometric_normal.dot(outgoing) <= 0.0 {
            return None;
        }
        let reflection = self.mirror.reflect(
            &self.scene,
            position,
            geometric_normal,
            shading_normal,
            outgoing,
        );
        Some(Mirrored {
            cosine,
            direction: reflection.direction,
            first_bounce: reflection.first_bounce,
        })
    }
}

/// A mirrored view ray.
#[derive(Clone, Copy, Debug)]
pub struct Mirrored {
    /// Cosine between normal and outgoing direction.
    pub cosine: f32,
    /// Unit direction, world axes.
    pub direction: Vec3,
    /// What it meets.
    pub first_bounce: Option<Hit>,
}

/// The hit of a pixel of a visibility buffer.
pub fn hit_at(buffer: &VisibilityBuffer, index: usize) -> Option<Hit> {
    let triangle = buffer.triangle[index];
    (triangle != NO_TRIANGLE).then(|| Hit {
        triangle,
        t: buffer.depth[index],
        u: buffer.u[index],
        v: buffer.v[index],
    })
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
            let saturated = radiance.saturated.at(x, y);
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
            let mirrored =
                (sure && normal_is_sure).then(|| surface.mirror(&hit, eye, rules.least_cosine));
            let Some(mirrored) = mirrored.flatten() else {
                result.dropped_count += 1;
                continue;
            };
            visibility[row * grid_width + column] = 1 + u8::from(mirrored.first_bounce.is_some());
            cells.push((row, column));
            result.pixels.push(ObjectPixel {
                hit,
                reflected: mirrored.direction,
                first_bounce: mirrored.first_bounce,
                linear,
                clipped: if saturated { 0b111 } else { 0 },
                weight: 1.0,
                segment,
            });
        }
    }
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
