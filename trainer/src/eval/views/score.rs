//! The figures of one prediction of one photograph, and their pools over frames.

use imaging::measures::{self, HighlightEnergy, SquaredError};
use imaging::{Image, Mask, Rgb8Image, srgb};

use super::figures::ViewError;
use super::predict::Predictions;
use crate::perceptual::{CROP_MARGIN, CropBox, Features, Lpips, NetworkInput, PerceptualError};

/// The methods, in the order of every array here, by their keys in the metrics.
pub(super) const METHODS: [&str; 3] = ["composition", "diffuse_only", "nearest_view"];

/// One prediction of one photograph over a mask that is not empty.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct ViewScore {
    pub(super) l1: f64,
    squared: SquaredError,
    pub(super) ssim: Option<f64>,
    pub(super) lpips: Option<f64>,
    highlights: HighlightEnergy,
}

/// Mean absolute difference over all pixels with a surface, with the number of these pixels.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct WholeFrame {
    l1: f64,
    pixel_count: usize,
}

/// A mean that grows.
#[derive(Clone, Copy, Debug, Default)]
struct Mean {
    sum: f64,
    weight: f64,
}

impl Mean {
    fn add(&mut self, value: f64, weight: f64) {
        self.sum += weight * value;
        self.weight += weight;
    }

    fn value(self) -> Option<f64> {
        (self.weight > 0.0).then(|| self.sum / self.weight)
    }
}

/// One method over all frames.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Pool {
    l1: Mean,
    squared: SquaredError,
    ssim: Mean,
    lpips: Mean,
    highlights: HighlightEnergy,
    whole: Mean,
}

impl Pool {
    /// Adds a frame; pixels count alike in L1 and PSNR, frames in SSIM and LPIPS.
    pub(super) fn add(&mut self, score: &ViewScore) {
        self.l1.add(score.l1, score.sample_count());
        self.squared = self.squared.and(score.squared);
        self.highlights = self.highlights.and(score.highlights);
        for (mean, value) in [(&mut self.ssim, score.ssim), (&mut self.lpips, score.lpips)] {
            if let Some(value) = value {
                mean.add(value, 1.0);
            }
        }
    }

    /// Adds what stands outside the mask too.
    pub(super) fn add_whole(&mut self, whole: WholeFrame) {
        self.whole.add(whole.l1, whole.pixel_count as f64);
    }

    /// The figures; `None` when no frame had a masked pixel.
    pub(super) fn error(&self) -> Option<ViewError> {
        Some(ViewError {
            l1: self.l1.value()?,
            psnr: self.squared.psnr()?.db,
            ssim: self.ssim.value(),
            lpips: self.lpips.value(),
            highlight_ratio: self.highlights.ratio(),
            l1_full: self.whole.value(),
        })
    }
}

impl ViewScore {
    /// Masked pixels times channels.
    pub(super) fn sample_count(&self) -> f64 {
        self.squared.sample_count as f64
    }
}

/// Scores predictions over `mask`, `diffuse` among or beside them; `None` when the mask is empty.
pub(super) fn masked_scores<const N: usize>(
    lpips: &Lpips,
    photograph: &Rgb8Image,
    diffuse: &Rgb8Image,
    predicted: [&Rgb8Image; N],
    mask: &Mask,
) -> anyhow::Result<Option<[ViewScore; N]>> {
    // The margin holds the windows of SSIM too: outside the crop nothing is counted.
    let Some(area) = CropBox::around(mask, CROP_MARGIN) else {
        return Ok(None);
    };
    let encoded = |image: &Rgb8Image| srgb::encoded_from_rgb8(&area.of(image));
    let truth = encoded(photograph);
    let mask = area.of(mask);
    let diffuse = encoded(diffuse);
    let seen = features(lpips, &truth, &mask)?;
    let score = |image: &Rgb8Image| -> anyhow::Result<ViewScore> {
        let image = encoded(image);
        let lpips = match (&seen, features(lpips, &image, &mask)?) {
            (Some(truth), Some(image)) => Some(lpips.distance(&image, truth)?.total()),
            _ => None,
        };
        Ok(ViewScore {
            l1: measures::l1(&image, &truth, Some(&mask))?.unwrap_or(0.0),
            squared: measures::squared_error(&image, &truth, Some(&mask))?,
            ssim: measures::ssim(&image, &truth, Some(&mask))?,
            lpips,
            highlights: measures::highlight_energy(&image, &truth, &diffuse, Some(&mask))?,
        })
    };
    let mut scores = [ViewScore::default(); N];
    for (slot, image) in scores.iter_mut().zip(predicted) {
        *slot = score(image)?;
    }
    Ok(Some(scores))
}

/// What the network sees; `None` of a crop that is too small for it.
fn features(
    lpips: &Lpips,
    image: &Image<[f32; 3]>,
    mask: &Mask,
) -> Result<Option<Features>, PerceptualError> {
    match NetworkInput::masked(image, mask) {
        Ok(Some(judged)) => lpips.features(&judged).map(Some),
        Ok(None) | Err(PerceptualError::TooSmall { .. }) => Ok(None),
        Err(error) => Err(error),
    }
}

/// The three predictions over all that has a surface.
pub(super) fn whole_scores(
    photograph: &Rgb8Image,
    predicted: &Predictions,
) -> anyhow::Result<[WholeFrame; 3]> {
    let truth = srgb::encoded_from_rgb8(photograph);
    let valid = &predicted.has_surface;
    let pixel_count = valid.pixels().iter().filter(|valid| **valid).count();
    let mut scores = [WholeFrame::default(); 3];
    for (score, image) in scores.iter_mut().zip(predicted.pictures()) {
        let l1 = measures::l1(&srgb::encoded_from_rgb8(image), &truth, Some(valid))?;
        *score = WholeFrame {
            l1: l1.unwrap_or(0.0),
            pixel_count,
        };
    }
    Ok(scores)
}
