//! Ten scenes that stand for the ten captures of the paper (Park 2020, figure 19), with far test views. `bowls` is
//! among the designed ones.

use std::f32::consts::FRAC_PI_2;

use glam::{Quat, Vec2, Vec3};

use super::things::{black, coat, film, paint, print, table, wood};
use crate::design::{Design, FrameSplit, ball, prop, target};
use crate::environment::{Enclosure, Room};
use crate::material::{Bumps, Material};
use crate::shape::Shape;
use crate::texture::Texture;

/// A long walk with far test views.
fn sequence(
    name: &'static str,
    about: &'static str,
    turn: f32,
    things: Vec<(crate::world::Object, Shape)>,
) -> Design {
    let mut design = Design::new(name, about, things);
    design.room = Room {
        turn,
        ..Room::default()
    };
    design.split = FrameSplit {
        train: 124,
        gap: 12,
        test: 64,
    };
    design.duration = 18.0;
    design.path.start_deg = -95.0;
    design.path.speed_deg = 11.0;
    design.path.seed = 2 + (10.0 * turn) as u64;
    design
}

/// A can with a rim, printed in bands.
fn can(radius: f32, height: f32, foot: Vec3) -> Shape {
    let points = [
        [0.0, height - 0.004],
        [radius - 0.006, height - 0.004],
        [radius - 0.004, height],
        [radius - 0.001, height - 0.001],
        [radius, height - 0.008],
        [radius, 0.5 * height],
        [radius, 0.006],
        [radius - 0.004, 0.0],
        [0.0, 0.0],
    ];
    let profile: Vec<Vec2> = points.into_iter().map(Vec2::from_array).collect();
    Shape::turned(foot, &finer(&profile, 0.006), 96)
}

/// The profile with its straight pieces cut into shorter ones.
fn finer(profile: &[Vec2], step: f32) -> Vec<Vec2> {
    let mut fine: Vec<Vec2> = profile.first().copied().into_iter().collect();
    for pair in profile.windows(2) {
        let count = ((pair[1] - pair[0]).length() / step).ceil().max(1.0) as u32;
        fine.extend((1..=count).map(|part| pair[0].lerp(pair[1], part as f32 / count as f32)));
    }
    fine
}

pub(super) fn cans() -> Design {
    let bands = |a: [f32; 3]| Texture::Bands {
        size: 0.022,
        colors: [a, [0.02, 0.02, 0.02], [0.6, 0.6, 0.58]],
    };
    let (left, right) = (Vec3::new(-0.09, 0.0, -0.03), Vec3::new(0.07, 0.0, 0.05));
    // Walls that stand upright mirror the table: one can lies, its axis to the right and a little to the back.
    let lying = can(0.04, 0.14, left)
        .rotated(Quat::from_rotation_z(FRAC_PI_2), left)
        .moved(Vec3::new(0.0, -0.04, 0.0))
        .rotated(Quat::from_rotation_y(-0.4), left);
    sequence(
        "cans",
        "two printed cans with a metal sheen, one of them lying",
        0.0,
        vec![
            table(wood(), 0.4),
            target(
                "red-can",
                Material::glossy(bands([0.6, 0.06, 0.05]), film([0.3; 3], 0.03)),
                left,
                lying,
            ),
            target(
                "blue-can",
                Material::glossy(bands([0.05, 0.12, 0.5]), film([0.25; 3], 0.05)),
                right,
                can(0.045, 0.11, right),
            ),
        ],
    )
}

pub(super) fn figure() -> Design {
    let ceramic = || Material::glossy(paint(0.05), coat(0.06, 0.015));
    let at = |x: f32, y: f32, z: f32| Vec3::new(x, y, z);
    sequence(
        "figure",
        "a glazed ceramic figure",
        0.7,
        vec![
            table(wood(), 0.4),
            ball("body", ceramic(), at(0.0, 0.0, 0.0), 0.07),
            ball("head", ceramic(), at(0.0, -0.12, 0.0), 0.045),
            ball("left-foot", ceramic(), at(-0.055, 0.0, -0.06), 0.028),
            ball("right-foot", ceramic(), at(0.055, 0.0, -0.06), 0.028),
            ball("left-ear", ceramic(), at(-0.04, -0.185, 0.0), 0.018),
            ball("right-ear", ceramic(), at(0.04, -0.185, 0.0), 0.018),
        ],
    )
}

/// Height of a pillow over its outline, 0 at the edge.
fn pillow(s: f32, t: f32) -> f32 {
    let along = |x: f32| (4.0 * x * (1.0 - x)).max(0.0).sqrt();
    along(s) * along(t)
}

pub(super) fn bag() -> Design {
    let surface = |side: f32| {
        Shape::sheet(110, 80, move |s, t| {
            let crease = 0.006 * (9.0 * s + 3.0 * t).sin() * (7.0 * t - 2.0 * s).cos()
                + 0.003 * (23.0 * s - 11.0 * t).sin();
            let thick = pillow(s, t) * (0.036 + crease);
            Vec3::new(0.26 * (s - 0.5), -0.036 - side * thick, 0.19 * (t - 0.5))
        })
    };
    // x × z looks up, and so would the lower side.
    let mut lower = surface(-1.0);
    for normal in &mut lower.normals {
        *normal = -*normal;
    }
    let mut both = surface(1.0);
    both.append(lower);
    sequence(
        "bag",
        "a bag of chips",
        1.4,
        vec![
            table(wood(), 0.4),
            target(
                "bag",
                Material::glossy(print(0.05), film([0.45, 0.43, 0.4], 0.03)),
                Vec3::ZERO,
                both,
            ),
        ],
    )
}

pub(super) fn bottle() -> Design {
    let points = [
        [0.0, 0.24],
        [0.014, 0.24],
        [0.016, 0.235],
        [0.015, 0.19],
        [0.022, 0.165],
        [0.038, 0.14],
        [0.044, 0.12],
        [0.045, 0.06],
        [0.044, 0.01],
        [0.036, 0.0],
        [0.0, 0.0],
    ];
    let profile: Vec<Vec2> = points.into_iter().map(Vec2::from_array).collect();
    let shape = Shape::turned(Vec3::ZERO, &finer(&profile, 0.006), 96);
    let mut design = sequence(
        "bottle",
        "a glossy dark bottle",
        2.1,
        vec![
            table(wood(), 0.4),
            target(
                "bottle",
                Material::glossy(print(0.07), coat(0.08, 0.008)),
                Vec3::ZERO,
                shape,
            ),
        ],
    );
    design.path.center.y = -0.11;
    design
}

pub(super) fn foil() -> Design {
    let shape = Shape::sheet(150, 120, |s, t| {
        let fold = |x: f32| (x.rem_euclid(2.0) - 1.0).abs() - 0.5;
        let crumple = 0.014 * fold(5.0 * s + 1.3 * t)
            + 0.011 * fold(4.2 * t - 2.1 * s + 0.3)
            + 0.007 * fold(9.0 * s + 6.0 * t);
        let dome = 0.05 * pillow(s, t);
        Vec3::new(
            0.26 * (s - 0.5),
            -0.02 - dome - crumple * pillow(s, t).min(1.0),
            0.2 * (t - 0.5),
        )
    });
    sequence(
        "foil",
        "a crumpled shiny bag",
        2.8,
        vec![
            table(wood(), 0.4),
            target(
                "foil",
                Material::glossy(print(0.09), film([0.6, 0.6, 0.58], 0.05)),
                Vec3::ZERO,
                shape,
            ),
        ],
    )
}

pub(super) fn plane() -> Design {
    // A picture that leans back by 20 degrees.
    let lean = 20.0_f32.to_radians();
    let up = Vec3::new(0.0, -lean.cos(), lean.sin());
    let (half_width, height) = (0.13, 0.19);
    let low = Vec3::new(0.0, -0.012, 0.0);
    let glass = Shape::rectangle(
        low - Vec3::X * half_width,
        Vec3::X * 2.0 * half_width,
        up * height,
        0.008,
    );
    let frame_material = || Material::glossy(Texture::Plain([0.25, 0.14, 0.06]), coat(0.05, 0.1));
    let front = Vec3::X.cross(up) * 0.008;
    let rail = |from: Vec3, along: Vec3, across: Vec3| {
        let mut shape = Shape::rectangle(from + front, along, across, 0.01);
        shape.append(Shape::rectangle(from, along, front, 0.01));
        shape.append(Shape::rectangle(from + front + across, along, -front, 0.01));
        shape
    };
    let mut frame = rail(
        low - up * 0.012 - Vec3::X * 0.145,
        Vec3::X * 0.29,
        up * 0.012,
    );
    frame.append(rail(
        low + up * height - Vec3::X * 0.145,
        Vec3::X * 0.29,
        up * 0.012,
    ));
    for x in [-half_width - 0.013, half_width + 0.001] {
        frame.append(rail(low + Vec3::X * x, Vec3::X * 0.012, up * height));
    }
    let mut design = sequence(
        "plane",
        "a picture behind glass in a frame",
        3.5,
        vec![
            table(wood(), 0.4),
            target(
                "glass",
                Material::glossy(print(0.04), coat(0.08, 0.003)),
                low,
                glass,
            ),
            target("frame", frame_material(), low, frame),
        ],
    );
    design.path.center.y = -0.1;
    design.path.elevation_deg = 24.0;
    design.path.sway_deg = 7.0;
    design.path.start_deg = -62.0;
    design.path.speed_deg = 7.0;
    design
}

pub(super) fn fruits() -> Design {
    let skin = |color: [f32; 3], length: f32| {
        let dark = color.map(|value| 0.12 * value);
        let mut material = Material::glossy(
            Texture::Blobs {
                size: 0.03,
                ground: dark,
                inks: [color, color.map(|v| 0.7 * v), [0.5, 0.4, 0.08]],
            },
            coat(0.05, 0.06),
        );
        material.bumps = Some(Bumps {
            tilt: 3.0_f32.to_radians(),
            length,
        });
        material
    };
    sequence(
        "fruits",
        "bumpy fruits",
        4.2,
        vec![
            table(wood(), 0.4),
            ball(
                "orange",
                skin([0.75, 0.33, 0.03], 0.012),
                Vec3::new(-0.06, 0.0, 0.0),
                0.05,
            ),
            ball(
                "apple",
                skin([0.55, 0.05, 0.04], 0.05),
                Vec3::new(0.05, 0.0, -0.03),
                0.045,
            ),
            ball(
                "lime",
                skin([0.18, 0.45, 0.05], 0.015),
                Vec3::new(0.02, 0.0, 0.075),
                0.038,
            ),
        ],
    )
}

pub(super) fn laptop() -> Design {
    let metal = || Material::glossy(Texture::Plain([0.06, 0.06, 0.065]), film([0.55; 3], 0.18));
    let lid_up = Vec3::new(0.0, -0.95, 0.31);
    let hinge = Vec3::new(-0.15, -0.018, 0.09);
    let lid = Shape::rectangle(hinge, Vec3::X * 0.3, lid_up * 0.2, 0.01);
    let screen = Shape::rectangle(
        hinge + Vec3::new(0.012, 0.0, -0.002) + lid_up * 0.012,
        Vec3::X * 0.276,
        lid_up * 0.176,
        0.01,
    );
    let mut board = table(wood(), 0.4);
    board.0.material = Material::glossy(wood(), coat(0.05, 0.05));
    let mut design = sequence(
        "laptop",
        "a laptop of rough metal on glossy wood",
        4.9,
        vec![
            board,
            target(
                "base",
                metal(),
                Vec3::ZERO,
                Shape::cuboid(
                    Vec3::new(0.0, -0.009, 0.0),
                    Vec3::new(0.15, 0.009, 0.1),
                    0.01,
                ),
            ),
            target("lid", metal(), hinge, lid),
            target(
                "screen",
                Material::glossy(print(0.06), coat(0.05, 0.01)),
                hinge,
                screen,
            ),
        ],
    );
    design.path.elevation_deg = 33.0;
    design
}

pub(super) fn room() -> Design {
    let mirror = Material::glossy(black(), coat(0.85, 0.005));
    let mut design = sequence(
        "room",
        "several shiny things in a small room, filmed by someone who is seen",
        5.6,
        vec![
            table(wood(), 0.55),
            ball("mirror", mirror, Vec3::new(-0.16, 0.0, 0.05), 0.08),
            ball(
                "vase",
                Material::glossy(paint(0.05), coat(0.07, 0.02)),
                Vec3::new(0.15, 0.0, 0.08),
                0.07,
            ),
            target(
                "can",
                Material::glossy(print(0.04), film([0.35; 3], 0.04)),
                Vec3::new(0.02, 0.0, -0.12),
                can(0.035, 0.12, Vec3::new(0.02, 0.0, -0.12)),
            ),
            prop(
                "books",
                Material::matte(paint(0.03)),
                Shape::cuboid(
                    Vec3::new(0.0, -0.03, 0.22),
                    Vec3::new(0.12, 0.03, 0.07),
                    0.012,
                ),
            ),
        ],
    );
    design.path.distance = 0.85;
    design.enclosure = Some(Enclosure {
        center: Vec3::new(0.0, -0.3, 0.0),
        half: Vec3::new(2.6, 1.6, 3.2),
    });
    design.has_operator = true;
    design
}
