//! From pixels to the rows of the linear solve: each effect is one factor or term here, or absent.

use effects::{Counters, Effect};
use geometry::PanoramaSize;
use glam::Vec3;
use raytrace::Hit;
use srm::rows::luminance;
use srm::{JointSettings, Row, Rows};

use super::diffuse::VertexColors;
use super::linear::GAIN;
use super::observe::{FrameObservations, ObjectPixel, Surface};
use crate::effects::EffectPlan;

/// The object's vertices numbered from 0 in the order of the mesh.
pub struct CompactVertices {
    /// Number of each vertex of the mesh; `u32::MAX` where it is not the object.
    pub compact: Vec<u32>,
    /// Vertex of the mesh of each number.
    pub full: Vec<u32>,
}

impl CompactVertices {
    /// Numbers the vertices of all segments.
    pub fn new(surface: &Surface) -> Self {
        let mut compact = vec![u32::MAX; surface.positions.len()];
        let mut full = Vec::new();
        for (vertex, &segment) in surface.vertex_segment.iter().enumerate() {
            if segment != 0 {
                compact[vertex] = full.len() as u32;
                full.push(vertex as u32);
            }
        }
        Self { compact, full }
    }
}

/// What rows are made from.
#[derive(Clone, Copy)]
pub struct RowMaker<'a> {
    /// The surface.
    pub surface: &'a Surface,
    /// Its colours, of which first bounces take theirs.
    pub colors: &'a VertexColors,
    /// Numbers of the object's vertices.
    pub vertices: &'a CompactVertices,
    /// The panorama of S.
    pub panorama: PanoramaSize,
    /// The effects.
    pub plan: &'a EffectPlan,
}

impl RowMaker<'_> {
    /// The rows of one pixel in `step` of all frames, the last of each, in order. `mirrors`: segments whose first
    /// bounces mirror, all where not yet known.
    pub fn rows(
        &self,
        observations: &[FrameObservations],
        mirrors: Option<&[u16]>,
        step: usize,
        counters: &mut Counters,
    ) -> Rows {
        let mut rows = Rows::default();
        let mut count = 0_usize;
        for frame in observations {
            let mut second = frame.second.iter().peekable();
            for (position, pixel) in frame.pixels.iter().enumerate() {
                let direction = second
                    .next_if(|(of, _)| *of as usize == position)
                    .map(|(_, direction)| *direction)
                    .filter(|_| self.mirrors(pixel, mirrors));
                count += 1;
                if count.is_multiple_of(step) {
                    rows.push(self.row(pixel, direction, frame.frame, counters));
                }
            }
        }
        rows
    }

    fn mirrors(&self, pixel: &ObjectPixel, mirrors: Option<&[u16]>) -> bool {
        let Some(mirrors) = mirrors else { return true };
        let bounce = pixel.first_bounce.as_ref();
        bounce.is_some_and(|hit| mirrors.contains(&self.surface.segment(hit.triangle)))
    }

    fn row(
        &self,
        pixel: &ObjectPixel,
        second: Option<Vec3>,
        frame: u32,
        counters: &mut Counters,
    ) -> Row {
        let hit = &pixel.hit;
        let gain = match self.plan.fresnel_of(pixel.segment) {
            None => GAIN,
            Some(fresnel) => {
                counters.fresnel_evals += 1;
                GAIN * fresnel.factor(pixel.cosine)
            }
        };
        let (taps, tap_gain) = match (pixel.is_blocked, second) {
            (false, _) => (self.panorama.taps(pixel.reflected.as_dvec3()), gain),
            // Blocked rows leave their taps free: what the first bounce mirrors stands there.
            (true, Some(direction)) => (self.panorama.taps(direction.as_dvec3()), gain * GAIN),
            (true, None) => (self.panorama.taps(pixel.reflected.as_dvec3()), 0.0),
        };
        if tap_gain > 0.0 {
            counters.add_taps(0, 4);
        }
        let known = match &pixel.first_bounce {
            None => [0.0; 3],
            Some(bounce) => {
                counters.taps_texture += 1;
                let gain = gain * self.plan.bounce_gain(pixel.segment);
                self.bounce_color(bounce, second.is_some())
                    .map(|value| value * gain)
            }
        };
        Row {
            vertices: self.surface.triangles[hit.triangle as usize]
                .map(|v| self.vertices.compact[v as usize]),
            barycentric: [1.0 - hit.u - hit.v, hit.u, hit.v],
            texels: taps.texels,
            taps: if tap_gain > 0.0 {
                taps.weights.map(|w| w * tap_gain)
            } else {
                [0.0; 4]
            },
            observed: pixel.linear,
            known,
            weight: self.weight(pixel, counters),
            clipped: pixel.clipped,
            frame,
            segment: pixel.segment,
        }
    }

    /// The colour of a first bounce: what it shows on average, or, where its mirror image is a term of its own, what
    /// it shows at least.
    fn bounce_color(&self, bounce: &Hit, mirrors: bool) -> [f32; 3] {
        let colors = if mirrors {
            &self.colors.robust_minimum
        } else {
            &self.colors.median
        };
        let [a, b, c] =
            self.surface.triangles[bounce.triangle as usize].map(|v| colors[v as usize]);
        [0, 1, 2].map(|i| a[i] * (1.0 - bounce.u - bounce.v) + b[i] * bounce.u + c[i] * bounce.v)
    }

    fn weight(&self, pixel: &ObjectPixel, counters: &mut Counters) -> f32 {
        if !self.plan.computed.contains(Effect::Noise) {
            return pixel.weight;
        }
        counters.noise_weights += 1;
        let level = luminance(pixel.linear.map(f64::from));
        let scale = JointSettings::default().residual_scale;
        pixel.weight * self.plan.noise.weight(level, scale) as f32
    }
}
