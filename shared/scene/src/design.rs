//! What a scene is, before it is filmed.

use effects::{Effect, EffectSet};
use geometry::DVec2;
use glam::Vec3;
use imaging::Vignetting;

use crate::environment::{Enclosure, Room};
use crate::material::Material;
use crate::path::HandHeld;
use crate::sensor::NoiseModel;
use crate::shape::Shape;
use crate::world::{ExactSurface, Object};

/// Frames for training, left out, and held out, in the order of the path.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FrameSplit {
    /// Frames that training sees.
    pub train: u32,
    /// Frames that nobody sees.
    pub gap: u32,
    /// Held-out frames, far along the path.
    pub test: u32,
}

impl FrameSplit {
    /// All frames.
    pub fn count(self) -> u32 {
        self.train + self.gap + self.test
    }

    /// The same shares of `count` frames, at least one of each kind that there was.
    #[must_use]
    pub fn scaled(self, count: u32) -> Self {
        let share = |part: u32| (part * count + self.count() / 2) / self.count();
        let test = share(self.test).max(self.test.min(1));
        let gap = share(self.gap).max(self.gap.min(1));
        Self {
            train: count.saturating_sub(test + gap).max(1),
            gap,
            test,
        }
    }
}

/// When the rows of the colour sensor see.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Shutter {
    /// From the first row to the last, seconds; 0 for all at once.
    pub readout: f64,
    /// How long a row sees, seconds; 0 for an instant.
    pub exposure: f64,
}

/// Errors that are put in on purpose.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Errors {
    /// Deviation of the recorded poses' positions, metres an axis. Their truth stays exact.
    pub pose_translation: f64,
    /// Deviation of their directions, radians an axis.
    pub pose_rotation: f64,
    /// Deviation of the vertices that the depth sensor meets, metres along their normals.
    pub mesh_noise: f32,
    /// Factor of the depth sensor's surface about the object's middle.
    pub mesh_scale: Option<f32>,
}

/// A scene, its light and how it is filmed.
#[derive(Clone, Debug)]
pub struct Design {
    /// Name as typed.
    pub name: &'static str,
    /// One line for people.
    pub about: &'static str,
    /// Objects with their shapes.
    pub things: Vec<(Object, Shape)>,
    /// The light.
    pub room: Room,
    /// Walls at a finite distance that carry it.
    pub enclosure: Option<Enclosure>,
    /// The camera's path.
    pub path: HandHeld,
    /// Length of the path, seconds.
    pub duration: f64,
    /// Frames.
    pub split: FrameSplit,
    /// What there is to simulate: the others do not occur here.
    pub effects: EffectSet,
    /// Light that the lens keeps at the corner of the picture.
    pub corner_light: f64,
    /// Noise of the colour sensor.
    pub noise: NoiseModel,
    /// Rows of the colour sensor.
    pub shutter: Shutter,
    /// Whether the person who films is seen in the reflections.
    pub has_operator: bool,
    /// Errors on purpose.
    pub errors: Errors,
}

impl Design {
    /// An ordinary capture of `things` in the default room.
    pub fn new(name: &'static str, about: &'static str, things: Vec<(Object, Shape)>) -> Self {
        Self {
            name,
            about,
            things,
            room: Room::default(),
            enclosure: None,
            path: HandHeld {
                center: glam::DVec3::new(0.0, -0.07, 0.0),
                distance: 0.62,
                start_deg: -75.0,
                speed_deg: 13.0,
                elevation_deg: 36.0,
                sway_deg: 11.0,
                shake: 0.003,
                seed: 1,
            },
            duration: 12.0,
            split: FrameSplit {
                train: 90,
                gap: 6,
                test: 24,
            },
            effects: EffectSet::all().without(Effect::PoseRefinement),
            corner_light: 0.72,
            noise: NoiseModel {
                full_well: 9000.0,
                read: 0.002,
            },
            shutter: Shutter::default(),
            has_operator: false,
            errors: Errors::default(),
        }
    }

    /// The lens, for frames of this size.
    pub(crate) fn vignetting(&self, width: u32, height: u32) -> Vignetting {
        let center = DVec2::new(f64::from(width - 1), f64::from(height - 1)) * 0.5;
        let radius = center.length().max(1.0);
        Vignetting::even_polynomial(center, radius, self.vignetting_terms())
            .unwrap_or(Vignetting::none())
    }

    /// a₁, a₂, a₃ over the distance from the middle to the corner.
    pub fn vignetting_terms(&self) -> [f64; 3] {
        let loss = 1.0 - self.corner_light;
        [-1.3 * loss, 0.3 * loss, 0.0]
    }
}

/// A thing that the scene is about.
pub fn target(name: &str, material: Material, anchor: Vec3, shape: Shape) -> (Object, Shape) {
    let object = Object {
        name: name.to_owned(),
        material,
        anchor,
        exact: ExactSurface::Mesh,
        is_target: true,
    };
    (object, shape)
}

/// A thing that stands about.
pub fn prop(name: &str, material: Material, shape: Shape) -> (Object, Shape) {
    let (mut object, shape) = target(name, material, Vec3::ZERO, shape);
    object.is_target = false;
    (object, shape)
}

/// A ball with its closed form, standing with its lowest point at `foot`.
pub fn ball(name: &str, material: Material, foot: Vec3, radius: f32) -> (Object, Shape) {
    let center = foot - Vec3::Y * radius;
    let (mut object, shape) = target(name, material, center, Shape::ball(center, radius, 64));
    object.exact = ExactSurface::Ball { center, radius };
    (object, shape)
}
