//! What each effect can change at most, from the survey's pixels (codes).

use std::collections::BTreeMap;

use effects::survey::CODES;
use geometry::robust;
use imaging::{Response, Vignetting};
use rayon::prelude::*;
use raytrace::Hit;
use sequence::Recording;
use srm::rows::luminance;

use super::fresnel::rise;
use super::noise::NoiseCurve;
use super::texture::{Texture, at_hit, drawn, gradient};
use super::views::{SurveyView, SurveyViews};
use crate::stages::observe::Surface;

/// Part of σ that is the mean of the positive half of noise.
const POSITIVE_NOISE: f64 = 0.4;
/// Pixels around a blocked one that may be blocked as well: a lobe reaches beyond the mirrored ray, and the surface is
/// not known to the pixel.
const NEAR: usize = 2;
/// A pixel shows the room in directions that nobody sees free at most so many times as bright as the upper quartile of
/// what its segment mirrors freely. With the pixel's own light as the limit: 200 random scenes, bound over true change
/// 4 in the median.
const UNSEEN_ROOM: f64 = 2.0;
/// The quartile.
const BRIGHT_QUANTILE: f64 = 0.75;
/// What a surface shows beyond its dark look in the median is so many times less than what a mirror may see in it.
const UNSEEN_SHINE: f64 = 3.1;
/// Part of σ by which noise alone lifts the median over the lower decile, less what stands for weak shine.
const SPREAD_OF_NOISE: f64 = 0.6;
/// Quantile of light over the colour of the first bounce that limits the reflectance of a segment.
const SHARE_QUANTILE: f64 = 0.2;
/// Radiance of first bounces from which they limit anything.
const LEAST_BOUNCE: f64 = 0.01;
/// Pixels with such a first bounce from which their quantile is one.
const FEWEST_BOUNCES: usize = 20;
/// Light spreads so many times wider over its levels than developed photographs of it, which a mosaic smooths: on 200
/// random scenes the true change by a lens or a response is up to 1.3 times what their levels say, rarely more.
const SMOOTHED: f64 = 1.25;
/// (1 − R₀)/R₀ of R₀ = 0.03: as steep as coated plastic gets. That of common plastic, 24, is less than the true change
/// of what reflects less.
const STEEP_KAPPA: f64 = 32.0;

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

/// What a mirrored ray meets.
#[derive(Clone, Copy, Debug, Default)]
struct Met {
    /// Luminance from all sides.
    color: f64,
    /// What it shows beyond its dark look: what it may mirror itself.
    shine: f64,
}

/// What one pixel of Ω says.
struct Seen {
    grey: f64,
    /// Ŝ: what it shows beyond its dark look.
    specular: f64,
    cosine: f64,
    segment: u16,
    bounce: Option<Met>,
    /// The same, or the mean of the pixels around where only their rays are blocked.
    near: Option<Met>,
    clipped_share: f64,
    /// Factor of the lens.
    lens: f64,
    level: f64,
    /// Noise of a pixel of the photograph.
    sigma: f64,
}

impl Seen {
    /// Light that the pixel surely does not exceed: every part of it is less.
    fn most(&self) -> f64 {
        self.grey + 3.0 * self.sigma
    }
}

/// What the pixels of a segment say together.
struct SegmentLook {
    /// Upper quartile of Ŝ.
    bright: f64,
    /// Largest share of a first bounce that it can reflect.
    share: f64,
}

impl SegmentLook {
    fn of(pixels: &[&Seen]) -> Self {
        let mut specular: Vec<f64> = pixels.iter().map(|pixel| pixel.specular).collect();
        let with_bounce = pixels.iter().filter_map(|pixel| {
            let color = pixel.bounce?.color;
            (color > LEAST_BOUNCE).then(|| pixel.most() / color)
        });
        let mut shares: Vec<f64> = with_bounce.collect();
        let share = if shares.len() < FEWEST_BOUNCES {
            1.0
        } else {
            robust::quantile(&mut shares, SHARE_QUANTILE).unwrap_or(1.0)
        };
        Self {
            bright: robust::quantile(&mut specular, BRIGHT_QUANTILE).unwrap_or(0.0),
            share: share.min(1.0),
        }
    }

    /// Of every segment.
    fn all(seen: &[Seen]) -> BTreeMap<u16, Self> {
        let mut pixels: BTreeMap<u16, Vec<&Seen>> = BTreeMap::new();
        for pixel in seen {
            pixels.entry(pixel.segment).or_default().push(pixel);
        }
        let looks = pixels.into_iter();
        looks
            .map(|(segment, pixels)| (segment, Self::of(&pixels)))
            .collect()
    }
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
    let looks = SegmentLook::all(&seen);
    let sigma = |pixel: &Seen| pixel.sigma;
    // Least of what `light` says of a pixel and its segment and of the pixel's own light, where there is any.
    let limited = |light: &dyn Fn(&Seen, &SegmentLook) -> Option<f64>| {
        CODES
            * mean(&|pixel| {
                let light = looks
                    .get(&pixel.segment)
                    .and_then(|look| light(pixel, look));
                light.map_or(0.0, |light| light.min(pixel.most()))
            })
    };
    Bounds {
        hit_fraction: share(&|pixel| pixel.bounce.is_some()),
        saturated_fraction: mean(&|pixel| pixel.clipped_share),
        mask_fraction: seen.len() as f64 / pixel_count.max(1) as f64,
        sigma: mean(&sigma),
        noise_ratio: quantile(&sigma, 0.95) / quantile(&sigma, 0.05).max(f64::MIN_POSITIVE),
        gradient: mean_gradient(views, surface, texture),
        visibility: limited(&|pixel, look| pixel.near.map(|_| UNSEEN_ROOM * look.bright)),
        first_bounce: limited(&|pixel, look| pixel.bounce.map(|met| look.share * met.color)),
        first_bounce_specular: limited(&|pixel, look| {
            let met = pixel.near?;
            Some(UNSEEN_SHINE * look.share * met.shine)
        }),
        fresnel: rise_bound(&seen),
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
    let mut met = vec![None; view.grey.len()];
    for pixel in &view.pixels {
        met[pixel.place] = pixel
            .bounce
            .map(|bounce| met_at(surface, texture, &bounce, noise, block));
    }
    view.pixels
        .iter()
        .filter_map(|pixel| {
            let grey = f64::from(view.grey[pixel.place]);
            let level = luminance(view.color[pixel.place].map(f64::from));
            let smoothed = mean_of_neighbours(&beyond, width, pixel.place)?;
            let sigma = noise.sigma(level);
            let [u, v] = [pixel.place % width, pixel.place / width]
                .map(|at| (at as f64 + 0.5) * block - 0.5);
            Some(Seen {
                grey,
                specular: (smoothed - POSITIVE_NOISE * sigma).max(0.0),
                cosine: f64::from(pixel.cosine),
                segment: pixel.segment,
                bounce: met[pixel.place],
                near: met[pixel.place].or_else(|| met_around(&met, width, pixel.place)),
                clipped_share: f64::from(pixel.clipped_share),
                lens: vignetting.factor(u, v),
                level,
                sigma,
            })
        })
        .collect()
}

/// What the surface shows where a mirrored ray meets it; dark where too few views saw that.
fn met_at(
    surface: &Surface,
    texture: &Texture,
    bounce: &Hit,
    noise: &NoiseCurve,
    block: f64,
) -> Met {
    let [color, low] =
        [&texture.median, &texture.low].map(|values| f64::from(at_hit(surface, values, bounce)));
    if !(color.is_finite() && low.is_finite()) {
        return Met::default();
    }
    // A survey pixel is the mean of a block.
    let spread = SPREAD_OF_NOISE * noise.sigma(color) / block;
    Met {
        color,
        shine: (color - low - spread).max(0.0),
    }
}

/// Mean of what the pixels around a place met; `None` where no ray is blocked.
fn met_around(met: &[Option<Met>], width: usize, place: usize) -> Option<Met> {
    let (column, row) = (place % width, place / width);
    let rows = row.saturating_sub(NEAR)..=(row + NEAR).min(met.len() / width - 1);
    let columns = column.saturating_sub(NEAR)..=(column + NEAR).min(width - 1);
    let around = rows.flat_map(|row| met[row * width..][columns.clone()].iter().flatten());
    let (sum, count) = around.fold((Met::default(), 0.0), |(sum, count), met| {
        let sum = Met {
            color: sum.color + met.color,
            shine: sum.shine + met.shine,
        };
        (sum, count + 1.0)
    });
    (count > 0.0).then(|| Met {
        color: sum.color / count,
        shine: sum.shine / count,
    })
}

/// ⟨Ŝ |f − f̄| / f⟩ with f = 1 + κ (1 − cos α)⁵ and its mean f̄ weighted by Ŝ.
fn rise_bound(seen: &[Seen]) -> f64 {
    let factor = |pixel: &Seen| 1.0 + STEEP_KAPPA * rise(pixel.cosine);
    let weight = seen.iter().map(|pixel| pixel.specular).sum::<f64>();
    if !(weight > 0.0) {
        return 0.0;
    }
    let weighted = seen.iter().map(|pixel| pixel.specular * factor(pixel));
    let mean = weighted.sum::<f64>() / weight;
    let change = |pixel: &Seen| pixel.specular * (factor(pixel) - mean).abs() / factor(pixel);
    CODES * seen.iter().map(change).sum::<f64>() / seen.len() as f64
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

/// ⟨D |V/V̄ − 1|⟩, of light before it was smoothed.
fn lens_bound(seen: &[Seen]) -> f64 {
    let count = seen.len().max(1) as f64;
    let mean = seen.iter().map(|pixel| pixel.lens).sum::<f64>() / count;
    if !(mean > 0.0) {
        return 0.0;
    }
    let change = |pixel: &Seen| pixel.level * (pixel.lens / mean - 1.0).abs();
    SMOOTHED * CODES * seen.iter().map(change).sum::<f64>() / count
}

/// ⟨|g(y) − a y|⟩ with the slope a that fits best, of light before it was smoothed: what reading codes as radiance would
/// change.
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
    SMOOTHED * CODES * change.sum::<f64>() / pairs.len() as f64
}
