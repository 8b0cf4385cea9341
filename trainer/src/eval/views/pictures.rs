//! Pictures that were drawn elsewhere, against the held-out photographs.

use std::path::Path;

use geometry::Pose;
use imaging::{Image, Rgb8Image};
use rayon::prelude::*;
use sequence::Recording;

use super::mask::MaskSource;
use super::predict::outline;
use super::score::{self, Pool, ViewScore};
use super::{Lpips, ViewError, chunks, test_frames};
use crate::eval::model::Model;
use crate::stages::observe::ColorView;

/// Figures of pictures that somebody else drew.
#[derive(Clone, Debug, PartialEq)]
pub struct PictureMetrics {
    /// Over all held-out frames, as of [`super::CompositionMetrics`].
    pub error: ViewError,
    /// L1 and masked samples of each frame that has any, in order.
    pub frames: Vec<(f64, f64)>,
}

impl PictureMetrics {
    /// L1 of `count` consecutive parts of the frames, weighted so that their mean is the L1 of all.
    pub fn blocks(&self, count: usize) -> Vec<f64> {
        let count = count.min(self.frames.len()).max(1);
        let whole: f64 = self.frames.iter().map(|(_, samples)| samples).sum();
        let part = |part: usize| {
            let range = part * self.frames.len() / count..(part + 1) * self.frames.len() / count;
            let sum: f64 = self.frames[range].iter().map(|(l1, n)| l1 * n).sum();
            count as f64 * sum / whole.max(1e-300)
        };
        (0..count).map(part).collect()
    }
}

/// Judges the pictures of all held-out frames with a pose of `poses`; `picture` gives the one of a frame, as the
/// camera codes, of any size: smaller ones are enlarged. The mask is as in [`super::evaluate_at`]. `None` when no
/// pixel counts.
///
/// # Errors
/// When a picture, mask or photograph cannot be read.
pub fn judge_pictures(
    recording: &Recording,
    model: &Model,
    poses: &[Option<Pose>],
    masks: Option<&Path>,
    picture: &(dyn Fn(usize) -> anyhow::Result<Rgb8Image> + Sync),
) -> anyhow::Result<Option<PictureMetrics>> {
    let view = ColorView::new(recording);
    let lpips = Lpips::bundled()?;
    let masks = masks.map_or(MaskSource::ShinySegments, MaskSource::Given);
    let tests = test_frames(recording, poses);
    let mut pool = Pool::default();
    let mut frames = Vec::new();
    for (_, chunk) in chunks(&tests) {
        let judged: Vec<Option<ViewScore>> = chunk
            .par_iter()
            .map(|test| {
                let pose = view.surface_from_color(&model.surface, &test.world_from_camera);
                let drawn = outline(&view, model, &pose);
                let mask = masks.mask(test.index, &drawn.has_surface, &drawn.is_shiny)?;
                let truth = recording.color(test.index)?;
                let found = enlarged(&picture(test.index)?, truth.width(), truth.height());
                let scores =
                    score::masked_scores(&lpips, &truth, &drawn.diffuse_only, [&found], &mask)?;
                Ok(scores.map(|[score]| score))
            })
            .collect::<anyhow::Result<_>>()?;
        for score in judged.iter().flatten() {
            pool.add(score);
            frames.push((score.l1, score.sample_count()));
        }
    }
    Ok(pool.error().map(|error| PictureMetrics { error, frames }))
}

/// The picture at `width` x `height`, bilinear between the centres of its pixels, held beyond the outermost; one of
/// that size stays as it is.
fn enlarged(picture: &Rgb8Image, width: u32, height: u32) -> Rgb8Image {
    if (picture.width(), picture.height()) == (width, height) {
        return picture.clone();
    }
    let along = |at: u32, from: u32, to: u32| {
        let place = (f64::from(at) + 0.5) * f64::from(from) / f64::from(to) - 0.5;
        let place = place.clamp(0.0, f64::from(from - 1));
        let low = place.floor();
        let next = (low as u32 + 1).min(from - 1);
        (low as u32, next, place - low)
    };
    Image::from_fn(width, height, |x, y| {
        let (x0, x1, fx) = along(x, picture.width(), width);
        let (y0, y1, fy) = along(y, picture.height(), height);
        let corners = [(x0, y0), (x1, y0), (x0, y1), (x1, y1)].map(|(x, y)| picture.at(x, y));
        std::array::from_fn(|c| {
            let [a, b, low_a, low_b] = corners.map(|corner| f64::from(corner[c]));
            let (top, bottom) = (a + fx * (b - a), low_a + fx * (low_b - low_a));
            (top + fy * (bottom - top)).round() as u8
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ramp_stays_a_ramp_when_it_is_enlarged() {
        let small: Rgb8Image = Image::from_fn(4, 2, |x, _| [(40 + 40 * x) as u8, 9, 200]);
        let large = enlarged(&small, 16, 8);
        assert_eq!((large.width(), large.height()), (16, 8));
        // Pixel centres: 40 a small pixel is 10 a large one; half of a large one lies before the middle.
        assert_eq!(large.at(2, 3), [45, 9, 200]);
        assert_eq!(large.at(9, 3), [115, 9, 200]);
        assert_eq!(large.at(0, 0), [40, 9, 200]);
        assert_eq!(large.at(15, 7), [160, 9, 200]);
        assert_eq!(enlarged(&small, 4, 2).pixels(), small.pixels());
    }

    #[test]
    fn the_mean_of_the_blocks_is_the_error() {
        let frames: Vec<(f64, f64)> = (0..12)
            .map(|k| (0.01 * f64::from(k), 100.0 + f64::from(k)))
            .collect();
        let l1 = frames.iter().map(|(l1, n)| l1 * n).sum::<f64>()
            / frames.iter().map(|(_, n)| n).sum::<f64>();
        let metrics = PictureMetrics {
            error: ViewError::default(),
            frames,
        };
        for count in [1, 5, 10, 40] {
            let blocks = metrics.blocks(count);
            assert_eq!(blocks.len(), count.min(12));
            let mean = blocks.iter().sum::<f64>() / blocks.len() as f64;
            assert!((mean - l1).abs() < 1e-12);
        }
    }
}
