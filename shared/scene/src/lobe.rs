//! GGX reflection and Schlick's Fresnel factor (Walter et al. 2007, Heitz 2014, Dupuy and Benyoub 2023).
//!
//! Directions are local: z along the normal. `alpha` is the GGX width itself, never its square root
//! (hard-cases I03). Nothing of this is used by an estimator.

use glam::Vec3;
use std::f32::consts::{PI, TAU};

/// Below this width a surface is a mirror: sampling returns the normal exactly and a density would be infinite
/// (hard-cases I04).
pub const MIRROR_ALPHA: f32 = 1e-3;

/// Keeps a quotient finite at grazing angles (hard-cases I05).
const FLOOR: f32 = 1e-7;

/// Density of half vectors, 1/steradian: α² / (π (α² cos²θ + sin²θ)²), with sin²θ as the squared length of what
/// is across the normal, so that it does not vanish with α (hard-cases I01). `half` is a unit vector.
pub fn density(alpha: f32, half: Vec3) -> f32 {
    let across = half.x * half.x + half.y * half.y;
    let alpha2 = alpha * alpha;
    let spread = alpha2 * half.z * half.z + across;
    alpha2 / (PI * spread * spread)
}

/// G₂ / (4 n·l n·v) of height-correlated Smith shadowing, without the 0/0 at grazing angles (hard-cases I05).
pub fn shadowing_over_cosines(alpha: f32, normal_light: f32, normal_view: f32) -> f32 {
    let alpha2 = alpha * alpha;
    let term = |a: f32, b: f32| a * (b * b * (1.0 - alpha2) + alpha2).sqrt();
    let sum = term(normal_light, normal_view) + term(normal_view, normal_light);
    0.5 / sum.max(FLOOR)
}

/// Smith's Λ for a direction with cosine `cosine` to the normal, times the cosine.
fn lambda_cosine(alpha: f32, cosine: f32) -> f32 {
    let alpha2 = alpha * alpha;
    0.5 * ((alpha2 + (1.0 - alpha2) * cosine * cosine).sqrt() - cosine)
}

/// G₂ / G₁(view): what a sample of the visible normals carries, in [0, 1].
pub fn sample_weight(alpha: f32, normal_light: f32, normal_view: f32) -> f32 {
    if !(normal_light > 0.0 && normal_view > 0.0) {
        return 0.0;
    }
    // (1 + Λv) / (1 + Λv + Λl), numerator and denominator times n·v n·l: no tangent becomes infinite.
    let view = (normal_view + lambda_cosine(alpha, normal_view)) * normal_light;
    view / (view + lambda_cosine(alpha, normal_light) * normal_view)
}

/// Density of the reflected direction when half vectors are drawn from the visible ones: D G₁ / (4 n·v), 1/steradian.
pub fn reflected_density(alpha: f32, half: Vec3, normal_view: f32) -> f32 {
    let visible = normal_view + lambda_cosine(alpha, normal_view);
    density(alpha, half) / (4.0 * visible.max(FLOOR))
}

/// A half vector among those that `view` (unit, z > 0) sees; `u` uniform in [0, 1)². By the spherical cap of Dupuy and
/// Benyoub; no root of a negative number (hard-cases I06).
pub fn sample_visible_half(alpha: f32, view: Vec3, u: [f32; 2]) -> Vec3 {
    let stretched =
        Vec3::new(alpha * view.x, alpha * view.y, view.z.max(0.0)).normalize_or(Vec3::Z);
    let angle = TAU * u[0];
    let z = (1.0 - u[1]) * (1.0 + stretched.z) - stretched.z;
    let sine = (1.0 - z * z).max(0.0).sqrt();
    let cap = Vec3::new(sine * angle.cos(), sine * angle.sin(), z) + stretched;
    Vec3::new(alpha * cap.x, alpha * cap.y, cap.z.max(0.0)).normalize_or(Vec3::Z)
}

/// The direction mirrored about `half`: 2 (v·h) h − v.
pub fn mirrored(view: Vec3, half: Vec3) -> Vec3 {
    2.0 * view.dot(half) * half - view
}

/// Schlick's factor R₀ + (1 − R₀)(1 − cos)⁵, in [R₀, 1] also for a cosine outside [0, 1] (hard-cases I08).
pub fn schlick(r0: f32, cosine: f32) -> f32 {
    let x = 1.0 - cosine.clamp(0.0, 1.0);
    r0 + (1.0 - r0) * (x * x) * (x * x) * x
}
