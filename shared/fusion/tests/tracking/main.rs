//! Tracking on surfaces whose answer is known.

mod live;
mod observability;
mod photometric;
mod robustness;
mod shapes;
mod steps;
