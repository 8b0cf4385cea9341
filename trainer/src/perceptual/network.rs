//! The five taps of AlexNet and the distance between two pictures' taps.

use candle_core::safetensors::SliceSafetensors;
use candle_core::{DType, Device, Tensor};
use imaging::{Image, Mask};

use super::PerceptualError;
use super::input::NetworkInput;

/// The weights, float16 (`recordings/perceptual/README.md`).
static WEIGHTS: &[u8] = include_bytes!("../../../recordings/perceptual/lpips_alex_f16.safetensors");

/// What is added to a norm before it divides: dead features stay 0.
const NORM_FLOOR: f64 = 1e-10;

/// Stride, padding and whether a 3x3 maximum of stride 2 comes before it, of conv1 to conv5.
const LAYERS: [(usize, usize, bool); 5] = [
    (4, 2, false),
    (1, 2, true),
    (1, 1, true),
    (1, 1, false),
    (1, 1, false),
];

/// Distance of each of the five layers; LPIPS is their sum.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LayerDistances(pub [f64; 5]);

impl LayerDistances {
    /// LPIPS.
    pub fn total(&self) -> f64 {
        self.0.iter().sum()
    }
}

/// One convolution with its head.
struct Layer {
    /// (output, input, height, width).
    weight: Tensor,
    /// (1, output, 1, 1).
    bias: Tensor,
    /// A value a channel.
    head: Vec<f32>,
}

/// The network. One serves all threads.
pub struct Lpips {
    layers: Vec<Layer>,
}

/// What the network sees in one picture: to be compared with any number of others.
pub struct Features {
    size: (u32, u32),
    taps: Vec<Tap>,
}

/// Activations after a ReLU, channel by channel.
pub(super) struct Tap {
    /// Values a channel.
    pub(super) pixel_count: usize,
    pub(super) values: Vec<f32>,
}

impl Lpips {
    /// The network with the weights of the program. Fails only when these are damaged.
    pub fn bundled() -> Result<Self, PerceptualError> {
        let file = SliceSafetensors::new(WEIGHTS)?;
        let load = |name: String| file.load(&name, &Device::Cpu)?.to_dtype(DType::F32);
        let layers = (1..=LAYERS.len())
            .map(|k| {
                let bias = load(format!("conv{k}.bias"))?;
                Ok(Layer {
                    weight: load(format!("conv{k}.weight"))?,
                    bias: bias.reshape((1, bias.elem_count(), 1, 1))?,
                    head: load(format!("lin{k}.weight"))?.flatten_all()?.to_vec1()?,
                })
            })
            .collect::<Result<_, candle_core::Error>>()?;
        Ok(Self { layers })
    }

    /// The taps of a picture. 4.3 billion multiplications for 640x480.
    pub fn features(&self, picture: &NetworkInput) -> Result<Features, PerceptualError> {
        let (width, height) = (picture.width as usize, picture.height as usize);
        // (batch, channels, height, width)
        let mut x = Tensor::from_slice(&picture.planes, (1, 3, height, width), &Device::Cpu)?;
        let mut taps = Vec::with_capacity(self.layers.len());
        for (layer, (stride, padding, is_pooled)) in self.layers.iter().zip(LAYERS) {
            if is_pooled {
                x = x.max_pool2d_with_stride(3, 2)?;
            }
            x = x
                .conv2d(&layer.weight, padding, stride, 1, 1)?
                .broadcast_add(&layer.bias)?
                .relu()?;
            let (_, _, rows, columns) = x.dims4()?;
            taps.push(Tap {
                pixel_count: rows * columns,
                values: x.flatten_all()?.to_vec1()?,
            });
        }
        Ok(Features {
            size: (picture.width, picture.height),
            taps,
        })
    }

    /// Distance of two pictures by their features, which must be of one size.
    pub fn distance(&self, a: &Features, b: &Features) -> Result<LayerDistances, PerceptualError> {
        if a.size != b.size {
            return Err(PerceptualError::SizeMismatch {
                left: a.size,
                right: b.size,
            });
        }
        let mut distances = [0.0; 5];
        for (k, distance) in distances.iter_mut().enumerate() {
            *distance = tap_distance(&self.layers[k].head, &a.taps[k], &b.taps[k]);
        }
        Ok(LayerDistances(distances))
    }

    /// LPIPS of two whole pictures, encoded RGB in [0, 1].
    pub fn whole(
        &self,
        a: &Image<[f32; 3]>,
        b: &Image<[f32; 3]>,
    ) -> Result<LayerDistances, PerceptualError> {
        let [a, b] = [a, b].map(|picture| self.features(&NetworkInput::whole(picture)?));
        self.distance(&a?, &b?)
    }

    /// LPIPS of the masked part of two pictures ([`NetworkInput::masked`]); `None` of an empty mask.
    pub fn masked(
        &self,
        a: &Image<[f32; 3]>,
        b: &Image<[f32; 3]>,
        mask: &Mask,
    ) -> Result<Option<LayerDistances>, PerceptualError> {
        let (Some(a), Some(b)) = (
            NetworkInput::masked(a, mask)?,
            NetworkInput::masked(b, mask)?,
        ) else {
            return Ok(None);
        };
        self.distance(&self.features(&a)?, &self.features(&b)?)
            .map(Some)
    }
}

impl Features {
    /// The five taps, for tests against golden activations.
    #[cfg(test)]
    pub(super) fn taps(&self) -> &[Tap] {
        &self.taps
    }
}

/// Mean over pixels of Σ head · (a/‖a‖ − b/‖b‖)², sums in f64 and in one order.
fn tap_distance(head: &[f32], a: &Tap, b: &Tap) -> f64 {
    let count = a.pixel_count;
    let [inverse_a, inverse_b] = [a, b].map(|tap| {
        let mut squares = vec![0.0_f64; count];
        for channel in tap.values.chunks_exact(count) {
            for (square, &value) in squares.iter_mut().zip(channel) {
                *square += f64::from(value) * f64::from(value);
            }
        }
        for square in &mut squares {
            *square = 1.0 / (square.sqrt() + NORM_FLOOR);
        }
        squares
    });
    let mut sum = 0.0;
    let channels = a
        .values
        .chunks_exact(count)
        .zip(b.values.chunks_exact(count));
    for (&weight, (a, b)) in head.iter().zip(channels) {
        let mut squares = 0.0;
        for pixel in 0..count {
            let difference =
                f64::from(a[pixel]) * inverse_a[pixel] - f64::from(b[pixel]) * inverse_b[pixel];
            squares += difference * difference;
        }
        sum += f64::from(weight) * squares;
    }
    sum / count as f64
}
