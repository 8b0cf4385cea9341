//! What the properties of a node say (oni-format section 2).

use std::collections::BTreeMap;

use sequence::ShiftConstants;

use super::record::{Fields, RecordKind};

/// Sides that are believed.
const SIDES: std::ops::RangeInclusive<u32> = 1..=16_384;

/// What a sample of a frame is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OniPixels {
    /// Depth, 1 mm a unit.
    DepthMillimetres,
    /// Depth, 100 µm a unit.
    DepthTenths,
    /// The sensor's shifts.
    Shifts,
    /// Three channels of 8 bits.
    Rgb8,
    /// U Y V Y.
    Uyvy,
    /// Y U Y V.
    Yuyv,
    /// One channel of 8 bits.
    Gray8,
    /// One channel of 16 bits.
    Gray16,
}

impl OniPixels {
    /// Bytes a pixel, decoded.
    pub fn byte_count(self) -> usize {
        match self {
            Self::Gray8 => 1,
            Self::Rgb8 => 3,
            _ => 2,
        }
    }

    /// Whether this is depth in whatever unit.
    pub fn is_depth(self) -> bool {
        matches!(
            self,
            Self::DepthMillimetres | Self::DepthTenths | Self::Shifts
        )
    }
}

/// Size and samples of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OniShape {
    /// Pixels a row, after cropping.
    pub width: u32,
    /// Rows, after cropping.
    pub height: u32,
    /// First column and row of the sensor's image that were kept.
    pub offset: [u32; 2],
    /// What the samples are.
    pub pixels: OniPixels,
}

impl OniShape {
    /// Pixels of a frame.
    pub fn area(&self) -> usize {
        self.width as usize * self.height as usize
    }
}

/// A value as it stands in the file.
#[derive(Clone, Debug, PartialEq)]
enum Value {
    Int(i64),
    Real(f64),
    Bytes(Vec<u8>),
}

/// The properties of a node as they are now: a later record replaces an earlier one.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Properties {
    values: BTreeMap<String, Value>,
    /// The property that spoke last of pixels: it wins.
    pixels: Option<(PixelWord, i64)>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum PixelWord {
    OpenNi1,
    OpenNi2,
}

impl Properties {
    /// Takes a property record; `None` when its fields are too short.
    pub(super) fn take(&mut self, kind: RecordKind, fields: &[u8]) -> Option<()> {
        let mut fields = Fields(fields);
        let name = fields.text()?;
        let bytes = fields.sized()?;
        let value = match kind {
            RecordKind::IntProperty => Value::Int(i64::from_le_bytes(*bytes.first_chunk()?)),
            RecordKind::RealProperty => Value::Real(f64::from_le_bytes(*bytes.first_chunk()?)),
            _ => Value::Bytes(bytes.to_vec()),
        };
        if let Value::Int(code) = value {
            match name.as_str() {
                "xnPixelFormat" => self.pixels = Some((PixelWord::OpenNi1, code)),
                "oniPixelFormat" => self.pixels = Some((PixelWord::OpenNi2, code)),
                _ => {}
            }
        }
        self.values.insert(name, value);
        Some(())
    }

    /// A whole number.
    pub fn int(&self, name: &str) -> Option<i64> {
        match self.values.get(name)? {
            Value::Int(value) => Some(*value),
            _ => None,
        }
    }

    /// A finite number, whichever way it was written.
    pub fn number(&self, name: &str) -> Option<f64> {
        match self.values.get(name)? {
            Value::Int(value) => Some(*value as f64),
            Value::Real(value) => value.is_finite().then_some(*value),
            Value::Bytes(_) => None,
        }
    }

    fn bytes(&self, name: &str) -> Option<&[u8]> {
        match self.values.get(name)? {
            Value::Bytes(bytes) => Some(bytes),
            _ => None,
        }
    }

    /// Size and samples of the frames from here on; `is_depth` says which node asks. `None` without a believable mode,
    /// with cropping that leaves nothing of it, or with samples that are not known.
    pub fn shape(&self, is_depth: bool) -> Option<OniShape> {
        let mut mode = Fields(self.bytes("xnMapOutputMode")?);
        let (width, height) = (mode.u32()?, mode.u32()?);
        let mut shape = OniShape {
            width,
            height,
            offset: [0, 0],
            pixels: self.pixels(is_depth)?,
        };
        if !SIDES.contains(&width) || !SIDES.contains(&height) {
            return None;
        }
        if let Some(cropping) = self.bytes("xnCropping") {
            let mut cropping = Fields(cropping);
            if cropping.u32()? != 0 {
                let mut side = || {
                    Some(u32::from(u16::from_le_bytes(
                        *cropping.take(2)?.first_chunk()?,
                    )))
                };
                let [left, top, wide, high] = [side()?, side()?, side()?, side()?];
                if wide == 0 || high == 0 || left + wide > width || top + high > height {
                    return None;
                }
                (shape.width, shape.height, shape.offset) = (wide, high, [left, top]);
            }
        }
        Some(shape)
    }

    fn pixels(&self, is_depth: bool) -> Option<OniPixels> {
        let unsaid = if is_depth {
            OniPixels::DepthMillimetres
        } else {
            OniPixels::Rgb8
        };
        Some(match self.pixels {
            None => unsaid,
            // Of depth, the older word only says that it has 16 bits.
            Some((PixelWord::OpenNi1, _)) if is_depth => unsaid,
            Some((PixelWord::OpenNi1, code)) => match code {
                1 | 5 => OniPixels::Rgb8,
                2 => OniPixels::Uyvy,
                3 => OniPixels::Gray8,
                4 => OniPixels::Gray16,
                _ => return None,
            },
            Some((PixelWord::OpenNi2, code)) => match code {
                100 => OniPixels::DepthMillimetres,
                101 => OniPixels::DepthTenths,
                102 | 103 => OniPixels::Shifts,
                200 | 204 => OniPixels::Rgb8,
                201 => OniPixels::Uyvy,
                202 => OniPixels::Gray8,
                203 => OniPixels::Gray16,
                205 => OniPixels::Yuyv,
                _ => return None,
            },
        })
    }

    /// Size of the sensor's image before cropping.
    pub fn full_size(&self) -> Option<[u32; 2]> {
        let mut mode = Fields(self.bytes("xnMapOutputMode")?);
        Some([mode.u32()?, mode.u32()?])
    }

    /// Frames a second that the mode promises.
    pub fn rate_hz(&self) -> Option<f64> {
        let mut mode = Fields(self.bytes("xnMapOutputMode")?);
        mode.take(8)?;
        mode.u32()
            .filter(|&rate| (1..=1000).contains(&rate))
            .map(f64::from)
    }

    /// Angles of view, horizontal and vertical, radians.
    pub fn field_of_view(&self) -> Option<[f64; 2]> {
        let mut fields = Fields(self.bytes("xnFOV")?);
        let mut angle = || Some(f64::from_bits(fields.u64()?));
        let angles = [angle()?, angle()?];
        angles
            .iter()
            .all(|angle| (0.1..3.0).contains(angle))
            .then_some(angles)
    }

    /// Whether the images are mirrored left to right.
    pub fn is_mirrored(&self) -> bool {
        self.int("xnMirror").is_some_and(|mirror| mirror != 0)
    }

    /// Constants of the structured-light sensor. The file counts lengths in centimetres, and has a table of 16 bits.
    pub fn shift_constants(&self) -> Option<ShiftConstants> {
        let table = self.bytes("S2D").unwrap_or_default();
        Some(ShiftConstants {
            zero_plane_mm: 10.0 * self.number("ZPD")?,
            zero_plane_pixel_mm: 10.0 * self.number("ZPPS")?,
            emitter_distance_cm: self.number("LDDIS")?,
            param_coefficient: self.number("ParamCoeff")?,
            constant_shift: self.number("ConstShift")?,
            pixel_size_factor: self.number("PixelSizeFactor")?,
            offset_pixels: ShiftConstants::USUAL_OFFSET,
            table_mm: table
                .as_chunks::<2>()
                .0
                .iter()
                .map(|&bytes| u16::from_le_bytes(bytes))
                .collect(),
        })
    }
}
