//! glint, the offline program: import, train, evaluate, report, render and export recordings of shiny
//! objects.
//!
//! For: the commands of the `glint` binary and the stages behind them. Not for: kernels (they live in the
//! crates of `shared/`) and not for capture (that is `glintd`).
//!
//! ```no_run
//! use glint::{progress::Progress, run_folder::RunFolder, train::{TrainConfig, train}};
//! let config = TrainConfig {
//!     recording: "room.glint".into(), profile: "draft".into(), poses: "source".into(), voxel_mm: 2.0,
//!     pixel_stride: 2, map_height: 250, frame_stride: 1, diffuse: Default::default(), object_box: None,
//!     effects: Default::default(), seed: 1, threads: 2,
//! };
//! let folder = RunFolder::create("run".as_ref(), false).unwrap();
//! let summary = train(&config, &folder, &Progress::silent()).unwrap();
//! println!("{}", summary.sentence);
//! ```
//!
//! Map: [`cli`] flags and exit codes · [`import`] foreign recordings · [`train`] the stages in order ·
//! [`stages`] poses, geometry, diffuse, linear · [`refine`] poses that fit each other · [`eval`] figures
//! against truth · [`perceptual`] LPIPS · [`tradeoff`] accuracy against time · [`report`] one page ·
//! [`budget`] the setting that a budget buys · [`render`] pictures from any view · [`export`] files for other programs · [`simulate`] captures with their
//! truth · [`run_folder`] what is kept.
//!
//! Invariants: training reads training frames only; no file has its final name before it is complete; the
//! same input, seed and SIMD level give the same bits for any number of threads.

pub mod budget;
pub mod cli;
pub mod clock;
pub mod color;
pub mod effects;
pub mod eval;
pub mod export;
pub mod import;
pub mod interrupt;
pub mod perceptual;
pub mod ply;
pub mod progress;
pub mod refine;
pub mod render;
pub mod report;
pub mod run_folder;
pub mod simulate;
pub mod stages;
pub mod tradeoff;
pub mod train;
