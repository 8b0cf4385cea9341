//! The vector kernel against its specification: equal bits, whatever the input.

use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;

use imaging::LinearPixel;

use super::*;

const RULE: UpdateRule = UpdateRule {
    truncation: 0.04,
    weight_at_one_metre: 1.0,
    weight_cap: 8.0,
    conflict: 0.125,
    conflict_at_one_metre: 0.1,
};

/// A block one metre ahead of a camera of focal length `width`, voxels of 5 mm, seen straight on.
fn straight_view(width: usize, height: usize) -> BlockView {
    let (focal, voxel) = (width as f32, 0.005);
    let (cx, cy) = (0.5 * width as f32, 0.5 * height as f32);
    let first = [-0.0175, -0.0175, 0.99];
    let homogeneous = |[x, y, z]: [f32; 3]| [focal * x + cx * z, focal * y + cy * z, z];
    BlockView {
        start: homogeneous(first),
        step: [
            homogeneous([voxel, 0.0, 0.0]),
            homogeneous([0.0, voxel, 0.0]),
            homogeneous([0.0, 0.0, voxel]),
        ],
        to_camera: [0.0, 0.0, -1.0],
        farthest: f32::INFINITY,
        nearest: f32::NEG_INFINITY,
        is_inside: false,
    }
}

/// A block in a state that integration can leave behind, exact zeros and saturated values included.
fn random_block(rng: &mut Pcg64) -> Block {
    let mut block = Block::EMPTY;
    for (tsdf, weight) in block.tsdf.iter_mut().zip(&mut block.weight) {
        *weight = match rng.random_range(0..4) {
            0 => continue,
            1 => f32::MIN_POSITIVE / 8.0,
            2 => RULE.weight_cap,
            _ => rng.random_range(0.0..RULE.weight_cap),
        };
        *tsdf = match rng.random_range(0..6) {
            0 => 0.0,
            1 => -0.0,
            2 => 1.0,
            3 => f32::MIN_POSITIVE / 8.0,
            _ => rng.random_range(-1.0..=1.0),
        };
    }
    block
}

fn bits(block: &Block) -> Vec<u32> {
    let values = block.tsdf.iter().chain(&block.weight);
    values.map(|value| value.to_bits()).collect()
}

fn fuse(
    level: Level,
    block: &mut Block,
    image: DepthView<'_>,
    view: &BlockView,
    rule: &UpdateRule,
) {
    let mut conflicts = Conflicts::NONE;
    let ahead = block.clone();
    integrate_block(
        level,
        block,
        None,
        Some(&ahead),
        image,
        view,
        rule,
        &mut conflicts,
    );
}

/// Runs both levels on copies of `block` and demands equal bits. Returns the number of voxels changed.
fn assert_twins_agree(
    block: &Block,
    depth: &[f32],
    width: usize,
    height: usize,
    view: &BlockView,
    rule: &UpdateRule,
    what: &str,
) -> usize {
    let image = DepthView {
        depth,
        width,
        height,
    };
    let run = |level| {
        let mut block = block.clone();
        fuse(level, &mut block, image, view, rule);
        block
    };
    let scalar = bits(&run(Level::Scalar));
    for level in [Level::Avx2, Level::detect()] {
        assert!(scalar == bits(&run(level)), "{level:?} differs: {what}");
    }
    let before = bits(block);
    let changed = scalar.iter().zip(&before).filter(|(a, b)| a != b);
    changed.count()
}

#[test]
fn twins_agree_for_every_small_image_and_offset() {
    let mut rng = Pcg64::seed_from_u64(1);
    let mut changed = 0;
    for width in 1..=33 {
        for height in [1, 2, 7, 8, 9, 33] {
            let depth: Vec<f32> = (0..width * height)
                .map(|_| rng.random_range(0.9..1.1))
                .collect();
            let mut view = straight_view(width, height);
            // A shift by a few pixels in steps that are no multiple of a pixel.
            let shift = rng.random_range(-9.0..9.0_f32);
            view.start[0] += shift;
            view.start[1] += 0.37 * shift;
            let block = random_block(&mut rng);
            changed += assert_twins_agree(
                &block,
                &depth,
                width,
                height,
                &view,
                &RULE,
                &format!("{width} x {height} shifted by {shift}"),
            );
        }
    }
    assert!(changed > 10_000, "only {changed} voxels changed");
}

#[test]
fn twins_agree_in_every_position_and_attitude() {
    const SIZE: usize = 64;
    let mut rng = Pcg64::seed_from_u64(2);
    let mut changed = 0;
    for round in 0..2000 {
        let depth: Vec<f32> = (0..SIZE * SIZE)
            .map(|_| match rng.random_range(0..8) {
                0 => 0.0,
                _ => rng.random_range(0.9..1.1),
            })
            .collect();
        let mut view = straight_view(SIZE, SIZE);
        for value in view.step.iter_mut().flatten() {
            *value += rng.random_range(-0.3..0.3_f32) * 0.005 * SIZE as f32;
        }
        for step in &mut view.step {
            step[2] = rng.random_range(-0.005..0.005);
        }
        view.to_camera = std::array::from_fn(|_| rng.random_range(-1.0..1.0));
        view.is_inside = round % 2 == 0;
        if round % 3 == 0 {
            view.farthest = rng.random_range(0.95..1.05);
        }
        if round % 3 == 1 {
            view.nearest = rng.random_range(0.95..1.05);
        }
        let block = random_block(&mut rng);
        let what = format!("round {round}");
        changed += assert_twins_agree(&block, &depth, SIZE, SIZE, &view, &RULE, &what);
    }
    assert!(changed > 100_000, "only {changed} voxels changed");
}

#[test]
fn twins_agree_on_extreme_numbers() {
    const EXTREMES: [f32; 14] = [
        0.0,
        -0.0,
        f32::MIN_POSITIVE,
        f32::MIN_POSITIVE / 8.0,
        -1.0,
        1.0,
        0.01,
        1e-30,
        1e30,
        f32::MAX,
        f32::MIN,
        f32::INFINITY,
        f32::NEG_INFINITY,
        f32::NAN,
    ];
    const SIZE: usize = 16;
    let mut rng = Pcg64::seed_from_u64(3);
    for round in 0..4000 {
        let pick = |rng: &mut Pcg64| EXTREMES[rng.random_range(0..EXTREMES.len())];
        let depth: Vec<f32> = (0..SIZE * SIZE)
            .map(|_| match rng.random_range(0..3) {
                0 => pick(&mut rng),
                _ => rng.random_range(0.9..1.1),
            })
            .collect();
        let mut view = straight_view(SIZE, SIZE);
        match round % 4 {
            0 => view.start[rng.random_range(0..3)] = pick(&mut rng),
            1 => view.step[rng.random_range(0..3)][rng.random_range(0..3)] = pick(&mut rng),
            2 => view.farthest = pick(&mut rng),
            _ => view.nearest = pick(&mut rng),
        }
        let block = random_block(&mut rng);
        let what = format!("round {round}: {view:?}");
        assert_twins_agree(&block, &depth, SIZE, SIZE, &view, &RULE, &what);
    }
}

#[test]
fn finite_depth_leaves_finite_blocks_whatever_the_view() {
    const SIZE: usize = 8;
    let mut rng = Pcg64::seed_from_u64(4);
    for _ in 0..1000 {
        let depth: Vec<f32> = (0..SIZE * SIZE)
            .map(|_| 10.0_f32.powf(rng.random_range(-30.0..30.0)))
            .collect();
        let mut view = straight_view(SIZE, SIZE);
        view.start[2] = 10.0_f32.powf(rng.random_range(-3.0..30.0));
        let mut block = Block::EMPTY;
        for _ in 0..3 {
            let image = DepthView {
                depth: &depth,
                width: SIZE,
                height: SIZE,
            };
            fuse(Level::detect(), &mut block, image, &view, &RULE);
        }
        assert!(block.tsdf.iter().all(|t| (-1.0..=1.0).contains(t)));
        let cap = RULE.weight_cap;
        assert!(block.weight.iter().all(|w| (0.0..=cap).contains(w)));
    }
}

/// A colour block in a state that integration can leave behind.
fn random_color(rng: &mut Pcg64) -> ColorBlock {
    let mut color = ColorBlock::EMPTY;
    for voxel in 0..color.weight.len() {
        let bound = if rng.random_range(0..4) == 0 {
            SATURATED
        } else {
            0
        };
        color.weight[voxel] = match rng.random_range(0..4) {
            0 => continue,
            1 => color::WEIGHT_CAP as u16 | bound,
            _ => rng.random_range(1..=color::WEIGHT_CAP as u16) | bound,
        };
        for channel in &mut color.channels {
            channel[voxel] = *[0, 1, u16::MAX, rng.random()]
                .get(rng.random_range(0..4))
                .unwrap_or(&7);
        }
    }
    color
}

#[test]
fn twins_agree_on_colour() {
    const SIZE: usize = 64;
    let mut rng = Pcg64::seed_from_u64(5);
    let mut changed = 0;
    for round in 0..1500 {
        let depth: Vec<f32> = (0..SIZE * SIZE)
            .map(|_| match rng.random_range(0..8) {
                0 => 0.0,
                _ => rng.random_range(0.95..1.05),
            })
            .collect();
        let pixels: Vec<LinearPixel> = (0..SIZE * SIZE)
            .map(|_| {
                let mut pixel: [u16; 4] = rng.random();
                pixel[3] &= LinearPixel::VALID | LinearPixel::SATURATED;
                LinearPixel(pixel)
            })
            .collect();
        let mut view = straight_view(SIZE, SIZE);
        for value in view.step.iter_mut().flatten() {
            *value += rng.random_range(-0.3..0.3_f32) * 0.005 * SIZE as f32;
        }
        for step in &mut view.step {
            step[2] = rng.random_range(-0.005..0.005);
        }
        view.is_inside = round % 2 == 0;
        let rule = UpdateRule {
            weight_at_one_metre: [1.0, 1e-6, 20.0, 1e6][round % 4],
            ..RULE
        };
        let (block, color) = (random_block(&mut rng), random_color(&mut rng));
        let image = DepthView {
            depth: &depth,
            width: SIZE,
            height: SIZE,
        };
        let run = |level| {
            let (mut block, mut color) = (block.clone(), color.clone());
            let mut conflicts = Conflicts::NONE;
            let colors = ColorView {
                pixels: &pixels,
                reach: 0.4,
            };
            let behind = integrate_block(
                level,
                &mut block,
                Some((&mut color, colors)),
                None,
                image,
                &view,
                &rule,
                &mut conflicts,
            );
            (bits(&block), color.channels, color.weight, behind)
        };
        let scalar = run(Level::Scalar);
        assert!(scalar == run(Level::Avx2), "round {round}");
        let pairs = scalar.2.iter().zip(&color.weight);
        changed += pairs.filter(|(after, before)| after != before).count();
    }
    assert!(changed > 30_000, "only {changed} voxels took colour");
}

#[test]
#[should_panic(expected = "one depth per pixel")]
fn a_depth_slice_of_the_wrong_length_is_refused() {
    let image = DepthView {
        depth: &[1.0; 15],
        width: 4,
        height: 4,
    };
    let view = straight_view(4, 4);
    let mut block = Block::EMPTY;
    fuse(Level::detect(), &mut block, image, &view, &RULE);
}

#[test]
#[should_panic(expected = "LARGEST_SIDE")]
fn a_width_that_overflows_the_pixel_index_is_refused() {
    let image = DepthView {
        depth: &[],
        width: 1 << 33,
        height: 1 << 31,
    };
    let view = straight_view(4, 4);
    let mut block = Block::EMPTY;
    fuse(Level::detect(), &mut block, image, &view, &RULE);
}
