//! Blocks of numbers that the camera holds: fixed parameters, algorithm blocks, presets, texts (protocol sections 3
//! and 8).

mod algorithm;
mod collector;
mod fixed;
mod presets;
mod text;

pub use algorithm::{
    BlankingBlock, PaddingBlock, RegistrationBlock, RegistrationField, decode_constant_shift,
    decode_tick_rate, encode_tick_rate,
};
pub use collector::{BlockCollector, BlockError};
pub use fixed::{FixedField, FixedParams};
pub use presets::{CmosPreset, Presets};
pub use text::{Text, decode_platform_string, encode_platform_string};
