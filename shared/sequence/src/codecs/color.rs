//! A colour frame as a payload and back: planes, prediction, zstd.

use super::CodecError;
use super::error::pixel_count;
use super::packer::{Packer, Unpacker};
use super::predict::{residuals_of, row_from_residuals};

/// Bytes before the body of a payload: the codec.
const HEAD_BYTES: usize = 1;
/// The codecs as they are written.
const RAW: u8 = 0;
const PREDICTED: u8 = 1;

/// How the bytes of a raw colour frame lie. JPEG is no such format: its files are payloads as they are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ColorFormat {
    /// One byte a pixel: even rows G R G R …, odd rows B G B G …
    BayerGrbg,
    /// Two pixels in four bytes, U Y V Y; even widths.
    Uyvy,
    /// Two pixels in four bytes, Y U Y V; even widths.
    Yuyv,
    /// Three bytes a pixel, R G B.
    Rgb8,
    /// Brightness in infrared: two bytes a pixel, little-endian, 0 to 1023.
    Infrared10,
}

impl ColorFormat {
    /// Bytes of a raw frame.
    ///
    /// # Errors
    /// [`CodecError::Size`] for sides that are not 1 to 16384, or odd widths of YUV 4:2:2.
    pub fn frame_bytes(self, width: u32, height: u32) -> Result<usize, CodecError> {
        let pixels = pixel_count(width, height)?;
        match self {
            Self::BayerGrbg => Ok(pixels),
            Self::Uyvy | Self::Yuyv if width % 2 == 1 => Err(CodecError::Size { width, height }),
            Self::Uyvy | Self::Yuyv | Self::Infrared10 => Ok(2 * pixels),
            Self::Rgb8 => Ok(3 * pixels),
        }
    }

    /// The planes in the order in which their residuals are written.
    fn planes(self, width: usize, height: usize) -> Vec<Plane> {
        let plane = |first, step, row_step, width, height| Plane {
            first,
            step,
            row_step,
            width,
            height,
            is_less_green: false,
        };
        match self {
            Self::BayerGrbg => [(0, 0), (1, 0), (0, 1), (1, 1)]
                .map(|(x, y)| {
                    let (columns, rows) = ((width + 1 - x) / 2, (height + 1 - y) / 2);
                    plane(y * width + x, 2, 2 * width, columns, rows)
                })
                .to_vec(),
            Self::Uyvy | Self::Yuyv => {
                let [y, u, v] = if self == Self::Uyvy {
                    [1, 0, 2]
                } else {
                    [0, 1, 3]
                };
                vec![
                    plane(y, 2, 2 * width, width, height),
                    plane(u, 4, 2 * width, width / 2, height),
                    plane(v, 4, 2 * width, width / 2, height),
                ]
            }
            Self::Rgb8 => {
                let channel = |first| plane(first, 3, 3 * width, width, height);
                let less_green = |first| Plane {
                    is_less_green: true,
                    ..channel(first)
                };
                vec![channel(1), less_green(0), less_green(2)]
            }
            Self::Infrared10 => [0, 1]
                .map(|byte| plane(byte, 2, 2 * width, width, height))
                .to_vec(),
        }
    }
}

/// Where the samples of a plane lie in a raw frame.
#[derive(Clone)]
struct Plane {
    /// Of the first sample, bytes.
    first: usize,
    /// From a sample to the next of its row, bytes.
    step: usize,
    /// From a row to the next, bytes.
    row_step: usize,
    width: usize,
    height: usize,
    /// Its samples are coded as their difference to the green of the pixel (RGB; green is byte 1 of 3).
    is_less_green: bool,
}

impl Plane {
    fn sample_count(&self) -> usize {
        self.width * self.height
    }

    /// The bytes of `frame` from the first sample of row `y` on.
    fn row_start(&self, y: usize) -> usize {
        self.first + y * self.row_step
    }

    /// Copies row `y` out of the raw frame.
    fn gather(&self, frame: &[u8], y: usize, row: &mut [u8]) {
        let start = self.row_start(y);
        match self.step {
            2 => gather_step::<2>(&frame[start..], row),
            3 => gather_step::<3>(&frame[start..], row),
            _ => gather_step::<4>(&frame[start..], row),
        }
        if self.is_less_green {
            let pixels = frame[y * self.row_step..].as_chunks::<3>().0;
            for (sample, pixel) in row.iter_mut().zip(pixels) {
                *sample = sample.wrapping_sub(pixel[1]);
            }
        }
    }

    /// Copies row `y` into the raw frame, where green already is.
    fn scatter(&self, row: &[u8], y: usize, frame: &mut [u8]) {
        if self.is_less_green {
            let pixels = frame[y * self.row_step..].as_chunks_mut::<3>().0;
            for (&sample, pixel) in row.iter().zip(pixels) {
                pixel[self.first] = sample.wrapping_add(pixel[1]);
            }
            return;
        }
        let start = self.row_start(y);
        match self.step {
            2 => scatter_step::<2>(row, &mut frame[start..]),
            3 => scatter_step::<3>(row, &mut frame[start..]),
            _ => scatter_step::<4>(row, &mut frame[start..]),
        }
    }
}

/// Every `STEP`-th byte of `bytes`; the last group may be cut behind its first byte.
fn gather_step<const STEP: usize>(bytes: &[u8], row: &mut [u8]) {
    let (groups, rest) = bytes.as_chunks::<STEP>();
    let whole = row.len().min(groups.len());
    for (sample, group) in row.iter_mut().zip(groups) {
        *sample = group[0];
    }
    if let (Some(sample), Some(&byte)) = (row.get_mut(whole), rest.first()) {
        *sample = byte;
    }
}

/// The inverse of [`gather_step`].
fn scatter_step<const STEP: usize>(row: &[u8], bytes: &mut [u8]) {
    let (groups, rest) = bytes.as_chunks_mut::<STEP>();
    let whole = row.len().min(groups.len());
    for (&sample, group) in row.iter().zip(groups) {
        group[0] = sample;
    }
    if let (Some(&sample), Some(byte)) = (row.get(whole), rest.first_mut()) {
        *byte = sample;
    }
}

/// What encoder and decoder share: the planes, two rows and the residuals of a frame.
struct Scratch {
    planes: Vec<Plane>,
    frame_bytes: usize,
    row: Vec<u8>,
    above: Vec<u8>,
    residuals: Vec<u8>,
}

impl Scratch {
    fn new(format: ColorFormat, width: u32, height: u32) -> Result<Self, CodecError> {
        let frame_bytes = format.frame_bytes(width, height)?;
        Ok(Self {
            planes: format.planes(width as usize, height as usize),
            frame_bytes,
            row: vec![0; width as usize],
            above: vec![0; width as usize],
            residuals: vec![0; frame_bytes],
        })
    }

    fn check(&self, got: usize) -> Result<(), CodecError> {
        let expected = self.frame_bytes;
        if got == expected {
            Ok(())
        } else {
            Err(CodecError::SampleCount { expected, got })
        }
    }
}

/// Encodes the colour frames of one stream.
pub struct ColorEncoder {
    scratch: Scratch,
    packer: Packer,
}

impl ColorEncoder {
    /// An encoder for frames of a stream's format and size.
    ///
    /// # Errors
    /// [`CodecError::Size`], see [`ColorFormat::frame_bytes`].
    pub fn new(format: ColorFormat, width: u32, height: u32) -> Result<Self, CodecError> {
        Ok(Self {
            scratch: Scratch::new(format, width, height)?,
            packer: Packer::new()?,
        })
    }

    /// Packs with another level of zstd than 1; see [`super::DepthEncoder::set_zstd_level`].
    ///
    /// # Errors
    /// [`CodecError::Compressor`] where zstd has no memory for it.
    pub fn set_zstd_level(&mut self, level: i32) -> Result<(), CodecError> {
        self.packer.set_level(level)
    }

    /// The most that a payload takes: the raw frame and a byte.
    pub fn max_payload_bytes(&self) -> usize {
        HEAD_BYTES + self.scratch.frame_bytes
    }

    /// Encodes a raw frame to the start of `out` and returns the length. Allocates nothing.
    ///
    /// # Errors
    /// [`CodecError::SampleCount`] and [`CodecError::Room`] where slices are not of the stream's size
    /// (`out` has at least [`Self::max_payload_bytes`]).
    pub fn encode(&mut self, frame: &[u8], out: &mut [u8]) -> Result<usize, CodecError> {
        self.scratch.check(frame.len())?;
        let expected = self.max_payload_bytes();
        let got = out.len();
        let out = out
            .get_mut(..expected)
            .ok_or(CodecError::Room { expected, got })?;
        let Scratch {
            planes,
            row,
            above,
            residuals,
            ..
        } = &mut self.scratch;
        let mut rest = residuals.as_mut_slice();
        for plane in planes.iter().filter(|plane| plane.sample_count() > 0) {
            let (plane_residuals, next) = rest.split_at_mut(plane.sample_count());
            rest = next;
            above[..plane.width].fill(0);
            for (y, residuals) in plane_residuals.chunks_exact_mut(plane.width).enumerate() {
                plane.gather(frame, y, &mut row[..plane.width]);
                residuals_of(&row[..plane.width], &above[..plane.width], residuals);
                std::mem::swap(row, above);
            }
        }
        let (head, body) = out.split_at_mut(HEAD_BYTES);
        // One byte less than raw, so that raw is what is not smaller.
        let room = body.len() - 1;
        let (codec, length) = match self.packer.pack(residuals, &mut body[..room]) {
            Some(length) => (PREDICTED, length),
            None => {
                body.copy_from_slice(frame);
                (RAW, body.len())
            }
        };
        head[0] = codec;
        Ok(HEAD_BYTES + length)
    }
}

/// Decodes the colour frames of one stream, in any order.
pub struct ColorDecoder {
    scratch: Scratch,
    unpacker: Unpacker,
}

impl ColorDecoder {
    /// A decoder for frames of a stream's format and size.
    ///
    /// # Errors
    /// [`CodecError::Size`], see [`ColorFormat::frame_bytes`].
    pub fn new(format: ColorFormat, width: u32, height: u32) -> Result<Self, CodecError> {
        Ok(Self {
            scratch: Scratch::new(format, width, height)?,
            unpacker: Unpacker::new()?,
        })
    }

    /// Fills the raw frame from `payload`. Allocates nothing; work is bounded by the stream's size, whatever
    /// the bytes. After an error the frame is undefined.
    ///
    /// # Errors
    /// [`CodecError`] says what no encoder writes; a damage may also decode to another frame (see the
    /// module).
    pub fn decode(&mut self, payload: &[u8], frame: &mut [u8]) -> Result<(), CodecError> {
        self.scratch.check(frame.len())?;
        let (&codec, body) = payload.split_first().ok_or(CodecError::Cut)?;
        match codec {
            PREDICTED => {}
            RAW if body.len() < frame.len() => return Err(CodecError::Cut),
            RAW if body.len() > frame.len() => return Err(CodecError::Surplus),
            RAW => {
                frame.copy_from_slice(body);
                return Ok(());
            }
            other => return Err(CodecError::UnknownCodec(other)),
        }
        let Scratch {
            planes,
            row,
            above,
            residuals,
            ..
        } = &mut self.scratch;
        if self.unpacker.unpack(body, residuals)? != residuals.len() {
            return Err(CodecError::Cut);
        }
        let mut rest = residuals.as_slice();
        for plane in planes.iter().filter(|plane| plane.sample_count() > 0) {
            let (plane_residuals, next) = rest.split_at(plane.sample_count());
            rest = next;
            above[..plane.width].fill(0);
            for (y, residuals) in plane_residuals.chunks_exact(plane.width).enumerate() {
                row_from_residuals(residuals, &above[..plane.width], &mut row[..plane.width]);
                plane.scatter(&row[..plane.width], y, frame);
                std::mem::swap(row, above);
            }
        }
        Ok(())
    }
}
