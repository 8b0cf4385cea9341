//! Nothing is allocated per frame once warm: counted over all threads that frames pass.

#[path = "fuse/scene.rs"]
mod scene;
#[path = "record/source.rs"]
mod source;

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::io;
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use glintd::capture::{CaptureOptions, capture};
use glintd::fuse::FuseOptions;
use glintd::outcome::Outcome;
use glintd::status::StopFlag;
use sequence::file_layer::{self, FileLayer, WritePath};

/// Counts the allocations of every thread but the test's own, which starts the others and then only watches.
struct Counting;

thread_local! {
    static WATCHES: Cell<bool> = const { Cell::new(false) };
}

fn count() {
    if !WATCHES.get() {
        COUNT.fetch_add(1, Ordering::Relaxed);
    }
}

static COUNT: AtomicU64 = AtomicU64::new(0);

#[expect(unsafe_code, reason = "an allocator that counts")]
// SAFETY: all work is the system allocator's; counting neither allocates nor panics: the thread-local is a
// constant without a destructor.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count();
        // SAFETY: the caller keeps the contract of `alloc`, which is passed on as it is.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: the pointer came from `System` above.
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        count();
        // SAFETY: the pointer came from `System` above.
        unsafe { System.realloc(pointer, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Notes the count of allocations at every seal.
struct Noting {
    file: Box<dyn FileLayer>,
    counts: Arc<[AtomicU64; 256]>,
    seals: usize,
}

impl FileLayer for Noting {
    fn allocate(&mut self, offset: u64, bytes: u64) -> io::Result<()> {
        self.file.allocate(offset, bytes)
    }

    fn write_at(&mut self, offset: u64, bytes: &[u8]) -> io::Result<usize> {
        self.file.write_at(offset, bytes)
    }

    fn sync(&mut self, offset: u64, bytes: u64) -> io::Result<()> {
        if let Some(slot) = self.counts.get(self.seals) {
            slot.store(COUNT.load(Ordering::Relaxed), Ordering::Relaxed);
        }
        self.seals += 1;
        self.file.sync(offset, bytes)
    }

    fn set_len(&mut self, bytes: u64) -> io::Result<()> {
        self.file.set_len(bytes)
    }

    fn free_bytes(&mut self) -> io::Result<u64> {
        self.file.free_bytes()
    }

    fn release_before(&mut self, offset: u64) {
        self.file.release_before(offset);
    }
}

/// One test at a time counts.
static TURN: Mutex<()> = Mutex::new(());

/// Records `input` and says how many allocations there were at each sync.
fn counts(input: &Path, fuse: Option<FuseOptions>) -> (Outcome, Vec<u64>) {
    let output = input.with_file_name("out.glint");
    let source = format!("replay:{}?speed=max", input.display());
    let mut options = CaptureOptions::new(source.parse().unwrap(), output);
    options.reserve_bytes = Some(0);
    options.fuse = fuse;
    options.clock = {
        use std::sync::atomic::AtomicI64;
        // Five milliseconds a look: several chunks in a short test.
        static NANOS: AtomicI64 = AtomicI64::new(0);
        glintd::clock::HostClock {
            monotonic: || NANOS.fetch_add(5_000_000, Ordering::Relaxed),
            wall: || 0,
        }
    };
    let counts: Arc<[AtomicU64; 256]> = Arc::new(std::array::from_fn(|_| AtomicU64::new(0)));
    let noted = Arc::clone(&counts);
    options.make_layer = Some(Box::new(move |path: &Path| {
        Ok(Box::new(Noting {
            file: file_layer::create(path, WritePath::default())?,
            counts: Arc::clone(&noted),
            seals: 0,
        }))
    }));
    let outcome = capture(options, &StopFlag::default()).unwrap();
    let counts: Vec<u64> = counts
        .iter()
        .map(|count| count.load(Ordering::Relaxed))
        .take_while(|count| *count > 0)
        .collect();
    println!("allocations at each sync: {counts:?}");
    assert!(counts.len() > 20, "{counts:?}");
    (outcome, counts)
}

#[test]
fn nothing_is_allocated_per_frame_once_warm() {
    let _turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
    WATCHES.set(true);
    let folder = tempfile::tempdir().unwrap();
    let input = source::write(folder.path(), 3000, &[]);
    let (outcome, counts) = counts(&input, None);
    assert_eq!(outcome.frames_recorded, 6000);
    // From the third chunk to the one before the last: hundreds of frames through all threads.
    let (warm, late) = (counts[7], counts[counts.len() - 4]);
    assert_eq!(late - warm, 0, "{counts:?}");
}

#[test]
fn nothing_is_allocated_per_frame_that_is_fused_once_warm() {
    let _turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
    WATCHES.set(true);
    let folder = tempfile::tempdir().unwrap();
    // Nothing at first; then the path goes round and round, so that the surface is complete after some rounds.
    let rounds = (0..400).map(scene::Shot::From);
    let shots: Vec<scene::Shot> = [scene::Shot::Blank(0)].into_iter().chain(rounds).collect();
    let input = scene::write(folder.path(), &shots);
    let mut fuse = FuseOptions::default();
    fuse.live.volume.voxel_size = 0.01;
    let (outcome, counts) = counts(&input, Some(fuse));
    let fusion = &outcome.fusion;
    assert_eq!((outcome.frames_recorded, fusion.fused), (802, 400));
    // The last third: tracked, fused, recorded, and nothing new to be seen.
    let (warm, late) = (counts[2 * counts.len() / 3], counts[counts.len() - 8]);
    assert_eq!(late - warm, 0, "{counts:?}");
}

/// Most allocations for a photograph: the decoder is a library, and these are what it makes of its own.
const MOST_FOR_A_JPEG: u64 = 100;

#[test]
fn a_jpeg_costs_few_allocations_and_always_as_many() {
    let _turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
    WATCHES.set(true);
    let codes = imaging::Rgb8Image::from_fn(640, 480, |x, y| [x as u8, y as u8, (x ^ y) as u8]);
    let jpeg = imaging::encode_jpeg(&codes, 90).unwrap();
    let counts: Vec<u64> = std::thread::scope(|scope| {
        let decoding = scope.spawn(|| {
            let mut counts = Vec::with_capacity(10);
            for _ in 0..10 {
                let before = COUNT.load(Ordering::Relaxed);
                let decoded = imaging::decode_jpeg(&jpeg);
                counts.push(COUNT.load(Ordering::Relaxed) - before);
                assert!(decoded.is_ok());
            }
            counts
        });
        decoding.join().unwrap()
    });
    println!("allocations for each photograph: {counts:?}");
    assert!(
        counts[1..]
            .iter()
            .all(|count| *count == counts[1] && *count < MOST_FOR_A_JPEG)
    );
}
