//! The fixed parameters of a unit (protocol section 8.1).

use crate::samples::DepthSensor;

/// Fields that glint reads, by their number in the block.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum FixedField {
    /// Serial number.
    Serial = 0,
    /// See [`FixedParams::depth_sensor`].
    DepthSensor = 14,
    /// Address of the depth sensor on its bus.
    DepthI2cAddress = 15,
    /// That bus.
    DepthI2cBus = 16,
    /// 0 none, 1 MT9M112, 2 MT9D131, 3 MT9M114; valid from firmware 5.6.9 on.
    ImageSensor = 19,
    /// Address of the image sensor on its bus.
    ImageI2cAddress = 20,
    /// That bus.
    ImageI2cBus = 21,
    /// From emitter to depth sensor, f32, cm.
    EmitterDistance = 23,
    /// From depth sensor to image sensor, f32, cm.
    ColorDistance = 24,
    /// From the camera to the reference plane, f32, cm.
    ZeroPlaneDistance = 25,
    /// Size of a pixel on the reference plane, f32, cm.
    ZeroPlanePixel = 26,
}

/// The block: 42 fields of 32 bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FixedParams {
    fields: [u32; Self::FIELD_COUNT],
}

impl FixedParams {
    /// Fields of the block.
    pub const FIELD_COUNT: usize = 42;
    /// Bytes of the block.
    pub const BYTES: usize = 4 * Self::FIELD_COUNT;

    /// What one real camera of long range said (an Xtion, 1d27:0601): to fall back on for Xtion and Carmine 1.08.
    /// For a Carmine 1.09 no numbers are known: they must come from the unit.
    pub fn xtion() -> Self {
        let mut params = Self {
            fields: [0; Self::FIELD_COUNT],
        };
        params.set(FixedField::DepthSensor, DepthSensor::Mt9m001.code());
        params.set(FixedField::ImageSensor, 1);
        params.set_length(FixedField::EmitterDistance, 7.5);
        params.set_length(FixedField::ColorDistance, 2.63);
        params.set_length(FixedField::ZeroPlaneDistance, 120.0);
        params.set_length(FixedField::ZeroPlanePixel, 0.1052);
        params
    }

    /// From the bytes of the block.
    pub fn decode(bytes: &[u8; Self::BYTES]) -> Self {
        let mut fields = [0; Self::FIELD_COUNT];
        for (field, bytes) in fields.iter_mut().zip(bytes.as_chunks().0) {
            *field = u32::from_le_bytes(*bytes);
        }
        Self { fields }
    }

    /// The bytes of the block.
    pub fn encode(&self) -> [u8; Self::BYTES] {
        let mut bytes = [0; Self::BYTES];
        for (bytes, field) in bytes.as_chunks_mut().0.iter_mut().zip(self.fields) {
            *bytes = field.to_le_bytes();
        }
        bytes
    }

    /// The bits of a field.
    pub fn get(&self, field: FixedField) -> u32 {
        self.fields[field as usize]
    }

    /// Sets a field.
    pub fn set(&mut self, field: FixedField, bits: u32) {
        self.fields[field as usize] = bits;
    }

    /// A field that is a length, cm; as the unit sent it, which may be no number.
    pub fn length_cm(&self, field: FixedField) -> f32 {
        f32::from_bits(self.get(field))
    }

    /// Sets a field that is a length.
    pub fn set_length(&mut self, field: FixedField, length_cm: f32) {
        self.set(field, length_cm.to_bits());
    }

    /// The depth sensor.
    pub fn depth_sensor(&self) -> DepthSensor {
        DepthSensor::from_code(self.get(FixedField::DepthSensor))
    }
}
