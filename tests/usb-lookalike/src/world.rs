//! The state behind all functions: cameras, contexts, open handles, transfers under way.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};

use rustix::time::{ClockId, clock_gettime};
use virtual_carmine::{Bus, Transfer, TransferStatus};

use crate::config::{CameraConfig, Config};
use crate::log;

static WORLD: Mutex<Option<World>> = Mutex::new(None);
static CHANGED: Condvar = Condvar::new();

/// The context that programs mean by a null pointer.
pub(crate) const DEFAULT_CONTEXT: u64 = 1;

/// Nanoseconds of `CLOCK_MONOTONIC`.
pub(crate) fn now_nanos() -> i64 {
    nanos_of(ClockId::Monotonic)
}

fn nanos_of(clock: ClockId) -> i64 {
    let time = clock_gettime(clock);
    time.tv_sec * 1_000_000_000 + time.tv_nsec
}

pub(crate) struct World {
    config: Config,
    pub(crate) cameras: Vec<Camera>,
    /// Transfers that have ended and wait for their callback, by context.
    contexts: BTreeMap<u64, VecDeque<Ended>>,
    pub(crate) handles: BTreeMap<u64, Handle>,
    queued: BTreeMap<u64, Queued>,
    /// Processor time that cameras have cost, which is not the host's.
    cpu_nanos: i64,
    /// Contexts whose waiting is to end.
    interrupted: BTreeSet<u64>,
    last_number: u64,
}

pub(crate) struct Camera {
    pub(crate) config: CameraConfig,
    pub(crate) bus: Bus,
    /// Handle that has claimed interface 0.
    pub(crate) claimed_by: Option<u64>,
    pub(crate) has_kernel_driver: bool,
    pub(crate) alt_setting: u8,
    was_opened: bool,
    unplugged_nanos: Option<i64>,
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct Handle {
    pub(crate) camera: usize,
    pub(crate) context: u64,
}

/// Whom the end of a transfer is told.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Waiter {
    /// The callback of the structure at this address.
    Callback(usize),
    /// A call that waits.
    Call,
}

struct Queued {
    camera: usize,
    context: u64,
    waiter: Waiter,
    deadline_nanos: Option<i64>,
    has_timed_out: bool,
    ended: Option<Transfer>,
}

/// A transfer for its callback.
pub(crate) struct Ended {
    /// Address of the structure.
    pub(crate) address: usize,
    pub(crate) transfer: Transfer,
    pub(crate) has_timed_out: bool,
    pub(crate) camera: usize,
}

/// What is queued.
pub(crate) enum Order<'a> {
    Bulk(usize),
    Isochronous(&'a [usize]),
}

/// Runs `action` on the world, which is made at the first call.
pub(crate) fn with_world<R>(action: impl FnOnce(&mut World) -> R) -> R {
    action(lock().get_or_insert_with(World::new))
}

/// Wakes all who sleep in [`wait_for`].
pub(crate) fn wake_all() {
    CHANGED.notify_all();
}

/// Asks `action` again and again until it has an answer: at the times it names (nanoseconds), and whenever another call
/// changes something.
pub(crate) fn wait_for<R>(mut action: impl FnMut(&mut World, i64) -> Result<R, i64>) -> R {
    let mut world = lock();
    loop {
        let now = now_nanos();
        match action(world.get_or_insert_with(World::new), now) {
            Ok(result) => return result,
            Err(until_nanos) => {
                let wait_nanos = (until_nanos - now).max(0).cast_unsigned();
                let wait = std::time::Duration::from_nanos(wait_nanos);
                let (again, _) = CHANGED
                    .wait_timeout(world, wait)
                    .unwrap_or_else(PoisonError::into_inner);
                world = again;
            }
        }
    }
}

/// A call that died left nothing half done that another could not live with.
fn lock() -> MutexGuard<'static, Option<World>> {
    WORLD.lock().unwrap_or_else(PoisonError::into_inner)
}

impl World {
    fn new() -> Self {
        let config = Config::from_environment().unwrap_or_else(|error| {
            eprintln!("virtual cameras: {error}");
            Config::default()
        });
        let cameras = config.camera.iter().filter_map(|camera| {
            let built = camera.build();
            if let Err(error) = &built {
                eprintln!("virtual cameras: {error}");
            }
            Some(Camera {
                config: camera.clone(),
                bus: Bus::new(built.ok()?),
                claimed_by: None,
                has_kernel_driver: camera.has_kernel_driver,
                alt_setting: 0,
                was_opened: false,
                unplugged_nanos: None,
            })
        });
        Self {
            cameras: cameras.collect(),
            config,
            contexts: BTreeMap::from([(DEFAULT_CONTEXT, VecDeque::new())]),
            handles: BTreeMap::new(),
            queued: BTreeMap::new(),
            cpu_nanos: 0,
            interrupted: BTreeSet::new(),
            last_number: DEFAULT_CONTEXT,
        }
    }

    fn number(&mut self) -> u64 {
        self.last_number += 1;
        self.last_number
    }

    pub(crate) fn add_context(&mut self) -> u64 {
        let context = self.number();
        self.contexts.insert(context, VecDeque::new());
        context
    }

    pub(crate) fn remove_context(&mut self, context: u64) {
        if context != DEFAULT_CONTEXT {
            self.contexts.remove(&context);
        }
        self.write_log();
    }

    pub(crate) fn open(&mut self, camera: usize, context: u64) -> u64 {
        let handle = self.number();
        self.handles.insert(handle, Handle { camera, context });
        if let Some(camera) = self.cameras.get_mut(camera) {
            camera.was_opened = true;
        }
        handle
    }

    pub(crate) fn close(&mut self, handle: u64) {
        for camera in &mut self.cameras {
            camera.claimed_by.take_if(|claimed| *claimed == handle);
        }
        self.handles.remove(&handle);
        self.write_log();
    }

    /// The camera of a handle that is open.
    pub(crate) fn camera_of(&mut self, handle: u64) -> Option<&mut Camera> {
        let camera = self.handles.get(&handle)?.camera;
        self.cameras.get_mut(camera)
    }

    /// Queues a transfer: its number.
    pub(crate) fn submit(
        &mut self,
        now_nanos: i64,
        handle: Handle,
        endpoint: u8,
        order: &Order<'_>,
        waiter: Waiter,
        timeout_millis: u32,
    ) -> u64 {
        let number = self.number();
        let timeout_nanos = i64::from(timeout_millis) * 1_000_000;
        self.queued.insert(
            number,
            Queued {
                camera: handle.camera,
                context: handle.context,
                waiter,
                deadline_nanos: (timeout_millis > 0).then_some(now_nanos + timeout_nanos),
                has_timed_out: false,
                ended: None,
            },
        );
        if let Some(camera) = self.cameras.get_mut(handle.camera) {
            match order {
                Order::Bulk(length) => camera.bus.submit(now_nanos, endpoint, number, *length),
                Order::Isochronous(packets) => {
                    camera.bus.submit_iso(now_nanos, endpoint, number, packets);
                }
            }
        }
        number
    }

    /// Puts a transfer that needs no bus among those that have ended.
    pub(crate) fn end_at_once(&mut self, handle: Handle, ended: Ended) {
        self.contexts
            .entry(handle.context)
            .or_default()
            .push_back(ended);
    }

    /// Whether the structure at `address` is under way.
    pub(crate) fn is_queued(&self, address: usize) -> bool {
        self.number_of(address).is_some()
    }

    fn number_of(&self, address: usize) -> Option<u64> {
        let waiter = Waiter::Callback(address);
        let found = self
            .queued
            .iter()
            .find(|(_, queued)| queued.waiter == waiter);
        found.map(|(&number, _)| number)
    }

    /// Takes the transfer of the structure at `address` back; whether it was under way.
    pub(crate) fn cancel(&mut self, now_nanos: i64, address: usize) -> bool {
        let Some(number) = self.number_of(address) else {
            return false;
        };
        self.cancel_number(now_nanos, number)
    }

    fn cancel_number(&mut self, now_nanos: i64, number: u64) -> bool {
        let queued = self.queued.get(&number);
        let camera = queued.and_then(|queued| self.cameras.get_mut(queued.camera));
        camera.is_some_and(|camera| camera.bus.cancel(now_nanos, number))
    }

    /// Lets time pass in all cameras that have been opened; sorts what has ended.
    pub(crate) fn pump(&mut self, now_nanos: i64) {
        let before_nanos = nanos_of(ClockId::ThreadCPUTime);
        self.let_time_pass(now_nanos);
        self.cpu_nanos += nanos_of(ClockId::ThreadCPUTime) - before_nanos;
    }

    fn let_time_pass(&mut self, now_nanos: i64) {
        self.time_out(now_nanos);
        for index in 0..self.cameras.len() {
            let camera = &mut self.cameras[index];
            if !camera.was_opened {
                continue;
            }
            camera.bus.advance(now_nanos);
            let is_new = camera.bus.camera().is_gone() && camera.unplugged_nanos.is_none();
            if is_new {
                let planned_nanos = camera.bus.camera().unplug_nanos();
                camera.unplugged_nanos = Some(planned_nanos.unwrap_or(now_nanos).min(now_nanos));
            }
            while let Some(transfer) = self.cameras[index].bus.completed() {
                self.sort(transfer);
            }
            if is_new {
                self.write_log();
            }
        }
    }

    fn sort(&mut self, transfer: Transfer) {
        let Some(queued) = self.queued.get_mut(&transfer.token) else {
            return;
        };
        match queued.waiter {
            Waiter::Call => queued.ended = Some(transfer),
            Waiter::Callback(address) => {
                let ended = Ended {
                    address,
                    has_timed_out: queued.has_timed_out,
                    camera: queued.camera,
                    transfer,
                };
                let context = queued.context;
                self.queued.remove(&ended.transfer.token);
                self.contexts.entry(context).or_default().push_back(ended);
            }
        }
    }

    fn time_out(&mut self, now_nanos: i64) {
        let is_late = |deadline_nanos: Option<i64>| {
            deadline_nanos.is_some_and(|deadline_nanos| deadline_nanos <= now_nanos)
        };
        let late: Vec<u64> = self
            .queued
            .iter()
            .filter(|(_, queued)| is_late(queued.deadline_nanos) && queued.ended.is_none())
            .map(|(&number, _)| number)
            .collect();
        for number in late {
            if let Some(queued) = self.queued.get_mut(&number) {
                queued.has_timed_out = true;
            }
            self.cancel_number(now_nanos, number);
        }
    }

    /// The next transfer of a context whose callback is due.
    pub(crate) fn take_ended(&mut self, context: u64) -> Option<Ended> {
        self.contexts.get_mut(&context)?.pop_front()
    }

    /// Ends the waiting of a context's next or present call.
    pub(crate) fn interrupt(&mut self, context: u64) {
        self.interrupted.insert(context);
    }

    /// Whether it was to end, which is then over.
    pub(crate) fn take_interruption(&mut self, context: u64) -> bool {
        self.interrupted.remove(&context)
    }

    /// The end of the transfer of a call that waits, and whether that is its timeout.
    pub(crate) fn take_waited(&mut self, number: u64) -> Option<(Transfer, bool)> {
        let has_ended = self.queued.get(&number)?.ended.is_some();
        if !has_ended {
            return None;
        }
        let queued = self.queued.remove(&number)?;
        Some((queued.ended?, queued.has_timed_out))
    }

    /// Takes the memory of a transfer back.
    pub(crate) fn recycle(&mut self, camera: usize, transfer: Transfer) {
        if let Some(camera) = self.cameras.get_mut(camera) {
            camera.bus.recycle(transfer.data);
        }
    }

    /// When there is something to do next.
    pub(crate) fn next_nanos(&self) -> Option<i64> {
        let opened = self.cameras.iter().filter(|camera| camera.was_opened);
        let camera_nanos = opened.filter_map(|camera| camera.bus.next_nanos());
        let deadlines = self
            .queued
            .values()
            .filter(|queued| queued.ended.is_none())
            .filter_map(|queued| queued.deadline_nanos);
        camera_nanos.chain(deadlines).min()
    }

    fn write_log(&self) {
        let Some(path) = &self.config.log else {
            return;
        };
        let cameras = self.cameras.iter();
        let cameras: Vec<_> = cameras
            .map(|camera| log::camera(camera.bus.camera(), camera.unplugged_nanos))
            .collect();
        log::write(path, &cameras, self.cpu_nanos);
    }
}

/// libusb's number for how a transfer ended.
pub(crate) fn status_code(status: TransferStatus, has_timed_out: bool) -> std::ffi::c_int {
    use crate::abi;
    match status {
        TransferStatus::Completed => abi::TRANSFER_COMPLETED,
        TransferStatus::Cancelled if has_timed_out => abi::TRANSFER_TIMED_OUT,
        TransferStatus::Cancelled => abi::TRANSFER_CANCELLED,
        TransferStatus::Stall => abi::TRANSFER_STALL,
        TransferStatus::NoDevice => abi::TRANSFER_NO_DEVICE,
    }
}
