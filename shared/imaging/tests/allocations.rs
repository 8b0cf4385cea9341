//! Development and registration take no memory per frame once they are made.

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicU64, Ordering};

use geometry::{DVec3, Intrinsics, Pose};
use imaging::{
    ColorLayout, Corrector, Developer, LinearPixel, Registration, Response, Vignetting, YuvCoding,
};

/// Counts the allocations of all threads.
struct Counting;

static COUNT: AtomicU64 = AtomicU64::new(0);

#[expect(unsafe_code, reason = "an allocator that counts")]
// SAFETY: all work is the system allocator's; counting neither allocates nor panics.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        COUNT.fetch_add(1, Ordering::Relaxed);
        // SAFETY: the caller keeps the contract of `alloc`, which is passed on as it is.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: the pointer came from `System` above.
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        COUNT.fetch_add(1, Ordering::Relaxed);
        // SAFETY: the pointer came from `System` above.
        unsafe { System.realloc(pointer, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Allocations of 20 runs of `frame` after 100 that warm up frame and threads (the pool takes memory at the first steal).
fn counted(mut frame: impl FnMut()) -> u64 {
    for _ in 0..100 {
        frame();
    }
    let before = COUNT.load(Ordering::Relaxed);
    for _ in 0..20 {
        frame();
    }
    COUNT.load(Ordering::Relaxed) - before
}

#[test]
fn a_frame_takes_no_memory() {
    const SIZE: [u32; 2] = [320, 240];
    let [width, height] = SIZE;
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(2)
        .build()
        .unwrap();
    let response = Response::gamma(2.2).unwrap();
    let corrector = Corrector::new(&response, &Vignetting::none(), width, height, 1.0);
    let mut pixels = vec![LinearPixel::INVALID; (width * height) as usize];
    let mut grey = vec![0.0; (width / 2 * (height / 2)) as usize];
    for layout in [
        ColorLayout::Rgb8,
        ColorLayout::BayerGrbg,
        ColorLayout::Yuyv(YuvCoding::default()),
    ] {
        // With clipped samples, whose marks grow.
        let bytes = layout.frame_bytes(width, height);
        let frame: Vec<u8> = (0..bytes).map(|at| (at % 256) as u8).collect();
        let mut developer = Developer::new(&corrector, layout).unwrap();
        let count = pool.install(|| {
            counted(|| {
                developer
                    .develop(&frame, true, &mut pixels, &mut grey)
                    .unwrap();
            })
        });
        assert_eq!(count, 0, "{layout:?}: {count} allocations");
    }
    let camera = |f: f64| Intrinsics::pinhole(width, height, f, f, 160.0, 120.0).unwrap();
    let beside = Pose::from_translation(DVec3::new(0.025, 0.0, 0.0));
    let mut registration = Registration::new(&camera(290.0), &camera(270.0), &beside).unwrap();
    let depth = vec![1.0; pixels.len()];
    let mut registered = pixels.clone();
    let count = pool.install(|| {
        counted(|| {
            registration
                .register(&depth, &pixels, &mut registered)
                .unwrap();
        })
    });
    assert_eq!(count, 0, "registration");
}
