//! A camera on a real bus.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use ps1080::usb::{INTERFACE, REQUEST_TYPE_IN, REQUEST_TYPE_OUT, TransferKind};
use rusb::{Context, Device, DeviceHandle, TransferType, UsbContext as _};

use super::transfer::{Ended, Idle, InFlight};
use crate::clock::HostClock;
use crate::ps1080::usb::{Arrival, QueueShape, UsbError, UsbTransport};

/// Longest wait for transfers that were taken back; libusb gives them in milliseconds.
const CANCEL_WAIT: Duration = Duration::from_secs(1);
/// Errors of an endpoint in a row after which it is given up.
const MOST_ERRORS: u32 = 200;

/// An endpoint of an alternate setting.
#[derive(Clone, Copy, Debug)]
struct EndpointOfSetting {
    setting: u8,
    address: u8,
    kind: TransferKind,
    /// Bytes of an isochronous packet, all transactions of a microframe together.
    packet_bytes: usize,
}

/// Transfers of an endpoint, oldest first.
struct Queue {
    endpoint: u8,
    flight: VecDeque<InFlight>,
    /// Bytes were lost before the next ones.
    is_damaged: bool,
    error_count: u32,
}

/// Interface 0 of a camera, claimed until this is dropped.
pub struct LibusbTransport {
    queues: Vec<Queue>,
    endpoints: Vec<EndpointOfSetting>,
    setting: u8,
    is_gone: bool,
    clock: HostClock,
    /// Since when nobody looks; `None` before the first look.
    looked_nanos: Option<i64>,
    longest_absence_nanos: i64,
    handle: DeviceHandle<Context>,
}

impl LibusbTransport {
    /// Opens `device` and claims its camera.
    ///
    /// # Errors
    /// Missing rights, another program that has it, a device that is gone.
    pub fn open(device: &Device<Context>) -> Result<Self, UsbError> {
        let endpoints = endpoints_of(device);
        let handle = device.open().map_err(error_of)?;
        // Where the system can do that; nothing binds interface 0 usually.
        let _ = handle.set_auto_detach_kernel_driver(true);
        handle.claim_interface(INTERFACE).map_err(error_of)?;
        Ok(Self {
            queues: Vec::with_capacity(2),
            endpoints,
            setting: 0,
            is_gone: false,
            clock: HostClock::default(),
            looked_nanos: None,
            longest_absence_nanos: 0,
            handle,
        })
    }

    fn endpoint(&self, setting: u8, address: u8) -> Option<&EndpointOfSetting> {
        self.endpoints
            .iter()
            .find(|endpoint| (endpoint.setting, endpoint.address) == (setting, address))
    }

    /// From `since_nanos` until `now_nanos` nobody looked.
    fn note_absence(&mut self, since_nanos: Option<i64>, now_nanos: i64) {
        if let Some(since_nanos) = since_nanos {
            let absence_nanos = now_nanos.saturating_sub(since_nanos);
            self.longest_absence_nanos = self.longest_absence_nanos.max(absence_nanos);
        }
    }

    /// Lets libusb work.
    fn handle_events(&self, timeout: Duration) -> Result<(), UsbError> {
        match self.handle.context().handle_events(Some(timeout)) {
            Ok(()) | Err(rusb::Error::Interrupted | rusb::Error::Timeout) => Ok(()),
            Err(error) => Err(error_of(error)),
        }
    }

    /// Hands out what has ended and submits it again; whether anything had.
    fn collect(&mut self, take: &mut dyn FnMut(Arrival<'_>)) -> Result<bool, UsbError> {
        let mut is_any = false;
        for queue in &mut self.queues {
            // As many as are there now: a camera that is faster than us must not keep us here.
            for _ in 0..queue.flight.len() {
                if !queue.flight.front().is_some_and(InFlight::is_done) {
                    break;
                }
                let Some(Ok(transfer)) = queue.flight.pop_front().map(InFlight::try_finish) else {
                    break;
                };
                is_any = true;
                let at_nanos = (self.clock.monotonic)();
                let endpoint = queue.endpoint;
                let mut is_damaged = std::mem::take(&mut queue.is_damaged);
                transfer.for_each_piece(|bytes, is_lost| {
                    is_damaged |= is_lost;
                    if !bytes.is_empty() {
                        take(Arrival {
                            endpoint,
                            bytes,
                            at_nanos,
                            is_damaged: std::mem::take(&mut is_damaged),
                        });
                    }
                });
                queue.is_damaged = is_damaged;
                match transfer.ended() {
                    Ended::Completed => queue.error_count = 0,
                    Ended::Gone => {
                        self.is_gone = true;
                        continue;
                    }
                    Ended::Cancelled => continue,
                    ended => {
                        queue.is_damaged = true;
                        queue.error_count += 1;
                        if ended == Ended::Stall {
                            // A halt is lifted so; that of a camera that is gone shows below.
                            let _ = self.handle.clear_halt(endpoint);
                        }
                        if queue.error_count > MOST_ERRORS {
                            return Err(UsbError::Stall);
                        }
                    }
                }
                if self.is_gone {
                    continue;
                }
                match transfer.submit() {
                    Ok(transfer) => queue.flight.push_back(transfer),
                    Err(UsbError::Gone) => self.is_gone = true,
                    Err(error) => return Err(error),
                }
            }
        }
        Ok(is_any)
    }

    fn take_back(&mut self, mut queue: Queue) {
        // The newest first: what an older one leaves must not go into a later one.
        for transfer in queue.flight.iter().rev() {
            transfer.cancel();
        }
        let begun = Instant::now();
        while !queue.flight.is_empty() && begun.elapsed() < CANCEL_WAIT {
            if self.handle_events(Duration::from_millis(2)).is_err() {
                break;
            }
            queue.flight = std::mem::take(&mut queue.flight)
                .into_iter()
                .filter_map(|transfer| transfer.try_finish().err())
                .collect();
        }
        if !queue.flight.is_empty() {
            tracing::warn!(
                "{} transfers of endpoint {:#04x} did not come back",
                queue.flight.len(),
                queue.endpoint
            );
        }
    }
}

impl Drop for LibusbTransport {
    fn drop(&mut self) {
        while let Some(queue) = self.queues.pop() {
            self.take_back(queue);
        }
        // A device that is gone has no interface to give back.
        let _ = self.handle.release_interface(INTERFACE);
    }
}

impl UsbTransport for LibusbTransport {
    fn now_nanos(&self) -> i64 {
        (self.clock.monotonic)()
    }

    fn pause(&mut self, nanos: i64) {
        std::thread::sleep(Duration::from_nanos(nanos.max(0).unsigned_abs()));
    }

    fn control_out(&mut self, packet: &[u8], timeout_nanos: i64) -> Result<(), UsbError> {
        let written =
            self.handle
                .write_control(REQUEST_TYPE_OUT, 0, 0, 0, packet, timeout(timeout_nanos));
        written.map(|_| ()).map_err(error_of)
    }

    fn control_in(&mut self, packet: &mut [u8], timeout_nanos: i64) -> Result<usize, UsbError> {
        self.handle
            .read_control(REQUEST_TYPE_IN, 0, 0, 0, packet, timeout(timeout_nanos))
            .map_err(error_of)
    }

    fn set_alternate(&mut self, setting: u8) -> Result<(), UsbError> {
        self.handle
            .set_alternate_setting(INTERFACE, setting)
            .map_err(error_of)?;
        self.setting = setting;
        Ok(())
    }

    fn endpoint_kind(&self, setting: u8, endpoint: u8) -> Option<TransferKind> {
        self.endpoint(setting, endpoint)
            .map(|endpoint| endpoint.kind)
    }

    fn start(&mut self, address: u8, shape: QueueShape) -> Result<(), UsbError> {
        let endpoint = *self
            .endpoint(self.setting, address)
            .ok_or(UsbError::NotFound)?;
        let transfer_count = shape.transfer_count(endpoint.kind);
        let mut flight = VecDeque::with_capacity(transfer_count);
        for _ in 0..transfer_count {
            let transfer = Idle::new(
                self.handle.as_raw(),
                address,
                endpoint.kind,
                shape.bulk_bytes,
                (shape.iso_packet_count, endpoint.packet_bytes),
            );
            match transfer.ok_or(UsbError::Other(0))?.submit() {
                Ok(transfer) => flight.push_back(transfer),
                // The memory for transfers of all cameras is limited: some are enough.
                Err(UsbError::Other(code)) if !flight.is_empty() => {
                    tracing::warn!(
                        "only {} of {} reads of endpoint {address:#04x} could be queued (libusb error {code}); `glintd doctor` looks at usbfs memory",
                        flight.len(),
                        transfer_count
                    );
                    break;
                }
                Err(error) => return Err(error),
            }
        }
        self.queues.push(Queue {
            endpoint: address,
            flight,
            is_damaged: false,
            error_count: 0,
        });
        Ok(())
    }

    fn stop(&mut self, endpoint: u8) {
        while let Some(place) = self
            .queues
            .iter()
            .position(|queue| queue.endpoint == endpoint)
        {
            let queue = self.queues.swap_remove(place);
            self.take_back(queue);
        }
    }

    fn longest_absence_nanos(&self) -> i64 {
        self.longest_absence_nanos
    }

    fn reap(
        &mut self,
        until_nanos: i64,
        take: &mut dyn FnMut(Arrival<'_>),
    ) -> Result<(), UsbError> {
        loop {
            let is_any = self.collect(take)?;
            if self.is_gone {
                return Err(UsbError::Gone);
            }
            let now_nanos = self.now_nanos();
            let rest_nanos = until_nanos - now_nanos;
            if is_any || rest_nanos <= 0 {
                return Ok(());
            }
            self.note_absence(self.looked_nanos, now_nanos);
            self.handle_events(Duration::from_nanos(rest_nanos.unsigned_abs()))?;
            let back_nanos = self.now_nanos();
            // Woken too late.
            self.note_absence(Some(until_nanos), back_nanos);
            self.looked_nanos = Some(back_nanos);
        }
    }
}

fn timeout(nanos: i64) -> Duration {
    // libusb counts milliseconds, and 0 is for ever.
    Duration::from_nanos(nanos.max(1_000_000).unsigned_abs())
}

pub(super) fn error_of(error: rusb::Error) -> UsbError {
    match error {
        rusb::Error::NoDevice => UsbError::Gone,
        rusb::Error::Timeout => UsbError::Timeout,
        rusb::Error::Pipe => UsbError::Stall,
        rusb::Error::Busy => UsbError::Busy,
        rusb::Error::Access => UsbError::Access,
        rusb::Error::NotFound => UsbError::NotFound,
        rusb::Error::Io => UsbError::Other(-1),
        rusb::Error::InvalidParam => UsbError::Other(-2),
        rusb::Error::Overflow => UsbError::Other(-8),
        rusb::Error::Interrupted => UsbError::Other(-10),
        rusb::Error::NoMem => UsbError::Other(-11),
        rusb::Error::NotSupported => UsbError::Other(-12),
        _ => UsbError::Other(-99),
    }
}

/// The data endpoints of interface 0 in all its settings.
fn endpoints_of(device: &Device<Context>) -> Vec<EndpointOfSetting> {
    let Ok(configuration) = device.active_config_descriptor() else {
        return Vec::new();
    };
    let mut endpoints = Vec::new();
    let interfaces = configuration
        .interfaces()
        .filter(|interface| interface.number() == INTERFACE);
    for setting in interfaces.flat_map(|interface| interface.descriptors()) {
        for endpoint in setting.endpoint_descriptors() {
            let kind = match endpoint.transfer_type() {
                TransferType::Bulk => TransferKind::Bulk,
                TransferType::Isochronous => TransferKind::Isochronous,
                _ => continue,
            };
            let size = usize::from(endpoint.max_packet_size());
            endpoints.push(EndpointOfSetting {
                setting: setting.setting_number(),
                address: endpoint.address(),
                kind,
                // Bits 12 and 11: further transactions a microframe.
                packet_bytes: (1 + (size >> 11 & 3)) * (size & 0x7FF),
            });
        }
    }
    endpoints
}
