//! USB by libusb: the raw layer for asynchronous transfers, rusb for the rest. The only folder of the driver with unsafe
//! code, all of it in `transfer`.

mod find;
mod transfer;
mod transport;

pub use find::{Found, list, open_camera};
pub use transport::LibusbTransport;
