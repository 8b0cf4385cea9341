//! What is wrong with an `.oni` file.

/// Why a file, or a frame of it, cannot be read.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum OniDamage {
    /// Another kind of file.
    #[error("this is no recording of OpenNI: it does not begin with NI10")]
    NoOni,
    /// A version that nobody wrote, or that came later.
    #[error(
        "version {}.{}.{}.{} of the format; 1.0.0.4 to 1.0.1.0 can be read",
        version.0, version.1, version.2, version.3
    )]
    Version {
        /// Major, minor, maintenance, build.
        version: (u8, u8, u16, u32),
    },
    /// The system says no.
    #[error("{0}")]
    Io(String),
    /// Properties that announce no picture.
    #[error("its properties announce no picture that can be read")]
    NoShape,
    /// A codec that is not known, or not for these samples.
    #[error("its codec does not belong to its pixels, or is not known")]
    Codec,
    /// Raw samples of another length.
    #[error("{bytes} bytes of raw samples where {expected} were announced")]
    RawSize {
        /// Bytes there are.
        bytes: usize,
        /// Bytes announced.
        expected: usize,
    },
    /// Fewer pixels than announced.
    #[error("{done} pixels of {expected}")]
    TooFewPixels {
        /// Decoded.
        done: usize,
        /// Announced.
        expected: usize,
    },
    /// More pixels than announced.
    #[error("more pixels than announced")]
    TooManyPixels,
    /// Bytes that end within a token, or are too few.
    #[error("its bytes end too early")]
    TooShort,
    /// A code that no writer makes.
    #[error("a code that means nothing")]
    Token,
    /// A JPEG that does not decode.
    #[error("JPEG: {0}")]
    Jpeg(String),
}

impl OniDamage {
    pub(super) fn io(error: &std::io::Error) -> Self {
        Self::Io(error.to_string())
    }
}
