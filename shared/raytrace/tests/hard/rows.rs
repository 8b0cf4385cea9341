//! The two halves of a hard-case test (hard-cases.md section 0), with their printed line, and seeded inputs.

use glam::{DVec3, Vec3};
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;

/// The naive twin must violate the tolerance on the listed input; NaN counts as a violation.
pub(crate) fn bites(id: &str, naive_error: f64, tolerance: f64) {
    println!("{id}: naive error {naive_error:.3e}, tolerance {tolerance:.1e}");
    assert!(
        naive_error.is_nan() || naive_error > tolerance,
        "{id}: the naive form passes with {naive_error:e} <= {tolerance:e}"
    );
}

/// The shipped function must meet the tolerance; NaN does not.
pub(crate) fn holds(id: &str, worst_error: f64, tolerance: f64) {
    println!("{id}: worst error {worst_error:.3e}, tolerance {tolerance:.1e}");
    assert!(
        worst_error <= tolerance,
        "{id}: worst error {worst_error:e} > {tolerance:e}"
    );
}

/// The larger of two errors where NaN wins, unlike in `f64::max`.
pub(crate) fn worse(a: f64, b: f64) -> f64 {
    if a.is_nan() || b.is_nan() {
        f64::NAN
    } else {
        a.max(b)
    }
}

pub(crate) fn generator(seed: u64) -> Pcg64 {
    Pcg64::seed_from_u64(seed)
}

/// Uniform in [low, high).
pub(crate) fn uniform(rng: &mut Pcg64, low: f64, high: f64) -> f64 {
    low + (high - low) * rng.random::<f64>()
}

/// Uniform on the unit sphere, by rejection from the cube.
pub(crate) fn unit_vector(rng: &mut Pcg64) -> Vec3 {
    loop {
        let v = DVec3::from_array(std::array::from_fn(|_| uniform(rng, -1.0, 1.0)));
        if (1e-4..=1.0).contains(&v.length_squared()) {
            return v.normalize().as_vec3();
        }
    }
}

/// `full` with release flags, a tenth of it in debug, where a ray takes ten times as long.
pub(crate) fn scaled_count(full: usize) -> usize {
    if cfg!(debug_assertions) {
        full / 10
    } else {
        full
    }
}
