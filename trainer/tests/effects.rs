//! Effects: what a recording calls for, and that what is off is not computed.

#[expect(dead_code, reason = "the studio serves other tests too")]
mod studio;

use std::path::Path;

use effects::{
    Counters, DecidedBy, Effect, EffectRequests, EffectSet, EffectsFile, Habit, Verdict,
};
use glint::effects::{Decided, Request, decide};
use glint::stages::geometry::build;
use glint::stages::object::find_object;
use glint::stages::observe::{ColorView, Observations, PixelRules, Surface, observe};
use glint::stages::poses::{PosedFrame, training_frames};
use glint::train::{TrainConfig, explain};
use sequence::Recording;
use studio::Finish;

const VOXEL: f32 = 0.004;

/// A recording with the surface that training would stand on.
struct Stage {
    recording: Recording,
    frames: Vec<PosedFrame>,
    surface: Surface,
    normal_sigma: Vec<f32>,
}

impl Stage {
    fn new(folder: &Path, finish: Finish) -> Self {
        let path = folder.join("studio.glint");
        studio::write(&path, &studio::film(finish), &studio::path());
        let recording = Recording::open(&path).unwrap();
        let frames = training_frames(&recording, "source").unwrap();
        let geometry = build(&recording, &frames, VOXEL, &mut |_, _| {}).unwrap();
        let parts = find_object(&geometry.mesh, None, 1);
        Self {
            surface: Surface::fused(geometry.mesh, parts.vertex_segment, VOXEL).unwrap(),
            normal_sigma: geometry.normal_sigma,
            recording,
            frames,
        }
    }

    fn decide(&self, requests: &str, previous: Option<&EffectsFile>, threads: usize) -> Decided {
        let requests: EffectRequests = requests.parse().unwrap();
        let request = Request {
            requests: &requests,
            habit: Habit::Cheap,
            previous,
            refinement: None,
            compares: true,
            stride: 2,
            seed: 1,
        };
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| decide(&self.recording, &self.surface, &self.frames, &request))
            .unwrap()
    }

    fn look(&self, effects: EffectSet, is_specular: bool) -> Observations {
        let rules = PixelRules {
            effects,
            is_specular,
            stride: 4,
            ..PixelRules::default()
        };
        observe(
            &self.recording,
            &ColorView::with_effects(&self.recording, effects),
            &self.surface,
            &self.normal_sigma,
            &self.frames[..12],
            &rules,
            &|_, _| {},
        )
        .unwrap()
    }
}

fn counters(observations: &Observations) -> Counters {
    let mut sum = Counters::default();
    for frame in &observations.frames {
        sum += &frame.counters;
    }
    sum
}

/// The file without what a clock says.
fn timeless(mut file: EffectsFile) -> EffectsFile {
    file.survey.seconds = 0.0;
    file
}

fn is_on(file: &EffectsFile, effect: Effect) -> bool {
    file.of(effect).unwrap().verdict == Verdict::On
}

#[test]
fn shiny_spheres_open_the_gate_and_the_bits_do_not_depend_on_threads() {
    let folder = tempfile::tempdir().unwrap();
    let stage = Stage::new(folder.path(), Finish::Shiny);
    let first = stage.decide("", None, 1);
    assert!(first.plan.is_specular);
    assert_eq!(first.file.effects.len(), Effect::ALL.len());
    assert_eq!(first.plan.computed, first.file.computed());
    // Reflectance 0.3 at all angles, no fall-off.
    for effect in [Effect::Fresnel, Effect::Vignetting] {
        assert!(!is_on(&first.file, effect), "{effect}");
    }
    assert!(is_on(&first.file, Effect::Response));
    let again = stage.decide("", None, 4);
    assert_eq!(timeless(first.file.clone()), timeless(again.file));
    // A clip of 5 seconds is too short for an honest probe, and says so.
    assert_eq!(first.file.survey.blocks, 0);
    let judged = first.file.effects.iter().filter(|r| r.probe.is_some());
    assert!(judged.clone().count() > 0);
    assert!(
        judged
            .clone()
            .all(|r| r.probe.as_ref().unwrap().ci.is_none())
    );
    // A run in the same folder keeps its verdicts.
    let kept = stage.decide("", Some(&first.file), 2);
    assert_eq!(kept.plan.computed, first.plan.computed);
}

#[test]
fn matte_spheres_stay_shut_at_survey_cost() {
    let folder = tempfile::tempdir().unwrap();
    let stage = Stage::new(folder.path(), Finish::Matte);
    let decided = stage.decide("", None, 2);
    println!("{:?}", decided.file.survey);
    assert!(!decided.plan.is_specular);
    for effect in Effect::ALL.into_iter().filter(|e| e.is_specular()) {
        let record = decided.file.of(effect).unwrap();
        assert_eq!((record.verdict, record.by), (Verdict::Off, DecidedBy::Gate));
    }
    let seen = stage.look(decided.plan.computed, decided.plan.is_specular);
    assert_eq!(counters(&seen), Counters::default());
    assert!(seen.frames.iter().all(|frame| frame.pixels.is_empty()));
    assert!(seen.frames.iter().all(|frame| !frame.samples.is_empty()));
}

#[test]
fn switches_have_the_last_word() {
    let folder = tempfile::tempdir().unwrap();
    let stage = Stage::new(folder.path(), Finish::Shiny);
    let none = stage.decide("none", None, 2);
    assert_eq!(none.plan.computed, EffectSet::NONE);
    let records = &none.file.effects;
    assert!(records.iter().all(|record| record.by == DecidedBy::Forced));
    assert!(!none.file.warnings.is_empty(), "the response is missed");
    let all = stage.decide("all", None, 2);
    assert_eq!(all.plan.computed, EffectSet::all());
    assert!(all.wants_refinement);
    assert!(
        !all.plan.fresnel.is_empty(),
        "parameters are found all the same"
    );
}

#[test]
fn an_effect_that_is_off_is_not_computed_and_changes_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let stage = Stage::new(folder.path(), Finish::Shiny);
    let all = EffectSet::all();
    let full = stage.look(all, true);
    assert!(counters(&full).rays_closest > 0);
    assert!(counters(&full).first_bounce_pixels > 0);

    // Without visibility: what it would be by hand, the same pixels with nothing in the way.
    let blind = stage.look(all.without(Effect::Visibility).closed(), true);
    assert_eq!(counters(&blind), Counters::default());
    for (blind, full) in blind.frames.iter().zip(&full.frames) {
        assert!(blind.second.is_empty());
        assert_eq!(blind.pixels.len(), full.pixels.len());
        for (pixel, by_hand) in blind.pixels.iter().zip(&full.pixels) {
            let mut by_hand = *by_hand;
            (by_hand.is_blocked, by_hand.first_bounce, by_hand.weight) = (false, None, 1.0);
            assert_eq!(format!("{pixel:?}"), format!("{by_hand:?}"));
        }
    }

    // Without first bounces: blocked all the same, by rays that ask for no more.
    let dark = stage.look(all.without(Effect::FirstBounce).closed(), true);
    let counted = counters(&dark);
    assert_eq!((counted.rays_closest, counted.first_bounce_pixels), (0, 0));
    assert!(counted.rays_occlusion > 0);
    for (dark, full) in dark.frames.iter().zip(&full.frames) {
        for (pixel, by_hand) in dark.pixels.iter().zip(&full.pixels) {
            let mut by_hand = *by_hand;
            by_hand.first_bounce = None;
            assert_eq!(format!("{pixel:?}"), format!("{by_hand:?}"));
        }
    }

    // Without the second mirroring: no buffer of it, all else alike.
    let once = stage.look(all.without(Effect::FirstBounceSpecular), true);
    assert_eq!(counters(&once).of(Effect::FirstBounceSpecular), 0);
    for (once, full) in once.frames.iter().zip(&full.frames) {
        assert_eq!(format!("{:?}", once.pixels), format!("{:?}", full.pixels));
    }
}

#[test]
fn a_dry_run_says_what_is_settled_and_writes_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let recording = folder.path().join("studio.glint");
    studio::write(&recording, &studio::film(Finish::Shiny), &studio::path());
    let config = TrainConfig {
        recording,
        profile: "draft".to_owned(),
        poses: "source".to_owned(),
        voxel_mm: 4.0,
        pixel_stride: 2,
        map_height: 250,
        frame_stride: 1,
        diffuse: Default::default(),
        object_box: None,
        effects: "-fresnel,+noise".parse().unwrap(),
        seed: 1,
        threads: 2,
    };
    let text = toml::to_string(&config).unwrap();
    let read: TrainConfig = toml::from_str(&text).unwrap();
    assert_eq!(read.effects, config.effects);
    let file = explain(&config, &glint::progress::Progress::silent()).unwrap();
    assert_eq!(file.of(Effect::Fresnel).unwrap().by, DecidedBy::Forced);
    assert!(is_on(&file, Effect::Noise));
    assert!(file.effects.iter().all(|record| record.probe.is_none()));
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
}
