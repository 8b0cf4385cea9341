//! raytrace
