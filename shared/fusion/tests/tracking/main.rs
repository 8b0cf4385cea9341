//! Tracking on surfaces whose answer is known.

mod observability;
mod photometric;
mod robustness;
mod shapes;
mod steps;
