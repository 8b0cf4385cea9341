//! Hard cases of section H and of sums: each test shows the textbook form fail and the shipped one hold.

mod gauge;
mod robustness;
mod scene;
mod sums;
