//! Rows D08, D09, D10, D17: where blocks are, how they are found, and how many there can be.

use std::collections::HashSet;

use fusion::volume::BlockTable;
use fusion::volume::key::{BLOCK_EDGE, COORDINATE_LIMIT, pack, split_voxel, unpack};
use fusion::{MeshConfig, Volume, VolumeConfig, extract_mesh};
use geometry::{DVec3, Pose};
use rand::RngExt as _;

use crate::rows::{bites, holds};
use crate::sampling::{generator, uniform};
use crate::scenes::{camera, look_at, render, sphere};

#[test]
fn hc_d08_negative_coordinates_have_their_own_blocks() {
    // Distinct places that fall together, of all voxels with coordinates −17..=17.
    let collisions = |place: fn([i32; 3]) -> [i32; 6]| {
        let mut places = HashSet::new();
        let range = -17..=17;
        for x in range.clone() {
            for y in range.clone() {
                for z in range.clone() {
                    places.insert(place([x, y, z]));
                }
            }
        }
        (35_usize.pow(3) - places.len()) as f64
    };
    let naive = collisions(|v| {
        // Division and remainder truncate towards 0.
        let (block, local) = (v.map(|c| c / 8), v.map(|c| (c % 8).abs()));
        [block[0], block[1], block[2], local[0], local[1], local[2]]
    });
    bites("D08", naive, 0.0);
    let shipped = |v| {
        let (block, index) = split_voxel(v);
        let local = [index % 8, index / 8 % 8, index / 64].map(|c| c as i32);
        [block[0], block[1], block[2], local[0], local[1], local[2]]
    };
    let mut wrong = collisions(|v| {
        let (block, index) = split_voxel(v);
        [block[0], block[1], block[2], index as i32, 0, 0]
    });
    let mut rng = generator(108);
    for _ in 0..5000 {
        let v: [i32; 3] = std::array::from_fn(|_| rng.random_range(-8_388_608..8_388_608));
        let expected: [i32; 6] = std::array::from_fn(|n| {
            let c = i64::from(v[n % 3]);
            let euclid = if n < 3 {
                c.div_euclid(8)
            } else {
                c.rem_euclid(8)
            };
            euclid as i32
        });
        wrong += f64::from(u8::from(shipped(v) != expected));
    }
    holds("D08", wrong, 0.0);
}

#[test]
fn hc_d08_a_ball_about_the_origin_is_whole_in_every_octant() {
    const VOXEL: f64 = 0.005;
    let camera = camera(96);
    let mut volume = Volume::new(VolumeConfig {
        voxel_size: VOXEL as f32,
        ..VolumeConfig::default()
    })
    .expect("a usable config");
    let ball = sphere(DVec3::ZERO, 0.1);
    for axis in [DVec3::X, DVec3::Y, DVec3::Z] {
        for eye in [0.6 * axis, -0.6 * axis] {
            let pose = look_at(eye, DVec3::ZERO);
            let depth = render(&camera, &pose, &ball);
            for _ in 0..4 {
                volume
                    .integrate(&depth, &camera, &pose)
                    .expect("one value per pixel");
            }
        }
    }
    let mesh = extract_mesh(&volume, &MeshConfig::default());
    let mut in_octant = [0_u32; 8];
    let mut error = 0.0_f64;
    for position in &mesh.positions {
        // Vertices on a plane between octants belong to both sides.
        if f64::from(position.abs().min_element()) > 0.5 * VOXEL {
            let octant = (0..3)
                .map(|n| usize::from(position[n] < 0.0) << n)
                .sum::<usize>();
            in_octant[octant] += 1;
        }
        error += (f64::from(position.length()) - 0.1).abs() / mesh.positions.len() as f64;
    }
    holds("D08 mean surface error, voxels", error / VOXEL, 0.5);
    let (least, most) = (in_octant.iter().min(), in_octant.iter().max());
    let share = f64::from(*most.unwrap_or(&0)) / f64::from(*least.unwrap_or(&0));
    holds(
        "D08 most over least vertices of an octant",
        share - 1.0,
        0.1,
    );
}

/// Keys of blocks on the planes x = ±y, and of every eighth block of a cube.
fn structured_keys() -> [Vec<[i32; 3]>; 2] {
    let planes = (-300..300)
        .flat_map(|x| (-150..150).flat_map(move |z| [[x, x, z], [x, -x, z]]))
        .filter(|&[x, y, _]| x != 0 || y != 0)
        .collect();
    let cube = (0..64_i32.pow(3))
        .map(|n| [n % 64, n / 64 % 64, n / 4096].map(|c| 8 * (c - 32)))
        .collect();
    [planes, cube]
}

fn random_blocks(count: usize, seed: u64) -> Vec<[i32; 3]> {
    let mut rng = generator(seed);
    let mut coordinate = || rng.random_range(-COORDINATE_LIMIT..COORDINATE_LIMIT);
    (0..count)
        .map(|_| [coordinate(), coordinate(), coordinate()])
        .collect()
}

fn table_of(blocks: &[[i32; 3]]) -> BlockTable {
    let mut table = BlockTable::default();
    for (index, &block) in blocks.iter().enumerate() {
        table.insert(pack(block).expect("in range"), index as u32);
    }
    table
}

/// Longest search for a stored key.
fn longest_probe(blocks: &[[i32; 3]]) -> f64 {
    let table = table_of(blocks);
    let probes = blocks
        .iter()
        .map(|&b| table.probe_length(pack(b).expect("in range")));
    probes.max().unwrap_or(0) as f64
}

/// Most keys that share a bucket under the hash of Teschner et al. in 2²⁰ buckets.
fn naive_depth(blocks: &[[i32; 3]]) -> f64 {
    let mut buckets = vec![0_u32; 1 << 20];
    for block in blocks {
        let [x, y, z] = block.map(|c| i64::from(c) as u64);
        let hash =
            x.wrapping_mul(73_856_093) ^ y.wrapping_mul(19_349_669) ^ z.wrapping_mul(83_492_791);
        buckets[(hash & ((1 << 20) - 1)) as usize] += 1;
    }
    f64::from(buckets.into_iter().max().unwrap_or(0))
}

#[test]
fn hc_d09_structured_keys_spread_like_random_ones() {
    const TOLERANCE: f64 = 2.0;
    let [planes, cube] = structured_keys();
    let naive = naive_depth(&planes) / naive_depth(&random_blocks(planes.len(), 1));
    let naive_cube = naive_depth(&cube) / naive_depth(&random_blocks(cube.len(), 2));
    bites("D09", naive.max(naive_cube), TOLERANCE);

    let mut worst = 0.0_f64;
    for keys in [planes, cube] {
        // One random set has luck; the longest of three has less.
        let random = (3..6).map(|seed| longest_probe(&random_blocks(keys.len(), seed)));
        worst = worst.max(longest_probe(&keys) / random.fold(0.0, f64::max));
    }
    holds("D09", worst, TOLERANCE);
}

#[test]
fn hc_d09_a_million_keys_are_found_exactly() {
    let mut blocks = random_blocks(1_000_000, 7);
    let edge = COORDINATE_LIMIT - 1;
    for corner in 0..8 {
        let side = |n: i32| {
            if corner >> n & 1 == 1 {
                edge
            } else {
                -COORDINATE_LIMIT
            }
        };
        blocks.push([side(0), side(1), side(2)]);
    }
    blocks.sort_unstable();
    blocks.dedup();
    let table = table_of(&blocks);
    let found = |block: [i32; 3]| table.get(pack(block).expect("in range"));
    let wrong = (0..blocks.len())
        .filter(|&n| found(blocks[n]) != Some(n as u32))
        .count();
    let strangers = random_blocks(10_000, 8);
    let ghosts = strangers
        .iter()
        .filter(|&&b| blocks.binary_search(&b).is_err() && found(b).is_some())
        .count();
    assert_eq!((table.len(), wrong, ghosts), (blocks.len(), 0, 0));
}

#[test]
fn hc_d10_coordinates_beyond_the_key_are_refused() {
    let limit = COORDINATE_LIMIT;
    // Naive: 21 bits of each coordinate, whatever it is.
    let naive = |block: [i32; 3]| {
        block.iter().fold(0_u64, |key, &c| {
            key << 21 | (i64::from(c) as u64 & 0x1f_ffff)
        })
    };
    let aliased = naive([limit, 5, 5]) == naive([-limit, 5, 5]);
    bites("D10", f64::from(u8::from(aliased)), 0.0);

    let mut wrong = 0;
    for axis in 0..3 {
        for (c, is_inside) in [
            (limit - 1, true),
            (limit, false),
            (limit + 1, false),
            (-limit + 1, true),
            (-limit, true),
            (-limit - 1, false),
            (i32::MAX, false),
            (i32::MIN, false),
        ] {
            let mut block = [1, -2, 3];
            block[axis] = c;
            let expected = is_inside.then_some(block);
            wrong += usize::from(pack(block).map(unpack) != expected);
        }
    }
    let mut rng = generator(110);
    for _ in 0..5000 {
        let block: [i32; 3] = std::array::from_fn(|_| rng.random_range(-2 * limit..2 * limit));
        let is_inside = block.iter().all(|c| (-limit..limit).contains(c));
        wrong += usize::from(pack(block).map(unpack) != is_inside.then_some(block));
    }
    holds("D10", wrong as f64, 0.0);
}

#[test]
fn hc_d10_a_camera_beyond_all_blocks_is_counted_and_harmless() {
    let camera = camera(32);
    let wall = vec![1.0; 32 * 24];
    for far in [5e4, -5e4, 1e9, -1e30] {
        let mut volume = Volume::new(VolumeConfig::default()).expect("a usable config");
        let pose = Pose::from_translation(DVec3::new(far, 0.0, 0.0));
        let stats = volume
            .integrate(&wall, &camera, &pose)
            .expect("one value per pixel");
        assert_eq!(volume.block_count(), 0, "at {far} m");
        assert!(stats.blocks_refused > 0, "at {far} m");
        assert_eq!(volume.refused_count(), stats.blocks_refused as u64);
    }
}

#[test]
fn hc_d17_noise_never_takes_more_than_the_budget() {
    /// Bytes.
    const LIMIT: usize = 4 << 20;
    const FRAMES: usize = 1000;
    let camera = camera(16);
    let mut volume = Volume::new(VolumeConfig {
        voxel_size: 0.01,
        memory_limit_bytes: LIMIT,
        ..VolumeConfig::default()
    })
    .expect("a usable config");
    let mut rng = generator(117);
    let mut naive = HashSet::new();
    let mut limit_reached = false;
    for _ in 0..FRAMES {
        let depth: Vec<f32> = (0..16 * 12)
            .map(|_| uniform(&mut rng, 0.3, 4.0) as f32)
            .collect();
        for (pixel, &depth) in depth.iter().enumerate() {
            // Naive: every block that a measurement falls into.
            let ray = [
                (pixel % 16) as f32 / 16.0 - 0.5,
                (pixel / 16) as f32 / 16.0 - 0.4,
                1.0,
            ];
            let block = ray.map(|r| (r * depth / (0.01 * BLOCK_EDGE as f32)).floor() as i32);
            naive.insert(block);
        }
        let stats = volume
            .integrate(&depth, &camera, &Pose::IDENTITY)
            .expect("one value per pixel");
        assert!(volume.memory_bytes() <= LIMIT);
        limit_reached |= stats.limit_reached;
    }
    let block_bytes = size_of::<fusion::kernels::integrate::Block>();
    bites(
        "D17, bytes",
        (naive.len() * block_bytes) as f64,
        LIMIT as f64,
    );
    holds("D17, bytes", volume.memory_bytes() as f64, LIMIT as f64);
    assert!(
        limit_reached && volume.refused_count() > 0,
        "refusals are said and counted"
    );
    assert!(volume.block_count() > 300, "the budget is used");
    // Still at work: what is there is updated.
    let wall = vec![2.0; 16 * 12];
    let stats = volume
        .integrate(&wall, &camera, &Pose::IDENTITY)
        .expect("one value per pixel");
    assert!(stats.blocks_visible > 0);
}

#[test]
fn hc_d17_a_block_needs_two_rays() {
    let camera = camera(16);
    let mut volume = Volume::new(VolumeConfig::default()).expect("a usable config");
    let mut speck = vec![0.0; 16 * 12];
    speck[6 * 16 + 8] = 1.0;
    volume
        .integrate(&speck, &camera, &Pose::IDENTITY)
        .expect("one value per pixel");
    assert_eq!(volume.block_count(), 0, "one ray is not enough");
    volume
        .integrate(&speck, &camera, &Pose::IDENTITY)
        .expect("one value per pixel");
    assert!(volume.block_count() > 0, "a second frame confirms it");
}
