//! A trained run in memory, and views drawn from it.

use std::collections::BTreeMap;

use anyhow::Context as _;
use geometry::{Intrinsics, PanoramaSize, Pose};
use glam::Vec3;
use imaging::{Image, LinearImage, read_rgb_exr};
use rayon::prelude::*;
use raytrace::{Hit, MirrorQuery, Scene, visibility_buffer};

use crate::effects::FresnelFit;
use crate::ply::{self, PlyMesh};
use crate::run_folder::RunFolder;
use crate::stages::geometry::GeometrySummary;
use crate::stages::linear::{GAIN, LinearSummary};
use crate::stages::observe::{Surface, hit_at};
use crate::train::{LINEAR_DIFFUSE_FILE, MEDIAN_FILE, SRM_FILE};

/// D, S and the surface of a run.
pub struct Model {
    /// The surface.
    pub surface: Surface,
    /// D of the linear stage, a vertex.
    pub diffuse: Vec<[f32; 3]>,
    /// Median colour over views, a vertex: the radiance of a first bounce, and diffuse on its own.
    pub median: Vec<[f32; 3]>,
    /// The specular map.
    pub specular_map: LinearImage,
    /// Its size.
    pub panorama: PanoramaSize,
    /// Segments that reflect.
    pub specular_segments: Vec<u16>,
    /// Reflectance of every segment, by its number; 0 where it does not reflect.
    reflectance: Vec<f32>,
    /// Rise of the reflectance of the segments that have one.
    fresnel: BTreeMap<u16, FresnelFit>,
}

/// One drawn view, linear radiance a pixel.
pub struct DrawnView {
    /// D + gain · (V · SRM + (1 − V) · first bounce); black where there is no surface.
    pub composition: LinearImage,
    /// The median texture alone.
    pub diffuse_only: LinearImage,
    /// What each pixel sees.
    pub hits: Vec<Option<Hit>>,
    /// Whether each pixel sees a segment that reflects.
    pub is_specular: Vec<bool>,
}

/// Pixels of a drawn view that one task handles.
const ROWS_A_TASK: usize = 16;

impl Model {
    /// Reads the newest stage of a run.
    pub fn load(folder: &RunFolder) -> anyhow::Result<Self> {
        let solved = ply::from_file(&folder.path(LINEAR_DIFFUSE_FILE))?;
        let median = ply::from_file(&folder.path(MEDIAN_FILE))?;
        anyhow::ensure!(
            median.linear.len() == solved.linear.len(),
            "{LINEAR_DIFFUSE_FILE} and {MEDIAN_FILE} are not of one mesh"
        );
        let summary: LinearSummary = folder.read_json("linear/summary.json")?;
        let geometry: GeometrySummary = folder.read_json("geometry/summary.json")?;
        let (specular_map, _) = read_rgb_exr(&folder.path(SRM_FILE))?;
        let panorama = PanoramaSize::from_height(specular_map.height())
            .filter(|size| size.width() == specular_map.width())
            .context("the specular map is not twice as wide as high")?;
        let mut reflectance = vec![0.0; usize::from(u16::MAX) + 1];
        for segment in summary.segments.iter().filter(|s| s.is_specular) {
            reflectance[usize::from(segment.id)] = GAIN * segment.relative_gain;
        }
        let fresnel = summary
            .segments
            .iter()
            .filter_map(|s| Some((s.id, s.fresnel?)))
            .collect();
        let specular_segments = summary
            .segments
            .iter()
            .filter(|s| s.is_specular)
            .map(|s| s.id)
            .collect();
        let PlyMesh {
            positions,
            normals,
            linear,
            segments,
            triangles,
            origin,
        } = solved;
        let surface = Surface {
            scene: Scene::new(&positions, &triangles)?,
            mirror: MirrorQuery::for_fused((geometry.voxel_mm * 1e-3) as f32),
            positions,
            normals,
            triangles,
            vertex_segment: segments,
            origin,
        };
        Ok(Self {
            surface,
            diffuse: linear,
            median: median.linear,
            specular_map,
            panorama,
            specular_segments,
            reflectance,
            fresnel,
        })
    }

    /// A per-vertex colour at a hit.
    pub fn color_at(&self, colors: &[[f32; 3]], hit: &Hit) -> [f32; 3] {
        let [a, b, c] = self.surface.triangles[hit.triangle as usize].map(|v| colors[v as usize]);
        [0, 1, 2].map(|i| a[i] * (1.0 - hit.u - hit.v) + b[i] * hit.u + c[i] * hit.v)
    }

    /// The map along a direction.
    pub fn reflected_radiance(&self, direction: Vec3) -> [f32; 3] {
        let taps = self.panorama.taps(direction.as_dvec3());
        let mut value = [0.0; 3];
        for (&texel, weight) in taps.texels.iter().zip(taps.weights) {
            let color = self.specular_map.pixels()[texel as usize];
            for c in 0..3 {
                value[c] += weight * color[c];
            }
        }
        value
    }

    /// Radiance of the composition at a hit seen from `eye` (surface axes).
    pub fn shade(&self, hit: &Hit, eye: Vec3) -> [f32; 3] {
        let segment = self.surface.segment(hit.triangle);
        let gain = self.reflectance[usize::from(segment)];
        if gain <= 0.0 {
            return self.color_at(&self.median, hit);
        }
        let diffuse = self.color_at(&self.diffuse, hit);
        let Some(mirrored) = self.surface.mirror(hit, eye, 0.0) else {
            return self.color_at(&self.median, hit);
        };
        let reflected = match &mirrored.first_bounce {
            Some(bounce) => self.color_at(&self.median, bounce),
            None => self.reflected_radiance(mirrored.direction),
        };
        let rise = self.fresnel.get(&segment);
        let gain = gain * rise.map_or(1.0, |rise| rise.factor(mirrored.cosine));
        [0, 1, 2].map(|c| diffuse[c] + gain * reflected[c])
    }

    /// Draws what `camera` sees at `surface_from_color`.
    pub fn draw(&self, camera: &Intrinsics, surface_from_color: &Pose) -> DrawnView {
        let surface = &self.surface;
        let buffer = visibility_buffer(
            &surface.scene,
            &surface.positions,
            &surface.triangles,
            camera,
            surface_from_color,
        );
        let (width, height) = (camera.width(), camera.height());
        let eye = surface_from_color.translation().as_vec3();
        let mut composition = Image::new(width, height, [0.0_f32; 3]);
        let mut diffuse_only = Image::new(width, height, [0.0_f32; 3]);
        let hits: Vec<Option<Hit>> = (0..width as usize * height as usize)
            .map(|index| hit_at(&buffer, index))
            .collect();
        let chunk = ROWS_A_TASK * width as usize;
        composition
            .pixels_mut()
            .par_chunks_mut(chunk)
            .zip(diffuse_only.pixels_mut().par_chunks_mut(chunk))
            .zip(hits.par_chunks(chunk))
            .for_each(|((composition, diffuse), hits)| {
                for ((composition, diffuse), hit) in composition.iter_mut().zip(diffuse).zip(hits) {
                    if let Some(hit) = hit {
                        *composition = self.shade(hit, eye);
                        *diffuse = self.color_at(&self.median, hit);
                    }
                }
            });
        let is_specular = hits
            .iter()
            .map(|hit| {
                hit.as_ref().is_some_and(|hit| {
                    self.specular_segments
                        .contains(&surface.segment(hit.triangle))
                })
            })
            .collect();
        DrawnView {
            composition,
            diffuse_only,
            hits,
            is_specular,
        }
    }
}
