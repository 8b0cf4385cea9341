//! What the camera does wrong on demand.

use serde::Deserialize;

/// All faults, none by default. Chances are from 0 to 1; counts run down to 0 and the fault is over.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Faults {
    /// Of the generator that all chances use.
    pub seed: u64,
    /// Requests that are refused.
    pub refusals: Vec<Refusal>,
    /// So many requests, the first ones, are never answered: a camera that still boots.
    pub unanswered_requests: u32,
    /// So many requests, the first ones, are not even taken: the transfer ends by the host's timeout.
    pub dead_requests: u32,
    /// So many replies come after a reply to another id.
    pub stale_replies: u32,
    /// Every reply comes after so many empty ones.
    pub empty_replies: u32,
    /// So many replies come in two parts.
    pub split_replies: u32,
    /// So many replies end early, and the rest never comes.
    pub cut_replies: u32,
    /// So many bytes that are no magic stand before every reply.
    pub garbage_bytes: usize,
    /// Chance of a packet to be left out; its id passes.
    pub packet_drop_chance: f64,
    /// Chance of a packet to be sent twice.
    pub packet_duplicate_chance: f64,
    /// Chance of a packet to have a bit of its header flipped.
    pub header_bit_chance: f64,
    /// Chance of a packet to have a bit of its payload flipped. No raw format can notice it.
    pub payload_bit_chance: f64,
    /// Chance of a frame to end early, with an END packet as if it were whole.
    pub short_frame_chance: f64,
    /// Chance of a frame to be the one before once more, under a stamp of its own.
    pub repeat_frame_chance: f64,
    /// Packets that say that the camera is in trouble.
    pub alarms: Vec<Alarm>,
    /// The endpoint gives nothing for a time, while the sensor goes on.
    pub stalls: Vec<Stall>,
    /// By how much the camera's clock is fast, in millionths.
    pub clock_drift_ppm: f64,
    /// The camera's counter when it is plugged in; near 2³² it wraps soon.
    pub first_ticks: u32,
    /// Unplugged so long after the first call.
    pub unplug_after_nanos: Option<i64>,
    /// Unplugged when the host has taken so many bytes of all streams.
    pub unplug_after_bytes: Option<u64>,
    /// Chance of a read to be ended early, anywhere.
    pub transfer_split_chance: f64,
    /// What is packed otherwise than the protocol says.
    pub deviation: Option<Deviation>,
}

/// Requests to refuse.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Refusal {
    /// Of this opcode; of any when absent.
    pub opcode: Option<u16>,
    /// The error word: 13 is "not ready".
    pub error: u16,
    /// So many times.
    pub count: u32,
}

/// A time without data.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Stall {
    /// On this stream.
    pub stream: StreamName,
    /// From so long after the stream was switched on.
    pub after_nanos: i64,
    /// For so long.
    pub length_nanos: i64,
}

/// A packet between two frames that is no part of either.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Alarm {
    /// On this stream.
    pub stream: StreamName,
    /// So long after the stream was switched on, before the frame that begins then.
    pub after_nanos: i64,
    /// What it says.
    pub trouble: Trouble,
}

/// What is wrong with the camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Trouble {
    /// The projector has failed.
    Projector,
    /// It is too hot.
    Overheat,
}

/// A stream, as configuration names it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum StreamName {
    /// Depth.
    Depth,
    /// Colour or infrared.
    Image,
}

/// Ways to pack otherwise than the protocol says. A comparison of pixels that does not notice them proves nothing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Deviation {
    /// Depth that is packed in 11 or 12 bits or compressed has the half bytes of each byte swapped.
    NibbleOrder,
    /// U and V of colour change places.
    ChromaSwapped,
    /// Compressed colour goes on with the last predictors in a new line.
    PredictorsKept,
}
