//! Frames that the tests code.

use rand::{Rng as _, RngExt as _};
use rand_pcg::Pcg64Mcg;
use sequence::codecs::{
    CodeTable, CodecError, ColorDecoder, ColorEncoder, ColorFormat, DepthCodec, DepthDecoder,
    DepthEncoder, EncodedDepth, depth_table_id,
};

pub(crate) const BOTH: [DepthCodec; 2] = [DepthCodec::Fast, DepthCodec::Dense];
pub(crate) const FORMATS: [ColorFormat; 5] = [
    ColorFormat::BayerGrbg,
    ColorFormat::Uyvy,
    ColorFormat::Yuyv,
    ColorFormat::Rgb8,
    ColorFormat::Infrared10,
];

/// A depth frame.
#[derive(Clone)]
pub(crate) struct Frame {
    pub(crate) width: u32,
    pub(crate) height: u32,
    pub(crate) samples: Vec<u16>,
}

impl Frame {
    pub(crate) fn from_fn(
        width: u32,
        height: u32,
        mut sample: impl FnMut(u32, u32) -> u16,
    ) -> Self {
        let places = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
        let samples = places.map(|(x, y)| sample(x, y)).collect();
        Self {
            width,
            height,
            samples,
        }
    }

    /// Both codecs, as codes and as values: what comes back is what went in.
    pub(crate) fn mismatch_count(&self) -> usize {
        let mut count = 0;
        for codec in BOTH {
            let as_codes = DepthEncoder::of_codes(self.width, self.height).unwrap();
            let as_values = DepthEncoder::of_values(self.width, self.height, None).unwrap();
            for mut encoder in [as_codes, as_values] {
                let (_, decoded) = through(&mut encoder, self, codec);
                count += self
                    .samples
                    .iter()
                    .zip(&decoded)
                    .filter(|(a, b)| a != b)
                    .count();
            }
        }
        count
    }
}

pub(crate) fn payload_of(
    encoder: &mut DepthEncoder,
    frame: &Frame,
    codec: DepthCodec,
) -> (EncodedDepth, Vec<u8>) {
    let mut payload = vec![0; encoder.max_payload_bytes()];
    let encoded = encoder.encode(&frame.samples, codec, &mut payload).unwrap();
    payload.truncate(encoded.byte_count);
    (encoded, payload)
}

/// Encodes and decodes with the encoder's table, which itself goes through its bytes.
pub(crate) fn through(
    encoder: &mut DepthEncoder,
    frame: &Frame,
    codec: DepthCodec,
) -> (EncodedDepth, Vec<u16>) {
    let (encoded, payload) = payload_of(encoder, frame, codec);
    let table = depth_table_id(&payload).unwrap().map(|id| {
        let table = encoder.table().unwrap();
        assert_eq!(table.id(), id);
        CodeTable::from_bytes(&table.to_bytes()).unwrap()
    });
    (
        encoded,
        decoded(&payload, table.as_ref(), frame.width, frame.height).unwrap(),
    )
}

pub(crate) fn decoded(
    payload: &[u8],
    table: Option<&CodeTable>,
    width: u32,
    height: u32,
) -> Result<Vec<u16>, CodecError> {
    let mut samples = vec![0xABCD; (width * height) as usize];
    let mut decoder = DepthDecoder::new(width, height).unwrap();
    decoder.decode(payload, table, &mut samples)?;
    Ok(samples)
}

pub(crate) fn checkerboard(width: u32, height: u32, dark: u16, bright: u16) -> Frame {
    Frame::from_fn(
        width,
        height,
        |x, y| if (x + y) % 2 == 0 { dark } else { bright },
    )
}

pub(crate) fn noise(width: u32, height: u32, random: &mut Pcg64Mcg) -> Frame {
    Frame::from_fn(width, height, |_, _| random.random())
}

/// Two planes with steps, sensor noise of a step, a hole, and a few of the second missing code.
pub(crate) fn shifts(width: u32, height: u32, random: &mut Pcg64Mcg) -> Frame {
    let slope = random.random_range(1..8);
    Frame::from_fn(width, height, |x, y| {
        let shift = if x > width / 2 {
            700 + (y * slope) / 8
        } else {
            480 + (x + y) / 5
        };
        match random.random_range(0..200) {
            0 => u16::MAX,
            _ if x * 8 > width * 7 || (x / 7 + y / 5) % 9 == 0 => 0,
            chance => (shift + u32::from(chance % 10 == 0)) as u16,
        }
    })
}

/// The depth in millimetres of a PS1080's shift, with the constants of a real camera (ps1080 8.2).
pub(crate) fn millimetres(shift: u16) -> u16 {
    let offset = (f64::from(shift) - 800.0) / 4.0 - 0.375;
    let at_zero_plane = offset * 0.1052;
    let depth = 10.0 * (at_zero_plane * 120.0 / (7.5 - at_zero_plane) + 120.0);
    if depth > 0.0 && depth < 10_000.0 {
        depth as u16
    } else {
        0
    }
}

/// A size and samples of a kind drawn by chance.
pub(crate) fn any_frame(random: &mut Pcg64Mcg) -> Frame {
    let (width, height) = (random.random_range(1..40), random.random_range(1..30));
    match random.random_range(0..6) {
        0 => noise(width, height, random),
        1 => checkerboard(width, height, 0, u16::MAX),
        2 => checkerboard(width, height, random.random(), random.random()),
        3 => {
            let (x_step, y_step): (u16, u16) = (random.random(), random.random());
            Frame::from_fn(width, height, |x, y| {
                x_step
                    .wrapping_mul(x as u16)
                    .wrapping_add(y_step.wrapping_mul(y as u16))
            })
        }
        4 => {
            let few = [0, 1, 2047, 32_767, 32_768, 65_534, u16::MAX];
            Frame::from_fn(width, height, |_, _| few[random.random_range(0..few.len())])
        }
        _ => shifts(width, height, random),
    }
}

/// Bytes of a colour frame: a smooth ramp with noise of `amplitude`.
pub(crate) fn color_bytes(
    format: ColorFormat,
    width: u32,
    height: u32,
    amplitude: u8,
    random: &mut Pcg64Mcg,
) -> Vec<u8> {
    let mut bytes = vec![0; format.frame_bytes(width, height).unwrap()];
    random.fill_bytes(&mut bytes);
    for (place, byte) in bytes.iter_mut().enumerate() {
        let ramp = (place / 37 % 256) as u8;
        *byte = ramp.wrapping_add(if amplitude == u8::MAX {
            *byte
        } else {
            *byte % (amplitude + 1)
        });
    }
    bytes
}

pub(crate) fn color_payload(format: ColorFormat, width: u32, height: u32, bytes: &[u8]) -> Vec<u8> {
    let mut encoder = ColorEncoder::new(format, width, height).unwrap();
    let mut payload = vec![0; encoder.max_payload_bytes()];
    let length = encoder.encode(bytes, &mut payload).unwrap();
    payload.truncate(length);
    payload
}

pub(crate) fn color_decoded(
    format: ColorFormat,
    width: u32,
    height: u32,
    payload: &[u8],
) -> Result<Vec<u8>, CodecError> {
    let mut bytes = vec![0xA5; format.frame_bytes(width, height).unwrap()];
    ColorDecoder::new(format, width, height)
        .unwrap()
        .decode(payload, &mut bytes)?;
    Ok(bytes)
}
