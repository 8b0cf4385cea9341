//! Colour through the volume: fused, meshed, predicted.

use std::num::NonZeroU32;

use fusion::{
    FusionError, MeshConfig, ModelView, SETTLED_COLORS, Volume, VolumeConfig, extract_mesh,
    remove_small_components,
};
use geometry::{Intrinsics, Pose};
use imaging::LinearPixel;

/// Radiance of a wall whose left half is dark.
const HALVES: [[f32; 3]; 2] = [[0.1, 0.2, 0.3], [0.8, 0.4, 0.2]];

fn camera(width: u32) -> Intrinsics {
    let (w, h) = (f64::from(width), f64::from(width * 3 / 4));
    Intrinsics::pinhole(width, width * 3 / 4, w, w, 0.5 * w - 0.5, 0.5 * h - 0.5).expect("usable")
}

fn volume() -> Volume {
    Volume::new(VolumeConfig {
        voxel_size: 0.005,
        ..VolumeConfig::default()
    })
    .expect("a usable config")
}

/// One pixel per depth: halves by column.
fn halves(width: usize, height: usize) -> Vec<LinearPixel> {
    (0..width * height)
        .map(|n| LinearPixel::from_radiance(HALVES[usize::from(n % width >= width / 2)], false))
        .collect()
}

#[test]
fn colour_reaches_the_mesh_and_the_prediction() {
    let camera = camera(160);
    let wall = vec![0.6; 160 * 120];
    let mut volume = volume();
    for _ in 0..3 {
        volume
            .integrate_colored(&wall, &halves(160, 120), &camera, &Pose::IDENTITY)
            .expect("one value per pixel");
    }
    let mut mesh = extract_mesh(&volume, &MeshConfig::default());
    remove_small_components(&mut mesh, 10);
    assert_eq!(mesh.radiance.len(), mesh.positions.len());
    assert!(mesh.positions.len() > 1000);
    for (position, radiance) in mesh.positions.iter().zip(&mesh.radiance) {
        // Voxels beside the border take either.
        if position.x.abs() > 0.01 {
            let expected = HALVES[usize::from(position.x > 0.0)];
            let off = (0..3).map(|n| (radiance[n] - expected[n]).abs());
            assert!(off.fold(0.0, f32::max) < 1e-3, "{radiance:?} at {position}");
        }
    }
    let mut view = ModelView::new(&camera, &Pose::IDENTITY);
    volume.predict(&camera, &Pose::IDENTITY, &mut view);
    for (x, half) in [(40, 0), (120, 1)] {
        let [red, green, blue] = HALVES[half];
        let luminance = 0.2126 * red + 0.7152 * green + 0.0722 * blue;
        assert!((view.at(x, 60).grey - luminance).abs() < 1e-3);
    }
    // Shaded afterwards it is the same.
    let shaded: Vec<f32> = view.surfels.iter().map(|surfel| surfel.grey).collect();
    view.surfels.iter_mut().for_each(|surfel| surfel.grey = 0.0);
    volume.shade(&mut view);
    let again: Vec<f32> = view.surfels.iter().map(|surfel| surfel.grey).collect();
    assert_eq!(again, shaded);
}

#[test]
fn a_settled_block_takes_colour_in_its_turn() {
    const STRIDE: u32 = 4;
    let camera = camera(96);
    let wall = vec![0.6; 96 * 72];
    let [bright, dark] =
        [1.0, 0.0].map(|v| vec![LinearPixel::from_radiance([v; 3], false); 96 * 72]);
    let mut strided = Volume::new(VolumeConfig {
        settled_color_stride: NonZeroU32::new(STRIDE).expect("not zero"),
        ..volume().config().clone()
    })
    .expect("a usable config");
    let mut every = volume();
    let fuse = |volume: &mut Volume, color: &[LinearPixel]| {
        volume
            .integrate_colored(&wall, color, &camera, &Pose::IDENTITY)
            .expect("one value per pixel");
    };
    // One frame more: the first only remembers what it met once.
    for _ in 0..=SETTLED_COLORS {
        fuse(&mut strided, &bright);
        fuse(&mut every, &bright);
    }
    let positions = |volume: &Volume| extract_mesh(volume, &MeshConfig::default()).positions;
    let radiance = |volume: &Volume| extract_mesh(volume, &MeshConfig::default()).radiance;
    assert_eq!(radiance(&strided), radiance(&every), "not settled yet");
    let changed = |before: &[[f32; 3]], after: &[[f32; 3]]| {
        let pairs = before.iter().zip(after);
        pairs
            .filter(|(before, after)| before[0] != after[0])
            .count()
    };
    // In a round of turns every place darkens, each frame a part of them.
    let start = radiance(&strided);
    let mut before = start.clone();
    for _ in 0..STRIDE {
        fuse(&mut strided, &dark);
        let after = radiance(&strided);
        let part = changed(&before, &after);
        assert!(
            part > 0 && part < before.len(),
            "{part} of {}",
            before.len()
        );
        before = after;
    }
    assert_eq!(changed(&start, &before), start.len());
    // Depth is taken from every frame all the while.
    for _ in 0..STRIDE {
        fuse(&mut every, &dark);
    }
    assert_eq!(positions(&strided), positions(&every));
}

#[test]
fn a_volume_without_colour_pays_nothing_for_it() {
    let camera = camera(96);
    let pose = Pose::IDENTITY;
    let depth: Vec<f32> = (0..96 * 72).map(|n| 0.5 + 1e-3 * (n % 96) as f32).collect();
    let (mut plain, mut colored) = (volume(), volume());
    for _ in 0..2 {
        plain.integrate(&depth, &camera, &pose).expect("fits");
        colored
            .integrate_colored(&depth, &halves(96, 72), &camera, &pose)
            .expect("fits");
    }
    assert!(!plain.has_color() && colored.has_color());
    assert!(plain.memory_bytes() < colored.memory_bytes());
    let [mesh, colored_mesh] =
        [&plain, &colored].map(|volume| extract_mesh(volume, &MeshConfig::default()));
    assert!(mesh.radiance.is_empty() && !colored_mesh.radiance.is_empty());
    assert_eq!(
        mesh.positions, colored_mesh.positions,
        "colour moves nothing"
    );
    // Colour that comes later finds its place.
    plain
        .integrate_colored(&depth, &halves(96, 72), &camera, &pose)
        .expect("fits");
    assert!(
        extract_mesh(&plain, &MeshConfig::default())
            .radiance
            .iter()
            .any(|r| r[0] > 0.0)
    );
}

#[test]
fn colour_beyond_the_memory_limit_is_said_and_left_out() {
    let camera = camera(96);
    let wall = vec![0.6; 96 * 72];
    let mut volume = volume();
    for _ in 0..2 {
        volume
            .integrate(&wall, &camera, &Pose::IDENTITY)
            .expect("fits");
    }
    let limit = volume.memory_bytes() + (100 << 10);
    let mut bounded = Volume::new(VolumeConfig {
        memory_limit_bytes: limit,
        ..volume.config().clone()
    })
    .expect("a usable config");
    for _ in 0..2 {
        bounded
            .integrate(&wall, &camera, &Pose::IDENTITY)
            .expect("fits");
    }
    let stats = bounded
        .integrate_colored(&wall, &halves(96, 72), &camera, &Pose::IDENTITY)
        .expect("one value per pixel");
    assert!(stats.limit_reached && !bounded.has_color());
    assert!(bounded.memory_bytes() <= limit);
    assert_eq!(bounded.block_count(), volume.block_count());
}

#[test]
fn a_colour_image_of_the_wrong_size_is_refused() {
    let camera = camera(64);
    let result = volume().integrate_colored(
        &[1.0; 64 * 48],
        &[LinearPixel::INVALID; 7],
        &camera,
        &Pose::IDENTITY,
    );
    let expected = FusionError::ColorSize {
        width: 64,
        height: 48,
        expected: 64 * 48,
        got: 7,
    };
    assert_eq!(result, Err(expected));
}
