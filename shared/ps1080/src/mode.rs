//! Closed choices of the protocol: sizes of pictures, modes of the camera and of its streams (protocol sections 3, 4).

/// Size of a picture. The numbers are the protocol's.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u16)]
pub enum Resolution {
    /// 320 x 240.
    Qvga = 0,
    /// 640 x 480.
    Vga = 1,
    /// 1280 x 1024.
    Sxga = 2,
    /// 1600 x 1200.
    Uxga = 3,
    /// 160 x 120.
    Qqvga = 4,
    /// 176 x 144.
    Qcif = 5,
    /// 432 x 240.
    P240 = 6,
    /// 352 x 288.
    Cif = 7,
    /// 640 x 360.
    P360 = 8,
    /// 864 x 480.
    P480 = 9,
    /// 800 x 448.
    P448 = 10,
    /// 800 x 600.
    Svga = 11,
    /// 1024 x 576.
    P576 = 12,
    /// 960 x 720.
    Dvd = 13,
    /// 1280 x 720.
    P720 = 14,
    /// 1280 x 960.
    P960 = 15,
}

impl Resolution {
    /// All, by their numbers.
    pub const ALL: [Self; 16] = [
        Self::Qvga,
        Self::Vga,
        Self::Sxga,
        Self::Uxga,
        Self::Qqvga,
        Self::Qcif,
        Self::P240,
        Self::Cif,
        Self::P360,
        Self::P480,
        Self::P448,
        Self::Svga,
        Self::P576,
        Self::Dvd,
        Self::P720,
        Self::P960,
    ];

    /// The resolution of a number.
    pub fn from_code(code: u16) -> Option<Self> {
        Self::ALL.get(usize::from(code)).copied()
    }

    /// The number.
    pub fn code(self) -> u16 {
        self as u16
    }

    /// Width and height, pixels.
    pub fn size(self) -> (u16, u16) {
        match self {
            Self::Qvga => (320, 240),
            Self::Vga => (640, 480),
            Self::Sxga => (1280, 1024),
            Self::Uxga => (1600, 1200),
            Self::Qqvga => (160, 120),
            Self::Qcif => (176, 144),
            Self::P240 => (432, 240),
            Self::Cif => (352, 288),
            Self::P360 => (640, 360),
            Self::P480 => (864, 480),
            Self::P448 => (800, 448),
            Self::Svga => (800, 600),
            Self::P576 => (1024, 576),
            Self::Dvd => (960, 720),
            Self::P720 => (1280, 720),
            Self::P960 => (1280, 960),
        }
    }
}

/// Mode of the camera, of GET_MODE and SET_MODE.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u16)]
pub enum CameraMode {
    /// A USB video class camera.
    Webcam = 0,
    /// The normal one: streams can run.
    Normal = 1,
    /// For the maker.
    Maintenance = 2,
    /// Starts anew; the camera stays on the bus.
    SoftReset = 3,
    /// Boots; the camera leaves the bus.
    Reboot = 4,
    /// Sleeps.
    Suspend = 5,
    /// Wakes.
    Resume = 6,
    /// Boots still.
    Init = 7,
    /// Restores itself.
    SystemRestore = 8,
    /// Waits for the host.
    WaitForEnumeration = 9,
    /// Its flash is damaged: no stream runs, nothing is to be repaired.
    Safe = 10,
}

impl CameraMode {
    /// The mode of a number.
    pub fn from_code(code: u16) -> Option<Self> {
        [
            Self::Webcam,
            Self::Normal,
            Self::Maintenance,
            Self::SoftReset,
            Self::Reboot,
            Self::Suspend,
            Self::Resume,
            Self::Init,
            Self::SystemRestore,
            Self::WaitForEnumeration,
            Self::Safe,
        ]
        .get(usize::from(code))
        .copied()
    }

    /// The number.
    pub fn code(self) -> u16 {
        self as u16
    }
}

/// What a stream sends: values of the parameters "stream mode".
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u16)]
pub enum StreamMode {
    /// Nothing.
    Off = 0,
    /// Stream 0: colour.
    Color = 1,
    /// Stream 1: depth.
    Depth = 2,
    /// Stream 0: infrared.
    Infrared = 3,
}

/// A sensor, where a request names one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u16)]
pub enum Cmos {
    /// Colour.
    Image = 0,
    /// Depth and infrared.
    Depth = 1,
}

impl Cmos {
    /// The sensor of a number.
    pub fn from_code(code: u16) -> Option<Self> {
        match code {
            0 => Some(Self::Image),
            1 => Some(Self::Depth),
            _ => None,
        }
    }
}
