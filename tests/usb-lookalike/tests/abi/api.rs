//! libusb's functions as its header declares them, found in the built library.
#![expect(unsafe_code, reason = "calls into a C library")]

use std::ffi::{CStr, CString, c_char, c_int, c_long, c_uint, c_void};
use std::ptr;
use std::sync::OnceLock;

use ps1080::host::{MAX_HOST_PACKET_BYTES, Received, ReplyReader, Request};
use usb_lookalike::config::CONFIG_VARIABLE;

pub(crate) type Opaque = *mut c_void;

const RTLD_NOW: c_int = 2;

unsafe extern "C" {
    fn dlopen(name: *const c_char, flags: c_int) -> Opaque;
    fn dlsym(library: Opaque, name: *const c_char) -> Opaque;
}

#[repr(C)]
struct Timeval {
    seconds: c_long,
    microseconds: c_long,
}

/// The fields before the pointer to interfaces, of a configuration.
#[repr(C)]
struct Configuration {
    head: [u8; 4],
    interface_count: u8,
    rest: [u8; 4],
    interfaces: *const Interface,
}

#[repr(C)]
struct Interface {
    settings: *const Setting,
    setting_count: c_int,
}

#[repr(C)]
struct Setting {
    head: [u8; 4],
    endpoint_count: u8,
}

/// The loaded library.
pub(crate) struct Library(usize);

/// A function of the library, called with these arguments.
macro_rules! call {
    ($library:expr, $name:literal, fn($($kind:ty),*) $(-> $result:ty)?, $($argument:expr),*) => {{
        type Function = unsafe extern "C" fn($($kind),*) $(-> $result)?;
        let symbol = $library.symbol($name);
        // SAFETY: the type is the one that libusb's header declares for the name, and the arguments are of this test.
        unsafe { std::mem::transmute::<Opaque, Function>(symbol)($($argument),*) }
    }};
}

pub(crate) use call;

impl Library {
    /// Loads it once, with the cameras of this test.
    pub(crate) fn load() -> &'static Self {
        static LIBRARY: OnceLock<Library> = OnceLock::new();
        LIBRARY.get_or_init(|| {
            let folder = tempfile::tempdir().unwrap();
            let config = folder.path().join("cameras.toml");
            std::fs::write(&config, crate::CONFIG).unwrap();
            let path = usb_lookalike::library::find().expect("the library is built");
            let path = CString::new(path.into_os_string().into_encoded_bytes()).unwrap();
            // SAFETY: no other thread reads the environment: they all wait here.
            unsafe { std::env::set_var(CONFIG_VARIABLE, &config) };
            // SAFETY: the name is a C string.
            let library = unsafe { dlopen(path.as_ptr(), RTLD_NOW) };
            assert!(!library.is_null());
            let library = Self(library.expose_provenance());
            // The configuration is read at the first call.
            library.init();
            library
        })
    }

    fn find(&self, name: &CStr) -> Opaque {
        // SAFETY: the library stays loaded; the name is a C string.
        unsafe { dlsym(ptr::with_exposed_provenance_mut(self.0), name.as_ptr()) }
    }

    pub(crate) fn symbol(&self, name: &CStr) -> Opaque {
        let symbol = self.find(name);
        assert!(!symbol.is_null(), "{name:?}");
        symbol
    }

    pub(crate) fn has(&self, name: &str) -> bool {
        !self.find(&CString::new(name).unwrap()).is_null()
    }

    pub(crate) fn init(&self) -> Opaque {
        let mut context = ptr::null_mut();
        let code = call!(
            self,
            c"libusb_init",
            fn(*mut Opaque) -> c_int,
            &raw mut context
        );
        assert_eq!(code, 0);
        context
    }

    /// Does something with the device at a place of the list.
    fn with_device<R>(&self, context: Opaque, index: usize, action: impl Fn(Opaque) -> R) -> R {
        let mut list = ptr::null_mut::<Opaque>();
        let count = call!(
            self,
            c"libusb_get_device_list",
            fn(Opaque, *mut *mut Opaque) -> isize,
            context,
            &raw mut list
        );
        // One may have been unplugged by another test; it is not the last one.
        let gone = crate::CAMERA_COUNT - count.unsigned_abs();
        let index = if index > 1 { index - gone } else { index };
        // SAFETY: the list has that many entries.
        let result = action(unsafe { list.add(index).read() });
        call!(
            self,
            c"libusb_free_device_list",
            fn(*mut Opaque, c_int),
            list,
            1
        );
        result
    }

    pub(crate) fn open(&self, context: Opaque, index: usize) -> Result<Opaque, c_int> {
        self.with_device(context, index, |device| {
            let mut handle = ptr::null_mut();
            let code = call!(
                self,
                c"libusb_open",
                fn(Opaque, *mut Opaque) -> c_int,
                device,
                &raw mut handle
            );
            if code == 0 { Ok(handle) } else { Err(code) }
        })
    }

    pub(crate) fn close(&self, handle: Opaque) {
        call!(self, c"libusb_close", fn(Opaque), handle);
    }

    pub(crate) fn claim(&self, handle: Opaque) -> c_int {
        call!(
            self,
            c"libusb_claim_interface",
            fn(Opaque, c_int) -> c_int,
            handle,
            0
        )
    }

    pub(crate) fn release(&self, handle: Opaque) -> c_int {
        call!(
            self,
            c"libusb_release_interface",
            fn(Opaque, c_int) -> c_int,
            handle,
            0
        )
    }

    pub(crate) fn kernel_driver(&self, handle: Opaque) -> c_int {
        call!(
            self,
            c"libusb_kernel_driver_active",
            fn(Opaque, c_int) -> c_int,
            handle,
            0
        )
    }

    pub(crate) fn detach(&self, handle: Opaque) -> c_int {
        call!(
            self,
            c"libusb_detach_kernel_driver",
            fn(Opaque, c_int) -> c_int,
            handle,
            0
        )
    }

    pub(crate) fn set_alt_setting(&self, handle: Opaque, setting: c_int) -> c_int {
        call!(
            self,
            c"libusb_set_interface_alt_setting",
            fn(Opaque, c_int, c_int) -> c_int,
            handle,
            0,
            setting
        )
    }

    /// A control transfer of interface 0 with a short timeout.
    pub(crate) fn control(
        &self,
        handle: Opaque,
        kind: u8,
        request: u8,
        value: u16,
        data: &mut [u8],
    ) -> c_int {
        call!(
            self,
            c"libusb_control_transfer",
            fn(Opaque, u8, u8, u16, u16, *mut u8, u16, c_uint) -> c_int,
            handle,
            kind,
            request,
            value,
            0,
            data.as_mut_ptr(),
            data.len() as u16,
            20
        )
    }

    /// Code and count of bytes.
    pub(crate) fn bulk(
        &self,
        handle: Opaque,
        endpoint: u8,
        data: &mut [u8],
        timeout_millis: c_uint,
    ) -> (c_int, c_int) {
        let mut count = 0;
        let code = call!(
            self,
            c"libusb_bulk_transfer",
            fn(Opaque, u8, *mut u8, c_int, *mut c_int, c_uint) -> c_int,
            handle,
            endpoint,
            data.as_mut_ptr(),
            data.len() as c_int,
            &raw mut count,
            timeout_millis
        );
        (code, count)
    }

    /// Vendor and product.
    pub(crate) fn product(&self, context: Opaque, index: usize) -> (u16, u16) {
        self.with_device(context, index, |device| {
            let mut descriptor = [0_u16; 9];
            let code = call!(
                self,
                c"libusb_get_device_descriptor",
                fn(Opaque, *mut u16) -> c_int,
                device,
                descriptor.as_mut_ptr()
            );
            assert_eq!(code, 0);
            (descriptor[4], descriptor[5])
        })
    }

    pub(crate) fn ports(&self, context: Opaque, index: usize) -> Vec<u8> {
        self.with_device(context, index, |device| {
            let mut ports = [0; 7];
            let count = call!(
                self,
                c"libusb_get_port_numbers",
                fn(Opaque, *mut u8, c_int) -> c_int,
                device,
                ports.as_mut_ptr(),
                7
            );
            ports[..count as usize].to_vec()
        })
    }

    pub(crate) fn max_iso_packet(&self, context: Opaque, index: usize) -> c_int {
        self.with_device(context, index, |device| {
            call!(
                self,
                c"libusb_get_max_iso_packet_size",
                fn(Opaque, u8) -> c_int,
                device,
                0x81
            )
        })
    }

    pub(crate) fn text(&self, handle: Opaque, index: u8) -> String {
        let mut text = [0; 64];
        let count = call!(
            self,
            c"libusb_get_string_descriptor_ascii",
            fn(Opaque, u8, *mut u8, c_int) -> c_int,
            handle,
            index,
            text.as_mut_ptr(),
            64
        );
        String::from_utf8(text[..count as usize].to_vec()).unwrap()
    }

    /// Interfaces, settings of the first, endpoints of its first setting.
    pub(crate) fn configuration(&self, context: Opaque, index: usize) -> (u8, c_int, u8) {
        self.with_device(context, index, |device| {
            let mut configuration = ptr::null::<Configuration>();
            let code = call!(
                self,
                c"libusb_get_active_config_descriptor",
                fn(Opaque, *mut *const Configuration) -> c_int,
                device,
                &raw mut configuration
            );
            assert_eq!(code, 0);
            // SAFETY: the descriptor stands until it is freed.
            let counts = unsafe {
                let interface = (*configuration).interfaces;
                (
                    (*configuration).interface_count,
                    (*interface).setting_count,
                    (*(*interface).settings).endpoint_count,
                )
            };
            call!(
                self,
                c"libusb_free_config_descriptor",
                fn(*const Configuration),
                configuration
            );
            counts
        })
    }

    /// Handles events until `is_done`, five seconds at most.
    pub(crate) fn events_until(&self, context: Opaque, is_done: impl Fn() -> bool) {
        for _ in 0..500 {
            if is_done() {
                return;
            }
            let time = Timeval {
                seconds: 0,
                microseconds: 10_000,
            };
            let code = call!(
                self,
                c"libusb_handle_events_timeout",
                fn(Opaque, *const Timeval) -> c_int,
                context,
                &raw const time
            );
            assert_eq!(code, 0);
        }
        panic!("transfers do not end");
    }
}

/// A request and its reply; a refusal is not expected, an error of libusb is given back.
pub(crate) fn host_request(
    library: &Library,
    handle: Opaque,
    request: Request,
) -> Result<Vec<u8>, c_int> {
    let mut packet = [0; MAX_HOST_PACKET_BYTES];
    let length = request.encode(1, &mut packet);
    let code = library.control(handle, 0x40, 0, 0, &mut packet[..length]);
    if code < 0 {
        return Err(code);
    }
    let mut reader = ReplyReader::new(request.opcode(), 1);
    loop {
        let code = library.control(handle, 0xC0, 0, 0, &mut packet);
        let count = usize::try_from(code).map_err(|_| code)?;
        match reader.receive(&packet[..count]).unwrap() {
            Received::NotYet => {}
            Received::Data(data) => return Ok(data.to_vec()),
            other => panic!("{other:?}"),
        }
    }
}
