//! Colours of matte reflection as functions of position: closed forms, so that no image is needed and truth has no
//! resolution.

use glam::Vec3;

/// Albedo over a surface, linear RGB in [0, 1], by position in metres relative to the object's anchor.
#[derive(Clone, Debug, PartialEq)]
pub enum Texture {
    /// The same everywhere.
    Plain([f32; 3]),
    /// Soft blobs of three inks on a dark ground.
    Blobs {
        /// Size of a blob, metres.
        size: f32,
        /// Albedo between the blobs.
        ground: [f32; 3],
        /// Albedo at the middle of a blob of each ink.
        inks: [[f32; 3]; 3],
    },
    /// Squares of two colours in the plane y = const, their edges a tenth of a square wide.
    Checker {
        /// Edge of a square, metres.
        size: f32,
        /// One colour.
        a: [f32; 3],
        /// The other.
        b: [f32; 3],
    },
    /// Rings around the vertical axis: a printed label.
    Bands {
        /// Height of a band, metres.
        size: f32,
        /// Colours from the bottom up, again and again.
        colors: [[f32; 3]; 3],
    },
}

/// From 0 to 1 around the middle of [0, 1], smooth.
fn smooth(value: f32) -> f32 {
    let x = value.clamp(0.0, 1.0);
    x * x * (3.0 - 2.0 * x)
}

fn mixed(a: [f32; 3], b: [f32; 3], at: f32) -> [f32; 3] {
    std::array::from_fn(|c| a[c] + (b[c] - a[c]) * at)
}

/// −1 to 1, alternating every `size`, with edges a tenth of it wide.
fn square_wave(along: f32, size: f32) -> f32 {
    let phase = (along / size).rem_euclid(2.0);
    let from_edge = if phase < 1.0 {
        phase.min(1.0 - phase)
    } else {
        -(phase - 1.0).min(2.0 - phase)
    };
    (from_edge / 0.05).clamp(-1.0, 1.0)
}

impl Texture {
    /// Albedo at a position.
    pub fn at(&self, position: Vec3) -> [f32; 3] {
        match self {
            Self::Plain(color) => *color,
            Self::Blobs { size, ground, inks } => {
                let p = position / *size;
                let mut color = *ground;
                for (index, ink) in inks.iter().enumerate() {
                    let phase = 1.7 * index as f32;
                    let wave = (2.1 * p.x + phase).sin() * (1.9 * p.y + 2.0 * phase).sin()
                        + 0.7 * (2.3 * p.z - phase + 0.6 * p.x).sin();
                    color = mixed(color, *ink, smooth(1.3 * (wave - 0.25)));
                }
                color
            }
            Self::Checker { size, a, b } => {
                let wave = square_wave(position.x, *size) * square_wave(position.z, *size);
                mixed(*a, *b, 0.5 + 0.5 * wave)
            }
            Self::Bands { size, colors } => {
                let along = -position.y / size;
                let index = along.floor();
                let inside = along - index;
                let color = |at: f32| colors[(at.rem_euclid(3.0) as usize).min(2)];
                mixed(color(index - 1.0), color(index), smooth(inside / 0.15))
            }
        }
    }
}
