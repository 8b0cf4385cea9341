//! Vectorised inner loops with a scalar specification each. The only place with `unsafe`.

pub(crate) mod field;
pub mod icp;
pub mod integrate;
pub(crate) mod prefetch;

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
        #[cfg(target_arch = "x86_64")]
        if std::is_x86_feature_detected!("avx2") {
            return Self::Avx2;
        }
        Self::Scalar
    }
}
