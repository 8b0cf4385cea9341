//! Depth and normals of another renderer's scene, by this simulator's rays.

use std::path::PathBuf;

use geometry::{DQuat, DVec2, DVec3, Intrinsics, Pose};
use glam::Vec3;
use imaging::{Image, decode_png_gray16, decode_png_rgb8};
use raytrace::Ray;
use scene::Environment;
use scene::material::Material;
use scene::shape::Shape;
use scene::texture::Texture;
use scene::world::{ExactSurface, LightQuality, Object, World};

fn folder() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../shared/data/mitsuba-dev")
}

/// The scene's mesh: little-endian floats x y z nx ny nz and a byte a vertex, triangles with i32 indices.
fn mesh() -> Shape {
    let bytes = std::fs::read(folder().join("truth/mesh.ply")).unwrap();
    let end = bytes
        .windows(11)
        .position(|w| w == b"end_header\n")
        .unwrap()
        + 11;
    let header = String::from_utf8_lossy(&bytes[..end]).into_owned();
    let count = |element: &str| -> usize {
        let line = header
            .lines()
            .find(|line| line.starts_with(element))
            .unwrap();
        line.rsplit(' ').next().unwrap().parse().unwrap()
    };
    let (vertices, faces) = (count("element vertex"), count("element face"));
    let float = |at: usize| f32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
    let mut shape = Shape::default();
    for vertex in 0..vertices {
        let at = end + 25 * vertex;
        let vector = |from: usize| Vec3::from_array([0, 4, 8].map(|axis| float(at + from + axis)));
        shape.positions.push(vector(0));
        shape.normals.push(vector(12));
    }
    for face in 0..faces {
        let at = end + 25 * vertices + 13 * face + 1;
        shape
            .triangles
            .push([0, 4, 8].map(|corner| float(at + corner).to_bits()));
    }
    shape
}

fn poses() -> Vec<Pose> {
    let text = std::fs::read_to_string(folder().join("poses.txt")).unwrap();
    text.lines()
        .filter(|line| !line.starts_with('#'))
        .map(|line| {
            let n: Vec<f64> = line.split(' ').map(|word| word.parse().unwrap()).collect();
            let rotation = DQuat::from_xyzw(n[4], n[5], n[6], n[7]).normalize();
            Pose::new(rotation, DVec3::new(n[1], n[2], n[3])).unwrap()
        })
        .collect()
}

fn median(mut values: Vec<f64>) -> f64 {
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

#[test]
fn depth_and_normals_of_mitsubas_scene_agree_within_rounding() {
    if !folder().exists() {
        eprintln!("SKIPPED: ../shared/data/mitsuba-dev is absent");
        return;
    }
    let object = Object {
        name: "all".into(),
        material: Material::matte(Texture::Plain([0.5; 3])),
        anchor: Vec3::ZERO,
        exact: ExactSurface::Mesh,
        is_target: true,
    };
    let environment = Environment::from_panorama(&Image::new(8, 4, [0.5; 3])).unwrap();
    let quality = LightQuality {
        light_count: 1,
        bounce_count: 1,
    };
    let world = World::new(vec![(object, mesh())], environment, quality, 1).unwrap();
    let camera = Intrinsics::pinhole(640, 480, 525.0, 525.0, 319.5, 239.5).unwrap();
    let poses = poses();
    for frame in [0, 30, 60, 99] {
        let read = |kind: &str| {
            std::fs::read(folder().join(format!("truth/{kind}/{frame:06}.png"))).unwrap()
        };
        let depth = decode_png_gray16(&read("depth")).unwrap();
        let normals = decode_png_rgb8(&read("normals")).unwrap();
        let (mut depth_errors, mut angles) = (Vec::new(), Vec::new());
        for y in (0..480).step_by(2) {
            for x in (0..640).step_by(2) {
                let ahead = camera
                    .camera_from_pixel(DVec2::new(f64::from(x), f64::from(y)))
                    .unwrap();
                let ahead = ahead / ahead.z;
                let pose = &poses[frame];
                let ray = Ray::new(
                    pose.translation().as_vec3(),
                    pose.transform_vector(ahead).as_vec3(),
                );
                let (told, code) = (depth.at(x, y), normals.at(x, y));
                let Some(point) = world.closest(&ray) else {
                    continue;
                };
                if told == 0 || code == [255; 3] {
                    continue;
                }
                depth_errors.push((f64::from(point.distance) - 1e-4 * f64::from(told)).abs());
                let normal = Vec3::from_array(code.map(|c| f32::from(c) / 127.0 - 1.0));
                angles.push(f64::from(point.normal.angle_between(normal.normalize())).to_degrees());
            }
        }
        assert!(depth_errors.len() > 20_000, "{}", depth_errors.len());
        let off = |values: &[f64], limit: f64| {
            values.iter().filter(|v| **v > limit).count() as f64 / values.len() as f64
        };
        println!(
            "frame {frame}: {} pixels, depth median {:.4} mm, over 0.11 mm {:.4}; normals median {:.3} degrees, over 1 degree {:.4}",
            depth_errors.len(),
            1e3 * median(depth_errors.clone()),
            off(&depth_errors, 1.1e-4),
            median(angles.clone()),
            off(&angles, 1.0)
        );
        // A tenth of a millimetre is one unit of the picture; silhouettes may fall to either side.
        assert!(off(&depth_errors, 1.1e-4) < 0.005);
        // A code is 0.45 degrees.
        assert!(median(angles.clone()) < 0.3 && off(&angles, 1.0) < 0.01);
    }
}
