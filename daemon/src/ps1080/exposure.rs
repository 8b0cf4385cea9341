//! Exposure, gain and white balance: found by the camera or given, then locked, read back, and written down
//! (protocol section 9, "Exposure": what is set before the stream runs has no effect).

use std::collections::VecDeque;

use ps1080::blocks::FixedField;
use ps1080::firmware::Feature;
use ps1080::host::{Request, WordList};
use ps1080::parameter::Parameter;
use serde_json::{Value, json};

use crate::ps1080::error::CameraError;
use crate::ps1080::exchange::Answer;
use crate::ps1080::modes::ExposurePlan;
use crate::ps1080::open::Unit;

/// Frames of colour after which settings take effect.
const SETTLING_FRAMES: u64 = 10;
/// Frames that the camera gets to find an exposure.
const FINDING_FRAMES: u64 = 45;

/// Register of the image sensor that chooses the page, and the page.
const PAGE_REGISTER: u16 = 0xF0;
const CAMERA_PAGE: u16 = 1;
/// Register with the automatic functions, and their bits.
const MODE_REGISTER: u16 = 0x06;
const AUTO_EXPOSURE_BIT: u16 = 0x4000;
const AUTO_WHITE_BALANCE_BIT: u16 = 0x0002;

/// Parameters that are set to 0, before exposure and gain.
const SWITCHED_OFF: [Parameter; 3] = [
    Parameter::AutoExposure,
    Parameter::AutoWhiteBalance,
    Parameter::LowLightCompensation,
];

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Act {
    /// Until so many frames of colour have come since the last wait.
    Await(u64),
    /// Reads what is to be kept.
    Read(Parameter),
    /// Sets a given value.
    Set(Parameter, u16),
    /// Sets exposure or gain to what is wanted.
    SetWanted(Parameter),
    /// Reads back.
    Check(Parameter),
    /// Begins with the register of the image sensor.
    Page,
    ReadMode,
    WriteMode,
    /// Says what came of it.
    Say,
}

/// Locks the exposure step by step, between the arrivals of data.
#[derive(Debug)]
pub(super) struct ExposureControl {
    acts: VecDeque<Act>,
    exposure: Option<u16>,
    gain: Option<u16>,
    mode_register: u16,
    /// Bus and address of the image sensor.
    sensor: (u16, u16),
    through_registers: bool,
    waited_from: u64,
    problems: Vec<String>,
    is_reported: bool,
}

impl ExposureControl {
    /// For `unit`.
    pub(super) fn new(plan: ExposurePlan, unit: &Unit) -> Self {
        use Parameter::{ExposureBar, ImageGain};
        let word = |field| unit.fixed.get(field) as u16;
        let through_registers = !unit.firmware().has(Feature::ImageParameters);
        let (mut exposure, mut gain) = (None, None);
        let mut problems = Vec::new();
        let mut acts = VecDeque::new();
        let off = SWITCHED_OFF.map(|parameter| Act::Set(parameter, 0));
        match plan {
            ExposurePlan::Auto => {}
            _ if through_registers => {
                if let ExposurePlan::Manual { .. } = plan {
                    let firmware = unit.firmware();
                    problems.push(format!(
                        "firmware {firmware} takes no values, only what it found is kept"
                    ));
                }
                acts.extend([
                    Act::Await(FINDING_FRAMES),
                    Act::Page,
                    Act::ReadMode,
                    Act::WriteMode,
                ]);
            }
            ExposurePlan::Lock => {
                acts.push_back(Act::Await(FINDING_FRAMES));
                acts.extend(off);
                // Not written back: whether firmware shows here what its automatic exposure found, nobody knows.
                acts.extend([Act::Read(ExposureBar), Act::Read(ImageGain)]);
            }
            ExposurePlan::Manual {
                exposure: wanted,
                gain: wanted_gain,
            } => {
                (exposure, gain) = (Some(wanted), Some(wanted_gain));
                acts.push_back(Act::Await(SETTLING_FRAMES));
                acts.extend(off);
                acts.extend([Act::SetWanted(ExposureBar), Act::SetWanted(ImageGain)]);
            }
        }
        if !acts.is_empty() {
            acts.push_back(Act::Await(SETTLING_FRAMES));
            if !through_registers {
                acts.extend(SWITCHED_OFF.map(Act::Check));
                acts.extend([Act::Check(ExposureBar), Act::Check(ImageGain)]);
            }
            acts.push_back(Act::Say);
        }
        Self {
            acts,
            exposure,
            gain,
            mode_register: 0,
            sensor: (
                word(FixedField::ImageI2cBus),
                word(FixedField::ImageI2cAddress),
            ),
            through_registers,
            waited_from: 0,
            problems,
            is_reported: false,
        }
    }

    /// The next request, when `frame_count` frames of colour have come.
    pub(super) fn next(&mut self, frame_count: u64) -> Option<Request> {
        let (bus, slave) = self.sensor;
        loop {
            let request = match *self.acts.front()? {
                Act::Await(count) if frame_count < self.waited_from + count => return None,
                Act::Await(_) => {
                    self.waited_from = frame_count;
                    self.acts.pop_front();
                    continue;
                }
                Act::Read(parameter) | Act::Check(parameter) => Request::get(parameter),
                Act::Set(parameter, value) => Request::set(parameter, value),
                Act::SetWanted(parameter) => match self.kept(parameter) {
                    Some(value) => Request::set(parameter, value),
                    None => {
                        self.acts.pop_front();
                        continue;
                    }
                },
                Act::Page => self.write_register(PAGE_REGISTER, CAMERA_PAGE)?,
                Act::ReadMode => Request::I2cRead {
                    bus,
                    slave,
                    read_count: 2,
                    words: WordList::new(&[MODE_REGISTER])?,
                },
                Act::WriteMode => {
                    let off = AUTO_EXPOSURE_BIT | AUTO_WHITE_BALANCE_BIT;
                    self.write_register(MODE_REGISTER, self.mode_register & !off)?
                }
                Act::Say => return None,
            };
            return Some(request);
        }
    }

    /// What came of the request.
    pub(super) fn done(&mut self, result: Result<&Answer, &CameraError>) {
        let Some(act) = self.acts.pop_front() else {
            return;
        };
        let answer = match result {
            Ok(answer) => answer,
            Err(error) => {
                self.problems.push(error.to_string());
                return;
            }
        };
        let words: Vec<u16> = answer
            .data()
            .as_chunks()
            .0
            .iter()
            .map(|word| u16::from_le_bytes(*word))
            .collect();
        match (act, words.as_slice()) {
            (Act::Read(Parameter::ExposureBar), [value, ..]) => self.exposure = Some(*value),
            (Act::Read(Parameter::ImageGain), [value, ..]) => self.gain = Some(*value),
            (Act::Check(parameter), [value, ..]) => self.check(parameter, *value),
            // One byte a word, the high one first.
            (Act::ReadMode, [high, low, ..]) => {
                self.mode_register = (high & 0xFF) << 8 | (low & 0xFF);
            }
            (Act::Read(_) | Act::Check(_) | Act::ReadMode, _) => {
                self.problems
                    .push(format!("{act:?}: an answer without a value"));
            }
            _ => {}
        }
    }

    /// Details of an event, once all is done.
    pub(super) fn report(&mut self) -> Option<Value> {
        if self.acts.front() != Some(&Act::Say) || self.is_reported {
            return None;
        }
        self.is_reported = true;
        self.acts.clear();
        if self.problems.is_empty() {
            return Some(self.locked());
        }
        Some(json!({
            "event": "warning",
            "message": format!("exposure is not locked: {}", self.problems.join("; ")),
            "exposure_locked": false,
        }))
    }

    fn locked(&self) -> Value {
        let mut details = json!({
            "event": "settings",
            "exposure_locked": true,
            "white_balance_locked": true,
        });
        if let Some(exposure) = self.exposure.filter(|_| !self.through_registers) {
            details["exposure_bar"] = exposure.into();
        }
        if let Some(gain) = self.gain.filter(|_| !self.through_registers) {
            details["gain"] = gain.into();
        }
        details
    }

    fn kept(&self, parameter: Parameter) -> Option<u16> {
        match parameter {
            Parameter::ExposureBar => self.exposure,
            Parameter::ImageGain => self.gain,
            _ => None,
        }
    }

    fn check(&mut self, parameter: Parameter, got: u16) {
        let expected = self.kept(parameter).unwrap_or(0);
        if got != expected {
            self.problems
                .push(format!("{parameter:?} reads {got} instead of {expected}"));
        }
    }

    fn write_register(&self, register: u16, value: u16) -> Option<Request> {
        let (bus, slave) = self.sensor;
        Some(Request::I2cWrite {
            bus,
            slave,
            words: WordList::new(&[register, value >> 8, value & 0xFF])?,
        })
    }
}
