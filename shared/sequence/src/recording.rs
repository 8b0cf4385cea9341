//! Reading a recording through a map.

use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use geometry::Pose;
use imaging::{Image, Rgb8Image, decode_jpeg, develop, jpeg_is_subsampled};
use zerocopy::FromBytes as _;

use crate::cameras::{ColorCamera, ColorEncoding, DepthCamera};
use crate::checksum::FileId;
use crate::contents::{Contents, StoredPoses};
use crate::decode::StreamDecoders;
use crate::description::Description;
use crate::error::SequenceError;
use crate::infrared::infrared_grey;
use crate::layout::{FrameHeader, RecordHeader};
use crate::map::LockedMap;
use crate::pairing::{Pair, pair_by_time};
use crate::record::{FrameTimes, PoseState};
use crate::scan::{Checking, RecordPlace};
use crate::split::Split;
use crate::time_index::TimeIndex;

/// An open recording: pairs of depth and colour, each read through a map, from any thread.
///
/// A *frame* of this type is a pair (`docs/sequence-format.md` section 8); single frames of the streams are in
/// [`Recording::contents`].
#[derive(Debug)]
pub struct Recording {
    path: PathBuf,
    map: LockedMap,
    contents: Contents,
    description: Description,
    pairs: Vec<Pair>,
    times: TimeIndex,
    split: Split,
    pose_sets: Vec<PoseSet>,
    decoders: Mutex<Vec<StreamDecoders>>,
}

/// A named path of the depth camera, one pose a pair.
#[derive(Clone, Debug, PartialEq)]
pub struct PoseSet {
    /// `source`, `live`, `refined` …
    pub name: String,
    /// World from depth camera; `None` where the producer has no pose, has lost the camera, or was in another
    /// world than for most frames (see [`StoredPoses::largest_map`]).
    pub world_from_depth: Vec<Option<Pose>>,
}

/// Frames further apart than this are no pair where no rate is known, nanoseconds.
const WIDEST_PAIR_NANOS: i64 = 20_000_000;

impl Recording {
    /// Opens a recording that nobody writes. All sealed chunks are read as their indices say; frames are
    /// checked when they are read.
    pub fn open(path: &Path) -> Result<Self, SequenceError> {
        Self::open_here(path).map_err(|error| error.in_file(path))
    }

    fn open_here(path: &Path) -> Result<Self, SequenceError> {
        let map = LockedMap::open(path)?;
        let mut contents = Contents::read(map.bytes(), Checking::Marks)?;
        let description = contents
            .description
            .take()
            .ok_or(SequenceError::NoDescription)?;
        let pairs = pairs_of(&contents, &description);
        let depth = contents.stream(description.depth_id);
        let nanos: Vec<i64> = pairs
            .iter()
            .map(|pair| depth[pair.depth].label.device_nanos)
            .collect();
        let split = split_of(&contents, depth, &pairs)?;
        let pose_sets = contents
            .pose_sets
            .iter()
            .map(|set| pose_set(set, &description, &contents, &pairs))
            .collect();
        Ok(Self {
            path: path.to_path_buf(),
            times: TimeIndex::new(&nanos),
            map,
            contents,
            description,
            pairs,
            split,
            pose_sets,
            decoders: Mutex::new(Vec::new()),
        })
    }

    /// The path that was opened.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Id of the file.
    pub fn file_id(&self) -> FileId {
        self.contents.file_id
    }

    /// Streams, calibration, device.
    pub fn description(&self) -> &Description {
        &self.description
    }

    /// Single frames, gaps, events, notes, damage.
    pub fn contents(&self) -> &Contents {
        &self.contents
    }

    /// How many pairs there are.
    pub fn frame_count(&self) -> usize {
        self.pairs.len()
    }

    /// The depth camera.
    pub fn depth_camera(&self) -> &DepthCamera {
        &self.description.streams.depth
    }

    /// The colour camera and its calibration.
    pub fn color_camera(&self) -> &ColorCamera {
        &self.description.streams.color
    }

    /// From depth camera axes to colour camera axes, metres.
    pub fn color_from_depth(&self) -> Pose {
        self.description.streams.color_from_depth
    }

    /// Which pairs training may see; all where the recording does not say.
    pub fn split(&self) -> &Split {
        &self.split
    }

    /// The pose sets in the order they were written.
    pub fn pose_sets(&self) -> &[PoseSet] {
        &self.pose_sets
    }

    /// World from depth camera of every pair in the set `name`; `None` when there is no such set.
    pub fn poses(&self, name: &str) -> Option<&[Option<Pose>]> {
        let set = self.pose_sets.iter().find(|set| set.name == name)?;
        Some(&set.world_from_depth)
    }

    /// Device time of the depth of pair `index` in nanoseconds; the zero is the source's.
    ///
    /// # Panics
    /// When `index` is not below [`Recording::frame_count`].
    pub fn time_nanos(&self, index: usize) -> i64 {
        self.depth_place_of(index).label.device_nanos
    }

    /// The pair whose depth is nearest in time, in O(1) for a steady rate; `None` in an empty recording.
    pub fn frame_at(&self, nanos: i64) -> Option<usize> {
        self.times.nearest(nanos)
    }

    /// All times of the depth of pair `index`.
    pub fn depth_times(&self, index: usize) -> Result<FrameTimes, SequenceError> {
        let place = self.depth_place(index)?;
        Ok(self
            .frame(place)
            .map_err(|error| self.blame(error, "depth", index))?
            .0)
    }

    /// All times of the colour of pair `index`.
    pub fn color_times(&self, index: usize) -> Result<FrameTimes, SequenceError> {
        let place = self.color_place(index)?;
        Ok(self
            .frame(place)
            .map_err(|error| self.blame(error, "color", index))?
            .0)
    }

    /// Whether the depth of pair `index` is that of the depth frame before it, byte for byte: nothing new was
    /// seen, and the time is not that of the image.
    ///
    /// # Panics
    /// When `index` is not below [`Recording::frame_count`].
    pub fn depth_is_repeat(&self, index: usize) -> bool {
        self.depth_place_of(index).is_repeat()
    }

    /// The same of the colour of pair `index`.
    ///
    /// # Panics
    /// When `index` is not below [`Recording::frame_count`].
    pub fn color_is_repeat(&self, index: usize) -> bool {
        let places = self.contents.stream(self.description.color_id);
        places[self.pairs[index].color].is_repeat()
    }

    /// Depth samples of pair `index`, as the sensor gave them: 0 and 65535 are no measurement, others times
    /// [`DepthCamera::depth_scale`] are metres.
    pub fn depth_raw(&self, index: usize) -> Result<Image<u16>, SequenceError> {
        let place = self.depth_place(index)?;
        self.depth_frame(place)
            .map_err(|error| self.blame(error, "depth", index))
    }

    /// Depth samples of one frame of the stream.
    pub fn depth_frame(&self, place: &RecordPlace) -> Result<Image<u16>, SequenceError> {
        let (_, payload) = self.frame(place)?;
        let (stream, tables) = (place.label.stream, &self.contents.tables);
        self.decode(|decoders| decoders.depth(payload, stream, tables))
    }

    /// Colour codes of pair `index`, red, green, blue: those of the payload, or of a mosaic and of YUV what
    /// [`develop::codes`] makes of it; of infrared the grey of [`infrared_grey`].
    pub fn color(&self, index: usize) -> Result<Rgb8Image, SequenceError> {
        let place = self.color_place(index)?;
        self.color_codes(place)
            .map_err(|error| self.blame(error, "color", index))
    }

    /// The same of one frame of the stream.
    pub fn color_codes(&self, place: &RecordPlace) -> Result<Rgb8Image, SequenceError> {
        let camera = self.color_camera();
        let (width, height) = (camera.intrinsics.width(), camera.intrinsics.height());
        let (_, payload) = self.frame(place)?;
        if camera.encoding == ColorEncoding::Jpeg {
            let codes = decode_jpeg(payload)?;
            require_size(&codes, width, height)?;
            return Ok(codes);
        }
        let frame = self.decode(|decoders| decoders.color(payload))?;
        if camera.encoding == ColorEncoding::Infrared10 {
            return Ok(infrared_grey(&frame, width, height)?);
        }
        let layout = camera.layout()?;
        Ok(develop::codes(
            &camera.response(),
            layout,
            &frame,
            width,
            height,
        )?)
    }

    /// The colour of pair `index` as the camera sent it: the raw frame in its format, or a JPEG.
    pub fn color_raw(&self, index: usize) -> Result<Vec<u8>, SequenceError> {
        let place = self.color_place(index)?;
        self.color_frame(place)
            .map_err(|error| self.blame(error, "color", index))
    }

    /// The colour of one frame of the stream, as the camera sent it.
    pub fn color_frame(&self, place: &RecordPlace) -> Result<Vec<u8>, SequenceError> {
        let (_, payload) = self.frame(place)?;
        self.decode(|decoders| decoders.color(payload))
    }

    /// Whether chroma of pair `index` is stored at a lower resolution than luma.
    pub fn color_is_subsampled(&self, index: usize) -> Result<bool, SequenceError> {
        match self.color_camera().encoding {
            ColorEncoding::Jpeg => jpeg_is_subsampled(self.color_bytes(index)?)
                .map_err(|error| self.blame(error.into(), "color", index)),
            ColorEncoding::Rgb8 | ColorEncoding::Infrared10 => Ok(false),
            ColorEncoding::BayerGrbg | ColorEncoding::Uyvy | ColorEncoding::Yuyv => Ok(true),
        }
    }

    /// The colour payload of pair `index` as it is stored.
    pub fn color_bytes(&self, index: usize) -> Result<&[u8], SequenceError> {
        let place = self.color_place(index)?;
        self.frame(place)
            .map(|(_, payload)| payload)
            .map_err(|error| self.blame(error, "color", index))
    }

    /// BLAKE3 of the whole file. Reads all of it.
    pub fn content_hash(&self) -> blake3::Hash {
        blake3::hash(self.map.bytes())
    }

    /// Lets the memory of frames that were read go; they can be read again.
    pub fn release(&self) {
        self.map.release();
    }

    /// Times and payload of a frame, its checksum verified.
    pub fn frame(&self, place: &RecordPlace) -> Result<(FrameTimes, &[u8]), SequenceError> {
        let damaged = || SequenceError::Damaged {
            offset: place.offset,
        };
        let start = usize::try_from(place.offset).map_err(|_| damaged())?;
        let bytes = self.map.bytes().get(start..).ok_or_else(damaged)?;
        let (header, rest) = RecordHeader::ref_from_prefix(bytes).map_err(|_| damaged())?;
        let payload = rest
            .get(..place.payload_bytes as usize)
            .ok_or_else(damaged)?;
        if !self.contents.file_id.is_record(header, payload)
            || header.sequence.get() != place.sequence
        {
            return Err(damaged());
        }
        let (times, image) = FrameHeader::ref_from_prefix(payload).map_err(|_| damaged())?;
        Ok((FrameTimes::of(times), image))
    }

    /// Runs `work` with decoders that nobody else uses.
    fn decode<T>(
        &self,
        work: impl FnOnce(&mut StreamDecoders) -> Result<T, SequenceError>,
    ) -> Result<T, SequenceError> {
        let idle = || self.decoders.lock().unwrap_or_else(PoisonError::into_inner);
        let taken = idle().pop();
        let mut decoders = match taken {
            Some(decoders) => decoders,
            None => StreamDecoders::new(&self.description)?,
        };
        let result = work(&mut decoders);
        idle().push(decoders);
        result
    }

    fn depth_place_of(&self, index: usize) -> &RecordPlace {
        &self.contents.stream(self.description.depth_id)[self.pairs[index].depth]
    }

    /// Where the depth of pair `index` lies.
    pub fn depth_place(&self, index: usize) -> Result<&RecordPlace, SequenceError> {
        let pair = self.pair(index)?;
        Ok(&self.contents.stream(self.description.depth_id)[pair.depth])
    }

    /// Where the colour of pair `index` lies.
    pub fn color_place(&self, index: usize) -> Result<&RecordPlace, SequenceError> {
        let pair = self.pair(index)?;
        Ok(&self.contents.stream(self.description.color_id)[pair.color])
    }

    fn pair(&self, index: usize) -> Result<Pair, SequenceError> {
        self.pairs.get(index).copied().ok_or_else(|| {
            SequenceError::NoSuchFrame {
                index,
                frame_count: self.pairs.len(),
            }
            .in_file(&self.path)
        })
    }

    fn blame(&self, error: SequenceError, stream: &'static str, index: usize) -> SequenceError {
        error.in_frame(stream, index).in_file(&self.path)
    }
}

fn require_size<T>(image: &Image<T>, width: u32, height: u32) -> Result<(), SequenceError> {
    if (image.width(), image.height()) == (width, height) {
        return Ok(());
    }
    Err(SequenceError::ImageSize {
        width: image.width(),
        height: image.height(),
        camera_width: width,
        camera_height: height,
    })
}

/// Pairs of a recording: half a period apart at most.
pub(crate) fn pairs_of(contents: &Contents, description: &Description) -> Vec<Pair> {
    let nanos = |id: u16| -> Vec<i64> {
        let places = contents.stream(id);
        places
            .iter()
            .map(|place| place.label.device_nanos)
            .collect()
    };
    let depth = nanos(description.depth_id);
    let color = nanos(description.color_id);
    pair_by_time(&depth, &color, widest_pair_nanos(description)).pairs
}

/// How far apart depth and colour of a pair may be: half a period, nanoseconds.
pub fn widest_pair_nanos(description: &Description) -> i64 {
    let rate_hz = description.streams.depth_timing.rate_hz;
    rate_hz.map_or(WIDEST_PAIR_NANOS, |rate_hz| {
        (0.5e9 / rate_hz).floor() as i64
    })
}

/// The stored split, of numbers of depth frames, as one of pairs.
fn split_of(
    contents: &Contents,
    depth: &[RecordPlace],
    pairs: &[Pair],
) -> Result<Split, SequenceError> {
    // Frames are numbered with 64 bits, but 2^32 of them do not fit a file that could be mapped.
    let all = Split::all_train(pairs.len() as u32);
    let Some(stored) = &contents.split else {
        return Ok(all);
    };
    let mut pair_of = std::collections::BTreeMap::new();
    for (index, pair) in pairs.iter().enumerate() {
        pair_of.insert(depth[pair.depth].label.number, index as u32);
    }
    let known = |numbers: &[u32]| -> Vec<u32> {
        let pairs = numbers
            .iter()
            .filter_map(|number| pair_of.get(&u64::from(*number)));
        pairs.copied().collect()
    };
    let mut split = Split {
        train: known(&stored.train),
        unused: known(&stored.unused),
        test: known(&stored.test),
    };
    // A pair that no list names is not trained on.
    let named: std::collections::BTreeSet<u32> = [&split.train, &split.unused, &split.test]
        .into_iter()
        .flatten()
        .copied()
        .collect();
    split
        .unused
        .extend((0..pairs.len() as u32).filter(|pair| !named.contains(pair)));
    split.unused.sort_unstable();
    split.check(pairs.len() as u32)?;
    Ok(split)
}

/// A stored set, of either camera, as poses of the depth camera for the pairs.
fn pose_set(
    stored: &StoredPoses,
    description: &Description,
    contents: &Contents,
    pairs: &[Pair],
) -> PoseSet {
    let map = stored.largest_map();
    let is_color = stored.head.stream == description.color_id;
    let color_from_depth = description.streams.color_from_depth;
    let places = contents.stream(stored.head.stream);
    let pose_of = |pair: &Pair| {
        let place = places.get(if is_color { pair.color } else { pair.depth })?;
        let found = stored
            .poses
            .binary_search_by_key(&place.label.number, |pose| pose.number);
        let pose = stored.poses.get(found.ok()?)?;
        let is_known = pose.state != PoseState::Lost && Some(pose.map) == map;
        let world_from_camera = is_known.then_some(pose.world_from_camera)?;
        Some(if is_color {
            world_from_camera * color_from_depth
        } else {
            world_from_camera
        })
    };
    PoseSet {
        name: stored.head.name.clone(),
        world_from_depth: pairs.iter().map(pose_of).collect(),
    }
}
