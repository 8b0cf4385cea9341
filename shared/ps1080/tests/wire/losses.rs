//! What is lost is counted, with its cause, and costs the frames that it must.

use ps1080::Damage;
use ps1080::samples::SampleFormat;
use ps1080::stream::{
    DeviceTicks, FrameEvent, FrameReceiver, HEADER_BYTES, LossCause, PacketKind, Packetiser,
    Padding, StreamKind,
};

use super::receive::{Host, Outcome, packets, ticks_of};

const COUNT: usize = 12;
/// Packets a frame: START, four BUFFER, END.
const PACKETS: usize = 6;

fn codes(frame: usize) -> Vec<u16> {
    (0..COUNT).map(|at| (frame * 100 + at) as u16).collect()
}

fn stream(frame_count: usize) -> Vec<Vec<u8>> {
    let payloads: Vec<Vec<u8>> = (0..frame_count)
        .map(|frame| {
            codes(frame)
                .iter()
                .flat_map(|code| code.to_le_bytes())
                .collect()
        })
        .collect();
    let packets = packets(&payloads, HEADER_BYTES + 4);
    assert_eq!(packets.len(), frame_count * PACKETS);
    packets
}

fn receive(packets: &[Vec<u8>]) -> Host {
    let mut host = Host::new(SampleFormat::Raw16, COUNT);
    host.transfer(&packets.concat());
    host
}

fn whole(frame: usize) -> Outcome {
    Outcome::Frame(ticks_of(frame), codes(frame))
}

#[test]
fn every_packet_that_is_missing_is_noticed() {
    for missing in 0..PACKETS {
        let mut packets = stream(3);
        packets.remove(PACKETS + missing);
        let host = receive(&packets);
        let cause = LossCause::PacketsMissing(1);
        let expected = match missing {
            // Nothing of the frame is taken.
            0 => Outcome::Lost(cause, 0),
            _ => Outcome::Lost(cause, 4 * missing as u64),
        };
        assert_eq!(host.outcomes, [whole(0), expected, whole(2)], "{missing}");
        let counts = host.receiver.counts();
        assert_eq!((counts.lost_count, counts.missing_packet_count), (1, 1));
    }
}

#[test]
fn frames_that_are_missing_are_one_loss_with_all_their_packets() {
    let mut packets = stream(5);
    packets.drain(PACKETS..3 * PACKETS);
    let host = receive(&packets);
    let lost = Outcome::Lost(LossCause::PacketsMissing(2 * PACKETS as u16), 0);
    assert_eq!(host.outcomes, [whole(0), lost, whole(3), whole(4)]);
}

#[test]
fn packets_that_come_twice_are_left_out() {
    for repeated in 0..3 * PACKETS {
        let mut packets = stream(3);
        packets.insert(repeated, packets[repeated].clone());
        let host = receive(&packets);
        assert_eq!(host.outcomes, [0, 1, 2].map(whole), "{repeated}");
        assert_eq!(host.receiver.counts().repeated_packet_count, 1);
    }
}

#[test]
fn swapped_packets_cost_their_frames() {
    for first in 0..2 * PACKETS - 1 {
        let mut packets = stream(3);
        packets.swap(first, first + 1);
        let host = receive(&packets);
        let frames: Vec<&Outcome> = host
            .outcomes
            .iter()
            .filter(|outcome| matches!(outcome, Outcome::Frame(..)))
            .collect();
        assert!(
            frames
                .iter()
                .all(|&frame| *frame == whole(0) || *frame == whole(1) || *frame == whole(2))
        );
        assert!(frames.len() < 3 && host.receiver.counts().lost_count > 0);
        assert_eq!(host.outcomes.last(), Some(&whole(2)));
    }
}

#[test]
fn ids_wrap_and_may_begin_anew_with_a_frame() {
    let payload = [1; 2 * COUNT];
    let mut packetiser = Packetiser::new(StreamKind::Depth, HEADER_BYTES + 4).unwrap();
    packetiser.skip_ids(65_530);
    let mut host = Host::new(SampleFormat::Raw16, COUNT);
    let send = |host: &mut Host, packetiser: &mut Packetiser, tick| {
        for packet in packetiser.frame(&payload, Padding::default(), DeviceTicks(tick)) {
            host.transfer(&packet.header);
            host.transfer(packet.payload);
        }
    };
    for tick in 0..3 {
        send(&mut host, &mut packetiser, tick);
    }
    assert_eq!(packetiser.next_id(), 12);
    // The stream is started again.
    let mut again = Packetiser::new(StreamKind::Depth, HEADER_BYTES + 4).unwrap();
    send(&mut host, &mut again, 3);
    let ticks: Vec<u32> = host
        .outcomes
        .iter()
        .map(|outcome| match outcome {
            Outcome::Frame(ticks, _) => ticks.0,
            other => panic!("{other:?}"),
        })
        .collect();
    assert_eq!(ticks, [0, 1, 2, 3]);
    // An id of 0 within a frame is no beginning.
    let mut packets = stream(3);
    packets[PACKETS + 2][4..6].copy_from_slice(&[0, 0]);
    let host = receive(&packets);
    let lost = Outcome::Lost(LossCause::IdRestarted, 8);
    assert_eq!(host.outcomes, [whole(0), lost, whole(2)]);
}

#[test]
fn a_frame_needs_its_start_and_its_end() {
    let mut packets = stream(3);
    packets.drain(..2);
    let late = receive(&packets);
    let lost = Outcome::Lost(LossCause::StartMissing, 0);
    assert_eq!(late.outcomes, [lost, whole(1), whole(2)]);

    // Ids go on, so nothing but the missing END tells.
    let mut packets = stream(3);
    packets.remove(2 * PACKETS - 1);
    for packet in &mut packets[2 * PACKETS - 1..] {
        packet[4] -= 1;
    }
    let host = receive(&packets);
    let lost = Outcome::Lost(LossCause::EndMissing, 20);
    assert_eq!(host.outcomes, [whole(0), lost, whole(2)]);
}

#[test]
fn a_wrong_size_field_costs_the_frame_and_no_other() {
    for packet in 0..PACKETS {
        for size in [0_u16, 11, 12, 13, 15, 17, 40, 90, 60_000] {
            let mut packets = stream(3);
            packets[PACKETS + packet][6..8].copy_from_slice(&size.to_be_bytes());
            let host = receive(&packets);
            let frames = host
                .outcomes
                .iter()
                .filter(|outcome| matches!(outcome, Outcome::Frame(..)));
            for frame in frames {
                assert!(*frame == whole(0) || *frame == whole(2), "{size}");
            }
        }
    }
}

#[test]
fn bytes_that_are_cut_out_never_give_a_wrong_frame_without_a_word() {
    let stream = stream(4).concat();
    for from in 0..stream.len() {
        for count in 1..40.min(stream.len() - from) {
            let mut host = Host::new(SampleFormat::Raw16, COUNT);
            host.transfer(&stream[..from]);
            host.transfer(&stream[from + count..]);
            for (index, outcome) in host.outcomes.iter().enumerate() {
                let is_right = match outcome {
                    Outcome::Frame(..) => (0..4).any(|frame| *outcome == whole(frame)),
                    _ => true,
                };
                // Exactly a packet's length within an END: what is left fits together, and the next id tells too late.
                let is_spliced = count % (HEADER_BYTES + 4) == 0;
                let is_doubted_here = match host.outcomes.get(index + 1) {
                    Some(Outcome::Lost(LossCause::GarbageAfterEnd, _)) => true,
                    Some(Outcome::Lost(LossCause::PacketsMissing(_), _)) => is_spliced,
                    _ => false,
                };
                assert!(
                    is_right || is_doubted_here,
                    "{count} bytes from {from}: {outcome:?}"
                );
            }
        }
    }
}

#[test]
fn a_payload_of_another_size_is_no_frame() {
    let short = vec![0; 2 * COUNT - 1];
    let long = vec![0; 2 * COUNT + 1];
    let mut host = Host::new(SampleFormat::Raw16, COUNT);
    host.transfer(&packets(&[short, long], 64).concat());
    assert_eq!(
        host.outcomes,
        [
            Outcome::Damaged(Damage::Short { missing_count: 1 }),
            Outcome::Damaged(Damage::Excess)
        ]
    );
}

#[test]
fn faults_are_said_and_other_packets_counted() {
    let mut packets = stream(2);
    let other = |code: u16| {
        let [low, high] = code.to_le_bytes();
        vec![0x52, 0x42, low, high, 9, 9, 0, 14, 0, 0, 0, 0, 1, 2]
    };
    packets.insert(9, other(0xDEAD));
    packets.insert(8, other(0xF31F));
    packets.insert(3, other(0xA200));
    packets.insert(3, other(0x8100));
    let host = receive(&packets);
    let faults = [PacketKind::Overheat, PacketKind::ProjectorFault].map(Outcome::Fault);
    assert_eq!(
        host.outcomes,
        [whole(0), faults[0].clone(), faults[1].clone(), whole(1)]
    );
    assert_eq!(host.receiver.counts().foreign_packet_count, 2);
}

#[test]
fn the_stamp_of_a_frame_is_that_of_its_end_and_depth_begins_with_padding() {
    for (kind, expected) in [
        (
            StreamKind::Depth,
            Padding {
                before: 3,
                after: 4,
            },
        ),
        (StreamKind::Image, Padding::default()),
    ] {
        let mut packetiser = Packetiser::new(kind, 64).unwrap();
        let mut receiver = FrameReceiver::new(kind);
        let padding = Padding {
            before: 3,
            after: 4,
        };
        let mut events = Vec::new();
        for packet in packetiser.frame(&[], padding, DeviceTicks(77)) {
            let mut transfer = packet.header.as_slice();
            while let Some(event) = receiver.next(&mut transfer) {
                events.push(match event {
                    FrameEvent::Started(padding) => Ok(padding),
                    FrameEvent::Ended(ticks) => Err(ticks),
                    other => panic!("{other:?}"),
                });
            }
        }
        assert_eq!(events, [Ok(expected), Err(DeviceTicks(77))]);
    }
}
