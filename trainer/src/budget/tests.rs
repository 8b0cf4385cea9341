//! Choosing and keeping, on tables and clocks that are made up.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use super::pick::{Target, plan};
use super::*;
use crate::stages::linear::{DiffuseOrder, LinearSettings};

/// Rows of a table: point, cost, error, front.
type Row = (&'static str, f64, f64, &'static str);

const USUAL: &[Row] = &[
    ("default", 40.0, 0.10, "maybe"),
    ("pixel-stride=1", 100.0, 0.09, "sure"),
    ("pixel-stride=4", 20.0, 0.12, "sure"),
    ("voxel-mm=3", 39.0, 0.30, "no"),
    ("map-height=62", 30.0, 0.15, "no"),
];

/// 10 frames of 1000 pixels, on a machine of 100 ms; a tenth of the cost is geometry, two are looking.
fn table(rows: &[Row]) -> Table {
    let mut text =
        "point,status,train_core_s,env_log_rmse_reach,pixels,scene_frames,scene_pixels,bench_ms,\
        poses_core_s,geometry_core_s,effects_core_s,diffuse_core_s,linear_core_s,front\n"
            .to_owned();
    for (point, cost, error, front) in rows {
        let (geometry, diffuse, linear) = (0.1 * cost, 0.2 * cost, 0.6 * cost);
        text += &format!(
            "{point},ok,{cost},{error},1000,10,1000,100,0,{geometry},{geometry},{diffuse},{linear},{front}\n"
        );
    }
    Table::parse(&text).unwrap()
}

const TARGET: Target = Target {
    scene_size: 10_000.0,
    bench_ms: 100.0,
};

#[test]
fn budgets_are_read_with_their_unit() {
    for (text, seconds) in [
        ("90s", 90.0),
        ("5min", 300.0),
        ("1.5h", 5400.0),
        ("2 min", 120.0),
    ] {
        assert_eq!(parse_budget(text), Ok(seconds));
    }
    for text in [
        "", "5", "min", "-3s", "0s", "infs", "NaNmin", "5 weeks", "5GiB",
    ] {
        let error = parse_budget(text).unwrap_err();
        assert!(error.contains("no budget"), "{text}: {error}");
    }
}

#[test]
fn a_larger_budget_buys_a_lower_error() {
    let tables = [table(USUAL)];
    let chosen = |budget: f64| plan(&tables, &TARGET, budget).unwrap().chosen;
    // 1.3 times the cost must fit.
    assert_eq!(chosen(1e9).name, "pixel-stride=1");
    assert_eq!(chosen(130.1).name, "pixel-stride=1");
    assert_eq!(chosen(129.0).name, "default");
    assert_eq!(chosen(51.0).name, "pixel-stride=4");
    assert_eq!(chosen(51.0).setting["pixel-stride"], "4");
    let error = plan(&tables, &TARGET, 25.0).unwrap_err().to_string();
    assert!(
        error.contains("pixel-stride=4")
            && error.contains("about 20")
            && error.contains("--budget 26s"),
        "{error}"
    );
}

#[test]
fn costs_go_by_frames_pixels_and_the_machine() {
    let tables = [table(USUAL)];
    let target = Target {
        scene_size: 3.0 * TARGET.scene_size,
        bench_ms: 50.0,
    };
    let found = plan(&tables, &target, 1e9).unwrap();
    let default = found.point("default").unwrap();
    assert!((default.core_s - 60.0).abs() < 1e-9);
    assert!((default.stages["linear"] - 36.0).abs() < 1e-9);
    assert!((default.linear_s.at(2000.0) - 24.0).abs() < 1e-9);
    // Of two scenes of one size the dearer one is believed, and errors are compared with the default of each.
    let mut dear = USUAL.to_vec();
    dear[2] = ("pixel-stride=4", 30.0, 0.2, "no");
    let found = plan(&[table(USUAL), table(&dear)], &TARGET, 1e9).unwrap();
    let coarse = found.point("pixel-stride=4").unwrap();
    assert!((coarse.core_s - 30.0).abs() < 1e-9);
    assert!((coarse.error_ratio - (1.2_f64 * 2.0).sqrt()).abs() < 1e-9);
    assert!(coarse.is_on_front);
}

#[test]
fn tables_that_say_nothing_are_refused() {
    assert!(Table::parse("").is_err());
    assert!(Table::parse("point,status\n").is_err());
    let failed = "point,status,reason\ndefault,failed,\"sorry, no\"\n";
    assert!(Table::parse(failed).is_err());
    let text = "point,status,train_core_s\ndefault,ok,x\n";
    assert!(Table::parse(text).is_err());
}

#[test]
fn the_tables_of_the_program_can_be_read_and_bought_from() {
    let tables = tables().unwrap();
    let target = Target {
        scene_size: tables[0].points[0].scene_size,
        bench_ms: tables[0].points[0].bench_ms,
    };
    let cheap = plan(&tables, &target, 0.01).unwrap_err().to_string();
    assert!(cheap.contains("the cheapest setting"), "{cheap}");
    let rich = plan(&tables, &target, 1e9).unwrap();
    let least = rich.points.iter().filter(|point| point.is_on_front);
    let least = least
        .map(|point| point.error_ratio)
        .fold(f64::INFINITY, f64::min);
    assert_eq!(rich.chosen.error_ratio, least);
    let mut config = crate::train::TrainConfig {
        recording: "x.glint".into(),
        profile: "draft".to_owned(),
        poses: "source".to_owned(),
        voxel_mm: 2.0,
        pixel_stride: 2,
        map_height: 250,
        frame_stride: 1,
        diffuse: DiffuseOrder::Joint,
        object_box: None,
        effects: "-pose-refinement".parse().unwrap(),
        seed: 1,
        threads: 1,
    };
    for point in &rich.points {
        point.apply(&mut config).unwrap();
        // What was asked about poses is never undone by a table.
        let refinement = config.effects.of(effects::Effect::PoseRefinement);
        assert_eq!(refinement, effects::Request::Off, "{}", point.name);
    }
}

/// A pacer on a budget of 52 core-seconds, with the default (40 planned), and its clock in milliseconds.
fn paced() -> (Pacer, Arc<AtomicU64>) {
    let plan = plan(&[table(USUAL)], &TARGET, 52.0).unwrap();
    assert_eq!(plan.chosen.name, "default");
    let clock = Arc::new(AtomicU64::new(0));
    let read = Arc::clone(&clock);
    let pacer = Pacer::with_clock(
        plan,
        Box::new(move || read.load(Ordering::Relaxed) as f64 * 1e-3),
    );
    (pacer, clock)
}

const FULL: LinearSettings = LinearSettings {
    diffuse: DiffuseOrder::Joint,
    map_height: 250,
    row_step: 1,
    rounds: None,
};

#[test]
fn what_goes_as_planned_is_left_alone() {
    let (pacer, clock) = paced();
    clock.store(4_000, Ordering::Relaxed);
    let asked = "+fresnel".parse().unwrap();
    assert_eq!(pacer.before_effects(&asked), asked);
    clock.store(8_000, Ordering::Relaxed);
    assert_eq!(pacer.before_diffuse(2), 2);
    clock.store(16_000, Ordering::Relaxed);
    assert_eq!(pacer.before_linear(FULL, 1000), FULL);
    assert!(pacer.notes().is_empty());
}

#[test]
fn what_goes_slower_gives_way_and_says_so() {
    let (pacer, clock) = paced();
    // Geometry took three times as long: so will the rest.
    clock.store(12_000, Ordering::Relaxed);
    let none = pacer.before_effects(&"".parse().unwrap());
    assert_eq!(none, "none".parse().unwrap());
    let wider = pacer.before_diffuse(2);
    assert!(wider > 2 && wider <= 8, "{wider}");
    // More rows than planned: fewer are used, as few as needed.
    clock.store(20_000, Ordering::Relaxed);
    let solved = pacer.before_linear(FULL, 1200);
    assert!(
        solved.row_step > 1 && solved.map_height == 250,
        "{solved:?}"
    );
    // At the pace of the geometry, the worst so far.
    let cost = 3.0 * 0.024 * 1200.0;
    assert!(cost / solved.row_step as f64 <= 32.0);
    assert!(cost / (solved.row_step - 1) as f64 > 32.0);
    // Almost nothing is left: the map shrinks and rounds are saved too.
    clock.store(51_000, Ordering::Relaxed);
    let solved = pacer.before_linear(FULL, 1200);
    assert_eq!((solved.map_height, solved.rounds), (62, Some(2)));
    assert_eq!(pacer.notes().len(), 4);
    assert!(pacer.notes()[0].contains("no effects are tried"));
}

#[test]
fn whatever_happens_after_the_geometry_the_budget_is_kept() {
    // Stages that take `slow` times what was planned, whatever was foreseen before; pixels by the square of the stride.
    for slow in [0.5, 1.0, 1.5, 2.0, 2.5, 3.0] {
        for many in [0.5, 1.0, 4.0] {
            let (pacer, clock) = paced();
            let spend = |seconds: f64| {
                clock.fetch_add((1e3 * slow * seconds) as u64, Ordering::Relaxed);
            };
            spend(4.0);
            let requests = "".parse().unwrap();
            if pacer.before_effects(&requests) == requests {
                spend(4.0);
            }
            let stride = pacer.before_diffuse(2);
            let share = 4.0 / f64::from(stride * stride);
            spend(8.0 * (0.5 + 0.5 * share));
            let pixels = 1000.0 * many * share;
            let solved = pacer.before_linear(FULL, pixels as usize);
            let map = if solved.map_height < 250 { 0.6 } else { 1.0 };
            spend(0.024 * pixels * map / solved.row_step as f64);
            let spent = Spent::of(&pacer);
            assert!(
                spent.budget_fraction <= MOST_SPENT,
                "{slow} times slower, {many} times the pixels: {spent}"
            );
        }
    }
}
