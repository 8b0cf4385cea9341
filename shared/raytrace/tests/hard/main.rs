//! Hard cases E01, E03 to E08, E11 to E13. E02 and E10 stand next to the code they need to see.

mod build;
mod meshes;
mod mirrors;
mod raster;
mod rays;
mod rows;
mod warps;
