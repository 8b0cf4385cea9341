//! `integrate/<blocks>`: the vector kernel against its scalar twin, taking turns, one thread.
//!
//! `cargo bench -p fusion` prints core-nanoseconds per block and voxel rates: once on blocks that stay in
//! the cache and once on more blocks than any cache holds, as a frame meets them.

use fusion::Level;
use fusion::kernels::integrate::{
    Block, BlockView, Conflicts, DepthView, UpdateRule, integrate_block,
};
use rustix::time::{ClockId, clock_gettime};

const WIDTH: usize = 640;
const HEIGHT: usize = 480;
const FOCAL: f32 = 585.0;
const VOXEL: f32 = 0.005;
const ROUNDS: usize = 5;

fn main() {
    // A slanted wall with steps of a triangulating sensor.
    let depth: Vec<f32> = (0..WIDTH * HEIGHT)
        .map(|pixel| {
            let wall = 1.2 + 0.5 * (pixel % WIDTH) as f32 / WIDTH as f32;
            let step = 2.89e-3 * wall * wall;
            (wall / step).round() * step
        })
        .collect();
    for (name, block_count, passes) in [("cached", 16, 400), ("streamed", 20_000, 1)] {
        let mut best = [f64::INFINITY; 2];
        for _ in 0..ROUNDS {
            for (slot, level) in [Level::Scalar, Level::detect()].into_iter().enumerate() {
                let seconds = run(level, &depth, block_count, passes);
                best[slot] = best[slot].min(seconds / (block_count * passes) as f64);
            }
        }
        let [scalar, vector] = best.map(|seconds| seconds * 1e9);
        println!(
            "integrate/{name}: scalar {scalar:.0} ns per block, {:?} {vector:.0} ns per block, ratio {:.2}, \
             {:.2} ns per voxel",
            Level::detect(),
            scalar / vector,
            vector / 512.0
        );
    }
}

/// Core-seconds of `passes` updates of `block_count` blocks along the wall.
fn run(level: Level, depth: &[f32], block_count: usize, passes: usize) -> f64 {
    let image = DepthView {
        depth,
        width: WIDTH,
        height: HEIGHT,
    };
    let rule = UpdateRule {
        truncation: 8.0 * VOXEL,
        weight_at_one_metre: 1.0,
        weight_cap: 128.0,
        conflict: 0.125,
        conflict_at_one_metre: 0.15,
    };
    let mut conflicts = Conflicts::NONE;
    let mut blocks = vec![Block::EMPTY; block_count];
    let mut spent = 0.0;
    // The first pass fills the blocks and is not counted.
    for pass in 0..=passes {
        let start = process_seconds();
        for number in 0..block_count {
            let view = view_of(number);
            let (before, after) = blocks.split_at_mut(number + 1);
            let (block, ahead) = (&mut before[number], after.first());
            integrate_block(
                level,
                block,
                None,
                ahead,
                image,
                &view,
                &rule,
                &mut conflicts,
            );
        }
        if pass > 0 {
            spent += process_seconds() - start;
        }
    }
    spent
}

/// Block `number` of a band about the wall, turned a little against the camera.
fn view_of(number: usize) -> BlockView {
    let (column, line) = (40 + number * 37 % 560, 40 + number * 61 % 400);
    let z = 1.2 + 0.5 * column as f32 / WIDTH as f32 + 0.04 * (number % 5) as f32 - 0.1;
    let (cx, cy) = (WIDTH as f32 / 2.0, HEIGHT as f32 / 2.0);
    let homogeneous = |[x, y, z]: [f32; 3]| [FOCAL * x + cx * z, FOCAL * y + cy * z, z];
    let turned = [[0.8, 0.0, -0.6], [0.36, 0.8, 0.48], [0.48, -0.6, 0.64]];
    BlockView {
        start: [column as f32 * z, line as f32 * z, z],
        step: turned.map(|axis: [f32; 3]| homogeneous(axis.map(|c| c * VOXEL))),
        to_camera: [0.6, -0.48, -0.64],
        farthest: f32::INFINITY,
        nearest: f32::NEG_INFINITY,
        is_inside: true,
    }
}

fn process_seconds() -> f64 {
    let time = clock_gettime(ClockId::ProcessCPUTime);
    time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
}
