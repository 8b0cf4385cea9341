//! How fine a detail the map can show, given how well the normals are known.

/// The finest bar (radians, one dark or bright stripe) that survives with a modulation of 0.1 when normals
/// err by `normal_sigma` radians: a reflection errs by twice the normal, and a Gaussian blur of σ leaves
/// exp(−2π²σ²/p²) of a wave of period p (hard-cases H12).
pub fn finest_bar(normal_sigma: f64) -> f64 {
    let blur = 2.0 * normal_sigma;
    let period = std::f64::consts::TAU * blur / (2.0 * std::f64::consts::LN_10).sqrt();
    0.5 * period
}
