//! The photometric term (hard-cases C09, C10).
