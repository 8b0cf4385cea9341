//! Points that lie (hard-cases C04, C06 to C08, C13).
