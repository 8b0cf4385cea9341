//! The scenes of effects-and-tradeoffs A6: each with one thing to find out about an effect.

use effects::{Effect, EffectSet};
use glam::{Vec2, Vec3};

use super::things::{black, coat, film, paint, print, table, wood};
use crate::design::{Design, Errors, FrameSplit, ball, target};
use crate::environment::{BAR_WIDTHS, Bars, Enclosure, Room};
use crate::material::{Bumps, Finish, Material};
use crate::shape::Shape;

/// Widths of the bars in a furnished room, degrees: the wider ones of the full target would be the room.
const ROOM_BARS: [f64; 5] = [2.88, 2.16, 1.44, 1.08, 0.72];

fn room_with_bars() -> Room {
    Room {
        bars: Some(Bars::new(&ROOM_BARS, 11)),
        ..Room::default()
    }
}

/// A flat printed sheet that lies on nothing.
fn sheet(name: &'static str, about: &'static str, finish: Finish) -> Design {
    let half = Vec3::new(0.34, 0.0, 0.26);
    let shape = Shape::rectangle(
        Vec3::new(-half.x, 0.0, -half.z),
        Vec3::X * 2.0 * half.x,
        Vec3::Z * 2.0 * half.z,
        0.01,
    );
    let material = Material {
        texture: print(0.035),
        finish,
        bumps: None,
    };
    let mut design = Design::new(
        name,
        about,
        vec![target("sheet", material, Vec3::ZERO, shape)],
    );
    design.path.center.y = 0.0;
    design.path.elevation_deg = 48.0;
    design
}

pub(super) fn matte() -> Design {
    sheet(
        "matte",
        "a flat Lambertian sheet with a printed texture",
        Finish::Matte,
    )
}

pub(super) fn matte_clean() -> Design {
    let mut design = sheet(
        "matte-clean",
        "the sheet of `matte` through a lens without fall-off and a straight response",
        Finish::Matte,
    );
    design.effects = EffectSet::NONE.with(Effect::Noise);
    design
}

pub(super) fn shiny_plane() -> Design {
    sheet(
        "shiny-plane",
        "the sheet of `matte` under a glossy varnish",
        Finish::Even(film([0.3; 3], 0.02)),
    )
}

/// A ball alone in the air.
fn floating(name: &'static str, about: &'static str, material: Material) -> Design {
    let mut design = Design::new(
        name,
        about,
        vec![ball("ball", material, Vec3::new(0.0, 0.03, 0.0), 0.1)],
    );
    design.room = room_with_bars();
    design
}

pub(super) fn mirror_ball() -> Design {
    let mut design = floating(
        "mirror-ball",
        "a mirroring ball alone, between bar targets",
        Material::glossy(black(), coat(0.9, 0.004)),
    );
    design.room.bars = Some(Bars::new(&BAR_WIDTHS, 11));
    design
}

pub(super) fn ball_on_table() -> Design {
    Design::new(
        "ball-on-table",
        "a mirroring ball on a textured matte table",
        vec![
            table(wood(), 0.45),
            ball(
                "ball",
                Material::glossy(black(), coat(0.9, 0.01)),
                Vec3::ZERO,
                0.1,
            ),
        ],
    )
}

pub(super) fn plastic_ball() -> Design {
    floating(
        "plastic-ball",
        "a ball of dark glossy plastic alone",
        Material::glossy(print(0.05), coat(0.04, 0.02)),
    )
}

/// A bowl with a wall 4 mm thick and its rim at `height`.
fn bowl(radius: f32, height: f32, foot: Vec3) -> Shape {
    let steps = 20;
    let inner = |at: f32| {
        let angle = std::f32::consts::FRAC_PI_2 * at;
        Vec2::new(
            (radius - 0.004) * angle.sin(),
            0.004 + (height - 0.004) * (1.0 - angle.cos()),
        )
    };
    let outer = |at: f32| {
        let angle = std::f32::consts::FRAC_PI_2 * at;
        Vec2::new(radius * angle.sin(), height * (1.0 - angle.cos()))
    };
    // Outside on the left: up the outside would have it on the right, so down the outside, after the inside up.
    let mut profile: Vec<Vec2> = (0..=steps)
        .map(|step| inner(step as f32 / steps as f32))
        .collect();
    profile.extend(
        (0..=steps)
            .rev()
            .map(|step| outer(step as f32 / steps as f32)),
    );
    Shape::turned(foot, &profile, 96)
}

pub(super) fn bowls() -> Design {
    let mut shape = bowl(0.15, 0.085, Vec3::ZERO);
    shape.append(bowl(0.085, 0.05, Vec3::new(0.0, -0.012, 0.0)));
    let material = Material::glossy(print(0.05), coat(0.5, 0.02));
    let mut design = Design::new(
        "bowls",
        "two nested glossy bowls in a far room",
        vec![
            table(wood(), 0.4),
            target("bowls", material, Vec3::ZERO, shape),
        ],
    );
    // One of the paper's ten as well: the same far test views.
    design.split = FrameSplit {
        train: 120,
        gap: 10,
        test: 60,
    };
    design.duration = 17.0;
    design.path.start_deg = -90.0;
    design.path.elevation_deg = 44.0;
    design
}

pub(super) fn two_materials() -> Design {
    let material = Material {
        texture: print(0.05),
        finish: Finish::Patches(film([0.5; 3], 0.01), film([0.5; 3], 0.2), 0.06),
        bumps: None,
    };
    floating(
        "two-materials",
        "a ball with patches of mirror and satin",
        material,
    )
}

pub(super) fn one_material() -> Design {
    floating(
        "one-material",
        "a ball of one satin finish",
        Material::glossy(print(0.05), film([0.4; 3], 0.06)),
    )
}

/// A glossy ball of 30 cm in a box whose walls are this far away.
fn boxed(name: &'static str, about: &'static str, walls: f32) -> Design {
    let material = Material::glossy(print(0.06), film([0.4; 3], 0.01));
    let foot = Vec3::new(0.0, 0.15, 0.0);
    let mut design = Design::new(name, about, vec![ball("ball", material, foot, 0.15)]);
    design.path.center.y = 0.0;
    design.path.distance = 0.68;
    design.enclosure = Some(Enclosure {
        center: Vec3::ZERO,
        half: Vec3::splat(walls),
    });
    design
}

pub(super) fn close_room() -> Design {
    boxed("close-room", "a ball of 30 cm with walls 1 m away", 1.0)
}

pub(super) fn far_room() -> Design {
    boxed(
        "far-room",
        "the ball of `close-room` with walls 20 m away",
        20.0,
    )
}

pub(super) fn vignette_40() -> Design {
    let mut design = Design::new(
        "vignette-40",
        "a painted box through a lens that loses 40 % at the corners",
        vec![
            table(paint(0.05), 0.4),
            target(
                "box",
                Material::matte(paint(0.03)),
                Vec3::ZERO,
                Shape::cuboid(
                    Vec3::new(0.0, -0.06, 0.0),
                    Vec3::new(0.09, 0.06, 0.07),
                    0.01,
                ),
            ),
        ],
    );
    design.corner_light = 0.6;
    design
}

pub(super) fn pose_noise() -> Design {
    let mut design = Design::new(
        "pose-noise",
        "glossy balls filmed with poses that are a pixel wrong",
        vec![
            table(wood(), 0.4),
            ball(
                "left",
                Material::glossy(print(0.05), film([0.3; 3], 0.02)),
                Vec3::new(-0.09, 0.0, 0.0),
                0.075,
            ),
            ball(
                "right",
                Material::glossy(print(0.04), film([0.3; 3], 0.02)),
                Vec3::new(0.09, 0.0, 0.02),
                0.06,
            ),
        ],
    );
    // A pixel of 525 a radian at 0.62 m, half of it by place and half by direction.
    design.errors = Errors {
        pose_translation: 0.0008,
        pose_rotation: 0.0013,
        ..Errors::default()
    };
    design.effects = EffectSet::all();
    design
}

pub(super) fn bumpy_normals() -> Design {
    let mut material = Material::glossy(print(0.05), film([0.4; 3], 0.01));
    material.bumps = Some(Bumps {
        tilt: 1.0_f32.to_radians(),
        length: 0.02,
    });
    floating(
        "bumpy-normals",
        "a glossy ball whose normals waver by a degree, finer than depth sees",
        material,
    )
}

pub(super) fn near_threshold() -> Design {
    let ground = Material::glossy(print(0.05), film([0.05; 3], 0.02));
    Design::new(
        "near-threshold",
        "a faintly glossy ball on a dark table: its first bounce is worth about the threshold",
        vec![
            table(
                crate::texture::Texture::Checker {
                    size: 0.05,
                    a: [0.12, 0.1, 0.09],
                    b: [0.05, 0.05, 0.06],
                },
                0.45,
            ),
            ball("ball", ground, Vec3::ZERO, 0.1),
        ],
    )
}
