//! The plug is pulled at any byte: the file is closed, and holds every frame that came whole.

use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64Mcg;
use sequence::GapCause;
use virtual_carmine::{Faults, Personality};

use crate::transport::{film, small};

#[test]
fn pulled_at_any_byte_the_file_is_sealed() {
    let mut random = Pcg64Mcg::seed_from_u64(4);
    // The first packets, then anywhere in the first frames.
    let mut places: Vec<u64> = vec![1, 11, 12, 13, 500, 3072, 3073];
    places.extend((0..13).map(|_| random.random_range(1..2_000_000)));
    for bytes in places {
        let faults = Faults {
            unplug_after_bytes: Some(bytes),
            ..Faults::default()
        };
        let filmed = film(Personality::carmine_1_09(), faults, small());
        assert_eq!(filmed.outcome.reason, "unplugged", "at {bytes}");
        assert!(
            filmed.verified.findings.is_empty(),
            "at {bytes}: {:?}",
            filmed.verified
        );
        assert!(
            filmed.outcome.is_whole(),
            "at {bytes}: {:?}",
            filmed.outcome.missing
        );
        let (depth, color) = filmed.assert_pixels();
        let delivered = [&filmed.counters.depth, &filmed.counters.image]
            .map(|stream| stream.frames_delivered as usize);
        assert_eq!([depth, color], delivered, "at {bytes}");
        let gaps = &filmed.recording.contents().gaps;
        assert!(
            gaps.iter()
                .all(|gap| gap.cause == Some(GapCause::Unplug) && gap.count == 1),
            "at {bytes}: {gaps:?}"
        );
    }
}
