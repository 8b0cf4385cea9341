//! Versions of firmware, hardware and chip, and what depends on them (protocol sections 1 to 3).

use core::fmt;

use crate::bytes::{FieldWriter, u16_at, u32_at};

/// Version of a camera's firmware. Known are the families 5.1 to 5.8; what is newer counts as 5.8.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Firmware {
    /// Generation: 5 in all fielded cameras.
    pub major: u8,
    /// Family.
    pub minor: u8,
    /// Build within it.
    pub build: u16,
}

impl Firmware {
    /// A version.
    pub const fn new(major: u8, minor: u8, build: u16) -> Self {
        Self {
            major,
            minor,
            build,
        }
    }

    /// Whether this crate speaks its language: 5.1 and later of generation 5.
    pub fn is_known(self) -> bool {
        self.major == 5 && self.minor >= 1
    }

    /// Whether the firmware serves `feature`.
    pub fn has(self, feature: Feature) -> bool {
        let (since, until) = feature.versions();
        self >= since && until.is_none_or(|until| self < until)
    }
}

impl fmt::Display for Firmware {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}.{}.{}", self.major, self.minor, self.build)
    }
}

/// What only some firmware has.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Feature {
    /// Mirroring and cropping in the camera.
    MirrorAndCrop,
    /// Infrared at SXGA.
    SxgaInfrared,
    /// GET_CMOS_BLANKING, and blanking as an algorithm block.
    Blanking,
    /// Modes of 25 frames a second.
    Fps25,
    /// Registration and padding as algorithm blocks.
    RegistrationBlocks,
    /// The block of device information.
    DeviceInfo,
    /// GET_CMOS_PRESETS.
    Presets,
    /// GET_SERIAL_NUMBER.
    SerialNumber,
    /// Depth on endpoint 0x81 and image on 0x82; before, the other way round.
    DepthOnFirstEndpoint,
    /// Alternate setting 0 is bulk; before, setting 1.
    BulkIsSetting0,
    /// The parameter "close range".
    CloseRange,
    /// Sound in the maker's own packets; after, the USB audio class.
    OwnAudio,
    /// Depth at QQVGA.
    QqvgaDepth,
    /// Field "image sensor" of the fixed parameters is valid.
    ImageSensorField,
    /// GET_PLATFORM_STRING.
    PlatformString,
    /// Cropping that raises the frame rate.
    FastCrop,
    /// SET_LED_STATE.
    Led,
    /// Exposure and white balance through parameters; before, through the registers of the sensor.
    ImageParameters,
    /// ENABLE_EMITTER.
    EmitterSwitch,
    /// Alternate setting 2: isochronous with a small depth endpoint.
    SmallDepthSetting,
}

impl Feature {
    /// First version with it, first version without it again.
    fn versions(self) -> (Firmware, Option<Firmware>) {
        let v = Firmware::new;
        match self {
            Self::MirrorAndCrop => (v(5, 0, 0), None),
            Self::SxgaInfrared | Self::Blanking => (v(5, 1, 0), None),
            Self::Fps25 => (v(5, 2, 0), Some(v(5, 6, 0))),
            Self::DepthOnFirstEndpoint | Self::RegistrationBlocks => (v(5, 2, 0), None),
            Self::DeviceInfo => (v(5, 3, 25), None),
            Self::Presets => (v(5, 3, 29), None),
            Self::SerialNumber => (v(5, 4, 0), None),
            Self::BulkIsSetting0 => (v(5, 5, 0), None),
            Self::CloseRange => (v(5, 6, 0), None),
            Self::OwnAudio => (v(0, 0, 0), Some(v(5, 6, 0))),
            Self::QqvgaDepth => (v(5, 6, 2), None),
            Self::ImageSensorField => (v(5, 6, 9), None),
            Self::PlatformString => (v(5, 7, 0), None),
            Self::FastCrop => (v(5, 7, 2), None),
            Self::Led => (v(5, 8, 0), None),
            Self::ImageParameters => (v(5, 8, 9), None),
            Self::EmitterSwitch => (v(5, 8, 15), None),
            Self::SmallDepthSetting => (v(5, 8, 16), None),
        }
    }
}

/// Circuit board.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Hardware {
    /// FPDB: development.
    Fpdb,
    /// CDB: development.
    Cdb,
    /// RD5: the reference design of 5.0 to 5.2.
    Rd5,
    /// RD1081.
    Rd1081,
    /// RD1082.
    Rd1082,
    /// RD109: Carmine 1.09, short range.
    Rd109,
    /// Another.
    Other(u16),
}

/// The answer to GET_VERSION.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Version {
    /// Of the firmware.
    pub firmware: Firmware,
    /// 0x00202020 is the PS1080, 0x00212020 the PS1080A6.
    pub chip: u32,
    /// Word of the hardware; see [`Version::hardware`].
    pub hardware_word: u16,
    /// Of the system.
    pub system: u16,
}

impl Version {
    /// Bytes of the answer.
    pub const BYTES: usize = 12;
    /// Chip word of the PS1080.
    pub const PS1080: u32 = 0x0020_2020;

    /// From the answer's data; `None` when they are too short or the build is no decimal number in hexadecimal digits.
    pub fn decode(data: &[u8]) -> Option<Self> {
        let (&[minor, major], _) = data.split_first_chunk()?;
        Some(Self {
            firmware: Firmware::new(major, minor, decimal(u16_at(data, 2)?)?),
            chip: u32_at(data, 4)?,
            hardware_word: u16_at(data, 8)?,
            system: u16_at(data, 10)?,
        })
    }

    /// The answer's data; `None` for a build above 9999.
    pub fn encode(&self) -> Option<[u8; Self::BYTES]> {
        let mut data = [0; Self::BYTES];
        let mut fields = FieldWriter::new(&mut data);
        fields.bytes(&[self.firmware.minor, self.firmware.major])?;
        fields.u16(binary_coded(self.firmware.build)?)?;
        fields.u32(self.chip)?;
        fields.u16(self.hardware_word)?;
        fields.u16(self.system)?;
        Some(data)
    }

    /// The board: several families of firmware count differently or not at all.
    pub fn hardware(&self) -> Hardware {
        let Firmware {
            major,
            minor,
            build,
        } = self.firmware;
        match (major, minor, build, self.hardware_word) {
            (5, 0..=2, ..) => Hardware::Rd5,
            (5, 3, ..28, _) => Hardware::Rd1081,
            (5, 3, 28, _) | (5, 4 | 5, ..) => Hardware::Rd1082,
            (5, 6, 6.., 0) => Hardware::Rd1081,
            (5, 6, 6.., 1) => Hardware::Rd1082,
            (.., 0 | 0x21) => Hardware::Fpdb,
            (.., 1) => Hardware::Cdb,
            (.., 3) => Hardware::Rd5,
            (.., 4) => Hardware::Rd1081,
            (.., 5) => Hardware::Rd1082,
            (.., 6) => Hardware::Rd109,
            (.., other) => Hardware::Other(other),
        }
    }
}

/// 0x0022 is 22.
fn decimal(coded: u16) -> Option<u16> {
    [12, 8, 4, 0].iter().try_fold(0, |value, shift| {
        let digit = coded >> shift & 0xF;
        (digit <= 9).then_some(10 * value + digit)
    })
}

/// 22 is 0x0022.
fn binary_coded(value: u16) -> Option<u16> {
    let digits = [1000, 100, 10, 1].map(|place| value / place % 10);
    let coded = digits.iter().fold(0, |coded, digit| coded << 4 | digit);
    (value <= 9999).then_some(coded)
}
