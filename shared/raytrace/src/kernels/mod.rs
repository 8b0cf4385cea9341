//! Vectorised inner loops with a scalar specification each. The only place with `unsafe`.

pub(crate) mod traverse;

/// Which instructions a kernel uses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Level {
    /// Plain Rust: the specification.
    Scalar,
    /// AVX2 on x86-64, with the bit-counting instructions that come with it.
    Avx2,
}

impl Level {
    /// The fastest level of this machine.
    pub fn detect() -> Self {
        #[cfg(target_arch = "x86_64")]
        if has_avx2() {
            return Self::Avx2;
        }
        Self::Scalar
    }
}

/// AVX2 with bit counting, which every such processor has; counting bits without it costs a tenth of the speed.
#[cfg(target_arch = "x86_64")]
fn has_avx2() -> bool {
    std::is_x86_feature_detected!("avx2")
        && std::is_x86_feature_detected!("bmi1")
        && std::is_x86_feature_detected!("bmi2")
        && std::is_x86_feature_detected!("lzcnt")
        && std::is_x86_feature_detected!("popcnt")
}
