//! A run from poses in a world of their own is judged in the world of `source`.

use std::path::Path;
use std::process::Command;

use geometry::{DVec3, PanoramaSize, Pose};
use glam::DMat3;
use glint::eval::mesh::{SurfaceMesh, read_mesh};
use glint::progress::Progress;
use glint::run_folder::RunFolder;
use glint::stages::linear::DiffuseOrder;
use glint::train::{MESH_FILE, TrainConfig, train};
use imaging::{Image, PanoramaAttributes, write_rgb_exr};
use serde_json::Value;

use crate::studio::{self, Finish};

fn train_from(recording: &Path, poses: &str, run: &Path) {
    let config = TrainConfig {
        recording: recording.to_path_buf(),
        profile: "draft".to_owned(),
        poses: poses.to_owned(),
        voxel_mm: 4.0,
        pixel_stride: 2,
        map_height: 250,
        frame_stride: 1,
        diffuse: DiffuseOrder::Joint,
        object_box: None,
        effects: "-pose-refinement".parse().unwrap(),
        seed: 1,
        threads: 2,
    };
    let folder = RunFolder::create(run, false).unwrap();
    train(&config, &folder, &Progress::silent()).unwrap();
}

/// The truth of the studio's room, all of it within reach.
fn write_truth(folder: &Path) {
    let size = PanoramaSize::from_height(128).unwrap();
    let attributes = PanoramaAttributes {
        world_from_panorama: DMat3::IDENTITY,
        origin: DVec3::ZERO,
        radius: f64::INFINITY,
        gain: 1.0,
    };
    let room = Image::from_vec(256, 128, studio::room_panorama(size)).unwrap();
    write_rgb_exr(&folder.join("environment.exr"), &room, &attributes).unwrap();
    let reach = Image::new(256, 128, [1.0; 3]);
    write_rgb_exr(&folder.join("reach.exr"), &reach, &attributes).unwrap();
}

/// A mesh in another world, as text.
fn write_mesh(path: &Path, mesh: &SurfaceMesh, other_from_world: &Pose) {
    let mut text = format!(
        "ply\nformat ascii 1.0\nelement vertex {}\nproperty double x\nproperty double y\nproperty double z\nelement face {}\nproperty list uchar int vertex_indices\nend_header\n",
        mesh.positions.len(),
        mesh.triangles.len()
    );
    for position in &mesh.positions {
        let p = other_from_world.transform_point(mesh.origin + position.as_dvec3());
        text.push_str(&format!("{} {} {}\n", p.x, p.y, p.z));
    }
    for [a, b, c] in &mesh.triangles {
        text.push_str(&format!("3 {a} {b} {c}\n"));
    }
    std::fs::write(path, text).unwrap();
}

fn evaluated(arguments: &[&str]) -> Value {
    let output = Command::new(env!("CARGO_BIN_EXE_glint"))
        .args(["--json", "eval"])
        .args(arguments)
        .output()
        .expect("the program starts");
    let error = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{error}");
    let text = String::from_utf8(output.stdout).unwrap();
    serde_json::from_str(text.lines().last().unwrap()).unwrap()
}

#[test]
fn map_and_mesh_of_a_turned_world_are_judged_in_that_of_the_source() {
    let desk = tempfile::tempdir().unwrap();
    let at = |name: &str| desk.path().join(name);
    let text = |name: &str| at(name).to_str().unwrap().to_owned();
    let source = studio::path();
    let turn = Pose::from_axis_angle(DVec3::new(0.1, 1.0, -0.15), 65.0_f64.to_radians());
    let world = Pose::from_translation(DVec3::new(0.5, 0.2, -0.3)) * turn;
    let live: Vec<Pose> = source.iter().map(|pose| world * *pose).collect();
    let frames = studio::film(Finish::Shiny);
    let sets: [(&str, &[Pose]); 2] = [("source", &source), ("live", &live)];
    studio::write_sets(&at("x.glint"), &frames, &sets);
    write_truth(desk.path());
    train_from(&at("x.glint"), "live", &at("run"));
    // The run's own surface, taken to the world of the source.
    let mesh = read_mesh(&at("run").join(MESH_FILE)).unwrap();
    write_mesh(&at("reference.ply"), &mesh, &world.inverse());
    let turned = evaluated(&[
        &text("run"),
        "--truth",
        desk.path().to_str().unwrap(),
        "--trajectory",
        "source",
        "--mesh",
        &text("reference.ply"),
    ]);
    let number = |value: &Value, key: &str| {
        value[key]
            .as_f64()
            .unwrap_or_else(|| panic!("{key} in {value}"))
    };
    println!("{turned}");
    assert!((number(&turned, "map_rotation_deg") - 65.0).abs() < 1e-6);
    assert!((number(&turned, "alignment_angle_deg") - 65.0).abs() < 1e-6);
    // As good as from the poses `source`; a map that is left as it lies is another room's.
    assert!(number(&turned, "env_corr_reach") > 0.8);
    assert!(number(&turned, "env_corr_turned") < 0.3);
    assert!(number(&turned, "ate_m") < 1e-9 && number(&turned, "fscore_5mm") > 0.999);
    assert!(number(&turned, "mesh_accuracy_q90_m") < 1e-5);
    let metrics = std::fs::read_to_string(at("run").join("metrics.json")).unwrap();
    let metrics: Value = serde_json::from_str(&metrics).unwrap();
    assert_eq!(metrics["trajectory"]["poses"], "live");
    let domain = metrics["mesh"]["completeness_domain"].as_str().unwrap();
    assert!(domain.contains("54 training frames"), "{domain}");
}
