//! Which unit the camera is.

use ps1080::blocks::{CmosPreset, FixedField, FixedParams, PaddingBlock, RegistrationBlock};
use ps1080::firmware::{Feature, Firmware, Version};
use ps1080::mode::CameraMode;
use ps1080::stream::Padding;

/// Everything about a unit that does not change while it runs.
#[derive(Clone, Debug)]
pub struct Personality {
    /// USB product; the vendor is always PrimeSense.
    pub product_id: u16,
    /// Whether further interfaces announce microphones.
    pub has_microphones: bool,
    /// What GET_VERSION says.
    pub version: Version,
    /// USB core type; `None`: the question is refused.
    pub usb_core: Option<u16>,
    /// What GET_SERIAL_NUMBER says, ASCII.
    pub serial: &'static str,
    /// Name in the block of device information, ASCII.
    pub device_name: &'static str,
    /// What GET_PLATFORM_STRING says, ASCII, at most 40 characters.
    pub platform: &'static str,
    /// The camera's mode: no stream runs in another than [`CameraMode::Normal`].
    pub mode: CameraMode,
    /// Modes of colour, as GET_CMOS_PRESETS says them, where the firmware has that; and, with or without it, those that
    /// are served.
    pub color_presets: Vec<CmosPreset>,
    /// The fixed parameters.
    pub fixed: FixedParams,
    /// Constant shift.
    pub constant_shift: u16,
    /// Coefficients of registration.
    pub registration: RegistrationBlock,
    /// Lines that registration adds and drops.
    pub padding_block: PaddingBlock,
    /// Pixels that are not sent, before and after the rest, while the camera registers.
    pub padding: Padding,
    /// Bytes of a block in one reply, at most 502, a multiple of 4.
    pub block_part_bytes: usize,
    /// Bytes of a packet, header included: 13 to 65 535.
    pub packet_bytes: usize,
    /// Bytes that the memory of a stream holds, at least two packets. A guess: nobody has measured it.
    pub fifo_bytes: usize,
    /// Ticks of the counter per microsecond.
    pub ticks_per_microsecond: u32,
    /// How long after a request its reply is ready.
    pub reply_nanos: i64,
    /// How long a sensor needs until it begins its first frame.
    pub start_nanos: i64,
    /// By how much image frames begin later than depth frames when frame sync is off; negative: earlier.
    pub skew_nanos: i64,
    /// The same when frame sync is on.
    pub synced_skew_nanos: i64,
    /// Whether a transfer ends when a frame ends and nothing is left to send. A guess: nobody has seen it.
    pub ends_transfers: bool,
}

const QVGA: u16 = 0;
const VGA: u16 = 1;
const SXGA: u16 = 2;

impl Personality {
    /// Firmware 5.8.22 on RD109 (Carmine 1.09), colour in all formats, Bayer too.
    ///
    /// No numbers of a real unit of that kind are public: its distances are made up.
    pub fn carmine_1_09() -> Self {
        let mut unit = Self::of(Firmware::new(5, 8, 22), 6, true);
        unit.fixed.set_length(FixedField::ZeroPlaneDistance, 45.0);
        unit.fixed.set_length(FixedField::ZeroPlanePixel, 0.0394);
        unit.product_id = 0x0609;
        unit
    }

    /// Firmware 5.8.22 on RD1081 (Carmine 1.08), colour without Bayer, distances of a real Xtion.
    pub fn carmine_1_08() -> Self {
        let mut unit = Self::of(Firmware::new(5, 8, 22), 4, false);
        unit.product_id = 0x0609;
        unit
    }

    /// Firmware 5.4.15: alternate setting 1 is bulk, no close range, exposure through the sensor's registers.
    pub fn firmware_5_4() -> Self {
        Self::of(Firmware::new(5, 4, 15), 4, true)
    }

    /// Firmware 5.1.0: depth on the second endpoint, no presets, no serial number.
    pub fn firmware_5_1() -> Self {
        Self::of(Firmware::new(5, 1, 0), 4, false)
    }

    /// A personality by its name in a configuration: `carmine-1.09`, `carmine-1.08`, `firmware-5.4`, `firmware-5.1`.
    pub fn named(name: &str) -> Option<Self> {
        Some(match name {
            "carmine-1.09" => Self::carmine_1_09(),
            "carmine-1.08" => Self::carmine_1_08(),
            "firmware-5.4" => Self::firmware_5_4(),
            "firmware-5.1" => Self::firmware_5_1(),
            _ => return None,
        })
    }

    fn of(firmware: Firmware, hardware_word: u16, has_bayer: bool) -> Self {
        let mut fixed = FixedParams::xtion();
        // Addresses on the two-wire bus: made up.
        fixed.set(FixedField::ImageI2cAddress, 0x5D);
        fixed.set(FixedField::DepthI2cAddress, 0x5C);
        Self {
            product_id: 0x0601,
            has_microphones: true,
            version: Version {
                firmware,
                chip: Version::PS1080,
                hardware_word,
                system: 1,
            },
            usb_core: Some(0),
            serial: "1206090000",
            device_name: "PrimeSense Sensor",
            platform: "",
            mode: CameraMode::Normal,
            color_presets: color_presets(has_bayer),
            fixed,
            constant_shift: ps1080::shift::XTION_CONSTANT_SHIFT,
            registration: RegistrationBlock {
                fields: [0; RegistrationBlock::FIELD_COUNT],
            },
            padding_block: PaddingBlock::default(),
            padding: Padding::default(),
            block_part_bytes: 502 / 4 * 4,
            packet_bytes: 3072,
            fifo_bytes: 64 << 10,
            ticks_per_microsecond: 60,
            reply_nanos: 200_000,
            start_nanos: 30_000_000,
            skew_nanos: 9_000_000,
            synced_skew_nanos: 0,
            ends_transfers: true,
        }
    }

    /// The firmware.
    pub fn firmware(&self) -> Firmware {
        self.version.firmware
    }

    /// Whether the firmware serves `feature`.
    pub fn has(&self, feature: Feature) -> bool {
        self.firmware().has(feature)
    }
}

/// Modes of colour, and one of 0 frames a second, which firmware sends by mistake.
fn color_presets(has_bayer: bool) -> Vec<CmosPreset> {
    let preset = |format, resolution, fps| CmosPreset {
        format,
        resolution,
        fps,
    };
    let mut presets = vec![preset(1, QVGA, 0)];
    for format in [1, 5] {
        presets.extend([
            preset(format, QVGA, 30),
            preset(format, QVGA, 60),
            preset(format, VGA, 30),
        ]);
    }
    if has_bayer {
        for format in [0, 6, 7] {
            presets.extend([preset(format, QVGA, 30), preset(format, VGA, 30)]);
        }
        presets.push(preset(0, SXGA, 30));
    }
    presets
}
