//! Light whose amount is known without tracing it: a sky that is the same everywhere, and one lamp.

use effects::EffectSet;
use glam::Vec3;
use imaging::Image;
use raytrace::Ray;
use scene::Environment;
use scene::design::prop;
use scene::lobe;
use scene::material::{Gloss, Material};
use scene::random::{Purpose, Stream};
use scene::shape::Shape;
use scene::texture::Texture;
use scene::transport::{PathRandom, Transport};
use scene::world::{LightQuality, World};

const QUALITY: LightQuality = LightQuality {
    light_count: 4096,
    bounce_count: 4,
};
const BLACK: Texture = Texture::Plain([0.0; 3]);

/// Normal of a sheet that leans by `angle` (radians) from the vertical towards +x; up is −y.
fn leaning(angle: f32) -> Vec3 {
    Vec3::new(angle.sin(), -angle.cos(), 0.0)
}

/// One sheet of a decimetre under a sky.
fn sheet(angle: f32, material: Material, sky: Environment) -> World {
    let across = Vec3::new(angle.cos(), angle.sin(), 0.0) * 0.1;
    let corner = -0.5 * (across + 0.1 * Vec3::Z);
    let shape = Shape::rectangle(corner, across, 0.1 * Vec3::Z, 0.05);
    World::new(vec![prop("sheet", material, shape)], sky, QUALITY, 5).expect("a world")
}

fn sky(radiance: impl Fn(u32, u32) -> f32) -> Environment {
    let map = Image::from_fn(64, 32, |x, y| [radiance(x, y); 3]);
    Environment::from_panorama(&map).expect("a panorama")
}

/// A direction of the unit sphere, axis z, for `u` in [0, 1) around it and height `z`.
fn around(u: f64, z: f64) -> Vec3 {
    let (sin, cos) = (std::f64::consts::TAU * u).sin_cos();
    let flat = (1.0 - z * z).sqrt();
    Vec3::new((flat * cos) as f32, (flat * sin) as f32, z as f32)
}

/// Mean of `value(u, v)` over the unit square, by the middles of `steps`² squares.
fn mean(steps: u32, value: impl Fn(f64, f64) -> f64) -> f64 {
    let at = |i: u32| (f64::from(i) + 0.5) / f64::from(steps);
    let squares = (0..steps).flat_map(|j| (0..steps).map(move |i| (i, j)));
    squares.map(|(i, j)| value(at(i), at(j))).sum::<f64>() / f64::from(steps * steps)
}

/// ∫ L cos / π over the side of `normal`.
fn irradiance_over_pi(sky: &Environment, normal: Vec3) -> f64 {
    4.0 * mean(512, |u, v| {
        let direction = around(u, 2.0 * v - 1.0);
        let cosine = f64::from(direction.dot(normal).max(0.0));
        f64::from(sky.radiance(Vec3::ZERO, direction)[0]) * cosine
    })
}

#[test]
fn matte_sheets_are_lit_by_the_cosine() {
    const TOLERANCE: f64 = 0.02;
    let even = |_, _| 0.7;
    let lamp = |x: u32, y: u32| {
        if (44..46).contains(&x) && (6..8).contains(&y) {
            60.0
        } else {
            0.05
        }
    };
    for angle in [0.0, 0.5, 1.0, 1.4] {
        for (name, sky) in [("even", sky(even)), ("lamp", sky(lamp))] {
            let expected = irradiance_over_pi(&sky, leaning(angle));
            let world = sheet(angle, Material::matte(Texture::Plain([0.5; 3])), sky);
            for light in world.vertex_light() {
                let error = f64::from(light[1]) / expected - 1.0;
                assert!(
                    error.abs() < TOLERANCE,
                    "{name}, {angle}: {light:?} instead of {expected}"
                );
            }
        }
    }
}

/// Share of light that a surface of reflectance 1 sends back, by the lobe's values.
fn albedo(alpha: f32, cosine: f32) -> f64 {
    let view = Vec3::new((1.0 - cosine * cosine).sqrt(), 0.0, cosine);
    std::f64::consts::TAU
        * mean(512, |u, z| {
            let light = around(u, z);
            let half = (light + view).normalize();
            let shadowing = lobe::shadowing_over_cosines(alpha, light.z, view.z);
            f64::from(lobe::density(alpha, half) * shadowing * light.z)
        })
}

/// Both ways in which light is looked for, the lobe's directions and the environment's, share it without loss.
#[test]
fn glossy_sheets_under_an_even_sky_send_back_their_albedo() {
    const TOLERANCE: f64 = 0.01;
    for alpha in [0.15, 0.3, 0.6] {
        let gloss = Gloss {
            alpha,
            r0: [1.0; 3],
            has_fresnel: false,
        };
        let world = sheet(0.0, Material::glossy(BLACK, gloss), sky(|_, _| 1.0));
        for cosine in [1.0_f32, 0.6, 0.3] {
            let outgoing = Vec3::new((1.0 - cosine * cosine).sqrt(), -cosine, 0.0);
            let ray = Ray::new(outgoing, -outgoing);
            let point = world.closest(&ray).expect("the sheet");
            let mut transport = Transport {
                world: &world,
                effects: EffectSet::all(),
                operator: None,
                counts: Default::default(),
            };
            let count = 20_000_u32;
            let sum: f64 = (0..count)
                .map(|path| {
                    let stream = |purpose| Stream::new(9, purpose, 0, u64::from(path));
                    let mut random =
                        PathRandom::new(0, stream(Purpose::Lobe), stream(Purpose::Environment));
                    f64::from(transport.leaving(&point, outgoing, &mut random)[1])
                })
                .sum();
            let (seen, expected) = (sum / f64::from(count), albedo(alpha, cosine));
            assert!(
                (seen / expected - 1.0).abs() < TOLERANCE,
                "alpha {alpha}, cosine {cosine}: {seen} instead of {expected}"
            );
        }
    }
}
