//! A stand-in for libusb-1.0 with virtual cameras behind it.
//!
//! For: programs that use libusb (glintd, the driver of OpenNI2), unmodified, on a machine without a camera. Put the
//! library first, as `libusb-1.0.so.0` in a folder of `LD_LIBRARY_PATH` or by `LD_PRELOAD`, and name a configuration
//! ([`config`]) in the environment variable `GLINT_VIRTUAL_CAMERAS`. Without it there are no cameras. Not for: devices
//! of any other kind, sending data to one, hot-plug notices.
//!
//! ```
//! let text = r#"
//! log = "cameras.json"
//! [[camera]]
//! personality = "carmine-1.09"
//! pattern_seed = 7
//! [camera.faults]
//! unplug_after_nanos = 2000000000
//! "#;
//! let config = usb_lookalike::config::Config::parse(text).unwrap();
//! assert_eq!(config.camera[0].pattern_seed, 7);
//! ```
//!
//! Map: [`config`] what cameras there are · `world` the state, behind one lock · `abi` what C sees · `exports` the
//! functions · `log` what the cameras say of themselves at the end.
//!
//! Invariants: contexts, devices and handles are numbers that look like pointers and are never followed; time is
//! `CLOCK_MONOTONIC`; there is no thread: what is due happens, with the time at which it was due, in whoever calls; a
//! host that does not queue transfers in time loses data ([`virtual_carmine::Bus`]).

mod abi;
pub mod config;
mod exports;
pub mod library;
mod log;
mod world;
