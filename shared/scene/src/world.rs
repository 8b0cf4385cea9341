//! Objects in their light, ready for rays.

use glam::Vec3;
use raytrace::{MirrorQuery, Ray, Scene};

use crate::environment::Environment;
use crate::error::SceneError;
use crate::irradiance;
use crate::material::Material;
use crate::shape::Shape;

/// The closed form of a surface, where it has one: hits and normals are then exact, and the mesh only says where to
/// look.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ExactSurface {
    /// None: the mesh is the surface.
    Mesh,
    /// A ball.
    Ball {
        /// Middle, metres.
        center: Vec3,
        /// Radius, metres.
        radius: f32,
    },
}

/// One thing in a scene.
#[derive(Clone, Debug, PartialEq)]
pub struct Object {
    /// Name, as it stands in `truth/manifest.json`.
    pub name: String,
    /// What it is made of.
    pub material: Material,
    /// Origin of its textures, metres.
    pub anchor: Vec3,
    /// Closed form.
    pub exact: ExactSurface,
    /// Whether it is what the scene is about: masks show glossy targets.
    pub is_target: bool,
}

/// Where a ray meets the scene.
#[derive(Clone, Copy, Debug)]
pub struct SurfacePoint {
    /// Position, metres.
    pub position: Vec3,
    /// Unit normal of the facet, on the side that the ray comes from.
    pub facet: Vec3,
    /// Unit shading normal, without waves, on the same side.
    pub normal: Vec3,
    /// Index of the object.
    pub object: u16,
    /// Irradiance over π: what a white matte surface would send out.
    pub light: [f32; 3],
    /// Distance along the ray, in lengths of its direction.
    pub distance: f32,
}

/// How carefully the light on matte surfaces is gathered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LightQuality {
    /// Directions of the environment's light, shared by all vertices.
    pub light_count: u32,
    /// Directions a vertex in which light from other surfaces is looked for.
    pub bounce_count: u32,
}

impl Default for LightQuality {
    fn default() -> Self {
        Self {
            light_count: 384,
            bounce_count: 32,
        }
    }
}

/// All objects as one mesh with light on it.
#[derive(Clone, Debug)]
pub struct World {
    /// The objects.
    pub objects: Vec<Object>,
    /// The light around.
    pub environment: Environment,
    pub(crate) mesh: Shape,
    pub(crate) object_of_triangle: Vec<u16>,
    pub(crate) scene: Scene,
    /// Irradiance over π, a vertex.
    pub(crate) light: Vec<[f32; 3]>,
}

impl World {
    /// Builds the tree and gathers the light.
    ///
    /// # Errors
    /// More triangles than a tree holds.
    pub fn new(
        things: Vec<(Object, Shape)>,
        environment: Environment,
        quality: LightQuality,
        seed: u64,
    ) -> Result<Self, SceneError> {
        let mut mesh = Shape::default();
        let mut object_of_triangle = Vec::new();
        let mut objects = Vec::new();
        for (object, shape) in things {
            let number = objects.len() as u16;
            object_of_triangle.extend(std::iter::repeat_n(number, shape.triangles.len()));
            mesh.append(shape);
            objects.push(object);
        }
        let scene = Scene::new(&mesh.positions, &mesh.triangles)?;
        let mut world = Self {
            objects,
            environment,
            light: vec![[0.0; 3]; mesh.positions.len()],
            mesh,
            object_of_triangle,
            scene,
        };
        world.light = irradiance::gather(&world, quality, seed);
        Ok(world)
    }

    /// The mesh: truth for those who compare surfaces.
    pub fn mesh(&self) -> &Shape {
        &self.mesh
    }

    /// Object of every triangle of [`World::mesh`].
    pub fn object_of_triangle(&self) -> &[u16] {
        &self.object_of_triangle
    }

    /// Light on every vertex of [`World::mesh`]: irradiance over π.
    pub fn vertex_light(&self) -> &[[f32; 3]] {
        &self.light
    }

    /// The tree over the mesh.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// What `ray` meets first.
    pub fn closest(&self, ray: &Ray) -> Option<SurfacePoint> {
        let hit = self.scene.closest(ray)?;
        Some(self.point_at(ray, &hit))
    }

    /// The surface at a hit of `ray`.
    pub(crate) fn point_at(&self, ray: &Ray, hit: &raytrace::Hit) -> SurfacePoint {
        let corners = self.mesh.triangles[hit.triangle as usize];
        let [a, b, c] = corners.map(|v| self.mesh.positions[v as usize]);
        let weights = [1.0 - hit.u - hit.v, hit.u, hit.v];
        let mixed = |values: [Vec3; 3]| {
            values[0] * weights[0] + values[1] * weights[1] + values[2] * weights[2]
        };
        let facet = (b - a).cross(c - a).normalize_or(-ray.direction);
        let facet = facing(facet, ray.direction);
        let light = corners.map(|v| self.light[v as usize]);
        let object = self.object_of_triangle[hit.triangle as usize];
        let mut point = SurfacePoint {
            position: mixed([a, b, c]),
            facet,
            normal: mixed(corners.map(|v| self.mesh.normals[v as usize])).normalize_or(facet),
            object,
            light: std::array::from_fn(|i| {
                light[0][i] * weights[0] + light[1][i] * weights[1] + light[2][i] * weights[2]
            }),
            distance: hit.t,
        };
        if let ExactSurface::Ball { center, radius } = self.objects[usize::from(object)].exact {
            snap_to_ball(&mut point, ray, center, radius);
        }
        // A normal that looks away from the ray at a silhouette is taken to the horizon.
        point.normal = facing_shading(point.normal, point.facet, ray.direction);
        point
    }

    /// Where a ray leaves the surface at `point` without meeting it.
    pub(crate) fn leaving(point: &SurfacePoint, direction: Vec3) -> Ray {
        let facet = if direction.dot(point.facet) < 0.0 {
            -point.facet
        } else {
            point.facet
        };
        Ray::new(
            MirrorQuery::for_exact().start(point.position, facet),
            direction,
        )
    }
}

fn facing(normal: Vec3, direction: Vec3) -> Vec3 {
    if normal.dot(direction) > 0.0 {
        -normal
    } else {
        normal
    }
}

/// The shading normal on the side of the facet, at least a hundredth towards the eye.
fn facing_shading(normal: Vec3, facet: Vec3, direction: Vec3) -> Vec3 {
    let normal = if normal.dot(facet) < 0.0 {
        -normal
    } else {
        normal
    };
    let toward = -direction.normalize_or_zero();
    let cosine = normal.dot(toward);
    if cosine >= 0.01 {
        return normal;
    }
    (normal + toward * (0.01 - cosine)).normalize_or(facet)
}

/// Moves a hit of a ball's mesh to the ball: the root nearest to the mesh's distance.
fn snap_to_ball(point: &mut SurfacePoint, ray: &Ray, center: Vec3, radius: f32) {
    let origin = (ray.origin - center).as_dvec3();
    let direction = ray.direction.as_dvec3();
    let a = direction.length_squared();
    let b = origin.dot(direction);
    let c = origin.length_squared() - f64::from(radius) * f64::from(radius);
    let discriminant = b * b - a * c;
    if discriminant >= 0.0 {
        let root = discriminant.sqrt();
        let (near, far) = ((-b - root) / a, (-b + root) / a);
        let mesh = f64::from(point.distance);
        let t = if (near - mesh).abs() <= (far - mesh).abs() {
            near
        } else {
            far
        };
        let position = origin + direction * t;
        point.position = center + position.as_vec3();
        point.distance = t as f32;
    }
    let normal = (point.position - center).normalize_or(point.facet);
    point.normal = normal;
    point.facet = facing(normal, ray.direction);
}
