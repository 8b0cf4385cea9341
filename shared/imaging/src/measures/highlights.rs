//! How much of the highlights a prediction keeps.

use super::require_within;
use crate::error::ImagingError;
use crate::image::{Image, Mask};

/// Light above the diffuse picture, summed over pixels and channels; pooled over frames before it becomes a ratio.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct HighlightEnergy {
    /// Σ \[predicted − diffuse\]₊.
    pub predicted: f64,
    /// Σ \[truth − diffuse\]₊.
    pub truth: f64,
}

impl HighlightEnergy {
    /// Pools with another image's energy.
    #[must_use]
    pub fn and(self, other: Self) -> Self {
        Self {
            predicted: self.predicted + other.predicted,
            truth: self.truth + other.truth,
        }
    }

    /// Predicted over true; below 1 highlights are muted, which L1 rewards. `None` when the truth has none.
    pub fn ratio(&self) -> Option<f64> {
        (self.truth > 0.0).then(|| self.predicted / self.truth)
    }
}

/// The energy above `diffuse` of a prediction and of the truth over the pixels of `mask`, all channels, in the
/// images' unit. Refuses images of different sizes and values that are not finite inside the mask.
pub fn highlight_energy(
    predicted: &Image<[f32; 3]>,
    truth: &Image<[f32; 3]>,
    diffuse: &Image<[f32; 3]>,
    mask: Option<&Mask>,
) -> Result<HighlightEnergy, ImagingError> {
    predicted.require_same_size(truth)?;
    predicted.require_same_size(diffuse)?;
    if let Some(mask) = mask {
        predicted.require_same_size(mask)?;
    }
    let mut energy = HighlightEnergy::default();
    for y in 0..predicted.height() {
        let marks = mask.map(|mask| mask.row(y));
        let colors = predicted.row(y).iter().zip(truth.row(y));
        for (x, ((p, t), d)) in colors.zip(diffuse.row(y)).enumerate() {
            if marks.is_some_and(|marks| !marks[x]) {
                continue;
            }
            for ((&p, &t), &d) in p.iter().zip(t).zip(d) {
                for value in [p, t, d] {
                    require_within(value, x as u32, y, f32::MIN, f32::MAX)?;
                }
                energy.predicted += (f64::from(p) - f64::from(d)).max(0.0);
                energy.truth += (f64::from(t) - f64::from(d)).max(0.0);
            }
        }
    }
    Ok(energy)
}

/// [`highlight_energy`] of one image as a ratio; `None` when the truth has no highlights or nothing is masked.
pub fn highlight_ratio(
    predicted: &Image<[f32; 3]>,
    truth: &Image<[f32; 3]>,
    diffuse: &Image<[f32; 3]>,
    mask: Option<&Mask>,
) -> Result<Option<f64>, ImagingError> {
    Ok(highlight_energy(predicted, truth, diffuse, mask)?.ratio())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn muted_highlights_have_a_ratio_below_one_by_hand() {
        let diffuse = Image::from_fn(2, 1, |_, _| [0.25_f32; 3]);
        // Light below the diffuse picture is no highlight: it must not cancel what is above.
        let truth = Image::from_fn(2, 1, |x, _| if x == 0 { [0.75; 3] } else { [0.0; 3] });
        let muted = Image::from_fn(2, 1, |x, _| if x == 0 { [0.5; 3] } else { [0.25; 3] });
        let ratio = |image: &Image<_>| highlight_ratio(image, &truth, &diffuse, None).unwrap();
        assert_eq!(ratio(&muted), Some(0.5));
        assert_eq!(ratio(&truth), Some(1.0));
        assert_eq!(ratio(&diffuse), Some(0.0));
        let whole = highlight_energy(&muted, &truth, &diffuse, None).unwrap();
        assert_eq!(whole.and(whole).ratio(), Some(0.5));
        let second = Image::from_fn(2, 1, |x, _| x == 1);
        let masked = highlight_ratio(&muted, &truth, &diffuse, Some(&second)).unwrap();
        assert_eq!(masked, None, "no highlight in the mask");
    }

    #[test]
    fn nothing_and_constants_have_no_ratio() {
        let empty = Image::new(0, 0, [0.0_f32; 3]);
        assert_eq!(highlight_ratio(&empty, &empty, &empty, None).unwrap(), None);
        let flat = Image::new(4, 4, [0.3_f32; 3]);
        let nothing = Image::new(4, 4, false);
        for mask in [None, Some(&nothing)] {
            assert_eq!(highlight_ratio(&flat, &flat, &flat, mask).unwrap(), None);
        }
        assert_eq!(HighlightEnergy::default().ratio(), None);
    }

    #[test]
    fn what_is_not_finite_or_of_another_size_is_refused_inside_the_mask_only() {
        let flat = Image::new(3, 3, [0.3_f32; 3]);
        let mut broken = flat.clone();
        *broken.at_mut(1, 1) = [0.3, f32::NAN, 0.3];
        assert!(highlight_energy(&flat, &flat, &broken, None).is_err());
        let around = Image::from_fn(3, 3, |x, y| (x, y) != (1, 1));
        assert!(highlight_energy(&flat, &flat, &broken, Some(&around)).is_ok());
        let other = Image::new(3, 2, [0.3_f32; 3]);
        assert!(highlight_energy(&flat, &flat, &other, None).is_err());
        assert!(highlight_energy(&flat, &other, &flat, None).is_err());
    }
}
