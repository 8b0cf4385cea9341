//! What each effect can change at most, from the survey's pixels (codes).

use effects::survey::CODES;
use geometry::robust;
use imaging::{Response, Vignetting};
use rayon::prelude::*;
use sequence::Recording;
use srm::rows::luminance;

use super::fresnel::{PLASTIC_KAPPA, rise};
use super::noise::NoiseCurve;
use super::texture::{Texture, at_hit, drawn, gradient};
use super::views::{SurveyView, SurveyViews};
use crate::stages::observe::Surface;

/// Part of σ that is the mean of the positive half of noise.
const POSITIVE_NOISE: f64 = 0.4;
/// Largest radiance of the room that bounds assume where more is not seen: the white level.
const ASSUMED_MAXIMUM: f64 = 1.0;
/// A lens whose factor varies less than this over the object is no effect.
const LEAST_FALL_OFF: f64 = 0.005;

/// Bounds and shares over the object's pixels Ω.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Bounds {
    /// Share of Ω whose mirrored ray is blocked.
    pub hit_fraction: f64,
    /// Share of Ω that is clipped.
    pub saturated_fraction: f64,
    /// Ω as a share of the pictures.
    pub mask_fraction: f64,
    /// Noise of a pixel over Ω, linear radiance.
    pub sigma: f64,
    /// σ at the bright over σ at the dark end of Ω.
    pub noise_ratio: f64,
    /// Mean gradient of the photographs over Ω, linear radiance a survey pixel.
    pub gradient: f64,
    /// Bounds, codes.
    pub visibility: f64,
    /// First bounce, diffuse.
    pub first_bounce: f64,
    /// First bounce, specular.
    pub first_bounce_specular: f64,
    /// Rise of the reflectance.
    pub fresnel: f64,
    /// Fall-off of the lens.
    pub vignetting: f64,
    /// Curve of the camera.
    pub response: f64,
}

/// What one pixel of Ω says.
struct Seen {
    grey: f64,
    /// Ŝ: what it shows beyond its dark look.
    specular: f64,
    cosine: f64,
    /// Luminance of its first bounce.
    bounce: Option<f64>,
    mirrors_again: bool,
    clipped_share: f64,
    /// Factor of the lens.
    lens: f64,
    level: f64,
}

/// All bounds.
pub(super) fn bounds(
    recording: &Recording,
    views: &SurveyViews,
    surface: &Surface,
    texture: &Texture,
    noise: &NoiseCurve,
) -> Bounds {
    let description = recording.color_camera();
    let vignetting = description.vignetting();
    let block = f64::from(description.intrinsics.width() / views.camera.width());
    let seen: Vec<Seen> = views
        .views
        .par_iter()
        .flat_map_iter(|view| seen(views, view, surface, texture, noise, &vignetting, block))
        .collect();
    let pixel_count = (views.camera.width() * views.camera.height()) as usize * views.views.len();
    let count = seen.len().max(1) as f64;
    let share = |keep: &dyn Fn(&Seen) -> bool| {
        seen.iter().filter(|pixel| keep(pixel)).count() as f64 / count
    };
    let mean = |value: &dyn Fn(&Seen) -> f64| seen.iter().map(value).sum::<f64>() / count;
    let quantile = |value: &dyn Fn(&Seen) -> f64, q: f64| {
        let mut values: Vec<f64> = seen.iter().map(value).filter(|v| v.is_finite()).collect();
        robust::quantile(&mut values, q).unwrap_or(0.0)
    };
    let specular = |pixel: &Seen| pixel.specular;
    let room = quantile(&specular, 0.99).max(ASSUMED_MAXIMUM);
    let strength = quantile(&specular, 0.95) / room;
    let sigma = |pixel: &Seen| noise.sigma(pixel.level);
    let factor = |pixel: &Seen| 1.0 + PLASTIC_KAPPA * rise(pixel.cosine);
    let weight = seen.iter().map(specular).sum::<f64>();
    let mean_factor = if weight > 0.0 {
        seen.iter().map(|p| p.specular * factor(p)).sum::<f64>() / weight
    } else {
        1.0
    };
    let second = share(&|pixel| pixel.mirrors_again);
    Bounds {
        hit_fraction: share(&|pixel| pixel.bounce.is_some()),
        saturated_fraction: mean(&|pixel| pixel.clipped_share),
        mask_fraction: seen.len() as f64 / pixel_count.max(1) as f64,
        sigma: mean(&sigma),
        noise_ratio: quantile(&sigma, 0.95) / quantile(&sigma, 0.05).max(f64::MIN_POSITIVE),
        gradient: mean_gradient(views, surface, texture),
        visibility: CODES
            * mean(&|pixel| {
                let added = (strength * room).min(pixel.grey + 3.0 * sigma(pixel));
                pixel.bounce.map_or(0.0, |_| added)
            }),
        first_bounce: CODES * strength * mean(&|pixel| pixel.bounce.unwrap_or(0.0)),
        first_bounce_specular: CODES * strength * strength * second * room,
        fresnel: CODES
            * mean(&|pixel| pixel.specular * (factor(pixel) - mean_factor).abs() / factor(pixel)),
        vignetting: lens_bound(&seen),
        response: response_bound(&seen, &description.response()),
    }
}

fn seen(
    views: &SurveyViews,
    view: &SurveyView,
    surface: &Surface,
    texture: &Texture,
    noise: &NoiseCurve,
    vignetting: &Vignetting,
    block: f64,
) -> Vec<Seen> {
    let width = views.camera.width() as usize;
    let low = drawn(view, surface, &texture.low);
    let beyond: Vec<f32> = view
        .grey
        .iter()
        .zip(&low)
        .map(|(seen, low)| (seen - low).max(0.0))
        .collect();
    view.pixels
        .iter()
        .filter_map(|pixel| {
            let grey = f64::from(view.grey[pixel.place]);
            let level = luminance(view.color[pixel.place].map(f64::from));
            let smoothed = mean_of_neighbours(&beyond, width, pixel.place)?;
            let specular = (smoothed - POSITIVE_NOISE * noise.sigma(level)).max(0.0);
            let [u, v] = [pixel.place % width, pixel.place / width]
                .map(|at| (at as f64 + 0.5) * block - 0.5);
            let bounce = pixel.bounce.map(|bounce| {
                let color = f64::from(at_hit(surface, &texture.median, &bounce));
                if color.is_finite() { color } else { 0.0 }
            });
            Some(Seen {
                grey,
                specular,
                cosine: f64::from(pixel.cosine),
                bounce,
                mirrors_again: pixel.second.is_some(),
                clipped_share: f64::from(pixel.clipped_share),
                lens: vignetting.factor(u, v),
                level,
            })
        })
        .collect()
}

/// Mean of the 3 x 3 pixels around a place; `None` where all are missing.
fn mean_of_neighbours(picture: &[f32], width: usize, place: usize) -> Option<f64> {
    let (mut sum, mut count) = (0.0, 0.0);
    for row in [place.checked_sub(width)?, place, place + width] {
        for index in row.checked_sub(1)?..=row + 1 {
            if let Some(value) = picture.get(index).filter(|value| value.is_finite()) {
                sum += f64::from(*value);
                count += 1.0;
            }
        }
    }
    (count > 0.0).then_some(sum / count)
}

/// ⟨‖∇G‖⟩ over Ω, of what the surface shows from all sides: highlights and noise do not register.
fn mean_gradient(views: &SurveyViews, surface: &Surface, texture: &Texture) -> f64 {
    let width = views.camera.width() as usize;
    let sums: Vec<(f64, f64)> = views
        .views
        .par_iter()
        .map(|view| {
            let slopes = gradient(&drawn(view, surface, &texture.median), width);
            let known = view.pixels.iter().map(|pixel| slopes[pixel.place]);
            known
                .filter(|[x, y]| x.is_finite() && y.is_finite())
                .fold((0.0, 0.0), |(sum, count), [x, y]| {
                    (sum + f64::from(x.hypot(y)), count + 1.0)
                })
        })
        .collect();
    let (sum, count) = sums
        .iter()
        .fold((0.0, 0.0), |(a, b), (sum, count)| (a + sum, b + count));
    sum / f64::max(count, 1.0)
}

/// ⟨D |V/V̄ − 1|⟩, 0 where the lens hardly varies.
fn lens_bound(seen: &[Seen]) -> f64 {
    let lens = || seen.iter().map(|pixel| pixel.lens).filter(|&v| v > 0.0);
    let count = lens().count().max(1) as f64;
    let mean = lens().sum::<f64>() / count;
    let (low, high) = lens().fold((f64::INFINITY, 0.0), |(low, high), value| {
        (f64::min(low, value), f64::max(high, value))
    });
    if !(mean > 0.0) || (high - low) / mean < LEAST_FALL_OFF {
        return 0.0;
    }
    let change = |pixel: &Seen| pixel.level * (pixel.lens / mean - 1.0).abs();
    CODES * seen.iter().map(change).sum::<f64>() / count
}

/// ⟨|g(y) − a y|⟩ with the slope a that fits best: what reading codes as radiance would change.
fn response_bound(seen: &[Seen], response: &Response) -> f64 {
    let pairs: Vec<(f64, f64)> = seen
        .iter()
        .map(|pixel| {
            let linear = pixel.level * pixel.lens;
            (f64::from(response.code(linear as f32, 1)) / CODES, linear)
        })
        .filter(|(code, linear)| code.is_finite() && linear.is_finite())
        .collect();
    let xx: f64 = pairs.iter().map(|(code, _)| code * code).sum();
    let xy: f64 = pairs.iter().map(|(code, linear)| code * linear).sum();
    if !(xx > 0.0) {
        return 0.0;
    }
    let slope = xy / xx;
    let change = pairs
        .iter()
        .map(|(code, linear)| (linear - slope * code).abs());
    CODES * change.sum::<f64>() / pairs.len() as f64
}
