//! Vectorised inner loops with a scalar specification each. The only place with `unsafe`.

pub(crate) mod demosaic;
pub(crate) mod develop;
pub(crate) mod register;
pub(crate) mod yuv;

/// Which instructions a kernel uses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Level {
    /// Plain Rust: the specification.
    Scalar,
    /// AVX2 on x86-64.
    Avx2,
}

impl Level {
    /// The fastest level of this machine.
    pub fn detect() -> Self {
        if Self::Avx2.is_usable() {
            Self::Avx2
        } else {
            Self::Scalar
        }
    }

    /// Whether this machine has the instructions.
    pub fn is_usable(self) -> bool {
        match self {
            Self::Scalar => true,
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => std::is_x86_feature_detected!("avx2"),
            #[cfg(not(target_arch = "x86_64"))]
            Self::Avx2 => false,
        }
    }
}
