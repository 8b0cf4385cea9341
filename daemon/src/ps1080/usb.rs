//! What the driver needs of USB, so that it can be tried without any.

use ps1080::usb::TransferKind;

/// Why a transfer did not succeed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum UsbError {
    /// The device is gone.
    #[error("the camera has been unplugged")]
    Gone,
    /// It did not answer in time.
    #[error("no answer in time")]
    Timeout,
    /// It refused the transfer on the level of USB.
    #[error("the camera stalls the endpoint")]
    Stall,
    /// Another program has it.
    #[error("another program uses the camera")]
    Busy,
    /// The rights to open it are missing.
    #[error("no right to open the camera")]
    Access,
    /// There is no such interface, setting or endpoint.
    #[error("the camera has no such interface, setting or endpoint")]
    NotFound,
    /// Anything else, by libusb's number.
    #[error("libusb error {0}")]
    Other(i32),
}

/// How an endpoint is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct QueueShape {
    /// Transfers that are in flight at a time.
    pub transfer_count: usize,
    /// Bytes of a transfer where the endpoint is bulk.
    pub bulk_bytes: usize,
    /// Packets of a transfer where it is isochronous.
    pub iso_packet_count: usize,
}

impl Default for QueueShape {
    /// 32 transfers of 20 KiB, 40 packets of USB 2 each: 50 ms of depth at VGA. A second of one recorder's queues is
    /// far below the 16 MB that Linux grants to all cameras together.
    fn default() -> Self {
        Self {
            transfer_count: 32,
            bulk_bytes: 20_480,
            iso_packet_count: 32,
        }
    }
}

/// What one transfer brought.
#[derive(Clone, Copy, Debug)]
pub struct Arrival<'a> {
    /// From which endpoint.
    pub endpoint: u8,
    /// Bytes of the stream, in order; of an isochronous transfer one call for each packet.
    pub bytes: &'a [u8],
    /// When it was noticed, in the transport's time.
    pub at_nanos: i64,
    /// Bytes before these were lost on the bus.
    pub is_damaged: bool,
}

/// The camera's interface 0, claimed. The camera counts as gone after the first [`UsbError::Gone`].
///
/// Time is the transport's: that of the host's monotonic clock, or that of a camera in software.
pub trait UsbTransport: Send {
    /// Now, nanoseconds.
    fn now_nanos(&self) -> i64;

    /// Lets time pass; data that come meanwhile wait in the queues.
    fn pause(&mut self, nanos: i64);

    /// Whether the time of [`now_nanos`](Self::now_nanos) stands still while nobody calls: then nothing is late.
    fn time_waits(&self) -> bool {
        false
    }

    /// The vendor request to the camera.
    ///
    /// # Errors
    /// When it is not taken.
    fn control_out(&mut self, packet: &[u8], timeout_nanos: i64) -> Result<(), UsbError>;

    /// The vendor request from the camera; how many bytes of `packet` came, 0 when nothing is ready.
    ///
    /// # Errors
    /// When there is no answer.
    fn control_in(&mut self, packet: &mut [u8], timeout_nanos: i64) -> Result<usize, UsbError>;

    /// Chooses an alternate setting.
    ///
    /// # Errors
    /// When there is none of this number.
    fn set_alternate(&mut self, setting: u8) -> Result<(), UsbError>;

    /// How `endpoint` works in the setting; `None` where it has none.
    fn endpoint_kind(&self, setting: u8, endpoint: u8) -> Option<TransferKind>;

    /// Keeps transfers in flight on `endpoint` of the active setting, until [`stop`](Self::stop).
    ///
    /// # Errors
    /// When the first of them cannot be queued.
    fn start(&mut self, endpoint: u8, shape: QueueShape) -> Result<(), UsbError>;

    /// Takes the transfers of `endpoint` back; what they hold is thrown away.
    fn stop(&mut self, endpoint: u8);

    /// Waits until something came or `until_nanos` is over, hands all of it out, and queues the transfers again.
    /// What came before the camera was gone is handed out before the error.
    ///
    /// # Errors
    /// [`UsbError::Gone`], and what makes an endpoint unusable.
    fn reap(&mut self, until_nanos: i64, take: &mut dyn FnMut(Arrival<'_>))
    -> Result<(), UsbError>;
}
