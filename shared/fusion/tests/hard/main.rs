//! Hard cases of fusion, meshing and the robust minimum: rows A14, D01 to D17 and G01 to G08.
//!
//! Each test has two halves (hard-cases.md section 0): a naive twin that violates the tolerance on the row's
//! input, and the shipped code that meets it there and on seeded neighbours. Where one run of the shipped
//! code is a whole scan, the thousand neighbours are voxels, pixels or vertices of random scenes. Rows that
//! need the insides of the mesher or of the minimum (D12, D13, D15, G01, G07) stand beside that code.

mod blocks;
mod color;
mod far_origin;
mod gains;
mod minimum;
mod number_format;
mod rows;
mod sampling;
mod scenes;
mod thin;
mod truncation;
