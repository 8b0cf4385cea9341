//! The few functions of OpenNI2's C interface that are needed, found at run time.
#![expect(unsafe_code, reason = "calls into a C library")]

use std::ffi::{CStr, c_char, c_int, c_void};
use std::ptr;
use std::str::FromStr;

/// API version 2.2.
const API_VERSION: c_int = 2002;
const STATUS_OK: c_int = 0;
const RTLD_NOW: c_int = 2;
const WAIT_MILLIS: c_int = 3_000;

const PROPERTY_VIDEO_MODE: c_int = 3;
/// Of a device: depth to colour by the camera.
const PROPERTY_REGISTRATION: c_int = 5;
const PROPERTY_MIRRORING: c_int = 7;
/// Format on the wire, of the driver of PrimeSense cameras; a 64-bit number.
const PROPERTY_INPUT_FORMAT: c_int = 0x1080_0001;
/// Of the PS1080 driver: `XN_MODULE_PROPERTY_EMITTER_STATE`.
const PROPERTY_EMITTER: c_int = 0x1080_E007;

type Opaque = *mut c_void;

unsafe extern "C" {
    fn dlopen(name: *const c_char, flags: c_int) -> Opaque;
    fn dlsym(library: Opaque, name: *const c_char) -> Opaque;
    fn _exit(code: c_int) -> !;
}

#[repr(C)]
struct VideoMode {
    pixels: c_int,
    width: c_int,
    height: c_int,
    fps: c_int,
}

#[repr(C)]
struct RawFrame {
    data_size: c_int,
    data: *const u8,
    sensor: c_int,
    timestamp: u64,
    index: c_int,
    width: c_int,
    height: c_int,
    mode: VideoMode,
    is_cropped: c_int,
    crop_x: c_int,
    crop_y: c_int,
    stride: c_int,
}

/// The library's functions.
#[derive(Clone, Copy)]
pub(crate) struct Api {
    initialize: extern "C" fn(c_int) -> c_int,
    extended_error: extern "C" fn() -> *const c_char,
    shutdown: extern "C" fn(),
    device_open: unsafe extern "C" fn(*const c_char, *mut Opaque) -> c_int,
    device_close: unsafe extern "C" fn(Opaque) -> c_int,
    set_device_property: unsafe extern "C" fn(Opaque, c_int, *const c_void, c_int) -> c_int,
    enable_sync: unsafe extern "C" fn(Opaque) -> c_int,
    create_stream: unsafe extern "C" fn(Opaque, c_int, *mut Opaque) -> c_int,
    destroy_stream: unsafe extern "C" fn(Opaque),
    set_property: unsafe extern "C" fn(Opaque, c_int, *const c_void, c_int) -> c_int,
    start: unsafe extern "C" fn(Opaque) -> c_int,
    stop: unsafe extern "C" fn(Opaque),
    wait: unsafe extern "C" fn(*const Opaque, c_int, *mut c_int, c_int) -> c_int,
    read_frame: unsafe extern "C" fn(Opaque, *mut *mut RawFrame) -> c_int,
    release_frame: unsafe extern "C" fn(*mut RawFrame),
}

/// A stream as it is asked for.
pub(crate) struct StreamRequest {
    pub(crate) sensor: c_int,
    input: u64,
    mode: [c_int; 4],
}

impl FromStr for StreamRequest {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers: Vec<i32> = text
            .split(':')
            .map(|number| number.parse().map_err(|_| format!("{text}: no number")))
            .collect::<Result<_, _>>()?;
        let &[sensor, input, pixels, width, height, fps] = numbers.as_slice() else {
            return Err(format!("{text}: not six numbers"));
        };
        Ok(Self {
            sensor,
            input: u64::from(input.unsigned_abs()),
            mode: [pixels, width, height, fps],
        })
    }
}

/// Loads the library; `None` where there is none.
pub(crate) fn load() -> Option<Api> {
    // SAFETY: the names are C strings; each function has the type that the library's header declares.
    unsafe {
        let library = dlopen(c"libOpenNI2.so.0".as_ptr(), RTLD_NOW);
        if library.is_null() {
            return None;
        }
        Some(Api {
            initialize: symbol(library, c"oniInitialize")?,
            extended_error: symbol(library, c"oniGetExtendedError")?,
            shutdown: symbol(library, c"oniShutdown")?,
            device_open: symbol(library, c"oniDeviceOpen")?,
            device_close: symbol(library, c"oniDeviceClose")?,
            set_device_property: symbol(library, c"oniDeviceSetProperty")?,
            enable_sync: symbol(library, c"oniDeviceEnableDepthColorSync")?,
            create_stream: symbol(library, c"oniDeviceCreateStream")?,
            destroy_stream: symbol(library, c"oniStreamDestroy")?,
            set_property: symbol(library, c"oniStreamSetProperty")?,
            start: symbol(library, c"oniStreamStart")?,
            stop: symbol(library, c"oniStreamStop")?,
            wait: symbol(library, c"oniWaitForAnyStream")?,
            read_frame: symbol(library, c"oniStreamReadFrame")?,
            release_frame: symbol(library, c"oniFrameRelease")?,
        })
    }
}

/// The function of a name.
///
/// # Safety
/// `F` is the type of that function.
unsafe fn symbol<F: Copy>(library: Opaque, name: &CStr) -> Option<F> {
    const { assert!(size_of::<F>() == size_of::<Opaque>()) };
    // SAFETY: the library has been loaded and stays; a function is a pointer.
    unsafe {
        let symbol = dlsym(library, name.as_ptr());
        (!symbol.is_null()).then(|| std::mem::transmute_copy(&symbol))
    }
}

/// Ends the process without the driver's farewell.
pub(crate) fn leave_at_once() -> ! {
    // SAFETY: nothing that is left behind is needed.
    unsafe { _exit(0) }
}

impl Api {
    fn check(self, what: &str, status: c_int) -> Result<(), String> {
        if status == STATUS_OK {
            return Ok(());
        }
        // SAFETY: the library keeps the text until its next error.
        let text = unsafe { CStr::from_ptr((self.extended_error)()) };
        Err(format!(
            "{what}: {status}, {}",
            text.to_string_lossy().trim()
        ))
    }
}

/// The first camera.
pub(crate) struct Device {
    api: Api,
    handle: Opaque,
}

impl Device {
    pub(crate) fn open(api: Api) -> Result<Self, String> {
        api.check("initialize", (api.initialize)(API_VERSION))?;
        let mut handle = ptr::null_mut();
        // SAFETY: no name means the first device; there is a place for the handle.
        let status = unsafe { (api.device_open)(ptr::null(), &raw mut handle) };
        api.check("open", status)?;
        Ok(Self { api, handle })
    }

    pub(crate) fn register(&self) -> Result<(), String> {
        let on: c_int = 1;
        let size = size_of::<c_int>() as c_int;
        let value = (&raw const on).cast();
        // SAFETY: the device is open; the value has the size that is said.
        let status = unsafe {
            (self.api.set_device_property)(self.handle, PROPERTY_REGISTRATION, value, size)
        };
        self.api.check("register", status)
    }

    /// Switches the emitter off.
    pub(crate) fn darken(&self) -> Result<(), String> {
        let off: u64 = 0;
        let size = size_of::<u64>() as c_int;
        let value = (&raw const off).cast();
        // SAFETY: the device is open; the value has the size that is said.
        let status =
            unsafe { (self.api.set_device_property)(self.handle, PROPERTY_EMITTER, value, size) };
        self.api.check("darken", status)
    }

    pub(crate) fn synchronise(&self) -> Result<(), String> {
        // SAFETY: the device is open.
        let status = unsafe { (self.api.enable_sync)(self.handle) };
        self.api.check("synchronise", status)
    }

    pub(crate) fn create(&self, request: &StreamRequest) -> Result<Stream<'_>, String> {
        let mut handle = ptr::null_mut();
        // SAFETY: the device is open; there is a place for the handle.
        let status =
            unsafe { (self.api.create_stream)(self.handle, request.sensor, &raw mut handle) };
        self.api.check("create", status)?;
        let stream = Stream {
            device: self,
            handle,
        };
        const INFRARED: c_int = 1;
        if request.sensor != INFRARED {
            stream.set("input format", PROPERTY_INPUT_FORMAT, &request.input)?;
        }
        let [pixels, width, height, fps] = request.mode;
        let mode = VideoMode {
            pixels,
            width,
            height,
            fps,
        };
        stream.set("video mode", PROPERTY_VIDEO_MODE, &mode)?;
        let off: c_int = 0;
        stream.set("mirroring", PROPERTY_MIRRORING, &off)?;
        Ok(stream)
    }

    pub(crate) fn close(self) {
        // SAFETY: the device is open, its streams are gone: they borrow it.
        unsafe { (self.api.device_close)(self.handle) };
        (self.api.shutdown)();
    }
}

pub(crate) struct Stream<'a> {
    device: &'a Device,
    handle: Opaque,
}

/// A frame as OpenNI2 gives it.
pub(crate) struct Frame {
    pub(crate) index: u64,
    pub(crate) micros: u64,
    pub(crate) data: Vec<u8>,
}

impl Stream<'_> {
    fn set<T>(&self, what: &str, property: c_int, value: &T) -> Result<(), String> {
        let api = self.device.api;
        let size = size_of::<T>() as c_int;
        // SAFETY: the stream exists; the value has the size that is said.
        let status =
            unsafe { (api.set_property)(self.handle, property, ptr::from_ref(value).cast(), size) };
        api.check(what, status)
    }

    pub(crate) fn start(&self) -> Result<(), String> {
        // SAFETY: the stream exists.
        let status = unsafe { (self.device.api.start)(self.handle) };
        self.device.api.check("start", status)
    }

    pub(crate) fn read(&self) -> Result<Frame, String> {
        let api = self.device.api;
        let mut frame = ptr::null_mut();
        // SAFETY: the stream runs; a frame is the caller's until it is released, its data as long as it says.
        unsafe {
            let status = (api.read_frame)(self.handle, &raw mut frame);
            api.check("read", status)?;
            let raw = &*frame;
            let size = usize::try_from(raw.data_size).unwrap_or(0);
            let read = Frame {
                index: u64::from(raw.index.unsigned_abs()),
                micros: raw.timestamp,
                data: std::slice::from_raw_parts(raw.data, size).to_vec(),
            };
            (api.release_frame)(frame);
            Ok(read)
        }
    }
}

impl Drop for Stream<'_> {
    fn drop(&mut self) {
        // SAFETY: the stream exists until here.
        unsafe {
            (self.device.api.stop)(self.handle);
            (self.device.api.destroy_stream)(self.handle);
        }
    }
}

/// The number of a stream that has a frame.
pub(crate) fn wait_for_any(streams: &[Stream<'_>]) -> Result<usize, String> {
    let api = streams.first().ok_or("no stream")?.device.api;
    let handles: Vec<Opaque> = streams.iter().map(|stream| stream.handle).collect();
    let mut ready = 0;
    // SAFETY: the streams exist; there is a place for the number.
    let status = unsafe {
        (api.wait)(
            handles.as_ptr(),
            handles.len() as c_int,
            &raw mut ready,
            WAIT_MILLIS,
        )
    };
    api.check("wait", status)?;
    usize::try_from(ready)
        .ok()
        .filter(|&ready| ready < streams.len())
        .ok_or_else(|| format!("stream {ready} is ready, which does not exist"))
}
