//! Parameters of the camera (protocol section 4).

/// Ids of GET_PARAM and SET_PARAM. Those that only the maker should touch are left out.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u16)]
#[expect(
    missing_docs,
    reason = "the names are the protocol's; section 4 explains them"
)]
pub enum Parameter {
    FrameSync = 1,
    Registration = 2,
    Stream0Mode = 5,
    Stream1Mode = 6,
    Stream2Mode = 7,
    ImageFormat = 12,
    ImageResolution = 13,
    ImageFps = 14,
    ImageGain = 15,
    ImageQuality = 16,
    ImageFlicker = 17,
    DepthFormat = 18,
    DepthResolution = 19,
    DepthFps = 20,
    DepthGain = 21,
    DepthHoleFilter = 22,
    DepthMirror = 23,
    DepthDecimation = 24,
    InfraredFormat = 25,
    InfraredResolution = 26,
    InfraredFps = 27,
    InfraredGain = 28,
    InfraredQuality = 29,
    LogFilter = 30,
    SelfCorrection = 36,
    DepthWhiteBalance = 45,
    ImageCropWidth = 46,
    ImageCropHeight = 47,
    ImageCropX = 48,
    ImageCropY = 49,
    ImageCropMode = 50,
    DepthCropWidth = 51,
    DepthCropHeight = 52,
    DepthCropX = 53,
    DepthCropY = 54,
    DepthCropMode = 55,
    InfraredCropWidth = 56,
    InfraredCropHeight = 57,
    InfraredCropX = 58,
    InfraredCropY = 59,
    InfraredCropMode = 60,
    SelfCorrectionDebug = 61,
    LaserPowerControl = 62,
    ImageMirror = 71,
    InfraredMirror = 72,
    WavelengthCorrection = 73,
    WavelengthCorrectionDebug = 74,
    ImageSharpness = 76,
    AutoWhiteBalance = 77,
    ColorTemperature = 78,
    BacklightCompensation = 79,
    AutoExposure = 80,
    ExposureBar = 81,
    LowLightCompensation = 82,
    CloseRange = 84,
}

/// All [`Parameter`]s, ascending.
pub const PARAMETERS: [Parameter; 55] = {
    use Parameter::*;
    [
        FrameSync,
        Registration,
        Stream0Mode,
        Stream1Mode,
        Stream2Mode,
        ImageFormat,
        ImageResolution,
        ImageFps,
        ImageGain,
        ImageQuality,
        ImageFlicker,
        DepthFormat,
        DepthResolution,
        DepthFps,
        DepthGain,
        DepthHoleFilter,
        DepthMirror,
        DepthDecimation,
        InfraredFormat,
        InfraredResolution,
        InfraredFps,
        InfraredGain,
        InfraredQuality,
        LogFilter,
        SelfCorrection,
        DepthWhiteBalance,
        ImageCropWidth,
        ImageCropHeight,
        ImageCropX,
        ImageCropY,
        ImageCropMode,
        DepthCropWidth,
        DepthCropHeight,
        DepthCropX,
        DepthCropY,
        DepthCropMode,
        InfraredCropWidth,
        InfraredCropHeight,
        InfraredCropX,
        InfraredCropY,
        InfraredCropMode,
        SelfCorrectionDebug,
        LaserPowerControl,
        ImageMirror,
        InfraredMirror,
        WavelengthCorrection,
        WavelengthCorrectionDebug,
        ImageSharpness,
        AutoWhiteBalance,
        ColorTemperature,
        BacklightCompensation,
        AutoExposure,
        ExposureBar,
        LowLightCompensation,
        CloseRange,
    ]
};

impl Parameter {
    /// The parameter of an id.
    pub fn from_id(id: u16) -> Option<Self> {
        PARAMETERS
            .into_iter()
            .find(|parameter| parameter.id() == id)
    }

    /// The id on the wire.
    pub fn id(self) -> u16 {
        self as u16
    }

    /// Whether the protocol document knows `value` as one of this parameter's; where it names no limit, all are.
    pub fn accepts(self, value: u16) -> bool {
        use Parameter::*;
        match self {
            FrameSync
            | Registration
            | Stream2Mode
            | DepthHoleFilter
            | DepthMirror
            | DepthDecimation
            | SelfCorrection
            | DepthWhiteBalance
            | SelfCorrectionDebug
            | LaserPowerControl
            | ImageMirror
            | InfraredMirror
            | WavelengthCorrection
            | WavelengthCorrectionDebug
            | AutoWhiteBalance
            | BacklightCompensation
            | AutoExposure
            | LowLightCompensation
            | CloseRange => value <= 1,
            Stream0Mode => matches!(value, 0 | 1 | 3),
            Stream1Mode => matches!(value, 0 | 2),
            ImageFormat => value <= 7,
            ImageResolution | DepthResolution | InfraredResolution => value <= 15,
            ImageFps | DepthFps | InfraredFps => matches!(value, 25 | 30 | 60),
            ImageQuality => (1..=10).contains(&value),
            ImageFlicker => matches!(value, 0 | 50 | 60),
            DepthFormat => value <= 4,
            DepthGain => value <= 50,
            ImageCropMode | DepthCropMode | InfraredCropMode => value <= 2,
            ImageSharpness => value <= 100,
            _ => true,
        }
    }
}
