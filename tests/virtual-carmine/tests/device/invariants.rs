//! What holds whatever the host does.

use ps1080::host::REQUEST_MAGIC;
use ps1080::parameter::Parameter;
use ps1080::stream::StreamKind;
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64Mcg;
use virtual_carmine::{Bus, Counters, Faults, Personality, Setup, TestPattern, VirtualCarmine};

use crate::host::{Host, MILLISECOND, SECOND, SEED};

fn personalities() -> [Personality; 4] {
    [
        Personality::carmine_1_09(),
        Personality::carmine_1_08(),
        Personality::firmware_5_4(),
        Personality::firmware_5_1(),
    ]
}

/// A request that is one more often than not, with numbers that mean something more often than not.
fn request(random: &mut Pcg64Mcg) -> Vec<u8> {
    let word_count = random.random_range(0..8_u16);
    let announced = if random.random_bool(0.1) {
        random.random()
    } else {
        word_count
    };
    let mut packet = REQUEST_MAGIC.to_vec();
    packet.extend(announced.to_le_bytes());
    packet.extend(random.random_range(0..45_u16).to_le_bytes());
    packet.extend(random.random::<u16>().to_le_bytes());
    for _ in 0..word_count {
        let word: u16 = if random.random_bool(0.8) {
            random.random_range(0..90)
        } else {
            random.random()
        };
        packet.extend(word.to_le_bytes());
    }
    if random.random_bool(0.05) {
        packet.truncate(random.random_range(0..packet.len()));
    }
    packet
}

#[test]
fn no_host_makes_it_panic() {
    let mut random = Pcg64Mcg::seed_from_u64(5);
    for unit in personalities() {
        let film = Box::new(TestPattern::with_cycle(1, 1));
        let mut camera = VirtualCarmine::new(unit, film, Faults::default());
        let mut now_nanos = 0;
        for _ in 0..5_000 {
            now_nanos += random.random_range(0..200_000);
            let mut data = request(&mut random);
            let length = data.len() as u16;
            camera.control(now_nanos, Setup::vendor_out(length), &mut data);
            let mut reply = vec![0; random.random_range(0..600)];
            camera.control(now_nanos, Setup::vendor_in(random.random()), &mut reply);
            let setup = Setup {
                request_type: random.random(),
                request: random.random_range(0..14),
                value: random.random_range(0..0x400),
                index: random.random_range(0..2),
                length: random.random_range(0..300),
            };
            camera.control(now_nanos, setup, &mut reply);
            let mut buffer = vec![0; random.random_range(0..2_000)];
            camera.read(now_nanos, random.random_range(0x80..0x85), &mut buffer);
            camera.set_alt_setting(now_nanos, random.random_range(0..200) / 50);
        }
    }
}

/// All bytes of both endpoints in half a second, and the camera's counters.
fn transcript(transfer_bytes: usize, faults: Faults) -> ([Vec<u8>; 2], Counters) {
    let mut host = Host::new(Personality::carmine_1_09(), faults);
    host.set(Parameter::Stream1Mode, 2);
    host.set(Parameter::Stream0Mode, 1);
    let mut bytes = [Vec::new(), Vec::new()];
    let mut token = 0;
    let until_nanos = host.now_nanos + SECOND / 2;
    for _ in 0..(400_000 / transfer_bytes) {
        for endpoint in [0x81, 0x82] {
            token += 2;
            let own = token | u64::from(endpoint & 1);
            host.bus
                .submit(host.now_nanos, endpoint, own, transfer_bytes);
        }
    }
    while host.now_nanos < until_nanos {
        host.now_nanos += MILLISECOND;
        host.bus.advance(host.now_nanos);
        while let Some(done) = host.bus.completed() {
            let is_depth = done.token & 1;
            bytes[is_depth as usize].extend(&done.data);
            token += 2;
            let endpoint = 0x82 - is_depth as u8;
            host.bus.recycle(done.data);
            host.bus
                .submit(host.now_nanos, endpoint, token | is_depth, transfer_bytes);
        }
    }
    (bytes, host.bus.camera().counters())
}

#[test]
fn the_same_calls_give_the_same_bytes() {
    let faults = Faults {
        seed: 9,
        packet_drop_chance: 0.01,
        header_bit_chance: 0.01,
        packet_duplicate_chance: 0.01,
        transfer_split_chance: 0.1,
        ..Faults::default()
    };
    let first = transcript(20_480, faults.clone());
    assert!(first.1.depth.dropped_packets > 0);
    assert!(first == transcript(20_480, faults));
}

#[test]
fn the_size_of_transfers_changes_no_byte() {
    let (small, counters) = transcript(512, Faults::default());
    assert_eq!(counters.depth.fifo_lost_bytes, 0);
    let (large, _) = transcript(20_480, Faults::default());
    for (small, large) in small.iter().zip(&large) {
        assert!(large.len() > 400_000);
        // The last, unfinished transfer may hold some.
        let length = small.len().min(large.len());
        assert!(small[..length] == large[..length]);
    }
}

#[test]
fn looking_late_changes_no_byte_while_transfers_are_queued() {
    let bytes = |step_nanos: i64| -> Vec<u8> {
        let film = Box::new(TestPattern::new(SEED));
        let camera = VirtualCarmine::new(Personality::carmine_1_09(), film, Faults::default());
        let mut host = Host::new(Personality::carmine_1_09(), Faults::default());
        host.bus = Bus::new(camera);
        host.set(Parameter::Stream1Mode, 2);
        for token in 0..100 {
            host.bus.submit(host.now_nanos, 0x81, token, 20_480);
        }
        let mut now_nanos = host.now_nanos;
        let until_nanos = now_nanos + SECOND / 4;
        while now_nanos < until_nanos {
            now_nanos = (now_nanos + step_nanos).min(until_nanos);
            host.bus.advance(now_nanos);
        }
        assert_eq!(host.bus.camera().counters().depth.fifo_lost_bytes, 0);
        assert!(host.bus.camera().delivered(StreamKind::Depth).len() > 4);
        std::iter::from_fn(|| host.bus.completed())
            .flat_map(|done| done.data)
            .collect()
    };
    assert!(bytes(MILLISECOND / 10) == bytes(SECOND));
}
