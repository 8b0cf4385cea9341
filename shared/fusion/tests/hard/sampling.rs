//! Seeded random inputs.

use geometry::DVec3;
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;

pub(crate) fn generator(seed: u64) -> Pcg64 {
    Pcg64::seed_from_u64(seed)
}

/// Uniform in [low, high).
pub(crate) fn uniform(rng: &mut Pcg64, low: f64, high: f64) -> f64 {
    low + (high - low) * rng.random::<f64>()
}

/// Normal with mean 0 and standard deviation 1 (Box and Muller).
pub(crate) fn normal(rng: &mut Pcg64) -> f64 {
    let (radius, angle) = (1.0 - rng.random::<f64>(), rng.random::<f64>());
    (-2.0 * radius.ln()).sqrt() * (std::f64::consts::TAU * angle).cos()
}

/// Uniform on the unit sphere, by rejection from the cube.
pub(crate) fn unit_vector(rng: &mut Pcg64) -> DVec3 {
    loop {
        let v = DVec3::from_array(std::array::from_fn(|_| uniform(rng, -1.0, 1.0)));
        if (1e-4..=1.0).contains(&v.length_squared()) {
            return v.normalize();
        }
    }
}
