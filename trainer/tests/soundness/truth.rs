//! What effects really change: the same rays through the same pixels with and without each of them, without noise.

use std::collections::BTreeMap;

use effects::survey::CODES;
use effects::{Effect, EffectSet};
use geometry::{DVec2, Pose};
use glint::effects::ObjectPixels;
use raytrace::Ray;
use scene::Film;
use scene::lobe::MIRROR_ALPHA;
use scene::random::{Purpose, Stream};
use scene::transport::{PathRandom, Transport, TransportCounts};
use scene::world::SurfacePoint;
use srm::rows::luminance;

/// The effects that have a bound of what they change.
pub(crate) const BOUNDED: [Effect; 6] = [
    Effect::Visibility,
    Effect::FirstBounce,
    Effect::FirstBounceSpecular,
    Effect::Fresnel,
    Effect::Vignetting,
    Effect::Response,
];
/// Paths of a pixel of a surface that is no perfect mirror.
const PATHS: u32 = 16;
/// Its seed: none that a film uses.
const SEED: u64 = 0x7275_7468;

/// Light of one pixel of a photograph, linear RGB before lens and sensor.
struct PixelLight {
    /// Object, if any.
    object: Option<u16>,
    matte: [f32; 3],
    /// Mirrored with no, one, two and three of visibility, first bounce and specular first bounce.
    steps: [[f32; 3]; 4],
    /// Mirrored with all of them and reflectance that does not rise.
    level: [f32; 3],
    /// Factor of the lens.
    lens: f32,
}

/// What a survey pixel shows: its photograph's pixels.
type Block = Vec<PixelLight>;

/// Mean absolute change of each of [`BOUNDED`] over about `count` of the object's pixels, codes; 0 where the scene has
/// none of it. A constant factor is none: the map takes it up.
pub(crate) fn changes(film: &Film, pixels: &[ObjectPixels], count: usize) -> [f64; BOUNDED.len()] {
    let blocks = blocks(film, pixels, count);
    let luminance_of = |light: [f32; 3]| luminance(light.map(f64::from));
    let mean = |of: &dyn Fn(&PixelLight) -> f64| {
        let change = |block: &Block| block.iter().map(of).sum::<f64>() / block.len() as f64;
        CODES * blocks.iter().map(|block| change(block).abs()).sum::<f64>()
            / blocks.len().max(1) as f64
    };
    let step = |number: usize| {
        mean(&|pixel| {
            let seen = |mirrored| luminance_of(pixel.clipped(mirrored));
            seen(pixel.steps[number + 1]) - seen(pixel.steps[number])
        })
    };
    let response = film.effects().contains(Effect::Response);
    let all = || blocks.iter().flatten();
    let scales = level_scales(all());
    let lens = scale(all().map(|pixel| {
        let full = luminance_of(pixel.full(false));
        (full, luminance_of(pixel.full(true)))
    }));
    let code = |pixel: &PixelLight| {
        let linear = pixel.full(true);
        let code = |c: usize| film.color().response.code(linear[c], c) / CODES as f32;
        luminance_of(std::array::from_fn(code))
    };
    let curve = scale(all().map(|pixel| (code(pixel), luminance_of(pixel.full(true)))));
    [
        step(0),
        step(1),
        step(2),
        mean(&|pixel| {
            let factor = pixel.object.and_then(|object| scales.get(&object));
            let factor = factor.map_or(1.0, |&factor| factor as f32);
            let level = pixel.level.map(|value| factor * value);
            luminance_of(pixel.clipped(pixel.steps[3])) - luminance_of(pixel.clipped(level))
        }),
        mean(&|pixel| luminance_of(pixel.full(true)) - lens * luminance_of(pixel.full(false))),
        if response {
            mean(&|pixel| luminance_of(pixel.full(true)) - curve * code(pixel))
        } else {
            0.0
        },
    ]
}

/// The factor of the first of each pair that comes nearest to the second.
fn scale(pairs: impl Iterator<Item = (f64, f64)>) -> f64 {
    let (xx, xy) = pairs.fold((0.0, 0.0), |(xx, xy), (x, y)| (xx + x * x, xy + x * y));
    if xx > 0.0 { xy / xx } else { 1.0 }
}

/// The factor of every object that a reflectance without rise leaves to the map, below the white level.
fn level_scales<'a>(pixels: impl Iterator<Item = &'a PixelLight>) -> BTreeMap<u16, f64> {
    let mut pairs: BTreeMap<u16, Vec<(f64, f64)>> = BTreeMap::new();
    for pixel in pixels {
        let Some(object) = pixel.object else { continue };
        let shown = |light: [f32; 3]| luminance(light.map(|value| f64::from(value.min(1.0))));
        let pair = (shown(pixel.level), shown(pixel.steps[3]));
        pairs.entry(object).or_default().push(pair);
    }
    let scales = pairs.into_iter();
    scales
        .map(|(object, pairs)| (object, scale(pairs.into_iter())))
        .collect()
}

impl PixelLight {
    /// Matte and mirrored light as far as the sensor tells it, before the lens.
    fn clipped(&self, mirrored: [f32; 3]) -> [f32; 3] {
        let most = 1.0 / self.lens.max(f32::MIN_POSITIVE);
        std::array::from_fn(|c| (self.matte[c] + mirrored[c]).min(most))
    }

    /// All light, at the sensor through the lens or without one.
    fn full(&self, has_lens: bool) -> [f32; 3] {
        let lens = if has_lens { self.lens } else { 1.0 };
        std::array::from_fn(|c| ((self.matte[c] + self.steps[3][c]) * lens).min(1.0))
    }
}

/// Light of the survey's pixels, thinned evenly to about `most` of the photographs' pixels.
fn blocks(film: &Film, pixels: &[ObjectPixels], most: usize) -> Vec<Block> {
    let in_photographs = |of: &ObjectPixels| of.places.len() * (of.block * of.block) as usize;
    let count: usize = pixels.iter().map(in_photographs).sum();
    // Odd, so that thinning does not fall into step with rows.
    let step = count.div_ceil(most).max(1) | 1;
    let chosen = pixels.iter().flat_map(|of| {
        let places = of.places.iter();
        places.map(move |&place| (of.frame as u32, of.block, place))
    });
    chosen
        .step_by(step)
        .map(|(frame, block, [column, row])| {
            let inside = (0..block * block).map(|i| [i % block, i / block]);
            inside
                .map(|[x, y]| pixel(film, frame, [column * block + x, row * block + y]))
                .collect()
        })
        .collect()
}

fn pixel(film: &Film, frame: u32, [x, y]: [u32; 2]) -> PixelLight {
    let camera = film.color();
    let at = DVec2::new(f64::from(x), f64::from(y));
    let pose: Pose = film.pose(frame) * film.color_from_depth().inverse();
    let ahead = camera.intrinsics.camera_from_pixel(at).unwrap();
    let ray = Ray::new(
        pose.translation().as_vec3(),
        pose.transform_vector(ahead.normalize()).as_vec3(),
    );
    let has_lens = film.effects().contains(Effect::Vignetting);
    let mut light = PixelLight {
        object: None,
        matte: [0.0; 3],
        steps: [[0.0; 3]; 4],
        level: [0.0; 3],
        lens: if has_lens {
            camera.vignetting.factor(at.x, at.y) as f32
        } else {
            1.0
        },
    };
    let all = film.effects();
    let look = transport(film, all);
    let Some(point) = film.world().closest(&ray) else {
        light.matte = look.background(ray.origin, ray.direction);
        return light;
    };
    light.object = Some(point.object);
    light.matte = look.matte(&point);
    let sets = [
        all.without(Effect::Visibility),
        all.without(Effect::FirstBounce),
        all.without(Effect::FirstBounceSpecular),
        all,
    ];
    let item = u64::from(y) << 32 | u64::from(x);
    let seen = |set: EffectSet| mirrored(film, set, &point, &ray, [u64::from(frame), item]);
    light.steps = sets.map(|set| seen(set.closed()));
    light.level = seen(all.without(Effect::Fresnel));
    light
}

fn transport(film: &Film, effects: EffectSet) -> Transport<'_> {
    Transport {
        world: film.world(),
        effects,
        operator: None,
        counts: TransportCounts::default(),
    }
}

/// Mirrored light of a point: the same paths for every set of effects.
fn mirrored(
    film: &Film,
    effects: EffectSet,
    point: &SurfacePoint,
    ray: &Ray,
    [frame, item]: [u64; 2],
) -> [f32; 3] {
    let mut transport = transport(film, effects);
    let Some((_, gloss, _)) = transport.gloss(point) else {
        return [0.0; 3];
    };
    let matte = transport.matte(point);
    let paths = if gloss.alpha < MIRROR_ALPHA { 1 } else { PATHS };
    let mut sum = [0.0; 3];
    for path in 0..paths {
        let stream = |purpose| Stream::new(SEED, purpose, frame, item);
        let mut random = PathRandom::new(path, stream(Purpose::Lobe), stream(Purpose::Environment));
        let leaving = transport.leaving(point, -ray.direction, &mut random);
        for c in 0..3 {
            sum[c] += (leaving[c] - matte[c]) / paths as f32;
        }
    }
    sum
}
