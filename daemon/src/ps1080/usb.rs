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
    /// Transfers that are in flight at a time where the endpoint is bulk.
    pub bulk_transfers: usize,
    /// Bytes of each.
    pub bulk_bytes: usize,
    /// Transfers that are in flight at a time where it is isochronous.
    pub iso_transfers: usize,
    /// Packets of each.
    pub iso_packet_count: usize,
}

impl Default for QueueShape {
    /// What the camera's own memory holds is full after 4 ms, so the queues are what a late machine lives on. Bulk: 96
    /// transfers of 20 KiB, 40 packets of USB 2 each: 105 ms of colour and 150 ms of depth at VGA; a camera's two queues
    /// are 4 MB of the 16 MB that Linux grants to all. Isochronous: 32 transfers of 4 ms.
    fn default() -> Self {
        Self {
            bulk_transfers: 96,
            bulk_bytes: 20_480,
            iso_transfers: 32,
            iso_packet_count: 32,
        }
    }
}

impl QueueShape {
    /// Transfers that are in flight at a time.
    pub fn transfer_count(&self, kind: TransferKind) -> usize {
        match kind {
            TransferKind::Bulk => self.bulk_transfers,
            TransferKind::Isochronous => self.iso_transfers,
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

    /// The longest time in which nobody looked whether something came: it was worked on what had come, or the machine did
    /// not let us. Nanoseconds; 0 where time waits.
    fn longest_absence_nanos(&self) -> i64 {
        0
    }

    /// Waits until something came or `until_nanos` is over, hands all of it out, and queues the transfers again.
    /// What came before the camera was gone is handed out before the error.
    ///
    /// # Errors
    /// [`UsbError::Gone`], and what makes an endpoint unusable.
    fn reap(&mut self, until_nanos: i64, take: &mut dyn FnMut(Arrival<'_>))
    -> Result<(), UsbError>;
}
