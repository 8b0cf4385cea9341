//! Motion and convergence (hard-cases C11, C12, C14).
