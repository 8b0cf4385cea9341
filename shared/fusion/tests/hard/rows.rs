//! The two halves of a hard-case test (hard-cases.md section 0), with their printed line.

/// The naive twin must violate the tolerance on the listed input; NaN counts as a violation.
pub(crate) fn bites(id: &str, naive_error: f64, tolerance: f64) {
    println!("{id}: naive error {naive_error:.3e}, tolerance {tolerance:.1e}");
    assert!(
        naive_error.is_nan() || naive_error > tolerance,
        "{id}: the naive form passes with {naive_error:e} <= {tolerance:e}"
    );
}

/// The shipped function must meet the tolerance; NaN does not.
pub(crate) fn holds(id: &str, worst_error: f64, tolerance: f64) {
    println!("{id}: worst error {worst_error:.3e}, tolerance {tolerance:.1e}");
    assert!(
        worst_error <= tolerance,
        "{id}: worst error {worst_error:e} > {tolerance:e}"
    );
}

/// The larger of two errors where NaN wins, unlike in `f64::max`.
pub(crate) fn worse(a: f64, b: f64) -> f64 {
    if a.is_nan() || b.is_nan() {
        f64::NAN
    } else {
        a.max(b)
    }
}
