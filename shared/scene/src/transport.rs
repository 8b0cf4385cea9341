//! Radiance along a ray: matte and mirrored light, with as many bounces as the effects ask for.

use effects::{Effect, EffectSet};
use glam::Vec3;
use raytrace::Ray;

use crate::lobe;
use crate::material::Gloss;
use crate::random::Stream;
use crate::world::{SurfacePoint, World};

/// Bounces after the first that are followed.
const MOST_BOUNCES: u32 = 4;
/// From this width on the environment's light is looked for as well as the lobe's directions.
const SHARED_ALPHA: f32 = 0.02;

/// The person who films: a dark capsule behind the camera that walks along with it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Operator {
    /// Head, metres.
    pub head: Vec3,
    /// Radius of the capsule that reaches from the head to the floor, metres.
    pub radius: f32,
    /// What it sends out.
    pub radiance: [f32; 3],
}

impl Operator {
    /// Whether a ray meets the capsule: distance between the ray and the vertical line below the head.
    fn blocks(&self, origin: Vec3, direction: Vec3) -> bool {
        let to_head = self.head - origin;
        let flat = direction.x * direction.x + direction.z * direction.z;
        // Nearest to the vertical line in the plan …
        let t = if flat > 1e-9 {
            ((to_head.x * direction.x + to_head.z * direction.z) / flat).max(0.0)
        } else {
            0.0
        };
        let at = direction * t;
        // … and clamped to what lies below the head.
        let below = (at.y - to_head.y).max(0.0);
        let nearest = to_head + Vec3::Y * below;
        let along = nearest.dot(direction);
        along > 0.0 && (nearest - direction * along).length_squared() < self.radius * self.radius
    }
}

/// Numbers of rays and terms that were computed: an effect that is off leaves its own at 0.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TransportCounts {
    /// Rays that ask whether anything is in the way.
    pub rays_occlusion: u64,
    /// Mirrored rays that ask what they meet.
    pub rays_closest: u64,
    /// Fresnel factors.
    pub fresnel_evals: u64,
    /// Mirrored rays that met a surface which was then looked at.
    pub first_bounce_pixels: u64,
    /// Surfaces met whose own mirrored light was followed.
    pub second_bounce_pixels: u64,
}

impl std::ops::AddAssign for TransportCounts {
    fn add_assign(&mut self, other: Self) {
        self.rays_occlusion += other.rays_occlusion;
        self.rays_closest += other.rays_closest;
        self.fresnel_evals += other.fresnel_evals;
        self.first_bounce_pixels += other.first_bounce_pixels;
        self.second_bounce_pixels += other.second_bounce_pixels;
    }
}

/// The light of a world at one moment.
#[derive(Debug)]
pub struct Transport<'a> {
    /// Objects and environment.
    pub world: &'a World,
    /// What is computed.
    pub effects: EffectSet,
    /// The person who films.
    pub operator: Option<Operator>,
    /// What was computed.
    pub counts: TransportCounts,
}

/// Numbers for one path of several through the same pixel.
///
/// The first bounce of path k takes the k-th point of a sequence that fills the square evenly (Roberts' R sequences),
/// moved by numbers of the pixel: the mean over paths converges faster, and each path is still uniform. Later bounces
/// draw by themselves.
pub struct PathRandom {
    /// Number of the path.
    path: u32,
    /// Shifts of the pixel, then directions of later bounces.
    lobe: Stream,
    /// As `lobe`, of the environment.
    environment: Stream,
    /// The pixel's shifts: lobe, environment.
    shifts: [f32; 5],
}

/// Steps of the sequences: powers of the plastic number's inverse in two, and of its like in three dimensions.
const STEPS: [f64; 5] = [
    0.754_877_666_246_692_8,
    0.569_840_290_998_053_3,
    0.819_172_513_396_164_4,
    0.671_043_606_703_789_2,
    0.549_700_477_901_970_3,
];

impl PathRandom {
    /// Path number `path` of a pixel whose shifts `lobe` and `environment` begin with.
    pub fn new(path: u32, mut lobe: Stream, mut environment: Stream) -> Self {
        let [a, b] = lobe.pair();
        let [c, d] = environment.pair();
        let e = environment.unit();
        // Later bounces of different paths must not share their numbers.
        lobe.skip(u64::from(path) * 64);
        environment.skip(u64::from(path) * 64);
        Self {
            path,
            lobe,
            environment,
            shifts: [a, b, c, d, e],
        }
    }

    fn sequence(&self, dimension: usize) -> f64 {
        (f64::from(self.shifts[dimension]) + STEPS[dimension] * f64::from(self.path)).fract()
    }

    fn lobe(&mut self, bounce: u32) -> [f32; 2] {
        if bounce == 0 {
            [0, 1].map(|dimension| below_one(self.sequence(dimension)))
        } else {
            self.lobe.pair()
        }
    }

    /// Of the first bounce only.
    fn environment(&mut self) -> (f64, [f32; 2]) {
        // A finer choice than 24 bits: one of 32,768 texels and where between its neighbours.
        let choice = self.sequence(2) + f64::from(self.environment.unit()) / 16_777_216.0;
        (
            choice.fract(),
            [3, 4].map(|dimension| below_one(self.sequence(dimension))),
        )
    }
}

/// In f32, which would round up to 1.
fn below_one(value: f64) -> f32 {
    (value as f32).min(1.0 - 0.5 * f32::EPSILON)
}

impl Transport<'_> {
    /// Radiance that a surface sends towards `outgoing` (unit).
    pub fn leaving(
        &mut self,
        point: &SurfacePoint,
        outgoing: Vec3,
        random: &mut PathRandom,
    ) -> [f32; 3] {
        let matte = self.matte(point);
        let mirrored = self.mirrored(point, outgoing, 0, random);
        add(matte, mirrored)
    }

    /// D: matte radiance.
    pub fn matte(&self, point: &SurfacePoint) -> [f32; 3] {
        let object = &self.world.objects[usize::from(point.object)];
        let albedo = object.material.texture.at(point.position - object.anchor);
        std::array::from_fn(|c| albedo[c] * point.light[c])
    }

    /// Light from beyond all objects.
    pub fn background(&self, origin: Vec3, direction: Vec3) -> [f32; 3] {
        match &self.operator {
            Some(operator) if operator.blocks(origin, direction) => operator.radiance,
            _ => self.world.environment.radiance(origin, direction),
        }
    }

    /// The gloss of a surface and its normal with waves.
    pub fn gloss(&self, point: &SurfacePoint) -> Option<(u8, Gloss, Vec3)> {
        let object = &self.world.objects[usize::from(point.object)];
        let local = point.position - object.anchor;
        let (number, gloss) = object.material.gloss(local)?;
        Some((number, gloss, object.material.bumped(local, point.normal)))
    }

    /// Reflectance of a gloss at a cosine between half vector and eye.
    pub fn reflectance(&mut self, gloss: &Gloss, cosine: f32) -> [f32; 3] {
        if !(gloss.has_fresnel && self.effects.contains(Effect::Fresnel)) {
            return gloss.r0;
        }
        self.counts.fresnel_evals += 1;
        gloss.r0.map(|r0| lobe::schlick(r0, cosine))
    }

    /// S: mirrored radiance after `bounce` bounces, one sample.
    fn mirrored(
        &mut self,
        point: &SurfacePoint,
        outgoing: Vec3,
        bounce: u32,
        random: &mut PathRandom,
    ) -> [f32; 3] {
        let Some((_, gloss, normal)) = self.gloss(point) else {
            return [0.0; 3];
        };
        let (tangent, bitangent) = geometry::direction::basis(normal);
        let local = |v: Vec3| Vec3::new(v.dot(tangent), v.dot(bitangent), v.dot(normal));
        let world = |v: Vec3| tangent * v.x + bitangent * v.y + normal * v.z;
        let view = local(outgoing);
        if !(view.z > 0.0) {
            return [0.0; 3];
        }
        let is_mirror = gloss.alpha < lobe::MIRROR_ALPHA;
        let half = if is_mirror {
            Vec3::Z
        } else {
            lobe::sample_visible_half(gloss.alpha, view, random.lobe(bounce))
        };
        let light = lobe::mirrored(view, half);
        let shares = !is_mirror && gloss.alpha >= SHARED_ALPHA && bounce == 0;
        let mut sum = [0.0; 3];
        if light.z > 0.0 {
            let weight = if is_mirror {
                1.0
            } else {
                lobe::sample_weight(gloss.alpha, light.z, view.z)
            };
            let factor = self.reflectance(&gloss, view.dot(half)).map(|f| f * weight);
            let direction = lifted(world(light), point.facet);
            let share = if shares {
                let own = lobe::reflected_density(gloss.alpha, half, view.z);
                own / (own + self.world.environment.density(direction))
            } else {
                1.0
            };
            let seen = self.incoming(point, direction, share, bounce, random);
            sum = std::array::from_fn(|c| factor[c] * seen[c]);
        }
        if shares {
            let lit = self.lit_by_environment(point, &gloss, view, &local, random);
            sum = add(sum, lit);
        }
        sum
    }

    /// What arrives along `direction`: the environment times `share`, or a surface.
    fn incoming(
        &mut self,
        point: &SurfacePoint,
        direction: Vec3,
        share: f32,
        bounce: u32,
        random: &mut PathRandom,
    ) -> [f32; 3] {
        let ray = World::leaving(point, direction);
        let sky = |transport: &Self| {
            transport
                .background(ray.origin, direction)
                .map(|value| value * share)
        };
        if !self.effects.contains(Effect::Visibility) {
            return sky(self);
        }
        if !self.effects.contains(Effect::FirstBounce) {
            self.counts.rays_occlusion += 1;
            return if self.world.scene().is_blocked(&ray) {
                [0.0; 3]
            } else {
                sky(self)
            };
        }
        self.counts.rays_closest += 1;
        let Some(met) = self.world.closest(&ray) else {
            return sky(self);
        };
        self.counts.first_bounce_pixels += 1;
        let matte = self.matte(&met);
        if bounce >= MOST_BOUNCES || !self.effects.contains(Effect::FirstBounceSpecular) {
            return matte;
        }
        self.counts.second_bounce_pixels += 1;
        let mirrored = self.mirrored(&met, -direction, bounce + 1, random);
        add(matte, mirrored)
    }

    /// The environment's light by its own directions, weighted against the lobe's (balance heuristic, Veach 1997).
    fn lit_by_environment(
        &mut self,
        point: &SurfacePoint,
        gloss: &Gloss,
        view: Vec3,
        local: &impl Fn(Vec3) -> Vec3,
        random: &mut PathRandom,
    ) -> [f32; 3] {
        let (choice, within) = random.environment();
        let (direction, density) = self.world.environment.sample(choice, within);
        let light = local(direction);
        if !(light.z > 0.0) || direction.dot(point.facet) <= 0.0 || !(density > 0.0) {
            return [0.0; 3];
        }
        let half = (light + view).normalize_or(Vec3::Z);
        let own = lobe::reflected_density(gloss.alpha, half, view.z);
        let scattered = lobe::density(gloss.alpha, half)
            * lobe::shadowing_over_cosines(gloss.alpha, light.z, view.z)
            * light.z;
        // f cos / p · p / (p + own): the lobe's own samples carry the rest.
        let weight = scattered / (density + own);
        if weight < 1e-7 {
            return [0.0; 3];
        }
        let ray = World::leaving(point, direction);
        if self.effects.contains(Effect::Visibility) {
            self.counts.rays_occlusion += 1;
            if self.world.scene().is_blocked(&ray) {
                return [0.0; 3];
            }
        }
        let factor = self.reflectance(gloss, view.dot(half));
        let seen = self.background(ray.origin, direction);
        std::array::from_fn(|c| factor[c] * weight * seen[c])
    }

    /// The ray that a mirror in the place of the surface would send the eye's ray along.
    pub fn mirror_ray(&self, point: &SurfacePoint, outgoing: Vec3) -> Option<Ray> {
        let (_, _, normal) = self.gloss(point)?;
        let direction = lobe::mirrored(outgoing, normal);
        Some(World::leaving(point, lifted(direction, point.facet)))
    }
}

fn add(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    std::array::from_fn(|c| a[c] + b[c])
}

/// A direction that would enter the facet, taken just above it.
fn lifted(direction: Vec3, facet: Vec3) -> Vec3 {
    let rise = direction.dot(facet);
    if rise >= 0.01 {
        return direction;
    }
    (direction + facet * (0.01 - rise)).normalize_or(facet)
}
