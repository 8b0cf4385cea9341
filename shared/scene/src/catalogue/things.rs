//! Textures, finishes and furniture that scenes share.

use glam::Vec3;

use crate::design::prop;
use crate::material::{Gloss, Material};
use crate::shape::Shape;
use crate::texture::Texture;
use crate::world::Object;

/// Inks on black: what is dark fixes the offset of the environment.
pub(super) fn print(size: f32) -> Texture {
    Texture::Blobs {
        size,
        ground: [0.02, 0.02, 0.025],
        inks: [[0.62, 0.09, 0.07], [0.08, 0.16, 0.5], [0.6, 0.52, 0.12]],
    }
}

/// A painted pattern without black.
pub(super) fn paint(size: f32) -> Texture {
    Texture::Blobs {
        size,
        ground: [0.35, 0.33, 0.3],
        inks: [[0.7, 0.25, 0.2], [0.2, 0.45, 0.6], [0.75, 0.7, 0.35]],
    }
}

/// Black with little else.
pub(super) fn black() -> Texture {
    Texture::Plain([0.015, 0.015, 0.018])
}

/// A gloss that rises towards grazing angles.
pub(super) fn coat(r0: f32, alpha: f32) -> Gloss {
    Gloss {
        alpha,
        r0: [r0; 3],
        has_fresnel: true,
    }
}

/// A gloss that is the same at all angles: a metal film.
pub(super) fn film(r0: [f32; 3], alpha: f32) -> Gloss {
    Gloss {
        alpha,
        r0,
        has_fresnel: false,
    }
}

/// A square matte table top at y = 0 with half an edge of `half` metres.
pub(super) fn table(texture: Texture, half: f32) -> (Object, Shape) {
    let corner = Vec3::new(-half, 0.0, -half);
    // x × z looks up, to −y.
    let shape = Shape::rectangle(corner, Vec3::X * 2.0 * half, Vec3::Z * 2.0 * half, 0.012);
    prop("table", Material::matte(texture), shape)
}

/// Squares of light and dark wood.
pub(super) fn wood() -> Texture {
    Texture::Checker {
        size: 0.04,
        a: [0.5, 0.36, 0.22],
        b: [0.24, 0.16, 0.1],
    }
}
