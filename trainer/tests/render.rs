//! Drawn views of a small studio run: sizes, samples, models, and what the judge makes of them.

#[expect(dead_code, reason = "the studio serves other tests too")]
mod studio;

use geometry::Pose;
use glint::eval::model::Model;
use glint::eval::views::{evaluate, judge_pictures};
use glint::progress::Progress;
use glint::render::painter::{DrawnModel, Painter, Scale};
use glint::render::{RenderOptions, ViewPath, render};
use glint::run_folder::RunFolder;
use glint::stages::linear::DiffuseOrder;
use glint::stages::observe::ColorView;
use glint::train::{TrainConfig, train};
use imaging::decode_png_rgb8;
use sequence::Recording;
use studio::Finish;

#[test]
fn views_are_drawn_at_any_size_and_judged_as_the_evaluation_does() {
    let desk = tempfile::tempdir().unwrap();
    let path = desk.path().join("studio.glint");
    studio::write(&path, &studio::film(Finish::Shiny), &studio::path());
    let config = TrainConfig {
        recording: path.clone(),
        profile: "draft".to_owned(),
        poses: "source".to_owned(),
        voxel_mm: 4.0,
        pixel_stride: 2,
        map_height: 126,
        frame_stride: 2,
        diffuse: DiffuseOrder::Joint,
        object_box: None,
        effects: "none".parse().unwrap(),
        seed: 1,
        threads: 2,
    };
    let folder = RunFolder::create(&desk.path().join("run"), false).unwrap();
    let summary = train(&config, &folder, &Progress::silent()).unwrap();
    let recording = Recording::open(&path).unwrap();
    let train_count = recording.split().train.len();
    assert_eq!(summary.frames, train_count.div_ceil(2));
    let model = Model::load(&folder).unwrap();
    assert_eq!(model.panorama.height(), 126);
    let poses = recording.poses("source").unwrap().to_vec();
    pictures_agree(&recording, &model, &poses);

    let options = RenderOptions {
        camera: true,
        ..RenderOptions::default()
    };
    let small = RenderOptions {
        scale: Scale::Quarter,
        ..options
    };
    let judged = |options: &RenderOptions| {
        let out = desk.path().join("views");
        let drawn = render(&folder, &ViewPath::Test, &out, options, &Progress::silent()).unwrap();
        assert_eq!(drawn.pictures, recording.split().test.len());
        assert!(drawn.draw_core_ms > 0.0 && drawn.prep_core_s > 0.0);
        let picture = |index: usize| {
            let bytes = std::fs::read(out.join(format!("{index:06}.png")))?;
            Ok(decode_png_rgb8(&bytes)?)
        };
        let judged = judge_pictures(&recording, &model, &poses, None, &picture);
        judged.unwrap().unwrap()
    };
    let (metrics, _) = evaluate(&recording, &model, "source", None, &|_, _| {})
        .unwrap()
        .unwrap();
    // Drawn, written, read and judged: the same figures to the last bit as of the evaluation in memory.
    let whole = judged(&options);
    let found = (
        whole.error.l1,
        whole.error.psnr,
        whole.error.ssim,
        whole.error.lpips,
    );
    let expected = metrics.composition;
    assert_eq!(
        found,
        (expected.l1, expected.psnr, expected.ssim, expected.lpips)
    );
    let nearest = judged(&RenderOptions {
        model: DrawnModel::Nearest,
        ..options
    });
    assert_eq!(nearest.error.l1, metrics.nearest_view.l1);
    let diffuse = judged(&RenderOptions {
        model: DrawnModel::Diffuse,
        ..options
    });
    assert_eq!(diffuse.error.l1, metrics.diffuse_only.l1);
    // A quarter is enlarged and judged over the same pixels; where the model errs by detail, less of it may err less.
    let small = judged(&small);
    assert_eq!(small.frames.len(), whole.frames.len());
    assert!(small.error.l1 > 0.0 && small.error.l1 != whole.error.l1);
    let parts = whole.blocks(10);
    let mean = parts.iter().sum::<f64>() / parts.len() as f64;
    assert!((mean - whole.error.l1).abs() < 1e-12);
}

/// A plain picture is what the model draws; four samples are the mean of a picture of twice the size.
fn pictures_agree(recording: &Recording, model: &Model, poses: &[Option<Pose>]) {
    let view = ColorView::new(recording);
    let pose = view.surface_from_color(&model.surface, &poses[3].unwrap());
    let drawn = |options: &RenderOptions| {
        let painter = Painter::new(recording, &view, model, poses, options).unwrap();
        painter.draw(&pose).unwrap()
    };
    let plain = RenderOptions::default();
    let whole = drawn(&plain);
    let expected = model.draw(&view.camera, &pose);
    assert_eq!(whole.linear.pixels(), expected.composition.pixels());
    let samples = RenderOptions {
        samples: 4,
        ..plain
    };
    // Four samples of half the size fall on the pixels of the whole.
    let half = drawn(&RenderOptions {
        scale: Scale::Half,
        ..samples
    });
    assert_eq!(half.linear.width() * 2, whole.linear.width());
    for y in 0..half.linear.height() {
        for x in 0..half.linear.width() {
            let four = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(dx, dy)| (2 * x + dx, 2 * y + dy));
            if four.iter().all(|&(x, y)| whole.has_surface.at(x, y)) {
                let sum: f32 = four.iter().map(|&(x, y)| whole.linear.at(x, y)[1]).sum();
                assert!((half.linear.at(x, y)[1] - sum / 4.0).abs() < 1e-5);
            }
        }
    }
    let wrong = RenderOptions {
        samples: 3,
        ..plain
    };
    assert!(Painter::new(recording, &view, model, poses, &wrong).is_err());
}
