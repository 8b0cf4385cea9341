//! Tracking, fusing and predicting allocate nothing per frame once warm, unless blocks are made.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use fusion::live::{Effort, LiveConfig, LiveFusion, LiveRig};
use fusion::tracking::TrackState;
use fusion::{ModelView, Volume, VolumeConfig};
use geometry::{DVec3, Intrinsics, Pose};
use imaging::{DepthImage, LinearPixel};

/// The system's allocator, which counts for each thread.
struct Counting;

thread_local! {
    static COUNT: Cell<u64> = const { Cell::new(0) };
}

#[expect(unsafe_code, reason = "a global allocator is an unsafe trait")]
// SAFETY: every call goes to the system's allocator as it came; counting allocates nothing (a const
// thread-local without a destructor).
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        COUNT.set(COUNT.get() + 1);
        // SAFETY: the caller keeps the contract of `alloc`.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: the pointer came from `alloc` above, which is the system's.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Allocations of the only worker of the pool during `work`.
fn allocations(work: impl FnOnce()) -> u64 {
    let before = COUNT.get();
    work();
    COUNT.get() - before
}

#[test]
fn a_warm_volume_allocates_nothing_per_frame() {
    const WIDTH: usize = 160;
    const HEIGHT: usize = 120;
    let camera = Intrinsics::pinhole(160, 120, 150.0, 150.0, 79.5, 59.5).expect("usable");
    let depth: Vec<f32> = (0..WIDTH * HEIGHT)
        .map(|n| {
            if n % 11 == 0 {
                0.0
            } else {
                0.8 + (n % WIDTH) as f32 * 1e-3
            }
        })
        .collect();
    let color = vec![LinearPixel::from_radiance([0.5; 3], false); WIDTH * HEIGHT];
    let poses = [0.0, 1e-3, 2e-3].map(|x| Pose::from_translation(DVec3::new(x, 0.0, 0.0)));
    // One worker, on which everything runs: the count is that of its thread.
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(1)
        .build()
        .expect("a pool");
    pool.install(|| {
        let config = VolumeConfig {
            voxel_size: 0.01,
            ..VolumeConfig::default()
        };
        let mut volume = Volume::new(config).expect("usable");
        let mut view = ModelView::new(&camera, &Pose::IDENTITY);
        let mut frame = |pose: &Pose| {
            volume.predict(&camera, pose, &mut view);
            let stats = volume.integrate_colored(&depth, &color, &camera, pose);
            stats.expect("one value per pixel").blocks_allocated
        };
        for pose in poses.iter().chain(&poses).chain(&poses) {
            frame(pose);
        }
        let mut made = 0;
        let count = allocations(|| made = poses.iter().chain(&poses).map(&mut frame).sum());
        assert_eq!(made, 0, "no block is made");
        assert_eq!(count, 0, "allocations of 6 warm frames");
        assert!(view.surface_count() > 1000);
    });
}

#[test]
fn a_warm_tracker_allocates_nothing_per_frame() {
    let camera = Intrinsics::pinhole(160, 120, 150.0, 150.0, 79.5, 59.5).expect("usable");
    // A wall with low waves, so that the whole pose is observed, but some of it badly, with waves of colour.
    let wave = |x: u32, y: u32| (x as f32 * 0.11).sin() + (y as f32 * 0.13).cos();
    let depth = DepthImage::from_fn(160, 120, |x, y| 1.0 + 0.01 * wave(x, y) + x as f32 * 2e-3);
    let colors: Vec<LinearPixel> = (0..160 * 120)
        .map(|n| LinearPixel::from_radiance([0.4 + 0.1 * wave(n % 160, n / 160); 3], false))
        .collect();
    let rig = LiveRig {
        depth_camera: camera,
        color_camera: Some(camera),
        color_from_depth: Pose::IDENTITY,
    };
    let config = LiveConfig {
        volume: VolumeConfig {
            voxel_size: 0.01,
            ..VolumeConfig::default()
        },
        ..LiveConfig::default()
    };
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(1)
        .build()
        .expect("a pool");
    pool.install(|| {
        let mut live = LiveFusion::new(config, rig, Pose::IDENTITY).expect("usable");
        let mut time = 0;
        let mut frame = || {
            time += 33_000_000;
            if let Some(grey) = live.grey_mut() {
                for y in 0..grey.height() {
                    for x in 0..grey.width() {
                        *grey.at_mut(x, y) = 0.4 + 0.1 * wave(2 * x, 2 * y);
                    }
                }
            }
            live.load(&depth, true);
            let tracked = live.track(time, Effort::default());
            live.fuse(&depth, Some(&colors)).expect("a frame");
            tracked.state
        };
        for _ in 0..6 {
            frame();
        }
        let mut states = [TrackState::Lost; 6];
        let count = allocations(|| states = std::array::from_fn(|_| frame()));
        assert_eq!(states, [TrackState::Ok; 6]);
        assert_eq!(count, 0, "allocations of 6 warm frames");
        let photometric = live.last_alignment().and_then(|found| found.photometric);
        assert!(photometric.is_some(), "the photograph counted");
    });
}
