//! The colour sensor: lens, photons, response, 8 bits, one colour a pixel.

use effects::{Effect, EffectSet};
use geometry::Intrinsics;
use imaging::{Image, LinearImage, Response, Vignetting};

use crate::random::{Purpose, Stream};

/// Noise of a photosite, in units of the white level.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NoiseModel {
    /// Electrons at the white level: the variance of light x is x over this.
    pub full_well: f32,
    /// Deviation of what is read in the dark.
    pub read: f32,
}

/// The colour camera.
#[derive(Clone, Debug)]
pub struct ColorSensor {
    /// Size, focal length, centre.
    pub intrinsics: Intrinsics,
    /// Fall-off of the lens.
    pub vignetting: Vignetting,
    /// From light to code.
    pub response: Response,
    /// Noise.
    pub noise: NoiseModel,
}

/// Red, green or blue under each photosite of a GRBG mosaic.
pub fn mosaic_channel(x: u32, y: u32) -> usize {
    [[1, 0], [2, 1]][(y % 2) as usize][(x % 2) as usize]
}

impl ColorSensor {
    /// The codes of a mosaic GRBG for linear radiance. Without an effect its step is left out: no fall-off, a straight
    /// response, no noise. Numbers are drawn a photosite, so what one effect draws does not move another's.
    pub fn expose(
        &self,
        light: &LinearImage,
        effects: EffectSet,
        seed: u64,
        frame: u64,
    ) -> Image<u8> {
        let lens = effects
            .contains(Effect::Vignetting)
            .then(|| self.vignetting.table(light.width(), light.height()));
        let straight = Response::identity();
        let response = if effects.contains(Effect::Response) {
            &self.response
        } else {
            &straight
        };
        let has_noise = effects.contains(Effect::Noise);
        Image::from_fn(light.width(), light.height(), |x, y| {
            let channel = mosaic_channel(x, y);
            let mut value = light.at(x, y)[channel];
            if let Some(lens) = &lens {
                value *= lens.at(x, y);
            }
            if has_noise {
                let pixel = u64::from(y) * u64::from(light.width()) + u64::from(x);
                let mut random = Stream::new(seed, Purpose::ColorNoise, frame, pixel);
                value += random.normal() * self.noise.sigma(value);
            }
            response.code(value.clamp(0.0, 1.0), channel).round() as u8
        })
    }
}

impl NoiseModel {
    /// Deviation at light `value`.
    pub fn sigma(&self, value: f32) -> f32 {
        (self.read * self.read + value.max(0.0) / self.full_well).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use geometry::DVec2;

    use super::*;

    fn sensor() -> ColorSensor {
        ColorSensor {
            intrinsics: Intrinsics::pinhole(64, 48, 50.0, 50.0, 31.5, 23.5).unwrap(),
            vignetting: Vignetting::even_polynomial(DVec2::new(31.5, 23.5), 40.0, [-0.4, 0.0, 0.0])
                .unwrap(),
            response: Response::gamma(2.2).unwrap(),
            noise: NoiseModel {
                full_well: 4000.0,
                read: 0.004,
            },
        }
    }

    #[test]
    fn each_photosite_gets_its_own_colour() {
        let light = Image::new(64, 48, [1.0, 0.5, 0.25]);
        let codes = sensor().expose(&light, EffectSet::NONE, 1, 0);
        // G R / B G, straight response.
        assert_eq!([codes.at(0, 0), codes.at(1, 0)], [128, 255]);
        assert_eq!([codes.at(0, 1), codes.at(1, 1)], [64, 128]);
    }

    #[test]
    fn noise_has_the_stated_mean_and_variance() {
        let light = Image::new(512, 512, [0.36; 3]);
        let effects = EffectSet::NONE.with(Effect::Noise);
        let codes = sensor().expose(&light, effects, 7, 3);
        let values: Vec<f64> = codes
            .pixels()
            .iter()
            .map(|&c| f64::from(c) / 255.0)
            .collect();
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0);
        // Rounding to codes adds a twelfth of a squared code.
        let expected = f64::from(sensor().noise.sigma(0.36)).powi(2) + 1.0 / (12.0 * 255.0 * 255.0);
        // Five standard errors of a mean and of a variance of normal numbers.
        assert!((mean - 0.36).abs() < 5.0 * (expected / n).sqrt(), "{mean}");
        let error = 5.0 * expected * (2.0 / n).sqrt();
        assert!((variance - expected).abs() < error, "{variance} {expected}");
    }

    #[test]
    fn an_effect_that_is_off_leaves_the_codes_of_a_sensor_without_it() {
        let light = Image::from_fn(64, 48, |x, y| [0.01 * x as f32, 0.02 * y as f32, 0.3]);
        let all = EffectSet::all();
        let mut plain = sensor();
        plain.vignetting = Vignetting::none();
        let off = sensor().expose(&light, all.without(Effect::Vignetting), 5, 2);
        assert_eq!(off, plain.expose(&light, all, 5, 2));
        // The lens changes light and with it the noise's size, never its numbers: the corner is darker, the middle the
        // same.
        let on = sensor().expose(&light, all, 5, 2);
        assert!(on.at(0, 46) < off.at(0, 46));
        assert_eq!(on.at(31, 23), off.at(31, 23));
    }
}
