//! What the camera answers to each request (protocol sections 3, 8 and 10).

use std::collections::BTreeMap;

use ps1080::blocks::{
    BlankingBlock, CmosPreset, FixedField, Text, encode_platform_string, encode_tick_rate,
};
use ps1080::firmware::Feature;
use ps1080::host::{AlgorithmKind, Nack, Request};
use ps1080::mode::{CameraMode, Cmos, Resolution};
use ps1080::stream::TickRate;

use crate::darkroom::Darkroom;
use crate::personality::Personality;
use crate::settings::Settings;

/// Units of blanking that the sensors have: any number but 0, which would mean that there is no colour sensor.
const BLANKING_UNITS: u32 = 40;
const NAME_BYTES: usize = 128;

/// What a request does to the streams.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Effect {
    /// Nothing, or a parameter that frames look up.
    None,
    /// Modes of streams may have changed.
    Streams,
    /// The camera leaves the bus.
    Leaves,
}

/// Data of a reply and what else happens.
pub(crate) type Answer = Result<(Vec<u8>, Effect), Nack>;

/// All that requests read and write.
pub(crate) struct Memory {
    pub(crate) unit: Personality,
    pub(crate) settings: Settings,
    pub(crate) darkroom: Darkroom,
    /// Registers of sensors, by bus, address and register.
    registers: BTreeMap<(u16, u16, u16), u16>,
    hardware: BTreeMap<u32, u32>,
    blanking: [u32; 2],
}

impl Memory {
    pub(crate) fn new(unit: Personality, darkroom: Darkroom) -> Self {
        Self {
            unit,
            settings: Settings::new(),
            darkroom,
            registers: BTreeMap::new(),
            hardware: BTreeMap::new(),
            blanking: [BLANKING_UNITS; 2],
        }
    }

    /// Answers `request`, which has come whole.
    pub(crate) fn answer(&mut self, request: &Request) -> Answer {
        self.must_have(request)?;
        let data = match *request {
            Request::GetVersion => {
                let version = self.unit.version.encode();
                version.ok_or(Nack::Unknown)?.to_vec()
            }
            Request::GetParam { id } => word(self.settings.read(id, &self.unit)?),
            Request::SetParam { ref pairs } => return self.set(pairs.as_slice()),
            Request::GetFixedParams { offset } => {
                let block = self.unit.fixed.encode();
                self.part(&block, 4 * usize::from(offset))
            }
            Request::GetMode => word(self.unit.mode.code()),
            Request::SetMode { mode } => return self.set_mode(mode),
            Request::I2cWrite { .. }
            | Request::I2cRead { .. }
            | Request::ReadAhb { .. }
            | Request::WriteAhb { .. } => self.reach_through(request)?,
            Request::AlgorithmParams {
                kind,
                resolution,
                fps: _,
                offset,
            } => {
                let block = self.algorithm(kind, resolution)?;
                self.part(&block, 2 * usize::from(offset))
            }
            Request::SetCmosBlanking { units, cmos, .. } => {
                *self.blanking_of(cmos)? = u32::from(units);
                Vec::new()
            }
            Request::GetCmosBlanking { cmos } => self.blanking_of(cmos)?.to_le_bytes().to_vec(),
            Request::GetCmosPresets { cmos } => self.presets(cmos)?,
            Request::GetSerialNumber => self.unit.serial.as_bytes().to_vec(),
            Request::GetPlatformString => {
                let mut data = [0; 80];
                let text = Text::decode(self.unit.platform.as_bytes());
                let length = encode_platform_string(&text, &mut data);
                data[..length].to_vec()
            }
            Request::GetUsbCoreType => word(self.unit.usb_core.ok_or(Nack::InvalidCommand)?),
            Request::EnableEmitter { on } => {
                self.settings.light(on)?;
                return Ok((Vec::new(), Effect::Streams));
            }
            Request::KeepAlive | Request::GetLog | Request::SetLedState { .. } => Vec::new(),
        };
        Ok((data, Effect::None))
    }

    /// Reads and writes of what is behind the camera's processor: sensors and its own hardware.
    fn reach_through(&mut self, request: &Request) -> Result<Vec<u8>, Nack> {
        match *request {
            Request::I2cWrite {
                bus,
                slave,
                ref words,
            } => {
                self.write_register(bus, slave, words.as_slice())?;
                Ok(Vec::new())
            }
            Request::I2cRead {
                bus,
                slave,
                read_count,
                ref words,
            } => self.read_register(bus, slave, read_count, words.as_slice()),
            Request::ReadAhb { address } => {
                let value = self.hardware.get(&address).copied().unwrap_or(0);
                Ok(value.to_le_bytes().to_vec())
            }
            Request::WriteAhb {
                address,
                value,
                mask,
            } => {
                let place = self.hardware.entry(address).or_default();
                *place = *place & !mask | value & mask;
                Ok(Vec::new())
            }
            _ => Err(Nack::InvalidCommand),
        }
    }

    /// Requests of later firmware are unknown.
    fn must_have(&self, request: &Request) -> Result<(), Nack> {
        let feature = match request {
            Request::SetCmosBlanking { .. } | Request::GetCmosBlanking { .. } => Feature::Blanking,
            Request::GetCmosPresets { .. } => Feature::Presets,
            Request::GetSerialNumber => Feature::SerialNumber,
            Request::GetPlatformString => Feature::PlatformString,
            Request::SetLedState { .. } => Feature::Led,
            Request::EnableEmitter { .. } => Feature::EmitterSwitch,
            _ => return Ok(()),
        };
        let has = self.unit.has(feature);
        has.then_some(()).ok_or(Nack::InvalidCommand)
    }

    /// Writes all pairs or none.
    fn set(&mut self, pairs: &[u16]) -> Answer {
        let mut settings = self.settings.clone();
        for pair in pairs.chunks_exact(2) {
            settings.write(pair[0], pair[1], &self.unit)?;
        }
        let before = &self.settings;
        let has_new_depth = settings.has_depth() && !before.has_depth();
        let has_new_image = settings.image_mode() != 0 && before.image_mode() == 0;
        let shots = [
            has_new_depth.then(|| settings.depth_shot(&self.unit)),
            has_new_image.then(|| settings.image_shot(&self.unit)),
        ];
        for (shot, _) in shots.into_iter().flatten().flatten() {
            // A film of other pictures than the wanted ones is a sensor without the mode.
            self.darkroom.payload(shot, 0).ok_or(Nack::BadParameters)?;
        }
        self.settings = settings;
        Ok((Vec::new(), Effect::Streams))
    }

    fn set_mode(&mut self, mode: u16) -> Answer {
        let mode = CameraMode::from_code(mode).ok_or(Nack::BadParameters)?;
        match mode {
            CameraMode::SoftReset => {
                self.settings.reset();
                Ok((Vec::new(), Effect::Streams))
            }
            CameraMode::Reboot => {
                self.settings.all_off();
                Ok((Vec::new(), Effect::Leaves))
            }
            _ if mode == self.unit.mode => Ok((Vec::new(), Effect::None)),
            _ => Err(Nack::BadParameters),
        }
    }

    /// The first word is the register; what follows is its value, a byte a word, the high one first.
    fn write_register(&mut self, bus: u16, slave: u16, words: &[u16]) -> Result<(), Nack> {
        self.sensor(bus, slave)?;
        let (&register, bytes) = words.split_first().ok_or(Nack::BadParameters)?;
        let value = bytes
            .iter()
            .fold(0, |value: u16, byte| value << 8 | byte & 0xFF);
        self.registers.insert((bus, slave, register), value);
        Ok(())
    }

    fn read_register(
        &self,
        bus: u16,
        slave: u16,
        read_count: u16,
        words: &[u16],
    ) -> Result<Vec<u8>, Nack> {
        self.sensor(bus, slave)?;
        let &register = words.first().ok_or(Nack::BadParameters)?;
        let value = self.registers.get(&(bus, slave, register));
        let [high, low] = value.copied().unwrap_or(0).to_be_bytes();
        match read_count {
            1 => Ok(word(u16::from(low))),
            2 => Ok([word(u16::from(high)), word(u16::from(low))].concat()),
            _ => Err(Nack::BadParameters),
        }
    }

    fn sensor(&self, bus: u16, slave: u16) -> Result<(), Nack> {
        let fixed = &self.unit.fixed;
        let is_there = [
            (FixedField::ImageI2cBus, FixedField::ImageI2cAddress),
            (FixedField::DepthI2cBus, FixedField::DepthI2cAddress),
        ]
        .iter()
        .any(|&(at_bus, at)| (fixed.get(at_bus), fixed.get(at)) == (bus.into(), slave.into()));
        is_there.then_some(()).ok_or(Nack::I2cFailed)
    }

    fn algorithm(&self, kind: u16, resolution: u16) -> Result<Vec<u8>, Nack> {
        let kind = AlgorithmKind::from_code(kind).ok_or(Nack::BadParameters)?;
        let has_qqvga = self.unit.has(Feature::QqvgaDepth);
        if resolution == Resolution::Qqvga.code() && !has_qqvga {
            return Err(Nack::BadParameters);
        }
        let feature = match kind {
            AlgorithmKind::Registration | AlgorithmKind::Padding => {
                Some(Feature::RegistrationBlocks)
            }
            AlgorithmKind::Blanking => Some(Feature::Blanking),
            AlgorithmKind::DeviceInfo => Some(Feature::DeviceInfo),
            AlgorithmKind::DepthInfo | AlgorithmKind::Frequency => None,
        };
        if feature.is_some_and(|feature| !self.unit.has(feature)) {
            return Err(Nack::BadParameters);
        }
        Ok(match kind {
            AlgorithmKind::DepthInfo => word(self.unit.constant_shift),
            AlgorithmKind::Registration => self.unit.registration.encode().to_vec(),
            AlgorithmKind::Padding => self.unit.padding_block.encode().to_vec(),
            AlgorithmKind::Blanking => blanking().encode().to_vec(),
            AlgorithmKind::DeviceInfo => self.device_info(),
            AlgorithmKind::Frequency => {
                // Up to 2²⁴ the number is exact.
                let ticks = self.unit.ticks_per_microsecond as f32;
                let rate = TickRate::from_ticks_per_microsecond(ticks).ok_or(Nack::Unknown)?;
                encode_tick_rate(rate).to_vec()
            }
        })
    }

    /// Name, then data of the maker, both filled up with zeros.
    fn device_info(&self) -> Vec<u8> {
        let mut block = vec![0; 2 * NAME_BYTES];
        let name = self.unit.device_name.bytes().take(NAME_BYTES - 1);
        block
            .iter_mut()
            .zip(name)
            .for_each(|(place, byte)| *place = byte);
        block
    }

    fn blanking_of(&mut self, cmos: u16) -> Result<&mut u32, Nack> {
        let cmos = Cmos::from_code(cmos).ok_or(Nack::BadParameters)?;
        Ok(&mut self.blanking[cmos as usize])
    }

    fn presets(&self, cmos: u16) -> Result<Vec<u8>, Nack> {
        let cmos = Cmos::from_code(cmos).ok_or(Nack::BadParameters)?;
        let presets: &[_] = match cmos {
            Cmos::Image => &self.unit.color_presets,
            Cmos::Depth => &[],
        };
        Ok(presets.iter().flat_map(CmosPreset::encode).collect())
    }

    /// The part of a block from byte `at` on that fits a reply; nothing past its end.
    fn part(&self, block: &[u8], at: usize) -> Vec<u8> {
        let rest = block.get(at..).unwrap_or_default();
        let length = self.unit.block_part_bytes.clamp(4, 500) / 4 * 4;
        rest.get(..length).unwrap_or(rest).to_vec()
    }
}

/// 30 microseconds a unit, of both sensors: made up.
fn blanking() -> BlankingBlock {
    BlankingBlock {
        lines: [(30.0, 0.0); 2],
    }
}

fn word(value: u16) -> Vec<u8> {
    value.to_le_bytes().to_vec()
}
