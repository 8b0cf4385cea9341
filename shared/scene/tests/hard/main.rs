//! Hard cases of GGX, Fresnel and the simulator (hard-cases section I), each with the naive formula that fails.

mod light;
mod lobe;
mod sampling;
