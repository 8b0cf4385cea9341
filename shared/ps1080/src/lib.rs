//! The wire language of PrimeSense PS1080 cameras (Carmine, Xtion), host's side and camera's side.
//!
//! For: requests and replies, packets and frames, the formats of depth, infrared and colour, the blocks of numbers
//! that a unit holds; firmware 5.1 to 5.8. Not for: USB libraries, clocks, waiting, what a depth means. Sections
//! that are named "protocol section" are those of the project's description of the protocol.
//!
//! ```
//! use ps1080::samples::{SampleDecoder, SampleFormat, encode_samples};
//! use ps1080::stream::{DeviceTicks, FrameEvent, FrameReceiver, Packetiser, Padding, StreamKind};
//! let shifts = [100, 200, 300, 400, 500, 600, 2047, 0];
//! let mut payload = [0; 11];
//! encode_samples(SampleFormat::Packed11, &shifts, 8, &mut payload).unwrap();
//! let mut packetiser = Packetiser::new(StreamKind::Depth, 512).unwrap();
//! let mut receiver = FrameReceiver::new(StreamKind::Depth);
//! let mut decoder = SampleDecoder::new(SampleFormat::Packed11, shifts.len());
//! let mut decoded = [0; 8];
//! for packet in packetiser.frame(&payload, Padding::default(), DeviceTicks(7)) {
//!     for mut transfer in [packet.header.as_slice(), packet.payload] {
//!         while let Some(event) = receiver.next(&mut transfer) {
//!             match event {
//!                 FrameEvent::Started(padding) => decoder.begin(padding),
//!                 FrameEvent::Data(bytes) => decoder.push(bytes, &mut decoded).unwrap(),
//!                 FrameEvent::Ended(ticks) => assert_eq!(ticks, DeviceTicks(7)),
//!                 FrameEvent::Lost(_) | FrameEvent::Fault(_) => unreachable!(),
//!             }
//!         }
//!     }
//! }
//! decoder.finish(&mut decoded).unwrap();
//! assert_eq!(decoded, shifts);
//! ```
//!
//! Map: [`host`] requests and replies · [`parameter`] and [`mode`] what they set · [`blocks`] numbers of a unit ·
//! [`shift`] constants of depth · [`stream`] packets and frames · [`samples`] depth and infrared · [`color`] ·
//! [`firmware`], [`timing`], [`usb`] what depends on the version.
//!
//! Invariants: no heap, no clock, no unsafe code; no bytes make a function panic; a picture that is handed out as whole
//! has every packet and every pixel, anything else is a [`LossCause`](stream::LossCause) or a [`Damage`].

#![no_std]
#![forbid(unsafe_code)]

pub mod blocks;
mod bytes;
pub mod color;
mod damage;
pub mod firmware;
pub mod host;
pub mod mode;
mod nibbles;
pub mod parameter;
pub mod samples;
pub mod shift;
pub mod stream;
pub mod timing;
pub mod usb;

pub use damage::{Damage, NoRoom};
