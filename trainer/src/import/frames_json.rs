//! `frames.json` of an exported folder: numbers, times and gaps as the recording had them.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::path::{Path, PathBuf};

use sequence::{COLOR_STREAM, DEPTH_STREAM, Description, Device, FrameTimes, Gap, StreamTiming};
use serde::Deserialize;
use serde::de::{Error as DecodeError, Visitor};

use super::error::{ImportError, read_text};
use super::gaps::disjoint;
use super::source::is_inside;

pub(crate) const FRAMES_JSON: &str = "frames.json";

/// What an import takes from the file, every number judged.
pub(crate) struct FramesJson {
    path: PathBuf,
    /// Rates, clocks and device of the recording.
    pub(crate) streams: RecordedStreams,
    /// Times of depth and colour by the names of both files.
    pairs: BTreeMap<[String; 2], [FrameTimes; 2]>,
    /// Images without a partner.
    pub(crate) singles: Vec<RecordedSingle>,
    /// Gaps of the streams that an import writes, by stream and first number, none overlapping another.
    pub(crate) gaps: Vec<Gap>,
}

/// What a recording said of its streams beside the cameras.
#[derive(Clone, Debug)]
pub(crate) struct RecordedStreams {
    pub(crate) depth_timing: StreamTiming,
    pub(crate) color_timing: StreamTiming,
    pub(crate) device: Option<Device>,
}

/// An image without a partner.
pub(crate) struct RecordedSingle {
    /// [`DEPTH_STREAM`] or [`COLOR_STREAM`].
    pub(crate) stream: u16,
    /// A file of the folder.
    pub(crate) file: String,
    pub(crate) times: FrameTimes,
}

/// Bytes of a device's words: they stand in every chunk of a recording.
const MOST_DEVICE_BYTES: usize = 1024;

impl FramesJson {
    /// Reads the file where `folder` has one.
    pub(crate) fn find(folder: &Path) -> Result<Option<Self>, ImportError> {
        let path = folder.join(FRAMES_JSON);
        if !path.exists() {
            return Ok(None);
        }
        let text = read_text(&path)?;
        let decoded: FramesText = serde_json::from_str(&text)
            .map_err(|error| wrong(&path, Some(error.line()), error.to_string()))?;
        decoded
            .judge(&path)
            .map(Some)
            .map_err(|message| wrong(&path, None, message))
    }

    /// Times of the depth and the colour of a pair, by the names of its files.
    pub(crate) fn pair(&self, depth: &Path, color: &Path) -> Result<[FrameTimes; 2], ImportError> {
        let name = |path: &Path| {
            let name = path.file_name().unwrap_or_default();
            format!("frames/{}", name.to_string_lossy())
        };
        let names = [depth, color].map(name);
        self.pairs.get(&names).copied().ok_or_else(|| {
            let [depth, color] = names;
            self.wrong(format!("no pair is {depth} and {color}"))
        })
    }

    pub(crate) fn pair_count(&self) -> usize {
        self.pairs.len()
    }

    /// A refusal that names this file.
    pub(crate) fn wrong(&self, message: String) -> ImportError {
        wrong(&self.path, None, message)
    }
}

fn wrong(path: &Path, line: Option<usize>, message: String) -> ImportError {
    ImportError::Text {
        path: path.to_path_buf(),
        line,
        message: format!(
            "{message}; correct it, or remove it: the pairs are then read by the times of poses.txt"
        ),
    }
}

/// The file, as far as an import reads it.
#[derive(Deserialize)]
struct FramesText {
    description: serde_json::Value,
    pairs: Vec<PairText>,
    #[serde(default)]
    unpaired: Vec<SingleText>,
    #[serde(default)]
    gaps: Vec<GapText>,
}

#[derive(Deserialize)]
struct PairText {
    depth_file: String,
    color_file: String,
    depth: TimesText,
    color: TimesText,
}

#[derive(Deserialize)]
struct SingleText {
    stream: StreamText,
    file: String,
    #[serde(flatten)]
    times: TimesText,
}

#[derive(Clone, Copy, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum StreamText {
    Depth,
    Color,
}

/// Whether a frame repeats its predecessor is seen in the images.
#[derive(Deserialize)]
struct TimesText {
    number: Integer,
    device_ticks: Option<Integer>,
    device_nanos: Integer,
    host_nanos: Option<[Integer; 2]>,
}

#[derive(Deserialize)]
struct GapText {
    stream: u16,
    first_number: Integer,
    count: Integer,
    from_nanos: Option<Integer>,
    to_nanos: Option<Integer>,
    cause: Option<String>,
    #[serde(default)]
    note: String,
}

impl FramesText {
    /// The sentence says what is wrong.
    fn judge(self, path: &Path) -> Result<FramesJson, String> {
        let description = serde_json::to_vec(&self.description)
            .map_err(|error| error.to_string())
            .and_then(|json| Description::from_json(&json).map_err(|error| error.to_string()))
            .map_err(|message| format!("the description: {message}"))?;
        let mut pairs = BTreeMap::new();
        let mut numbers = BTreeSet::new();
        let mut require_new = |stream: u16, times: &FrameTimes| {
            if numbers.insert((stream, times.number)) {
                return Ok(());
            }
            let word = if stream == DEPTH_STREAM {
                "depth"
            } else {
                "colour"
            };
            Err(format!("{word} number {} is there twice", times.number))
        };
        for pair in self.pairs {
            let times = [pair.depth.judge()?, pair.color.judge()?];
            require_new(DEPTH_STREAM, &times[0])?;
            require_new(COLOR_STREAM, &times[1])?;
            pairs.insert([pair.depth_file, pair.color_file], times);
        }
        let mut singles = Vec::new();
        for single in self.unpaired {
            let times = single.times.judge()?;
            let stream = match single.stream {
                StreamText::Depth => DEPTH_STREAM,
                StreamText::Color => COLOR_STREAM,
            };
            require_new(stream, &times)?;
            if !is_inside(Path::new(&single.file)) {
                return Err(format!("`{}` is no file of the folder", single.file));
            }
            let file = single.file;
            singles.push(RecordedSingle {
                stream,
                file,
                times,
            });
        }
        let gaps = gaps_of(self.gaps, &description)?;
        let streams = description.streams;
        Ok(FramesJson {
            path: path.to_path_buf(),
            streams: RecordedStreams {
                depth_timing: streams.depth_timing,
                color_timing: streams.color_timing,
                device: streams.device.filter(is_short),
            },
            pairs,
            singles,
            gaps,
        })
    }
}

fn is_short(device: &Device) -> bool {
    let words = [&device.name, &device.serial, &device.firmware, &device.path];
    words.iter().map(|word| word.len()).sum::<usize>() <= MOST_DEVICE_BYTES
}

/// The gaps of both streams.
fn gaps_of(gaps: Vec<GapText>, description: &Description) -> Result<Vec<Gap>, String> {
    let mut judged = Vec::new();
    for gap in gaps {
        // Other streams are not exported.
        let stream = match gap.stream {
            id if id == description.depth_id => DEPTH_STREAM,
            id if id == description.color_id => COLOR_STREAM,
            _ => continue,
        };
        judged.push(gap.judge(stream)?);
    }
    Ok(disjoint(judged))
}

impl TimesText {
    fn judge(&self) -> Result<FrameTimes, String> {
        let host = self.host_nanos.as_ref();
        let host = host.map(|[first, last]| Ok::<_, String>([first.nanos()?, last.nanos()?]));
        Ok(FrameTimes {
            number: self.number.frame_number()?,
            device_ticks: self.device_ticks.as_ref().map(Integer::ticks).transpose()?,
            device_nanos: self.device_nanos.nanos()?,
            host_nanos: host.transpose()?,
            is_repeat: false,
        })
    }
}

impl GapText {
    fn judge(self, stream: u16) -> Result<Gap, String> {
        let nanos = |value: Option<Integer>| value.map(Integer::nanos).transpose();
        let first_number = self.first_number.frame_number()?;
        let count = self.count.frame_number()?;
        if count == 0 {
            return Err(format!("the gap at number {first_number} has no frames"));
        }
        Ok(Gap {
            stream,
            first_number,
            count,
            from_nanos: nanos(self.from_nanos)?,
            to_nanos: nanos(self.to_nanos)?,
            cause: self.cause.and_then(|cause| cause.parse().ok()),
            note: self.note,
        })
    }
}

/// An integer, as JSON has it or as decimal digits.
#[derive(Clone, Copy)]
struct Integer(i128);

impl Integer {
    /// A number or count of frames. A split names frames with 32 bits; at 30 Hz they last for 4 years.
    fn frame_number(self) -> Result<u64, String> {
        let number = u32::try_from(self.0).map(u64::from);
        number.map_err(|_| format!("{} is no number of a frame (0 to 4294967295)", self.0))
    }

    fn ticks(&self) -> Result<u64, String> {
        u64::try_from(self.0).map_err(|_| format!("{} is no device counter of 64 bits", self.0))
    }

    fn nanos(self) -> Result<i64, String> {
        i64::try_from(self.0).map_err(|_| format!("{} is no time in nanoseconds", self.0))
    }
}

impl<'de> Deserialize<'de> for Integer {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(IntegerVisitor)
    }
}

struct IntegerVisitor;

impl Visitor<'_> for IntegerVisitor {
    type Value = Integer;

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("an integer or a string of its decimal digits")
    }

    fn visit_u64<E: DecodeError>(self, value: u64) -> Result<Integer, E> {
        Ok(Integer(value.into()))
    }

    fn visit_i64<E: DecodeError>(self, value: i64) -> Result<Integer, E> {
        Ok(Integer(value.into()))
    }

    fn visit_str<E: DecodeError>(self, digits: &str) -> Result<Integer, E> {
        let value = digits.parse().map(Integer);
        value.map_err(|_| E::invalid_value(serde::de::Unexpected::Str(digits), &self))
    }
}
