//! Light on matte surfaces, a vertex: from the environment past all objects, and once more from their matte surfaces.

use glam::Vec3;
use rayon::prelude::*;
use raytrace::{Hit, MirrorQuery, Ray};

use crate::lobe;
use crate::random::{Purpose, Stream};
use crate::world::{LightQuality, World};

/// One of the directions that stand for the environment: radiance times solid angle over π.
struct Light {
    direction: Vec3,
    radiance: [f32; 3],
}

/// Times that light is passed from surface to surface.
const PASSES: u64 = 2;
/// Largest radiance that mirrors pass on to matte surfaces: the bright curves that lamps draw through them would be
/// noise between vertices.
const MIRRORED_LIMIT: f32 = 2.0;

/// Irradiance over π on the side of each vertex' normal.
pub(crate) fn gather(world: &World, quality: LightQuality, seed: u64) -> Vec<[f32; 3]> {
    let lights = lights(world, quality.light_count, seed);
    let vertices = 0..world.mesh().positions.len();
    let direct: Vec<[f32; 3]> = vertices
        .clone()
        .into_par_iter()
        .map(|vertex| from_environment(world, &lights, vertex))
        .collect();
    let mut all = direct.clone();
    for pass in 1..=PASSES {
        let colors = matte_colors(world, &all);
        all = vertices
            .clone()
            .into_par_iter()
            .map(|vertex| {
                let random = Stream::new(seed, Purpose::Irradiance, pass, vertex as u64);
                let bounced = from_surfaces(world, &colors, vertex, quality.bounce_count, random);
                std::array::from_fn(|c| direct[vertex][c] + bounced[c])
            })
            .collect();
    }
    all
}

/// Directions in proportion to the light, one in each of as many equal parts of it.
fn lights(world: &World, count: u32, seed: u64) -> Vec<Light> {
    let environment = &world.environment;
    (0..count)
        .map(|index| {
            let mut random = Stream::new(seed, Purpose::Irradiance, 0, u64::from(index));
            let choice = (f64::from(index) + f64::from(random.unit())) / f64::from(count.max(1));
            let (direction, density) = environment.sample(choice, random.pair());
            let radiance = environment.radiance(Vec3::ZERO, direction);
            let share = 1.0 / (density * count as f32 * std::f32::consts::PI);
            Light {
                direction,
                radiance: radiance.map(|value| value * share),
            }
        })
        .collect()
}

fn start(world: &World, vertex: usize) -> Vec3 {
    let mesh = world.mesh();
    // A tenth of a millimetre: facets of curved surfaces lie below their vertices.
    let raised = mesh.positions[vertex] + mesh.normals[vertex] * 1e-4;
    MirrorQuery::for_exact().start(raised, mesh.normals[vertex])
}

fn from_environment(world: &World, lights: &[Light], vertex: usize) -> [f32; 3] {
    let normal = world.mesh().normals[vertex];
    let origin = start(world, vertex);
    let visible: Vec<(&Light, f32)> = lights
        .iter()
        .map(|light| (light, light.direction.dot(normal)))
        .filter(|(_, cosine)| *cosine > 0.0)
        .collect();
    let rays: Vec<Ray> = visible
        .iter()
        .map(|(light, _)| Ray::new(origin, light.direction))
        .collect();
    let mut blocked = vec![false; rays.len()];
    world.scene().blocked_batch(&rays, &mut blocked);
    let mut sum = [0.0_f64; 3];
    for ((light, cosine), is_blocked) in visible.iter().zip(blocked) {
        if !is_blocked {
            for (sum, radiance) in sum.iter_mut().zip(light.radiance) {
                *sum += f64::from(radiance * cosine);
            }
        }
    }
    sum.map(|value| value as f32)
}

/// Matte radiance of each triangle's middle under the direct light.
fn matte_colors(world: &World, direct: &[[f32; 3]]) -> Vec<[f32; 3]> {
    let mesh = world.mesh();
    let triangles = mesh.triangles.iter().zip(world.object_of_triangle());
    triangles
        .map(|(corners, &object)| {
            let object = &world.objects[usize::from(object)];
            let middle: Vec3 = corners.iter().map(|&v| mesh.positions[v as usize]).sum();
            let albedo = object.material.texture.at(middle / 3.0 - object.anchor);
            std::array::from_fn(|c| {
                let light: f32 = corners.iter().map(|&v| direct[v as usize][c]).sum();
                albedo[c] * light / 3.0
            })
        })
        .collect()
}

/// Light that other surfaces send, by cosine-weighted directions.
fn from_surfaces(
    world: &World,
    colors: &[[f32; 3]],
    vertex: usize,
    count: u32,
    mut random: Stream,
) -> [f32; 3] {
    let normal = world.mesh().normals[vertex];
    let origin = start(world, vertex);
    let (tangent, bitangent) = geometry::direction::basis(normal);
    let mut sum = [0.0_f64; 3];
    for index in 0..count {
        let u = (index as f32 + random.unit()) / count as f32;
        let angle = std::f32::consts::TAU * random.unit();
        let flat = u.sqrt();
        let direction = tangent * (flat * angle.cos())
            + bitangent * (flat * angle.sin())
            + normal * (1.0 - u).max(0.0).sqrt();
        let ray = Ray::new(origin, direction);
        if let Some(hit) = world.scene().closest(&ray) {
            let mirrored = mirrored(world, colors, &ray, &hit);
            for (sum, (matte, mirrored)) in sum
                .iter_mut()
                .zip(colors[hit.triangle as usize].iter().zip(mirrored))
            {
                *sum += f64::from(matte + mirrored);
            }
        }
    }
    sum.map(|value| (value / f64::from(count.max(1))) as f32)
}

/// What a glossy surface mirrors towards the ray, as a mirror would: matte surfaces blur it anyway.
fn mirrored(world: &World, colors: &[[f32; 3]], ray: &Ray, hit: &Hit) -> [f32; 3] {
    let object = &world.objects[usize::from(world.object_of_triangle()[hit.triangle as usize])];
    if !object.material.is_glossy() {
        return [0.0; 3];
    }
    let point = world.point_at(ray, hit);
    let Some((_, gloss)) = object.material.gloss(point.position - object.anchor) else {
        return [0.0; 3];
    };
    let outgoing = -ray.direction;
    let direction = lobe::mirrored(outgoing, point.normal);
    let onward = World::leaving(&point, direction);
    let seen = match world.scene().closest(&onward) {
        Some(next) => colors[next.triangle as usize],
        None => world.environment.radiance(onward.origin, direction),
    };
    let cosine = outgoing.dot(point.normal);
    std::array::from_fn(|c| {
        let reflectance = if gloss.has_fresnel {
            lobe::schlick(gloss.r0[c], cosine)
        } else {
            gloss.r0[c]
        };
        reflectance * seen[c].min(MIRRORED_LIMIT)
    })
}
