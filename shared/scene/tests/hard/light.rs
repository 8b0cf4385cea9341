//! The environment and random numbers: I09, I10.

use geometry::{DVec2, PanoramaSize};
use glam::Vec3;
use imaging::Image;
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;
use scene::Environment;
use scene::random::{Purpose, Stream};

/// Radiance of a texel.
type Radiance = fn(u32, u32) -> f32;

fn environment(radiance: impl Fn(u32, u32) -> f32) -> Environment {
    let map = Image::from_fn(64, 32, |x, y| [radiance(x, y); 3]);
    Environment::from_panorama(&map).expect("a panorama")
}

/// Weight of each texel: mean of its light, which is bilinear, times its solid angle.
fn weights(environment: &Environment) -> Vec<f64> {
    const PARTS: u32 = 8;
    let size = PanoramaSize::from_height(32).expect("a panorama");
    let inside = |part: u32| (f64::from(part) + 0.5) / f64::from(PARTS) - 0.5;
    (0..32_u32)
        .flat_map(|y| (0..64_u32).map(move |x| (x, y)))
        .map(|(x, y)| {
            let parts = (0..PARTS * PARTS).map(|part| [inside(part % PARTS), inside(part / PARTS)]);
            let light = parts.map(|[dx, dy]| {
                let at = DVec2::new(f64::from(x) + dx, f64::from(y) + dy);
                let direction = size.direction_from_texel(at).as_vec3();
                f64::from(environment.radiance(Vec3::ZERO, direction)[1])
            });
            light.sum::<f64>() / f64::from(PARTS * PARTS) * size.solid_angle(y)
        })
        .collect()
}

/// χ² of drawn texels against their weight, and the limit for p = 1e-3.
fn chi_square(radiance: impl Fn(u32, u32) -> f32, seed: u64) -> (f64, f64) {
    let environment = environment(&radiance);
    let mut expected = weights(&environment);
    let total: f64 = expected.iter().sum();
    if total == 0.0 {
        expected = weights(&self::environment(|_, _| 1.0));
    }
    let total: f64 = expected.iter().sum();
    let size = PanoramaSize::from_height(32).expect("a panorama");
    let mut observed = vec![0.0; size.texel_count()];
    let count = 200_000;
    let mut random = Pcg64::seed_from_u64(seed);
    for _ in 0..count {
        let (direction, density) =
            environment.sample(random.random(), [random.random(), random.random()]);
        assert!(density > 0.0 && density.is_finite(), "{density}");
        assert!((direction.length() - 1.0).abs() < 1e-5);
        observed[size.index_from_direction(direction.as_dvec3())] += 1.0;
    }
    // Texels with few draws are counted together.
    let (mut statistic, mut freedom) = (0.0, -1.0);
    let (mut rest_seen, mut rest_aim) = (0.0, 0.0);
    for (seen, weight) in observed.iter().zip(&expected) {
        let aim = weight / total * f64::from(count);
        if aim >= 10.0 {
            statistic += (seen - aim) * (seen - aim) / aim;
            freedom += 1.0;
        } else {
            rest_seen += seen;
            rest_aim += aim;
        }
    }
    if rest_aim >= 10.0 {
        statistic += (rest_seen - rest_aim) * (rest_seen - rest_aim) / rest_aim;
        freedom += 1.0;
    } else {
        assert!(rest_seen < 30.0, "dark texels are drawn: {rest_seen}");
    }
    let freedom: f64 = f64::max(freedom, 1.0);
    let k = 2.0 / (9.0 * freedom);
    (statistic, freedom * (1.0 - k + 3.09 * k.sqrt()).powi(3))
}

#[test]
fn hc_i09_the_environment_is_drawn_by_its_light() {
    // Bite: an f32 sum loses what comes after a bright texel, and no light at all is 0/0.
    let lamp = 1e8_f32;
    assert_eq!(lamp + 1.0, lamp);
    let dark: f32 = [0.0; 8].iter().sum();
    assert!((dark / dark).is_nan());
    let cases: [(&str, Radiance); 4] = [
        ("black", |_, _| 0.0),
        (
            "one texel",
            |x, y| if (x, y) == (11, 9) { 3.0 } else { 0.0 },
        ),
        ("constant", |_, _| 0.7),
        ("wide range", |x, y| {
            if (x, y) == (5, 6) {
                1e5
            } else {
                1e-3 * (1 + (x * 7 + y * 13) % 97) as f32
            }
        }),
    ];
    for (seed, (name, radiance)) in cases.into_iter().enumerate() {
        let (statistic, limit) = chi_square(radiance, 900 + seed as u64);
        println!("I09, {name}: χ² {statistic:.1}, limit {limit:.1}");
        assert!(statistic < limit, "{name}");
    }
    let mut random = Pcg64::seed_from_u64(109);
    for seed in 0..8 {
        let brightness: Vec<f32> = (0..64 * 32)
            .map(|_| 10.0_f32.powf(4.0 * random.random::<f32>() - 2.0))
            .collect();
        let (statistic, limit) = chi_square(|x, y| brightness[(y * 64 + x) as usize], seed);
        assert!(statistic < 1.1 * limit, "{statistic} {limit}");
    }
}

#[test]
fn hc_i09_densities_integrate_to_one() {
    let environment = environment(|x, y| (1 + x * y % 31) as f32);
    let size = PanoramaSize::from_height(128).expect("a panorama");
    let mut sum = 0.0;
    for index in 0..size.texel_count() {
        let texel = glam::DVec2::new(
            (index % size.width() as usize) as f64,
            (index / size.width() as usize) as f64,
        );
        let direction = size.direction_from_texel(texel).as_vec3();
        let row = (index / size.width() as usize) as u32;
        sum += f64::from(environment.density(direction)) * size.solid_angle(row);
    }
    assert!((sum - 1.0).abs() < 1e-3, "{sum}");
}

/// The environment's own directions, from first principles: the map's middle looks along +z, right of it is +x, its top
/// is −y. Not by the mapping that is judged.
#[test]
fn a_bright_texel_is_seen_where_it_should_be() {
    for (x, y, toward) in [
        (32, 16, Vec3::Z),
        (48, 16, Vec3::X),
        (16, 16, -Vec3::X),
        (0, 16, -Vec3::Z),
        (32, 0, -Vec3::Y),
        (32, 31, Vec3::Y),
    ] {
        let lit = environment(|tx, ty| {
            let near = |a: u32, b: u32, n: u32| (a + n - b) % n <= 1 || (b + n - a) % n <= 1;
            let is_pole = ty == y && (y == 0 || y == 31);
            f32::from(u8::from(
                is_pole || (near(tx, x, 64) && ty.abs_diff(y) <= 1),
            ))
        });
        assert!(lit.radiance(Vec3::ZERO, toward)[0] > 0.9, "({x}, {y})");
        assert!(lit.radiance(Vec3::ZERO, -toward)[0] < 0.1, "({x}, {y})");
    }
}

fn correlation(pairs: impl Iterator<Item = (f32, f32)>) -> (f64, f64) {
    let pairs: Vec<(f64, f64)> = pairs.map(|(a, b)| (f64::from(a), f64::from(b))).collect();
    let n = pairs.len() as f64;
    let mean = |of: &dyn Fn(&(f64, f64)) -> f64| pairs.iter().map(of).sum::<f64>() / n;
    let (ma, mb) = (mean(&|p| p.0), mean(&|p| p.1));
    let cov = mean(&|p| (p.0 - ma) * (p.1 - mb));
    let (va, vb) = (mean(&|p| (p.0 - ma).powi(2)), mean(&|p| (p.1 - mb).powi(2)));
    (cov / (va * vb).sqrt(), 4.0 / n.sqrt())
}

#[test]
fn hc_i10_numbers_of_frames_and_pixels_are_apart() {
    const N: u64 = 20_000;
    let number = |seed, frame, pixel, skip: u64| {
        let mut stream = Stream::new(seed, Purpose::ColorNoise, frame, pixel);
        for _ in 0..skip {
            stream.unit();
        }
        stream.unit()
    };
    // Bite: a seed of pixel index plus frame gives a frame the noise of the one before, a pixel on.
    let naive = |frame: u64, pixel: u64| Pcg64::seed_from_u64(frame + pixel).random::<f32>();
    let (shifted, limit) = correlation((0..N).map(|p| (naive(0, p + 1), naive(1, p))));
    assert!(shifted > 0.99 && limit < 0.1);
    for frame in 0..3 {
        for (name, (found, limit)) in [
            (
                "frames",
                correlation((0..N).map(|p| (number(1, frame, p, 0), number(1, frame + 1, p, 0)))),
            ),
            (
                "pixels",
                correlation((0..N).map(|p| (number(1, frame, p, 0), number(1, frame, p + 1, 0)))),
            ),
            (
                "shifted",
                correlation(
                    (0..N).map(|p| (number(1, frame, p + 1, 0), number(1, frame + 1, p, 0))),
                ),
            ),
            (
                "dimensions",
                correlation((0..N).map(|p| (number(1, frame, p, 0), number(1, frame, p, 1)))),
            ),
            (
                "seeds",
                correlation((0..N).map(|p| (number(1, frame, p, 0), number(2, frame, p, 0)))),
            ),
        ] {
            println!("I10, {name}: correlation {found:.4}, limit {limit:.4}");
            assert!(found.abs() < limit, "{name}");
        }
    }
    // The order of the work does not matter: a number is a function of what it is for.
    assert_eq!(number(7, 8, 9, 3), number(7, 8, 9, 3));
}
