//! Making a camera ready, and learning what it is (protocol section 5, "Open").

use ps1080::blocks::{
    CmosPreset, FixedParams, Presets, Text, decode_constant_shift, decode_platform_string,
    decode_tick_rate,
};
use ps1080::firmware::{Feature, Firmware, Version};
use ps1080::host::{AlgorithmKind, Request};
use ps1080::mode::{CameraMode, Cmos, Resolution};
use ps1080::shift::XTION_CONSTANT_SHIFT;
use ps1080::stream::TickRate;
use ps1080::timing::UsbCore;

use crate::ps1080::error::CameraError;
use crate::ps1080::exchange::{MILLI_NANOS, SECOND_NANOS};
use crate::ps1080::session::Session;

/// After a soft reset the camera is asked whether it is there so often, so far apart.
const ALIVE_TRIES: u32 = 10;
const ALIVE_RETRY_NANOS: i64 = 10 * MILLI_NANOS;
/// Longest wait for a reply to SET_MODE, which some firmware does not send.
const RESET_REPLY_NANOS: i64 = SECOND_NANOS / 2;
const FPS: u16 = 30;

/// What is known of a camera once it has been asked.
#[derive(Clone, Debug)]
pub struct Unit {
    /// Firmware, chip, hardware.
    pub version: Version,
    /// Serial number; empty where the firmware has none.
    pub serial: String,
    /// Name in the device's own words; empty where the firmware has none.
    pub name: String,
    /// Platform, empty in most.
    pub platform: String,
    /// Modes of colour that it lists; empty where the firmware has no list.
    pub color_presets: Vec<CmosPreset>,
    /// Lengths and sensors.
    pub fixed: FixedParams,
    /// Constant shift, pixels.
    pub constant_shift: u16,
    /// What the counter counts.
    pub tick_rate: TickRate,
}

impl Unit {
    /// The firmware.
    pub fn firmware(&self) -> Firmware {
        self.version.firmware
    }
}

impl Session {
    /// Firmware and hardware: the first request, which tells how to speak to the camera.
    ///
    /// # Errors
    /// Silence, a version that cannot be read, a firmware of another language.
    pub fn ask_version(&mut self) -> Result<Version, CameraError> {
        let answer = self.ask_first(Request::GetVersion)?;
        let version = Version::decode(answer.data()).ok_or(CameraError::Version)?;
        if !version.firmware.is_known() {
            return Err(CameraError::Firmware(version.firmware));
        }
        // Asked for slowly: how fast it may be is what is asked.
        let core = self.ask_core();
        self.know(version.firmware, core);
        Ok(version)
    }

    /// Failure counts as the usual one.
    fn ask_core(&mut self) -> UsbCore {
        match self.ask_briefly(Request::GetUsbCoreType, SECOND_NANOS) {
            Ok(answer) if answer.data().first() == Some(&1) => UsbCore::GadgetFs,
            _ => UsbCore::Jungo,
        }
    }

    /// Serial number, where the firmware has one.
    ///
    /// # Errors
    /// Refusal, silence.
    pub fn ask_serial(&mut self, firmware: Firmware) -> Result<String, CameraError> {
        if !firmware.has(Feature::SerialNumber) {
            return Ok(String::new());
        }
        let answer = self.ask(Request::GetSerialNumber)?;
        Ok(Text::<64>::decode(answer.data()).as_str().to_owned())
    }

    /// Resets the camera and asks all that a recording needs to know.
    ///
    /// # Errors
    /// A camera that does not answer, is damaged, or is of another kind.
    pub fn open(&mut self) -> Result<Unit, CameraError> {
        let version = self.ask_version()?;
        let firmware = version.firmware;
        let color_presets = self.ask_presets(firmware)?;
        self.require_normal_mode()?;
        self.reset()?;
        self.require_normal_mode()?;
        let fixed = FixedParams::decode(&self.fixed_block()?);
        let serial = self.ask_serial(firmware)?;
        let name = self.ask_name(firmware)?;
        let platform = self.ask_platform(firmware)?;
        let constant_shift = self.ask_constant_shift()?;
        let tick_rate = self.ask_tick_rate()?;
        Ok(Unit {
            version,
            serial,
            name,
            platform,
            color_presets,
            fixed,
            constant_shift,
            tick_rate,
        })
    }

    fn ask_presets(&mut self, firmware: Firmware) -> Result<Vec<CmosPreset>, CameraError> {
        if !firmware.has(Feature::Presets) {
            return Ok(Vec::new());
        }
        let cmos = Cmos::Image as u16;
        let answer = self.ask(Request::GetCmosPresets { cmos })?;
        Ok(Presets::decode(answer.data()).collect())
    }

    fn require_normal_mode(&mut self) -> Result<(), CameraError> {
        let answer = self.ask(Request::GetMode)?;
        let (&word, _) = answer
            .data()
            .split_first_chunk()
            .ok_or(CameraError::Numbers { what: "mode" })?;
        let code = u16::from_le_bytes(word);
        match CameraMode::from_code(code) {
            Some(CameraMode::Normal) => Ok(()),
            Some(CameraMode::Safe) => Err(CameraError::SafeMode),
            _ => Err(CameraError::Mode(code)),
        }
    }

    fn reset(&mut self) -> Result<(), CameraError> {
        self.ask(Request::KeepAlive)?;
        let mode = CameraMode::SoftReset.code();
        match self.ask_briefly(Request::SetMode { mode }, RESET_REPLY_NANOS) {
            Err(error) if error.is_gone() => return Err(error),
            // Refused or not answered: the requests that follow show whether it lives.
            Ok(_) | Err(_) => {}
        }
        self.pause_millis(self.delays().soft_reset_millis);
        let mut tries = 1;
        loop {
            match self.ask(Request::KeepAlive) {
                Ok(_) => return Ok(()),
                Err(error) if tries == ALIVE_TRIES || error.is_gone() => return Err(error),
                Err(_) => tries += 1,
            }
            self.usb.pause(ALIVE_RETRY_NANOS);
        }
    }

    fn ask_name(&mut self, firmware: Firmware) -> Result<String, CameraError> {
        if !firmware.has(Feature::DeviceInfo) {
            return Ok(String::new());
        }
        let kind = AlgorithmKind::DeviceInfo;
        let block: [u8; 256] = self.algorithm_block("device information", kind, 0, 0)?;
        // The second half is the vendor's.
        Ok(Text::<128>::decode(&block[..128]).as_str().to_owned())
    }

    fn ask_platform(&mut self, firmware: Firmware) -> Result<String, CameraError> {
        if !firmware.has(Feature::PlatformString) {
            return Ok(String::new());
        }
        let answer = self.ask(Request::GetPlatformString)?;
        let text = decode_platform_string(answer.data());
        Ok(text.as_str().to_owned())
    }

    fn ask_constant_shift(&mut self) -> Result<u16, CameraError> {
        let (kind, vga) = (AlgorithmKind::DepthInfo, Resolution::Vga.code());
        match self.algorithm_block("depth information", kind, vga, FPS) {
            Ok(block) => Ok(decode_constant_shift(&block)),
            Err(CameraError::Refused { nack, .. }) => {
                tracing::warn!(
                    "the camera does not say its constant shift ({nack}); that of an Xtion is taken"
                );
                Ok(XTION_CONSTANT_SHIFT)
            }
            Err(error) => Err(error),
        }
    }

    /// What the counter counts; to be asked again whenever a stream starts.
    pub(super) fn ask_tick_rate(&mut self) -> Result<TickRate, CameraError> {
        let vga = Resolution::Vga.code();
        let block = self.algorithm_block("frequency", AlgorithmKind::Frequency, vga, FPS)?;
        decode_tick_rate(&block).ok_or(CameraError::Numbers { what: "frequency" })
    }
}
