//! A furnished room as a function of direction: windows, lamps, a person, shelves and, on request, bar targets.

use glam::{Vec2, Vec3};

use super::bars::Bars;

/// A room seen from the middle of its floor plan, 1.1 m above the floor.
#[derive(Clone, Debug, PartialEq)]
pub struct Room {
    /// Half of its extent in x, up, down and z, metres.
    pub extent: RoomExtent,
    /// Turns the furniture about the vertical, radians.
    pub turn: f32,
    /// Factor of all light.
    pub brightness: f32,
    /// Targets, in place of what lies behind them.
    pub bars: Option<Bars>,
}

/// Distances from where the room is seen, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RoomExtent {
    /// To the walls at left and right.
    pub x: f32,
    /// To the ceiling.
    pub up: f32,
    /// To the floor.
    pub down: f32,
    /// To the walls before and behind.
    pub z: f32,
}

impl Default for Room {
    fn default() -> Self {
        Self {
            extent: RoomExtent {
                x: 2.6,
                up: 1.6,
                down: 1.1,
                z: 3.2,
            },
            turn: 0.0,
            brightness: 1.0,
            bars: None,
        }
    }
}

const WALL: [f32; 3] = [0.30, 0.28, 0.25];
const SKY: [f32; 3] = [2.6, 3.0, 3.6];
const LAMP: [f32; 3] = [26.0, 22.0, 16.0];

/// Whether a point of a wall lies in the rectangle about `middle`.
fn in_rectangle(point: Vec2, middle: [f32; 2], half: [f32; 2]) -> bool {
    (point.x - middle[0]).abs() < half[0] && (point.y - middle[1]).abs() < half[1]
}

/// A number in [0, 1) that belongs to a whole number.
fn of_index(index: f32) -> f32 {
    ((index * 12.9898 + 4.1).sin() * 43_758.547).rem_euclid(1.0)
}

impl Room {
    /// Radiance that comes from `direction` (unit, world axes).
    pub fn radiance(&self, direction: Vec3) -> [f32; 3] {
        if let Some(value) = self.bars.as_ref().and_then(|bars| bars.radiance(direction)) {
            return [value; 3];
        }
        let (sine, cosine) = self.turn.sin_cos();
        let d = Vec3::new(
            cosine * direction.x - sine * direction.z,
            direction.y,
            sine * direction.x + cosine * direction.z,
        );
        let RoomExtent { x, up, down, z } = self.extent;
        let vertical = if d.y < 0.0 { up } else { down };
        let reach = [
            (d.x.abs() / x, 0),
            (d.z.abs() / z, 1),
            (d.y.abs() / vertical, 2),
        ];
        let (inverse, axis) = reach
            .into_iter()
            .max_by(|a, b| a.0.total_cmp(&b.0))
            .unwrap_or_default();
        let hit = d / inverse.max(1e-9);
        let height = -hit.y;
        let color = match axis {
            0 if d.x > 0.0 => self.window_wall(Vec2::new(hit.z, height)),
            0 => shelf_wall(Vec2::new(hit.z, height)),
            1 if d.z > 0.0 => person_wall(Vec2::new(hit.x, height)),
            1 => door_wall(Vec2::new(hit.x, height)),
            _ if d.y < 0.0 => ceiling(Vec2::new(hit.x, hit.z)),
            _ => floor(Vec2::new(hit.x, hit.z)),
        };
        color.map(|value| value * self.brightness)
    }

    /// Two windows with crossbars; the sky gets brighter upward.
    fn window_wall(&self, p: Vec2) -> [f32; 3] {
        for middle in [-1.35, 1.05] {
            let half = [0.62, 0.55];
            if !in_rectangle(p, [middle, 0.45], half) {
                continue;
            }
            let is_bar = (p.x - middle).abs() < 0.035 || (p.y - 0.55).abs() < 0.03;
            let is_frame = !in_rectangle(p, [middle, 0.45], [half[0] - 0.06, half[1] - 0.06]);
            if is_bar || is_frame {
                return [0.55, 0.52, 0.48];
            }
            let sky = 0.55 + 0.45 * ((p.y + 0.1) / 1.1).clamp(0.0, 1.0);
            return if p.y < 0.12 {
                [0.45, 0.62, 0.35]
            } else {
                SKY.map(|value| value * sky)
            };
        }
        plain_wall(p)
    }
}

fn plain_wall(p: Vec2) -> [f32; 3] {
    if p.y < -0.95 {
        return [0.14, 0.10, 0.07];
    }
    // Brighter towards the ceiling, as walls lit from above are.
    let shade = 1.0 + 0.18 * p.y;
    WALL.map(|value| value * shade)
}

/// Books on three shelves, each of its own colour and height.
fn shelf_wall(p: Vec2) -> [f32; 3] {
    if !in_rectangle(p, [0.2, 0.1], [1.5, 0.95]) {
        return plain_wall(p);
    }
    let shelf = ((p.y + 0.85) / 0.48).floor();
    let above_board = (p.y + 0.85).rem_euclid(0.48);
    if above_board < 0.05 {
        return [0.32, 0.2, 0.1];
    }
    let book = (p.x / 0.11).floor();
    let key = book + 37.0 * shelf;
    if above_board > 0.27 + 0.17 * of_index(key + 0.5) {
        return [0.05, 0.04, 0.035];
    }
    [
        0.08 + 0.55 * of_index(key),
        0.08 + 0.5 * of_index(key + 0.21),
        0.08 + 0.45 * of_index(key + 0.43),
    ]
}

/// A person before a bright curtain, and a picture.
fn person_wall(p: Vec2) -> [f32; 3] {
    let person = p - Vec2::new(-0.9, 0.0);
    let head = (person - Vec2::new(0.0, 0.55)) / Vec2::new(0.14, 0.18);
    let body = (person - Vec2::new(0.0, -0.35)) / Vec2::new(0.33, 0.72);
    let arm = (person - Vec2::new(0.33, 0.12)) / Vec2::new(0.3, 0.09);
    if head.length_squared() < 1.0 {
        return [0.16, 0.10, 0.08];
    }
    if body.length_squared() < 1.0 || arm.length_squared() < 1.0 {
        return [0.03, 0.04, 0.07];
    }
    if in_rectangle(p, [-0.9, 0.1], [0.95, 1.05]) {
        let fold = (p.x * 21.0).sin();
        return [0.78, 0.72, 0.6].map(|value| value * (0.8 + 0.12 * fold));
    }
    if in_rectangle(p, [1.2, 0.4], [0.5, 0.36]) {
        if !in_rectangle(p, [1.2, 0.4], [0.45, 0.31]) {
            return [0.06, 0.05, 0.04];
        }
        let wave = (p.x * 9.0).sin() * (p.y * 11.0).cos();
        return [0.45 + 0.3 * wave, 0.3 - 0.1 * wave, 0.22];
    }
    plain_wall(p)
}

/// A door, a dark cupboard and a standing lamp.
fn door_wall(p: Vec2) -> [f32; 3] {
    let lamp = p - Vec2::new(-1.6, 0.45);
    if lamp.y.abs() < 0.16 && lamp.x.abs() < 0.14 + 0.25 * (0.16 - lamp.y) {
        return [7.0, 5.2, 3.0];
    }
    if lamp.x.abs() < 0.015 && lamp.y < 0.0 {
        return [0.05, 0.05, 0.05];
    }
    if in_rectangle(p, [0.3, -0.1], [0.45, 0.98]) {
        let panel =
            in_rectangle(p, [0.3, 0.35], [0.3, 0.35]) || in_rectangle(p, [0.3, -0.55], [0.3, 0.3]);
        return if panel {
            [0.52, 0.5, 0.46]
        } else {
            [0.62, 0.6, 0.56]
        };
    }
    if in_rectangle(p, [1.7, -0.35], [0.55, 0.7]) {
        return [0.07, 0.05, 0.04];
    }
    plain_wall(p)
}

/// Two rows of lamps and a beam.
fn ceiling(p: Vec2) -> [f32; 3] {
    for middle in [[-0.9, -0.8], [0.9, -0.8], [-0.9, 1.4], [0.9, 1.4]] {
        if in_rectangle(p, middle, [0.3, 0.08]) {
            return LAMP;
        }
    }
    if (p.y - 0.3).abs() < 0.12 {
        return [0.16, 0.12, 0.08];
    }
    [0.42, 0.41, 0.39]
}

/// Planks and a carpet.
fn floor(p: Vec2) -> [f32; 3] {
    if in_rectangle(p, [0.0, 0.0], [1.3, 1.8]) {
        return [0.16, 0.06, 0.06];
    }
    let plank = of_index((p.x / 0.16).floor());
    [0.2, 0.14, 0.09].map(|value| value * (0.7 + 0.5 * plank))
}
