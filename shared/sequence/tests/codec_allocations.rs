//! Encoders and decoders allocate when they are made, and nothing per frame.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use sequence::codecs::{
    ColorDecoder, ColorEncoder, ColorFormat, DepthCodec, DepthDecoder, DepthEncoder,
};

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

/// Allocations of this thread during `work`.
fn allocations(work: impl FnOnce()) -> u64 {
    let before = COUNT.get();
    work();
    COUNT.get() - before
}

#[test]
fn a_warm_codec_allocates_nothing_per_frame() {
    let (width, height) = (64, 48);
    let scene = |frame: usize| -> Vec<u16> {
        let value = |index: usize| (index % 7 * 40 + index / 64 * 7 + 600 + 13 * frame) as u16;
        (0..64 * 48)
            .map(|index| if index % 5 == 0 { 0 } else { value(index) })
            .collect()
    };
    let frames: Vec<_> = (0..6).map(scene).collect();
    let noise: Vec<u16> = (0..64 * 48_u32)
        .map(|i| (i.wrapping_mul(2_654_435_761) >> 13) as u16)
        .collect();
    let mut encoder = DepthEncoder::of_values(width, height, None).unwrap();
    let mut decoder = DepthDecoder::new(width, height).unwrap();
    let mut payload = vec![0; encoder.max_payload_bytes()];
    let mut decoded = vec![0; 64 * 48];
    let mut new_table_count = 0;
    let mut pass = |samples: &[u16], codec| {
        let encoded = encoder.encode(samples, codec, &mut payload).unwrap();
        let bytes = &payload[..encoded.byte_count];
        decoder
            .decode(bytes, encoder.table(), &mut decoded)
            .unwrap();
        assert!(decoded == samples);
        new_table_count += u32::from(encoded.has_new_table);
    };
    pass(&frames[0], DepthCodec::Fast);
    let count = allocations(|| {
        for codec in [DepthCodec::Fast, DepthCodec::Dense] {
            for samples in frames.iter().chain([&noise]) {
                pass(samples, codec);
            }
        }
    });
    assert_eq!(count, 0, "allocations of 14 warm depth frames");
    assert!(new_table_count > 1, "the table was extended meanwhile");

    for format in [
        ColorFormat::BayerGrbg,
        ColorFormat::Uyvy,
        ColorFormat::Rgb8,
        ColorFormat::Infrared10,
    ] {
        let bytes = format.frame_bytes(width, height).unwrap();
        let frame: Vec<u8> = (0..bytes).map(|index| (index / 9) as u8).collect();
        let mut encoder = ColorEncoder::new(format, width, height).unwrap();
        let mut decoder = ColorDecoder::new(format, width, height).unwrap();
        let mut payload = vec![0; encoder.max_payload_bytes()];
        let mut decoded = vec![0; bytes];
        let mut pass = || {
            let length = encoder.encode(&frame, &mut payload).unwrap();
            decoder.decode(&payload[..length], &mut decoded).unwrap();
        };
        pass();
        assert_eq!(allocations(|| (0..5).for_each(|_| pass())), 0, "{format:?}");
        assert_eq!(decoded, frame);
    }
}
