//! Values of the lobe: I01, I02, I03, I05, I08.

use glam::Vec3;
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;
use scene::lobe;

/// The density in f64 by its definition.
fn exact_density(alpha: f64, theta: f64) -> f64 {
    let (sine, cosine) = theta.sin_cos();
    let spread = alpha * alpha * cosine * cosine + sine * sine;
    alpha * alpha / (std::f64::consts::PI * spread * spread)
}

fn tilted(theta: f64) -> Vec3 {
    Vec3::new(theta.sin() as f32, 0.0, theta.cos() as f32)
}

/// The density as it stands in papers, in f32: (n·h)² (α² − 1) + 1.
fn naive_density(alpha: f32, half: Vec3) -> f32 {
    let t = half.z * half.z * (alpha * alpha - 1.0) + 1.0;
    alpha * alpha / (std::f32::consts::PI * t * t)
}

fn relative(value: f32, exact: f64) -> f64 {
    (f64::from(value) / exact - 1.0).abs()
}

#[test]
fn hc_i01_density_of_narrow_lobes() {
    const TOLERANCE: f64 = 1e-6;
    // Bite: the peak of narrow lobes.
    assert!(relative(naive_density(1e-2, Vec3::Z), exact_density(1e-2, 0.0)) > 1e-4);
    assert!(relative(naive_density(1e-3, Vec3::Z), exact_density(1e-3, 0.0)) > 1e-2);
    assert!(!naive_density(1e-4, Vec3::Z).is_finite());
    let mut worst = 0.0_f64;
    let mut check = |alpha: f32, theta: f64| {
        let half = tilted(theta);
        // What the rounded vector stands for, in f64.
        let across = f64::from(half.x).atan_of(f64::from(half.z));
        let error = relative(
            lobe::density(alpha, half),
            exact_density(f64::from(alpha), across),
        );
        worst = worst.max(error);
    };
    for exponent in 0..=10 {
        let alpha = 10.0_f32.powf(-0.5 * exponent as f32);
        for factor in [0.0, 0.5, 1.0, 5.0] {
            check(alpha, (factor * f64::from(alpha)).min(1.4));
        }
    }
    let mut random = Pcg64::seed_from_u64(101);
    for _ in 0..2000 {
        let alpha = 10.0_f32.powf(-5.0 * random.random::<f32>());
        check(
            alpha,
            (5.0 * f64::from(alpha) * random.random::<f64>()).min(1.5),
        );
    }
    println!("I01, worst relative error {worst:.2e}, tolerance {TOLERANCE:.0e}");
    assert!(worst <= TOLERANCE);
}

/// The angle whose tangent is `self / z`.
trait AtanOf {
    fn atan_of(self, z: f64) -> f64;
}

impl AtanOf for f64 {
    fn atan_of(self, z: f64) -> f64 {
        (self / z).atan()
    }
}

#[test]
fn hc_i02_a_lamp_through_a_narrow_lobe_is_no_firefly() {
    // Bite: evaluated at a direction drawn evenly, one sample of a narrow lobe outweighs everything, and half floats
    // cannot hold its peak.
    let peak = lobe::density(2e-3, Vec3::Z);
    assert!(peak > 65_504.0, "beyond f16: {peak}");
    let mut random = Pcg64::seed_from_u64(102);
    let mut largest = 0.0_f32;
    for _ in 0..5000 {
        let alpha = 10.0_f32.powf(-4.0 * random.random::<f32>());
        let cosine = random.random_range(1e-3_f32..1.0);
        let view = Vec3::new((1.0 - cosine * cosine).sqrt(), 0.0, cosine);
        let half = lobe::sample_visible_half(alpha, view, [random.random(), random.random()]);
        let light = lobe::mirrored(view, half);
        largest = largest.max(lobe::sample_weight(alpha, light.z, view.z));
    }
    println!("I02, largest weight of a sample {largest}, at most 1");
    assert!(largest <= 1.0 + 1e-6);
}

#[test]
fn hc_i03_alpha_is_the_width_itself() {
    const TOLERANCE: f64 = 0.02;
    // Half of the peak at tan² θ = (√2 − 1) / (1/α² − √2); the mirrored direction turns twice as far.
    let half_width = |density: &dyn Fn(f64) -> f64| {
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if density(middle) > 0.5 * density(0.0) {
                low = middle;
            } else {
                high = middle;
            }
        }
        2.0 * low
    };
    let expected = 0.1295;
    // Bite: 0.1 taken for a perceptual roughness, α = r².
    let squared = half_width(&|theta| f64::from(lobe::density(0.01, tilted(theta))));
    assert!((squared / expected - 1.0).abs() > 0.5, "{squared}");
    let own = half_width(&|theta| f64::from(lobe::density(0.1, tilted(theta))));
    println!("I03, half width {own:.4} rad, {expected} expected, tolerance {TOLERANCE}");
    assert!((own / expected - 1.0).abs() <= TOLERANCE);
    let mut random = Pcg64::seed_from_u64(103);
    for _ in 0..1000 {
        let alpha = random.random_range(0.005_f64..0.3);
        let tangent = ((2.0_f64.sqrt() - 1.0) / (1.0 / (alpha * alpha) - 2.0_f64.sqrt())).sqrt();
        let found = half_width(&|theta| f64::from(lobe::density(alpha as f32, tilted(theta))));
        assert!(
            (found / (2.0 * tangent.atan()) - 1.0).abs() <= TOLERANCE,
            "{alpha}"
        );
    }
}

/// G₂ and the quotient apart, as in papers: ∞ · 0 at the horizon.
fn naive_shadowing(alpha: f32, nl: f32, nv: f32) -> f32 {
    let lambda = |c: f32| 0.5 * ((1.0 + alpha * alpha * (1.0 - c * c) / (c * c)).sqrt() - 1.0);
    let g2 = 1.0 / (1.0 + lambda(nl) + lambda(nv));
    g2 / (4.0 * nl * nv)
}

#[test]
fn hc_i05_grazing_angles_stay_finite_and_symmetric() {
    const TOLERANCE: f32 = 1e-6;
    assert!(!naive_shadowing(0.1, 0.0, 0.0).is_finite());
    let mut worst = 0.0_f32;
    let mut check = |alpha: f32, nl: f32, nv: f32| {
        let one = lobe::shadowing_over_cosines(alpha, nl, nv);
        let other = lobe::shadowing_over_cosines(alpha, nv, nl);
        assert!(one.is_finite() && lobe::sample_weight(alpha, nl, nv).is_finite());
        worst = worst.max((one - other).abs() / one.max(1.0));
    };
    for alpha in [1e-3, 0.1, 1.0] {
        for nl in [1.0, 1e-3, 1e-6, 0.0] {
            for nv in [1.0, 1e-3, 1e-6, 0.0] {
                check(alpha, nl, nv);
            }
        }
    }
    let mut random = Pcg64::seed_from_u64(105);
    for _ in 0..2000 {
        let mut cosine = || 10.0_f32.powf(-8.0 * random.random::<f32>());
        let (alpha, nl, nv) = (cosine().max(1e-4), cosine(), cosine());
        check(alpha, nl, nv);
    }
    println!("I05, worst asymmetry {worst:.1e}, tolerance {TOLERANCE:.0e}");
    assert!(worst <= TOLERANCE);
    // Where both exist they agree.
    let (naive, own) = (
        naive_shadowing(0.3, 0.4, 0.7),
        lobe::shadowing_over_cosines(0.3, 0.4, 0.7),
    );
    assert!((naive / own - 1.0).abs() < 1e-5);
}

#[test]
fn hc_i08_schlick_stays_within_its_range() {
    const R0: f32 = 0.04;
    let naive = |cosine: f32| R0 + (1.0 - R0) * (1.0 - cosine).powi(5);
    assert!(naive(-0.2) > 2.0, "a normal that looks away makes light");
    let mut random = Pcg64::seed_from_u64(108);
    for _ in 0..2000 {
        let cosine = random.random_range(-1.0_f32..1.000_001);
        let value = lobe::schlick(R0, cosine);
        assert!((R0..=1.0).contains(&value), "{cosine}: {value}");
    }
    // The mean of (1 − cos)⁵ over a ball's disc is 1/21.
    let count = 200_000;
    let sum: f64 = (0..count)
        .map(|index| {
            // Even in area: radius² uniform.
            let radius2 = (f64::from(index) + 0.5) / f64::from(count);
            let cosine = (1.0 - radius2).sqrt() as f32;
            f64::from((lobe::schlick(0.0, cosine) - 0.0) / 1.0)
        })
        .sum();
    let mean = sum / f64::from(count);
    println!("I08, mean {mean:.5}, 1/21 expected");
    assert!((mean * 21.0 - 1.0).abs() < 1e-3);
}
