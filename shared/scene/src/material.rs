//! What surfaces are made of.

use glam::Vec3;

use crate::texture::Texture;

/// Mirror-like reflection of a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gloss {
    /// GGX width; below [`crate::lobe::MIRROR_ALPHA`] a mirror.
    pub alpha: f32,
    /// Reflectance at normal incidence, linear RGB.
    pub r0: [f32; 3],
    /// Whether it rises to 1 at grazing angles as Schlick says; otherwise it is the same at all angles.
    pub has_fresnel: bool,
}

/// Where which gloss lies.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Finish {
    /// None anywhere.
    Matte,
    /// One everywhere.
    Even(Gloss),
    /// Two in patches of the given size, metres.
    Patches(Gloss, Gloss, f32),
}

/// Waves on a surface, finer than its mesh.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bumps {
    /// Deviation of the normal, radians.
    pub tilt: f32,
    /// Length of a wave, metres.
    pub length: f32,
}

/// Matte reflection under mirror-like reflection; the two add.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// Albedo of matte reflection.
    pub texture: Texture,
    /// Mirror-like reflection.
    pub finish: Finish,
    /// Waves, where there are any.
    pub bumps: Option<Bumps>,
}

impl Material {
    /// Without gloss.
    pub fn matte(texture: Texture) -> Self {
        Self {
            texture,
            finish: Finish::Matte,
            bumps: None,
        }
    }

    /// With one gloss.
    pub fn glossy(texture: Texture, gloss: Gloss) -> Self {
        Self {
            texture,
            finish: Finish::Even(gloss),
            bumps: None,
        }
    }

    /// Whether any part reflects.
    pub fn is_glossy(&self) -> bool {
        self.finish != Finish::Matte
    }

    /// Number of the gloss at a position relative to the object's anchor and the gloss itself.
    pub fn gloss(&self, position: Vec3) -> Option<(u8, Gloss)> {
        match self.finish {
            Finish::Matte => None,
            Finish::Even(gloss) => Some((0, gloss)),
            Finish::Patches(a, b, size) => {
                let p = position / size;
                let wave = (2.4 * p.x).sin() * (2.2 * p.y + 0.4).sin() + 0.6 * (2.6 * p.z).sin();
                Some(if wave > 0.0 { (0, a) } else { (1, b) })
            }
        }
    }

    /// The normal with waves: `normal` (unit) tilted by smooth functions of position.
    pub fn bumped(&self, position: Vec3, normal: Vec3) -> Vec3 {
        let Some(Bumps { tilt, length }) = self.bumps else {
            return normal;
        };
        let p = position * (std::f32::consts::TAU / length);
        let wave = Vec3::new(
            (p.x + 0.7 * p.y).sin() * (0.9 * p.z).cos(),
            (p.y - 0.6 * p.z).sin() * (1.1 * p.x).cos(),
            (p.z + 0.8 * p.x).sin() * (0.8 * p.y).cos(),
        );
        let across = wave - normal * wave.dot(normal);
        // Each component has a mean square of 1/4, two of three lie across.
        (normal + across * (tilt * std::f32::consts::SQRT_2)).normalize_or(normal)
    }
}
