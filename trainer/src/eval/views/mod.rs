//! The model against held-out photographs, beside diffuse alone and the nearest training photograph
//! (effects-and-tradeoffs.md C2).
//!
//! Map: `predict` draws · `mask` says which pixels count · `nearest` and `training` find the training view ·
//! `score` takes the figures · `pictures` judges what was drawn elsewhere · `angle` orders LPIPS by distance from
//! training · `figures` is what is written.

mod angle;
mod figures;
mod mask;
mod nearest;
mod pictures;
mod predict;
mod score;
mod training;

use std::path::Path;

use geometry::Pose;
use imaging::Mask;
use rayon::prelude::*;
use sequence::Recording;

pub use angle::{AngleBin, AngleCurve, AngleMetrics};
pub use figures::{CompositionMetrics, FrameError, Strip, ViewError};
pub use pictures::{PictureMetrics, judge_pictures};
pub use training::{NearestFrame, Photograph, TrainingViews};

use super::model::Model;
use crate::perceptual::Lpips;
use crate::stages::observe::ColorView;
use crate::stages::poses::PosedFrame;
use mask::MaskSource;
use score::{METHODS, Pool, ViewScore, WholeFrame};

/// Held-out frames whose pictures are kept, evenly spread.
const MOST_STRIPS: usize = 4;

/// Frames in work at once: each holds the network's activations for four pictures, 50 MB at 640x480.
const MOST_AT_ONCE: usize = 8;

/// Judges all test frames; `None` when the recording has none, or no masked pixel in any. `masks` is a folder of
/// 1-bit PNGs named by frame; without it the shiny segments of the mesh are the mask.
pub fn evaluate(
    recording: &Recording,
    model: &Model,
    pose_set: &str,
    masks: Option<&Path>,
    progress: &dyn Fn(usize, usize),
) -> anyhow::Result<Option<(CompositionMetrics, Vec<Strip>)>> {
    let Some(poses) = recording.poses(pose_set) else {
        return Ok(None);
    };
    evaluate_at(recording, model, poses, masks, progress)
}

/// As [`evaluate`], with `poses` (world from depth camera, one a frame of the recording) instead of a set: a run may
/// have poses of its own.
pub fn evaluate_at(
    recording: &Recording,
    model: &Model,
    poses: &[Option<Pose>],
    masks: Option<&Path>,
    progress: &dyn Fn(usize, usize),
) -> anyhow::Result<Option<(CompositionMetrics, Vec<Strip>)>> {
    let tests = test_frames(recording, poses);
    if tests.is_empty() {
        return Ok(None);
    }
    let view = ColorView::new(recording);
    let judge = Judge::new(recording, model, &view, poses, masks)?;
    let strip_step = tests.len().div_ceil(MOST_STRIPS);
    let mut tally = Tally::default();
    for (start, chunk) in chunks(&tests) {
        let judged: Vec<JudgedFrame> = chunk
            .par_iter()
            .enumerate()
            .map(|(k, test)| judge.frame(test, (start + k).is_multiple_of(strip_step)))
            .collect::<anyhow::Result<_>>()?;
        for frame in judged {
            tally.add(frame);
        }
        progress(start + chunk.len(), tests.len());
    }
    Ok(tally.metrics(judge.masks, tests.len()))
}

/// The frames that are held out and have a pose, in order.
fn test_frames(recording: &Recording, poses: &[Option<Pose>]) -> Vec<PosedFrame> {
    let mut tests: Vec<PosedFrame> = recording
        .split()
        .test
        .iter()
        .filter_map(|&index| {
            let index = index as usize;
            Some(PosedFrame {
                index,
                world_from_camera: poses.get(index).copied().flatten()?,
            })
        })
        .collect();
    tests.sort_by_key(|frame| frame.index);
    tests
}

/// Frames that are judged side by side, with the place of the first.
fn chunks(tests: &[PosedFrame]) -> impl Iterator<Item = (usize, &[PosedFrame])> {
    let size = rayon::current_num_threads().clamp(1, MOST_AT_ONCE);
    tests
        .chunks(size)
        .enumerate()
        .map(move |(k, chunk)| (k * size, chunk))
}

/// All that judging a frame needs.
struct Judge<'a> {
    recording: &'a Recording,
    model: &'a Model,
    view: &'a ColorView,
    training: TrainingViews<'a>,
    masks: MaskSource<'a>,
    lpips: Lpips,
}

/// One frame with its scores, `None` where its mask is empty.
struct JudgedFrame {
    error: FrameError,
    scores: Option<[ViewScore; 3]>,
    whole: [WholeFrame; 3],
    masked_count: usize,
    hole_count: usize,
    strip: Option<Strip>,
}

impl<'a> Judge<'a> {
    fn new(
        recording: &'a Recording,
        model: &'a Model,
        view: &'a ColorView,
        poses: &[Option<Pose>],
        masks: Option<&'a Path>,
    ) -> anyhow::Result<Self> {
        Ok(Self {
            recording,
            model,
            view,
            training: TrainingViews::new(recording, view, model, poses),
            masks: masks.map_or(MaskSource::ShinySegments, MaskSource::Given),
            lpips: Lpips::bundled()?,
        })
    }

    fn frame(&self, test: &PosedFrame, keeps_strip: bool) -> anyhow::Result<JudgedFrame> {
        let pose = self
            .view
            .surface_from_color(&self.model.surface, &test.world_from_camera);
        let nearest = self.training.nearest(&pose)?;
        let photograph = nearest.photograph()?;
        let predicted = predict::predict(self.view, self.model, &pose, &photograph);
        let truth = self.recording.color(test.index)?;
        let mask = self
            .masks
            .mask(test.index, &predicted.has_surface, &predicted.is_shiny)?;
        let scores = score::masked_scores(
            &self.lpips,
            &truth,
            &predicted.diffuse_only,
            predicted.pictures(),
            &mask,
        )?;
        let [composition, diffuse, nearest_view] = [0, 1, 2].map(|k| scores.map(|s| s[k]));
        Ok(JudgedFrame {
            error: FrameError {
                frame: test.index,
                nearest: nearest.index(),
                angle_deg: nearest.angle.to_degrees(),
                l1: composition.map(|s| s.l1),
                l1_diffuse: diffuse.map(|s| s.l1),
                l1_nearest: nearest_view.map(|s| s.l1),
                ssim: composition.and_then(|s| s.ssim),
                ssim_diffuse: diffuse.and_then(|s| s.ssim),
                ssim_nearest: nearest_view.and_then(|s| s.ssim),
                lpips: composition.and_then(|s| s.lpips),
                lpips_diffuse: diffuse.and_then(|s| s.lpips),
                lpips_nearest: nearest_view.and_then(|s| s.lpips),
            },
            scores,
            whole: score::whole_scores(&truth, &predicted)?,
            masked_count: mask.pixels().iter().filter(|inside| **inside).count(),
            hole_count: count_both(&mask, &predicted.is_hole),
            strip: keeps_strip.then_some(Strip {
                frame: test.index,
                photograph: truth,
                composition: predicted.composition,
                diffuse_only: predicted.diffuse_only,
                nearest_view: predicted.nearest_view,
                mask,
            }),
        })
    }
}

/// Sums over frames, in order of frames.
#[derive(Default)]
struct Tally {
    pools: [Pool; 3],
    frames: Vec<FrameError>,
    samples: Vec<angle::AngleSample>,
    strips: Vec<Strip>,
    masked_count: usize,
    hole_count: usize,
}

impl Tally {
    fn add(&mut self, judged: JudgedFrame) {
        for (k, pool) in self.pools.iter_mut().enumerate() {
            pool.add_whole(judged.whole[k]);
            if let Some(scores) = &judged.scores {
                pool.add(&scores[k]);
            }
        }
        let error = judged.error;
        let values = match (error.lpips, error.lpips_diffuse, error.lpips_nearest) {
            (Some(composition), Some(diffuse), Some(nearest)) => {
                Some([composition, diffuse, nearest])
            }
            _ => None,
        };
        self.samples.push(angle::AngleSample {
            frame: error.frame,
            angle_deg: error.angle_deg,
            values,
        });
        self.frames.push(error);
        self.masked_count += judged.masked_count;
        self.hole_count += judged.hole_count;
        self.strips.extend(judged.strip);
    }

    fn metrics(
        self,
        masks: MaskSource<'_>,
        frame_count: usize,
    ) -> Option<(CompositionMetrics, Vec<Strip>)> {
        let [composition, diffuse_only, nearest_view] = self.pools.map(|pool| pool.error());
        let metrics = CompositionMetrics {
            mask: masks.description().to_owned(),
            pixel_count: self.masked_count,
            frame_count,
            lpips_frame_count: self.samples.iter().filter(|s| s.values.is_some()).count(),
            composition: composition?,
            diffuse_only: diffuse_only?,
            nearest_view: nearest_view?,
            nearest_hole_fraction: self.hole_count as f64 / self.masked_count as f64,
            lpips_by_angle: angle::by_angle(METHODS, &self.samples),
            frames: self.frames,
        };
        Some((metrics, self.strips))
    }
}

fn count_both(a: &Mask, b: &Mask) -> usize {
    a.pixels()
        .iter()
        .zip(b.pixels())
        .filter(|(a, b)| **a && **b)
        .count()
}
