//! Shapes as triangle meshes with smooth normals. What has a closed form besides (a ball) keeps it: see
//! [`crate::world::ExactSurface`].

use glam::{Quat, Vec2, Vec3};
use std::f32::consts::{PI, TAU};

/// Triangles with a normal a vertex, counter-clockwise seen from outside.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Shape {
    /// Vertices, metres.
    pub positions: Vec<Vec3>,
    /// Unit normals, outward.
    pub normals: Vec<Vec3>,
    /// Vertex indices.
    pub triangles: Vec<[u32; 3]>,
}

/// Cosine of the largest angle between pieces of a profile that are one smooth surface (50 degrees).
const SMOOTH_COSINE: f32 = 0.643;

impl Shape {
    /// The ball about `center`, `rings` from pole to pole (the poles lie on the y axis) and twice as many sectors.
    pub fn ball(center: Vec3, radius: f32, rings: u32) -> Self {
        let mut shape = Self::sheet(2 * rings, rings, |across, down| {
            let (around, polar) = (TAU * across, PI * down);
            center
                + radius
                    * Vec3::new(
                        polar.sin() * around.cos(),
                        -polar.cos(),
                        polar.sin() * around.sin(),
                    )
        });
        for (normal, position) in shape.normals.iter_mut().zip(&shape.positions) {
            *normal = (*position - center) / radius;
        }
        shape.drop_slivers();
        shape.outward()
    }

    /// The surface `at(s, t)` for s, t in [0, 1], `columns` x `rows` squares; normals from neighbours.
    pub fn sheet(columns: u32, rows: u32, at: impl Fn(f32, f32) -> Vec3) -> Self {
        let mut shape = Self::default();
        for row in 0..=rows {
            for column in 0..=columns {
                let (s, t) = (column as f32 / columns as f32, row as f32 / rows as f32);
                shape.positions.push(at(s, t));
                let step = 0.25;
                let (ds, dt) = (step / columns as f32, step / rows as f32);
                let across = at(s + ds, t) - at(s - ds, t);
                let down = at(s, t + dt) - at(s, t - dt);
                shape.normals.push(across.cross(down).normalize_or_zero());
            }
        }
        for row in 0..rows {
            for column in 0..columns {
                let vertex = |r: u32, c: u32| r * (columns + 1) + c;
                let [a, b, c, d] = [
                    vertex(row, column),
                    vertex(row, column + 1),
                    vertex(row + 1, column + 1),
                    vertex(row + 1, column),
                ];
                shape.triangles.extend([[a, b, c], [a, c, d]]);
            }
        }
        shape
    }

    /// The rectangle `corner + s·across + t·down`, in squares of about `step` metres.
    pub fn rectangle(corner: Vec3, across: Vec3, down: Vec3, step: f32) -> Self {
        let count = |edge: Vec3| ((edge.length() / step).ceil() as u32).clamp(1, 400);
        Self::sheet(count(across), count(down), |s, t| {
            corner + s * across + t * down
        })
    }

    /// The box about `center`.
    pub fn cuboid(center: Vec3, half: Vec3, step: f32) -> Self {
        let mut shape = Self::default();
        for [normal, across] in [[Vec3::X, Vec3::Y], [Vec3::Y, Vec3::Z], [Vec3::Z, Vec3::X]] {
            for normal in [normal, -normal] {
                let down = normal.cross(across);
                let corner = center + half * (normal - across - down);
                shape.append(Self::rectangle(
                    corner,
                    2.0 * half * across,
                    2.0 * half * down,
                    step,
                ));
            }
        }
        shape
    }

    /// What `profile` (radius, height above the ground y = 0; metres) sweeps around the vertical axis through `foot`.
    /// The profile runs with the outside on its left when radius points right and height up. Corners sharper than 50
    /// degrees stay sharp.
    pub fn turned(foot: Vec3, profile: &[Vec2], sectors: u32) -> Self {
        let mut shape = Self::default();
        let edge = |index: usize| -> Option<Vec2> {
            let (a, b) = (profile.get(index)?, profile.get(index + 1)?);
            let along = (*b - *a).normalize_or_zero();
            Some(Vec2::new(-along.y, along.x))
        };
        for index in 0..profile.len().saturating_sub(1) {
            let own = edge(index).unwrap_or_default();
            let smooth = |other: Option<Vec2>| match other {
                Some(other) if other.dot(own) > SMOOTH_COSINE => (own + other).normalize_or(own),
                _ => own,
            };
            let ends = [
                (profile[index], smooth(index.checked_sub(1).and_then(edge))),
                (profile[index + 1], smooth(edge(index + 1))),
            ];
            shape.append(Self::band(foot, ends, sectors));
        }
        shape.drop_slivers();
        shape.outward()
    }

    /// One piece of a turned profile: two circles with their normals.
    fn band(foot: Vec3, ends: [(Vec2, Vec2); 2], sectors: u32) -> Self {
        let mut shape = Self::default();
        for (point, normal) in ends {
            for sector in 0..=sectors {
                let around = TAU * sector as f32 / sectors as f32;
                let spoke = Vec3::new(around.cos(), 0.0, around.sin());
                shape
                    .positions
                    .push(foot + spoke * point.x - Vec3::Y * point.y);
                shape
                    .normals
                    .push((spoke * normal.x - Vec3::Y * normal.y).normalize_or_zero());
            }
        }
        for sector in 0..sectors {
            let (low, high) = (sector, sector + sectors + 1);
            shape
                .triangles
                .extend([[low, low + 1, high + 1], [low, high + 1, high]]);
        }
        shape
    }

    /// Adds another shape's triangles.
    pub fn append(&mut self, other: Self) {
        let first = self.positions.len() as u32;
        self.positions.extend(other.positions);
        self.normals.extend(other.normals);
        self.triangles
            .extend(other.triangles.iter().map(|t| t.map(|v| v + first)));
    }

    /// Moves each vertex.
    #[must_use]
    pub fn moved(mut self, by: Vec3) -> Self {
        for position in &mut self.positions {
            *position += by;
        }
        self
    }

    /// Turns the shape about a point.
    #[must_use]
    pub fn rotated(mut self, rotation: Quat, pivot: Vec3) -> Self {
        for position in &mut self.positions {
            *position = pivot + rotation * (*position - pivot);
        }
        for normal in &mut self.normals {
            *normal = rotation * *normal;
        }
        self
    }

    /// Takes triangles without area out: a ring of a pole is one point.
    fn drop_slivers(&mut self) {
        let positions = &self.positions;
        self.triangles.retain(|t| {
            let [a, b, c] = t.map(|v| positions[v as usize]);
            (b - a).cross(c - a).length() > 1e-12
        });
    }

    /// Orders the corners of each triangle so that its facet looks where its normals look.
    fn outward(mut self) -> Self {
        for t in &mut self.triangles {
            let [a, b, c] = t.map(|v| self.positions[v as usize]);
            let normal: Vec3 = t.map(|v| self.normals[v as usize]).iter().sum();
            if (b - a).cross(c - a).dot(normal) < 0.0 {
                t.swap(1, 2);
            }
        }
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn area(shape: &Shape) -> f64 {
        let corner = |v: u32| shape.positions[v as usize].as_dvec3();
        shape
            .triangles
            .iter()
            .map(|t| {
                let [a, b, c] = t.map(corner);
                0.5 * (b - a).cross(c - a).length()
            })
            .sum()
    }

    /// By the divergence theorem: positive when facets look outward.
    fn volume(shape: &Shape) -> f64 {
        let corner = |v: u32| shape.positions[v as usize].as_dvec3();
        shape
            .triangles
            .iter()
            .map(|t| {
                let [a, b, c] = t.map(corner);
                a.dot(b.cross(c)) / 6.0
            })
            .sum()
    }

    #[test]
    fn a_ball_has_its_area_volume_and_outward_normals() {
        let ball = Shape::ball(Vec3::new(0.3, -0.2, 1.0), 0.5, 64);
        let pi = std::f64::consts::PI;
        assert!((area(&ball) / pi - 1.0).abs() < 2e-3, "{}", area(&ball));
        assert!((volume(&ball) / (pi / 6.0) - 1.0).abs() < 3e-3);
        for (position, normal) in ball.positions.iter().zip(&ball.normals) {
            let expected = (*position - Vec3::new(0.3, -0.2, 1.0)) / 0.5;
            assert!((*normal - expected).length() < 1e-5);
        }
    }

    #[test]
    fn a_turned_cylinder_has_its_area_and_volume_and_sharp_rims() {
        let profile = [
            Vec2::new(0.0, 0.0),
            Vec2::new(0.3, 0.0),
            Vec2::new(0.3, 0.8),
            Vec2::new(0.0, 0.8),
        ];
        let profile: Vec<Vec2> = profile.into_iter().rev().collect();
        let can = Shape::turned(Vec3::ZERO, &profile, 256);
        let pi = std::f64::consts::PI;
        let expected = 2.0 * pi * 0.3 * 0.8 + 2.0 * pi * 0.09;
        assert!((area(&can) / expected - 1.0).abs() < 1e-3, "{}", area(&can));
        assert!(
            (volume(&can) / (pi * 0.09 * 0.8) - 1.0).abs() < 1e-3,
            "{}",
            volume(&can)
        );
        let axial = can.normals.iter().filter(|n| n.y.abs() > 0.999).count();
        let radial = can.normals.iter().filter(|n| n.y.abs() < 0.001).count();
        assert_eq!(axial + radial, can.normals.len(), "rims are sharp");
    }

    #[test]
    fn a_box_looks_outward_and_has_its_volume() {
        let cuboid = Shape::cuboid(Vec3::ONE, Vec3::new(0.1, 0.2, 0.3), 0.1);
        assert!(
            (volume(&cuboid) - 8.0 * 0.006).abs() < 1e-6,
            "{}",
            volume(&cuboid)
        );
    }
}
