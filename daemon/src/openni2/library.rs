//! The C library behind a safe interface: one device, its depth and colour streams, frames copied out.
#![expect(unsafe_code, reason = "calls into a C library")]

use std::ffi::{CStr, CString, c_int};
use std::ptr;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use openni2_sys as sys;
use zerocopy::{FromZeros, Immutable, IntoBytes};

/// API version 2.2, as the library counts it.
const API_VERSION: c_int = 2002;

/// Set by the library when a device is gone; there is one library and one device a process.
static IS_GONE: AtomicBool = AtomicBool::new(false);

/// What the library refuses.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("OpenNI2 cannot {what}: {}", if text.is_empty() { "it does not say why" } else { text.as_str() })]
pub struct OpenNiError {
    what: &'static str,
    text: String,
}

/// Which stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Sensor {
    Depth,
    Color,
}

/// Size, samples and rate of a stream, in the library's words.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct VideoMode {
    pub(super) format: i32,
    pub(super) width: u32,
    pub(super) height: u32,
    pub(super) fps: u32,
}

/// A frame that the library holds.
pub(super) struct Frame<'a> {
    /// Counted by the driver.
    pub(super) index: i32,
    /// Microseconds.
    pub(super) timestamp_us: u64,
    pub(super) format: i32,
    pub(super) width: u32,
    pub(super) height: u32,
    /// Bytes from row to row.
    pub(super) stride: usize,
    pub(super) bytes: &'a [u8],
}

/// A device that is open, with the streams it has.
pub(super) struct Device {
    handle: sys::OniDeviceHandle,
    depth: Option<sys::OniStreamHandle>,
    color: Option<sys::OniStreamHandle>,
    is_running: bool,
}

// SAFETY: the library guards its state by locks of its own; the handles may be used by any thread, and are used by one
// at a time because all functions that use them take `&mut self` or are of a value that is not `Sync`.
unsafe impl Send for Device {}

extern "C" fn disconnected(_: *const sys::OniDeviceInfo, _: *mut std::ffi::c_void) {
    IS_GONE.store(true, Ordering::Release);
}

impl Device {
    /// Starts the library and opens `uri`, or any device.
    pub(super) fn open(uri: Option<&str>) -> Result<Self, OpenNiError> {
        let uri = uri.map(CString::new).transpose();
        let uri = uri.map_err(|_| OpenNiError {
            what: "open the device",
            text: "its name holds a zero byte".to_owned(),
        })?;
        // SAFETY: no pointers; the library may be started more than once and counts.
        check("start", unsafe { sys::oniInitialize(API_VERSION) })?;
        let mut device = Self {
            handle: ptr::null_mut(),
            depth: None,
            color: None,
            is_running: false,
        };
        let mut callbacks = sys::OniDeviceCallbacks {
            deviceConnected: None,
            deviceDisconnected: Some(disconnected),
            deviceStateChanged: None,
        };
        let mut registration = ptr::null_mut();
        // SAFETY: both pointers are of this frame, the library copies the functions; the cookie is not used. Whether it
        // succeeds does not matter: a device that is gone then shows by its silence.
        unsafe {
            sys::oniRegisterDeviceCallbacks(&mut callbacks, ptr::null_mut(), &mut registration);
        }
        let name = uri.as_ref().map_or(ptr::null(), |uri| uri.as_ptr());
        // SAFETY: `name` is null or a C string that outlives the call; the handle is written on success.
        check("open the device", unsafe {
            sys::oniDeviceOpen(name, &mut device.handle)
        })?;
        IS_GONE.store(false, Ordering::Release);
        device.depth = device.create(sys::ONI_SENSOR_DEPTH);
        device.color = device.create(sys::ONI_SENSOR_COLOR);
        Ok(device)
    }

    fn create(&mut self, sensor: i32) -> Option<sys::OniStreamHandle> {
        let mut stream = ptr::null_mut();
        // SAFETY: the device is open; the handle is written on success.
        let status = unsafe { sys::oniDeviceCreateStream(self.handle, sensor, &mut stream) };
        (status == sys::ONI_STATUS_OK).then_some(stream)
    }

    fn stream(&self, sensor: Sensor) -> Option<sys::OniStreamHandle> {
        match sensor {
            Sensor::Depth => self.depth,
            Sensor::Color => self.color,
        }
    }

    /// Whether the library has seen the device go.
    pub(super) fn is_gone(&self) -> bool {
        IS_GONE.load(Ordering::Acquire)
    }

    /// Whether it is a recording that is played.
    pub(super) fn is_file(&self) -> bool {
        // SAFETY: the device is open.
        unsafe {
            sys::oniDeviceIsPropertySupported(self.handle, sys::ONI_DEVICE_PROPERTY_PLAYBACK_SPEED)
                != 0
        }
    }

    /// Vendor and product.
    pub(super) fn name(&self) -> String {
        let mut info = sys::OniDeviceInfo {
            uri: [0; sys::ONI_MAX_STR],
            vendor: [0; sys::ONI_MAX_STR],
            name: [0; sys::ONI_MAX_STR],
            usbVendorId: 0,
            usbProductId: 0,
        };
        // SAFETY: the device is open, `info` is of the size that the library knows.
        let status = unsafe { sys::oniDeviceGetInfo(self.handle, &mut info) };
        if status != sys::ONI_STATUS_OK {
            return String::new();
        }
        let text = |chars: &[std::ffi::c_char]| -> String {
            let bytes = chars.iter().map(|&char| char as u8);
            String::from_utf8_lossy(&bytes.take_while(|&byte| byte != 0).collect::<Vec<u8>>())
                .into_owned()
        };
        format!("{} {}", text(&info.vendor), text(&info.name))
    }

    /// Sets a property of the device; whether it was taken.
    pub(super) fn set<T: IntoBytes + Immutable>(&mut self, property: i32, value: T) -> bool {
        let bytes = value.as_bytes();
        // SAFETY: the device is open, `bytes` are as long as is said and are only read.
        let status = unsafe {
            sys::oniDeviceSetProperty(
                self.handle,
                property,
                bytes.as_ptr().cast(),
                bytes.len() as c_int,
            )
        };
        status == sys::ONI_STATUS_OK
    }

    /// Whether depth can be warped to colour, by device or driver.
    pub(super) fn can_register(&self) -> bool {
        let mode = sys::ONI_IMAGE_REGISTRATION_DEPTH_TO_COLOR;
        // SAFETY: the device is open.
        unsafe { sys::oniDeviceIsImageRegistrationModeSupported(self.handle, mode) != 0 }
    }

    /// Ties the shutters; whether it was taken.
    pub(super) fn sync(&mut self) -> bool {
        // SAFETY: the device is open.
        unsafe { sys::oniDeviceEnableDepthColorSync(self.handle) == sys::ONI_STATUS_OK }
    }

    /// Sets a property of a stream; whether it was taken.
    pub(super) fn set_of<T: IntoBytes + Immutable>(
        &mut self,
        sensor: Sensor,
        property: i32,
        value: T,
    ) -> bool {
        let Some(stream) = self.stream(sensor) else {
            return false;
        };
        let bytes = value.as_bytes();
        // SAFETY: the stream exists, `bytes` are as long as is said and are only read.
        let status = unsafe {
            sys::oniStreamSetProperty(
                stream,
                property,
                bytes.as_ptr().cast(),
                bytes.len() as c_int,
            )
        };
        status == sys::ONI_STATUS_OK
    }

    /// A property of a stream, if it has just the size of a `T`.
    pub(super) fn get_of<T: FromZeros + IntoBytes>(
        &self,
        sensor: Sensor,
        property: i32,
    ) -> Option<T> {
        let stream = self.stream(sensor)?;
        let mut value = T::new_zeroed();
        let mut size = size_of::<T>() as c_int;
        // SAFETY: the stream exists; the library writes at most `size` bytes, and any bytes are a `T` of numbers: only
        // numbers and arrays of numbers are asked for here.
        let status = unsafe {
            sys::oniStreamGetProperty(stream, property, (&raw mut value).cast(), &mut size)
        };
        (status == sys::ONI_STATUS_OK && size as usize == size_of::<T>()).then_some(value)
    }

    /// The mode that a stream is in.
    pub(super) fn mode(&self, sensor: Sensor) -> Option<VideoMode> {
        let words: [i32; 4] = self.get_of(sensor, sys::ONI_STREAM_PROPERTY_VIDEO_MODE)?;
        VideoMode::of(words)
    }

    /// The modes that a stream can be in.
    pub(super) fn modes(&self, sensor: Sensor) -> Vec<VideoMode> {
        let Some(stream) = self.stream(sensor) else {
            return Vec::new();
        };
        // SAFETY: the stream exists; the library keeps what it points to as long as the stream lives, and the count is
        // that of the modes behind the pointer.
        let modes = unsafe {
            let info = sys::oniStreamGetSensorInfo(stream);
            let Some(info) = info.as_ref() else {
                return Vec::new();
            };
            let count = usize::try_from(info.numSupportedVideoModes).unwrap_or(0);
            if info.pSupportedVideoModes.is_null() || count == 0 {
                return Vec::new();
            }
            std::slice::from_raw_parts(info.pSupportedVideoModes, count)
        };
        let words = |mode: &sys::OniVideoMode| {
            [
                mode.pixelFormat,
                mode.resolutionX,
                mode.resolutionY,
                mode.fps,
            ]
        };
        modes
            .iter()
            .filter_map(|mode| VideoMode::of(words(mode)))
            .collect()
    }

    /// Puts a stream into a mode; whether it was taken.
    pub(super) fn set_mode(&mut self, sensor: Sensor, mode: VideoMode) -> bool {
        let words = [
            mode.format,
            mode.width as i32,
            mode.height as i32,
            mode.fps as i32,
        ];
        self.set_of(sensor, sys::ONI_STREAM_PROPERTY_VIDEO_MODE, words)
    }

    /// Lets all streams run.
    pub(super) fn start(&mut self) -> Result<(), OpenNiError> {
        self.is_running = true;
        for stream in self.depth.into_iter().chain(self.color) {
            // SAFETY: the stream exists.
            check("start a stream", unsafe { sys::oniStreamStart(stream) })?;
        }
        Ok(())
    }

    /// Waits for a frame of one of `wanted` and gives it to `take`; `None` when none came in time.
    pub(super) fn next<R>(
        &mut self,
        wanted: &[Sensor],
        timeout: Duration,
        take: impl FnOnce(Sensor, Frame<'_>) -> R,
    ) -> Result<Option<R>, OpenNiError> {
        let with_handles = |sensor: &Sensor| Some((*sensor, self.stream(*sensor)?));
        let streams: Vec<_> = wanted.iter().filter_map(with_handles).collect();
        let mut handles: Vec<_> = streams.iter().map(|(_, handle)| *handle).collect();
        let mut index: c_int = -1;
        // SAFETY: the handles are of streams that exist, their count is said.
        let status = unsafe {
            sys::oniWaitForAnyStream(
                handles.as_mut_ptr(),
                handles.len() as c_int,
                &mut index,
                timeout.as_millis() as c_int,
            )
        };
        if status == sys::ONI_STATUS_TIME_OUT {
            return Ok(None);
        }
        check("wait for a frame", status)?;
        let Some(&(sensor, handle)) = usize::try_from(index).ok().and_then(|at| streams.get(at))
        else {
            return Ok(None);
        };
        let mut held: *mut sys::OniFrame = ptr::null_mut();
        // SAFETY: the stream exists; the frame is written on success.
        check("read a frame", unsafe {
            sys::oniStreamReadFrame(handle, &mut held)
        })?;
        // SAFETY: the library gave a frame, which stays as it is until it is released below.
        let Some(frame) = (unsafe { held.as_ref() }) else {
            return Ok(None);
        };
        let size = usize::try_from(frame.dataSize).unwrap_or(0);
        let bytes = if frame.data.is_null() {
            &[][..]
        } else {
            // SAFETY: the frame owns `dataSize` bytes at `data`; nobody writes to them while it is held.
            unsafe { std::slice::from_raw_parts(frame.data.cast::<u8>(), size) }
        };
        let result = take(
            sensor,
            Frame {
                index: frame.frameIndex,
                timestamp_us: frame.timestamp,
                format: frame.videoMode.pixelFormat,
                width: u32::try_from(frame.width).unwrap_or(0),
                height: u32::try_from(frame.height).unwrap_or(0),
                stride: usize::try_from(frame.stride).unwrap_or(0),
                bytes,
            },
        );
        // SAFETY: held since it was read, and not used any more.
        unsafe { sys::oniFrameRelease(held) };
        Ok(Some(result))
    }
}

impl VideoMode {
    fn of([format, width, height, fps]: [i32; 4]) -> Option<Self> {
        Some(Self {
            format,
            width: u32::try_from(width).ok()?,
            height: u32::try_from(height).ok()?,
            fps: u32::try_from(fps).ok()?,
        })
    }
}

impl Drop for Device {
    /// Stops the streams and gives a camera back. A recording is left open until the process ends: the thread of the
    /// library's player walks the list of streams without a lock as long as the device lives, and a stream may not
    /// outlive its device, so there is no order in which both can be destroyed (segmentation fault in 37 of 300 runs of
    /// a program of these calls alone; in none of 400 that leave the device). Its thread sleeps once all have stopped.
    fn drop(&mut self) {
        let is_left = !self.handle.is_null() && self.is_file();
        let streams = [self.depth, self.color].into_iter().flatten();
        if self.is_running {
            for stream in streams.clone() {
                // SAFETY: the stream exists; stopping one that did not start does nothing.
                unsafe { sys::oniStreamStop(stream) };
            }
        }
        if is_left {
            return;
        }
        for stream in streams {
            // SAFETY: the stream exists and is not used after this; its device is still open.
            unsafe { sys::oniStreamDestroy(stream) };
        }
        if !self.handle.is_null() {
            // SAFETY: the device was opened, its streams are gone, and it is not used after this.
            unsafe { sys::oniDeviceClose(self.handle) };
        }
        // SAFETY: the library was started by `open`, once for this value.
        unsafe { sys::oniShutdown() };
    }
}

/// An error of the library with its own words.
fn check(what: &'static str, status: sys::OniStatus) -> Result<(), OpenNiError> {
    if status == sys::ONI_STATUS_OK {
        return Ok(());
    }
    // SAFETY: the library gives a C string of its own, which stays until its next call; it is copied at once.
    let text = unsafe {
        let text = sys::oniGetExtendedError();
        if text.is_null() {
            String::new()
        } else {
            CStr::from_ptr(text).to_string_lossy().trim().to_owned()
        }
    };
    Err(OpenNiError { what, text })
}
