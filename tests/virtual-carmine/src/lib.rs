//! A PrimeSense Carmine in software.
//!
//! For: tests of whoever talks to the camera, without one. It answers the control endpoint, films, packs, stamps and
//! loses data as the project's description of the protocol says ("protocol section"), and does wrong what
//! [`Faults`] ask for. Not for: USB libraries, sleeping, clocks: it is told what time it is, in nanoseconds of any
//! monotonic clock, and each call's time must not be before the last call's.
//!
//! ```
//! use ps1080::host::{MAX_HOST_PACKET_BYTES, Opcode, Received, ReplyReader, Request};
//! use ps1080::parameter::Parameter;
//! use virtual_carmine::{Bus, Control, Faults, Personality, Setup, TestPattern, Transfer, VirtualCarmine};
//!
//! let film = Box::new(TestPattern::new(7));
//! let camera = VirtualCarmine::new(Personality::carmine_1_09(), film, Faults::default());
//! let mut bus = Bus::new(camera);
//! // Depth on, with the defaults of the camera: QVGA, 30 frames a second, 11 bits.
//! let mut packet = [0; MAX_HOST_PACKET_BYTES];
//! let length = Request::set(Parameter::Stream1Mode, 2).encode(1, &mut packet);
//! let out = Setup::vendor_out(length as u16);
//! assert_eq!(bus.control(0, out, &mut packet[..length]), Control::Done(length));
//! let mut reader = ReplyReader::new(Opcode::SetParam, 1);
//! // A millisecond later the answer is there.
//! let Control::Done(length) = bus.control(1_000_000, Setup::vendor_in(512), &mut packet) else { panic!() };
//! assert_eq!(reader.receive(&packet[..length]), Ok(Received::Data(&[])));
//! // Sixteen transfers are queued; what has come within a second is handed out.
//! for token in 0..16 {
//!     bus.submit(1_000_000, 0x81, token, 20_480);
//! }
//! bus.advance(1_000_000_000);
//! let Some(Transfer { token, data, .. }) = bus.completed() else { panic!() };
//! assert_eq!((token, &data[..4]), (0, &[0x52, 0x42, 0x00, 0x71][..]));
//! // The other fifteen took what they could; the rest of the second was lost in the camera, which knows it.
//! assert!(bus.camera().counters().depth.fifo_lost_bytes > 0);
//! ```
//!
//! Map: [`VirtualCarmine`] the device, driven by control transfers and reads · [`Bus`] queued transfers in front of
//! it · [`Personality`] which unit it is · [`Faults`] what it does wrong · [`Film`] what it sees: [`TestPattern`]
//! and [`RecordingFilm`] · [`Counters`] what it says of itself.
//!
//! Guessed, since no description of a real camera says it: sizes of the FIFO and of isochronous packets, that a transfer
//! ends with the frame when nothing is left to send, columns of a mirrored mosaic, addresses of the sensors,
//! that a reset leaves the emitter as it is, that depth goes on without any sample while the emitter is off. Not there:
//! cropping (refused), sound, files in the flash (unknown requests), JPEG but from recordings.
//!
//! Invariants: the same calls at the same times give the same bytes; frames are made by deadline whether or not anybody
//! reads, and what finds no room in the FIFO is lost as whole packets and counted; no bytes from a host make it panic.

mod answers;
mod bus;
mod camera;
mod clock;
mod conversation;
mod counters;
mod darkroom;
mod descriptors;
mod faults;
mod fifo;
mod film;
mod frame;
mod pattern;
mod personality;
mod recording;
mod sensor;
mod settings;
mod shot;
mod usb;

pub use bus::{Bus, Transfer, TransferStatus};
pub use camera::{Read, VirtualCarmine};
pub use counters::{Counters, DeliveredFrame, StreamCounters};
pub use faults::{Alarm, Deviation, Faults, Refusal, Stall, StreamName, Trouble};
pub use film::{ColorLayout, Film};
pub use pattern::TestPattern;
pub use personality::Personality;
pub use recording::{FilmError, RecordingFilm};
pub use usb::{Control, Setup};
