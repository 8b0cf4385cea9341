//! What a budget buys on the bundled recording, and a run that has to give way.

#[expect(dead_code, reason = "the studio serves other tests too")]
mod studio;

use std::path::{Path, PathBuf};
use std::process::Command;

use glint::budget::{Pacer, Plan, Spent, Target, plan, tables};
use glint::progress::Progress;
use glint::run_folder::RunFolder;
use glint::stages::linear::DiffuseOrder;
use glint::train::{TrainConfig, train_paced};
use sequence::Recording;
use studio::Finish;

fn bundled() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../recordings/two-cans.glint")
}

/// The bundled recording on a machine of which the tables were made; the clock of this one has no say.
fn target(recording: &Path) -> Target {
    let recording = Recording::open(recording).unwrap();
    let camera = recording.color_camera().intrinsics;
    let pixels = f64::from(camera.width()) * f64::from(camera.height());
    Target {
        scene_size: recording.split().train.len() as f64 * pixels,
        bench_ms: tables().unwrap()[0].points[0].bench_ms,
    }
}

#[test]
fn the_choice_follows_the_budget() {
    let (tables, target) = (tables().unwrap(), target(&bundled()));
    let rich = plan(&tables, &target, 1e9).unwrap();
    let mut costs: Vec<f64> = rich.points.iter().map(|point| point.core_s).collect();
    costs.sort_by(f64::total_cmp);
    let chosen: Vec<Plan> = costs
        .iter()
        .filter_map(|cost| plan(&tables, &target, 1.3001 * cost).ok())
        .collect();
    assert!(chosen.len() >= 3);
    for [poor, rich] in chosen.array_windows() {
        assert!(poor.chosen.error_ratio >= rich.chosen.error_ratio);
    }
    for plan in &chosen {
        assert!(1.3 * plan.chosen.core_s <= plan.budget_s);
    }
    let first = chosen.first().map(|plan| plan.chosen.name.clone());
    assert_ne!(first, chosen.last().map(|plan| plan.chosen.name.clone()));
}

#[test]
fn a_budget_that_buys_nothing_is_refused_before_anything_is_written() {
    let desk = tempfile::tempdir().unwrap();
    let run = desk.path().join("run");
    let output = Command::new(env!("CARGO_BIN_EXE_glint"))
        .arg("train")
        .arg(bundled())
        .arg("-o")
        .arg(&run)
        .args(["--budget", "0.01s"])
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(said.contains("the cheapest setting"), "{said}");
    assert!(!run.exists());
    // A budget chooses what the flags would.
    let both = Command::new(env!("CARGO_BIN_EXE_glint"))
        .arg("train")
        .arg(bundled())
        .arg("-o")
        .arg(&run)
        .args(["--budget", "5min", "--pixel-stride", "4"])
        .output()
        .unwrap();
    assert_eq!(both.status.code(), Some(2));
}

#[test]
fn a_run_that_was_planned_too_cheap_gives_way_and_ends() {
    let desk = tempfile::tempdir().unwrap();
    let recording = desk.path().join("studio.glint");
    studio::write(&recording, &studio::film(Finish::Shiny), &studio::path());
    let mut config = TrainConfig {
        recording: recording.clone(),
        profile: "draft".to_owned(),
        poses: "source".to_owned(),
        voxel_mm: 4.0,
        pixel_stride: 1,
        map_height: 250,
        frame_stride: 1,
        diffuse: DiffuseOrder::Joint,
        object_box: None,
        effects: "-pose-refinement".parse().unwrap(),
        seed: 1,
        threads: 1,
    };
    let plan = plan(&tables().unwrap(), &target(&recording), 1e9).unwrap();
    plan.chosen.apply(&mut config).unwrap();
    config.voxel_mm = 4.0;
    // Almost all was spent before the first stage.
    let spent = plan.budget_s - 1e-3;
    let pacer = Pacer::with_clock(plan, Box::new(move || spent));
    let folder = RunFolder::create(&desk.path().join("run"), false).unwrap();
    let summary = train_paced(&config, &folder, Some(&pacer), &Progress::silent()).unwrap();
    assert!(summary.frames > 0);
    let spent = Spent::of(&pacer);
    assert!(spent.gave_way.len() >= 3, "{spent}");
    assert!(spent.budget_fraction < 1.0);
}
