//! Small scenes by chance: what a generator of 64 bits makes of shapes, finishes, light, lens and path.

use std::f32::consts::{FRAC_PI_2, TAU};

use effects::{Effect, EffectSet};
use geometry::DVec3;
use glam::{Quat, Vec2, Vec3};
use scene::design::{Design, FrameSplit, ball, prop, target};
use scene::environment::{Enclosure, Room};
use scene::film::FilmOptions;
use scene::material::{Bumps, Finish, Gloss, Material};
use scene::path::HandHeld;
use scene::random::{Purpose, Stream};
use scene::sensor::NoiseModel;
use scene::shape::Shape;
use scene::texture::Texture;
use scene::world::{LightQuality, Object};

/// Numbers of one scene.
struct Chance(Stream);

impl Chance {
    fn between(&mut self, low: f32, high: f32) -> f32 {
        low + (high - low) * self.0.unit()
    }

    /// Evenly spread logarithm.
    fn over_decades(&mut self, low: f32, high: f32) -> f32 {
        self.between(low.ln(), high.ln()).exp()
    }

    fn happens(&mut self, share: f32) -> bool {
        self.0.unit() < share
    }

    /// 0 to `count` − 1.
    fn one_of(&mut self, count: u32) -> u32 {
        ((self.0.unit() * count as f32) as u32).min(count - 1)
    }

    fn color(&mut self, low: f32, high: f32) -> [f32; 3] {
        [(); 3].map(|()| self.between(low, high))
    }

    /// From plain to high contrast, from black to white.
    fn texture(&mut self) -> Texture {
        let size = self.between(0.02, 0.07);
        let dark = self.over_decades(0.01, 0.5);
        let bright = self.between(dark, 0.8);
        match self.one_of(4) {
            0 => Texture::Plain(self.color(dark, bright)),
            1 => Texture::Blobs {
                size,
                ground: self.color(0.8 * dark, dark),
                inks: [(); 3].map(|()| self.color(dark, bright)),
            },
            2 => Texture::Checker {
                size,
                a: self.color(0.8 * dark, dark),
                b: self.color(0.8 * bright, bright),
            },
            _ => Texture::Bands {
                size,
                colors: [(); 3].map(|()| self.color(dark, bright)),
            },
        }
    }

    fn gloss(&mut self, most_r0: f32) -> Gloss {
        let r0 = self.over_decades(0.02, most_r0);
        let is_tinted = r0 > 0.4 && self.happens(0.4);
        Gloss {
            alpha: self.over_decades(0.001, 0.3),
            r0: [1.0, 0.8, 0.5].map(|tint| if is_tinted { r0 * tint } else { r0 }),
            has_fresnel: self.happens(0.7),
        }
    }

    fn material(&mut self) -> Material {
        let finish = match self.one_of(10) {
            0 => Finish::Matte,
            1 => Finish::Patches(self.gloss(0.95), self.gloss(0.95), self.between(0.04, 0.08)),
            _ => Finish::Even(self.gloss(0.95)),
        };
        let bumps = Bumps {
            tilt: self.between(0.2, 1.5).to_radians(),
            length: self.between(0.01, 0.03),
        };
        Material {
            texture: self.texture(),
            finish,
            bumps: self.happens(0.1).then_some(bumps),
        }
    }

    /// A thing about `foot` that fits into `radius`.
    fn thing(&mut self, foot: Vec3, radius: f32) -> (Object, Shape) {
        let material = self.material();
        let height = radius * self.between(0.8, 2.0);
        let (name, shape) = match self.one_of(5) {
            0 | 1 => return ball("ball", material, foot, radius),
            2 => {
                let half = Vec3::new(0.6 * radius, 0.5 * height, 0.7 * radius);
                let turn = Quat::from_rotation_y(self.between(0.0, TAU));
                let shape = Shape::cuboid(foot - Vec3::Y * half.y, half, 0.01);
                ("box", shape.rotated(turn, foot))
            }
            3 => {
                let height = radius * self.between(0.4, 0.9);
                ("bowl", bowl(radius, height, foot))
            }
            _ => ("can", can(0.7 * radius, height, foot)),
        };
        target(name, material, foot, shape)
    }

    /// A table top, matte or varnished.
    fn table(&mut self) -> (Object, Shape) {
        let half = self.between(0.25, 0.5);
        let corner = Vec3::new(-half, 0.0, -half);
        let shape = Shape::rectangle(corner, Vec3::X * 2.0 * half, Vec3::Z * 2.0 * half, 0.015);
        let texture = self.texture();
        let material = if self.happens(0.3) {
            Material::glossy(texture, self.gloss(0.3))
        } else {
            Material::matte(texture)
        };
        prop("table", material, shape)
    }

    /// One to three things around the middle, with or without a table.
    fn things(&mut self) -> Vec<(Object, Shape)> {
        let count = 1 + self.one_of(3);
        let start = self.between(0.0, TAU);
        let mut things: Vec<(Object, Shape)> = (0..count)
            .map(|index| {
                let spoke = start + TAU * index as f32 / count as f32;
                let away = if count == 1 { 0.0 } else { 0.1 };
                let foot = Vec3::new(away * spoke.cos(), 0.0, away * spoke.sin());
                let radius = self.between(0.05, if count == 1 { 0.12 } else { 0.085 });
                self.thing(foot, radius)
            })
            .collect();
        if self.happens(0.6) {
            things.push(self.table());
        }
        things
    }

    fn room(&mut self) -> Room {
        let mut room = Room {
            turn: self.between(0.0, TAU),
            brightness: self.over_decades(0.4, 1.5),
            ..Room::default()
        };
        room.extent.x *= self.between(0.7, 1.5);
        room.extent.z *= self.between(0.7, 1.5);
        room
    }

    fn path(&mut self) -> HandHeld {
        HandHeld {
            center: DVec3::new(0.0, -0.06, 0.0),
            distance: f64::from(self.between(0.52, 0.75)),
            start_deg: f64::from(self.between(-180.0, 180.0)),
            speed_deg: f64::from(self.between(8.0, 20.0)),
            elevation_deg: f64::from(self.between(25.0, 50.0)),
            sway_deg: f64::from(self.between(4.0, 12.0)),
            shake: 0.003,
            seed: self.0.bits(),
        }
    }

    /// What is simulated: everything, or a camera that is better in one way or another.
    fn effects(&mut self) -> EffectSet {
        let mut effects = EffectSet::all().without(Effect::PoseRefinement);
        for (effect, share) in [
            (Effect::Response, 0.3),
            (Effect::Vignetting, 0.2),
            (Effect::Saturation, 0.3),
            (Effect::Noise, 0.1),
        ] {
            if self.happens(share) {
                effects = effects.without(effect);
            }
        }
        effects
    }
}

/// Wall of a bowl, metres: three voxels of the survey's surface. A thinner one is lost in fusion, and what no mirrored
/// ray can meet has no bound.
const WALL: f32 = 0.012;

/// A bowl that opens upwards.
fn bowl(radius: f32, height: f32, foot: Vec3) -> Shape {
    let steps = 12_u32;
    let arc = |step: u32, radius: f32, floor: f32| {
        let (sine, cosine) = (FRAC_PI_2 * step as f32 / steps as f32).sin_cos();
        Vec2::new(radius * sine, floor + (height - floor) * (1.0 - cosine))
    };
    // Up the inside, down the outside: what is around lies on the left.
    let inside = (0..=steps).map(|step| arc(step, radius - WALL, WALL));
    let outside = (0..=steps).rev().map(|step| arc(step, radius, 0.0));
    let profile: Vec<Vec2> = inside.chain(outside).collect();
    Shape::turned(foot, &profile, 64)
}

/// A can, its wall in rings so that light on it is told apart.
fn can(radius: f32, height: f32, foot: Vec3) -> Shape {
    let steps = 12_u32;
    let ring = |step: u32| Vec2::new(radius, height * step as f32 / steps as f32);
    let axis = |height: f32| std::iter::once(Vec2::new(0.0, height));
    let profile: Vec<Vec2> = axis(height)
        .chain((0..=steps).rev().map(ring))
        .chain(axis(0.0))
        .collect();
    Shape::turned(foot, &profile, 64)
}

/// How carefully a scene is filmed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Care {
    /// 24 to 36 frames, one scene in ten at twice the survey's width.
    Full,
    /// As few frames as say something, small and with one sample a pixel.
    Quick,
}

/// The scene number `seed` and how it is filmed.
pub(crate) fn scene(seed: u64, care: Care) -> (Design, FilmOptions) {
    let mut chance = Chance(Stream::new(seed, Purpose::Design, 2, 0));
    let mut design = Design::new("by-chance", "things by chance", chance.things());
    design.room = chance.room();
    let walls = Enclosure {
        center: Vec3::ZERO,
        half: Vec3::splat(chance.between(1.2, 4.0)),
    };
    design.enclosure = chance.happens(0.25).then_some(walls);
    design.path = chance.path();
    let frames = 24 + chance.one_of(13);
    design.split = FrameSplit {
        train: if care == Care::Full { frames } else { 12 },
        gap: 0,
        test: 0,
    };
    design.effects = chance.effects();
    design.corner_light = f64::from(chance.between(0.6, 1.0));
    design.noise = NoiseModel {
        full_well: chance.over_decades(2000.0, 20_000.0),
        read: chance.over_decades(0.001, 0.006),
    };
    let is_wide = chance.happens(0.1);
    let (width, lights, samples) = match (care, is_wide) {
        (Care::Quick, _) => (128, 32, 1),
        // A survey pixel is the mean of four samples.
        (Care::Full, false) => (160, 96, 4),
        (Care::Full, true) => (320, 96, 1),
    };
    let options = FilmOptions {
        width,
        seed,
        quality: LightQuality {
            light_count: lights,
            bounce_count: lights / 12,
        },
        samples,
        paths: 1,
        ..FilmOptions::default()
    };
    (design, options)
}
