//! Asking for memory ahead of its use.

/// Brings the cache line of `values[index]` near, where the processor can; changes no result.
#[inline]
pub(crate) fn prefetch<T, const N: usize>(values: &[T; N], index: usize) {
    let value = &raw const values[index];
    #[cfg(target_arch = "x86_64")]
    #[expect(unsafe_code, reason = "an instruction of the processor")]
    // SAFETY: SSE is part of x86-64, and the pointer is that of a value, checked above.
    unsafe {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        _mm_prefetch::<_MM_HINT_T0>(value.cast());
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = value;
}
