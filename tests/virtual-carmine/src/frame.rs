//! A frame on its way from the sensor to the memory.

use ps1080::stream::{HEADER_BYTES, PacketHeader, PacketKind};
use rand::RngExt as _;
use rand_pcg::Pcg64Mcg;

use crate::counters::StreamCounters;
use crate::faults::{Faults, StreamName, Trouble};

/// A frame on its way from the sensor: its packets, ready one after the other.
#[derive(Default)]
pub(crate) struct Frame {
    pub(crate) film_index: u64,
    pub(crate) stamp: u32,
    pub(crate) begin_device_nanos: i64,
    pub(crate) readout_nanos: i64,
    pub(crate) wire: Vec<u8>,
    pub(crate) packet_ends: Vec<usize>,
    pub(crate) next_packet: usize,
    pub(crate) is_whole: bool,
}

impl Frame {
    /// Puts the alarms that are due before all packets: how many. They have no place in the count of ids.
    pub(crate) fn prepend_alarms(
        &mut self,
        faults: &Faults,
        stream: StreamName,
        since_nanos: i64,
        sent_count: usize,
    ) -> usize {
        let own = faults.alarms.iter().filter(|alarm| alarm.stream == stream);
        let mut count = 0;
        for alarm in own.skip(sent_count) {
            if alarm.after_nanos > since_nanos {
                break;
            }
            let header = PacketHeader {
                kind: match alarm.trouble {
                    Trouble::Projector => PacketKind::ProjectorFault,
                    Trouble::Overheat => PacketKind::Overheat,
                },
                id: 0,
                payload_bytes: 0,
                field: self.stamp,
            };
            self.wire.extend(header.encode().into_iter().flatten());
            self.packet_ends.push(self.wire.len());
            count += 1;
        }
        count
    }

    /// Adds a packet, with the faults that chance gives it.
    pub(crate) fn append(
        &mut self,
        header: &[u8],
        payload: &[u8],
        faults: &Faults,
        random: &mut Pcg64Mcg,
        counters: &mut StreamCounters,
    ) {
        if happens(faults.packet_drop_chance, random) {
            counters.dropped_packets += 1;
            self.is_whole = false;
            return;
        }
        let is_double = happens(faults.packet_duplicate_chance, random);
        let in_header = happens(faults.header_bit_chance, random);
        let in_payload = happens(faults.payload_bit_chance, random) && !payload.is_empty();
        let at = self.wire.len();
        self.wire.extend_from_slice(header);
        self.wire.extend_from_slice(payload);
        for (is_flipped, from, to) in [
            (in_header, at, at + HEADER_BYTES),
            (in_payload, at + HEADER_BYTES, self.wire.len()),
        ] {
            if is_flipped {
                self.wire[random.random_range(from..to)] ^= 1 << random.random_range(0..8);
                counters.flipped_packets += 1;
                self.is_whole = false;
            }
        }
        self.packet_ends.push(self.wire.len());
        if is_double {
            counters.duplicated_packets += 1;
            self.wire.extend_from_within(at..);
            self.packet_ends.push(self.wire.len());
        }
    }

    pub(crate) fn packet(&self, number: usize) -> &[u8] {
        let before = number.checked_sub(1);
        let from = before.map_or(0, |before| self.packet_ends[before]);
        &self.wire[from..self.packet_ends[number]]
    }

    /// When packet `number` has been read out, in the camera's time: packets follow each other by their bytes.
    pub(crate) fn packet_nanos(&self, number: usize) -> i64 {
        let total = self.wire.len().max(1) as i64;
        self.begin_device_nanos + self.readout_nanos * self.packet_ends[number] as i64 / total
    }
}

/// Draws only where there is a chance, so that a fault that is off changes no other's luck.
pub(crate) fn happens(chance: f64, random: &mut Pcg64Mcg) -> bool {
    chance > 0.0 && random.random_bool(chance.min(1.0))
}
