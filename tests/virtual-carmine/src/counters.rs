//! What the camera knows of itself: tests assert on these, not on what a host believes.

use serde::Serialize;

/// Counts since the camera was plugged in.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Counters {
    /// Of the stream of depth.
    pub depth: StreamCounters,
    /// Of the stream of colour or infrared.
    pub image: StreamCounters,
    /// Requests of the host protocol that came.
    pub request_count: u64,
    /// Those that were refused, on demand or because they are wrong.
    pub refused_count: u64,
    /// Times that a reply was asked for and none was ready.
    pub empty_reply_count: u64,
}

/// Counts of one stream.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct StreamCounters {
    /// Frames that the sensor began.
    pub frames_filmed: u64,
    /// Frames of which the host took every byte, unharmed; packets may have come twice.
    pub frames_delivered: u64,
    /// Frames of which something was lost or harmed on the way to the host. When all has been fetched, these and the
    /// delivered ones are all that were filmed, but for one that was under way when the stream was switched off.
    pub frames_damaged: u64,
    /// Packets made, and those that a fault took away or doubled too.
    pub packets_made: u64,
    /// Packets that found no room in the FIFO.
    pub fifo_lost_packets: u64,
    /// Their bytes, headers included.
    pub fifo_lost_bytes: u64,
    /// Packets that a fault kept back.
    pub dropped_packets: u64,
    /// Packets that a fault sent twice.
    pub duplicated_packets: u64,
    /// Packets in which a fault flipped a bit.
    pub flipped_packets: u64,
    /// Frames that a fault ended early.
    pub shortened_frames: u64,
    /// Frames that a fault filmed twice.
    pub repeated_frames: u64,
    /// Bytes that the host took.
    pub delivered_bytes: u64,
}

/// A frame that the host took whole; see [`crate::VirtualCarmine::delivered`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DeliveredFrame {
    /// Number of the frame on the film.
    pub film_index: u64,
    /// Its stamp.
    pub ticks: u32,
    /// When its last byte could be taken, nanoseconds of the host.
    pub ready_nanos: i64,
}
