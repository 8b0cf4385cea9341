//! `frames.json` as an import reads it: what is refused, and excerpts. No file makes it panic.

use std::path::Path;

use glint::export::ExportTarget;
use glint::import::{ImportOptions, import};
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64Mcg;
use sequence::{COLOR_STREAM, ColorEncoding, DEPTH_STREAM, Gap, GapCause, Recording};
use serde_json::{Value, json};

use crate::made::{Made, color_nanos, depth_nanos};

fn exported() -> Made {
    let made = Made::new(ColorEncoding::Jpeg);
    made.export(ExportTarget::Folder, "folder");
    made
}

fn options(made: &Made) -> ImportOptions {
    ImportOptions {
        input: made.at("folder"),
        output: made.at("again.glint"),
        format: None,
        rig: None,
        split: None,
        range: None,
    }
}

fn json_of(made: &Made) -> Value {
    serde_json::from_slice(&made.read("folder/frames.json")).unwrap()
}

fn set_json(made: &Made, json: &Value) {
    let bytes = serde_json::to_vec(json).unwrap();
    std::fs::write(made.at("folder/frames.json"), bytes).unwrap();
}

fn numbers(recording: &Recording, stream: u16) -> Vec<u64> {
    let places = recording.contents().stream(stream).iter();
    places.map(|place| place.label.number).collect()
}

/// Number, count and cause of the gaps of a stream.
fn gaps(recording: &Recording, stream: u16) -> Vec<(u64, u64, Option<GapCause>)> {
    let of_stream = |gap: &&Gap| gap.stream == stream;
    let gaps = recording.contents().gaps.iter().filter(of_stream);
    gaps.map(|gap| (gap.first_number, gap.count, gap.cause))
        .collect()
}

#[test]
fn a_json_that_does_not_fit_the_folder_is_refused_in_one_sentence() {
    let made = exported();
    let whole = json_of(&made);
    let refuses = |expected: &[&str], change: &dyn Fn(&mut Value)| {
        let mut json = whole.clone();
        change(&mut json);
        set_json(&made, &json);
        let error = import(&options(&made), &mut |_, _| {}).expect_err("this cannot be imported");
        let sentence = format!("{error:#}");
        assert!(!sentence.contains('\n'), "{sentence}");
        for part in expected.iter().chain(&["frames.json"]) {
            assert!(sentence.contains(part), "no `{part}` in: {sentence}");
        }
        assert!(!Path::new(&made.at("again.glint")).exists());
    };
    refuses(&["missing field `pairs`"], &|json| {
        json.as_object_mut().unwrap().remove("pairs");
    });
    refuses(&["the description", "NaN"], &|json| {
        json["description"]["streams"][0]["rate_hz"] = json!("NaN");
    });
    refuses(&["the rate of a stream"], &|json| {
        json["description"]["streams"][1]["rate_hz"] = json!(-1.0);
    });
    refuses(&["6 pairs, the folder has 7"], &|json| {
        json["pairs"].as_array_mut().unwrap().pop();
    });
    refuses(&["no pair is frames/000002.depth.png"], &|json| {
        json["pairs"][2]["depth_file"] = json!("frames/2.depth.png");
    });
    refuses(&["the depth of pair 1", "line 4 of poses.txt"], &|json| {
        json["pairs"][1]["depth"]["device_nanos"] = json!("17");
    });
    refuses(&["depth number 0 is there twice"], &|json| {
        json["pairs"][1]["depth"]["number"] = json!("0");
    });
    refuses(&["colour number 4 is there twice"], &|json| {
        json["unpaired"][1]["number"] = json!(4);
    });
    for number in [json!(-1), json!(1_u64 << 32), json!("99999999999999999999")] {
        refuses(&["is no number of a frame"], &|json| {
            json["pairs"][1]["color"]["number"] = number.clone();
        });
    }
    refuses(&["is no number of a frame"], &|json| {
        json["gaps"][0]["count"] = json!(u64::MAX);
    });
    refuses(&["has no frames"], &|json| {
        json["gaps"][0]["count"] = json!(0);
    });
    refuses(&["no time in nanoseconds"], &|json| {
        json["pairs"][0]["color"]["device_nanos"] = json!("9223372036854775808");
    });
    refuses(&["no device counter"], &|json| {
        json["pairs"][0]["color"]["device_ticks"] = json!("-1");
    });
    refuses(&["decimal digits"], &|json| {
        json["pairs"][0]["color"]["device_nanos"] = json!(0.5);
    });
    for file in ["../x.png", "/etc/passwd", "unpaired/../../x.png", ""] {
        refuses(&["is no file of the folder"], &|json| {
            json["unpaired"][0]["file"] = json!(file);
        });
    }
}

#[test]
fn a_single_image_must_be_there_and_be_an_image_of_its_stream() {
    let made = exported();
    let mut json = json_of(&made);
    json["unpaired"][0]["file"] = json!("unpaired/000009.color.jpg");
    set_json(&made, &json);
    let error = import(&options(&made), &mut |_, _| {}).expect_err("a depth image that is JPEG");
    assert!(format!("{error:#}").contains("000009.color.jpg"));
    json["unpaired"][0]["file"] = json!("unpaired/1.depth.png");
    set_json(&made, &json);
    let error = import(&options(&made), &mut |_, _| {}).expect_err("no such file");
    assert!(format!("{error:#}").contains("1.depth.png"));
}

#[test]
fn holes_that_no_gap_explains_get_one_and_gaps_never_overlap() {
    let made = exported();
    let mut json = json_of(&made);
    json["gaps"] = json!([
        {"stream": 1, "first_number": 0, "count": 4294967295_u64, "cause": "usb-short"},
        {"stream": 1, "first_number": 2, "count": 5, "cause": "a cause of later years"},
        {"stream": 9, "first_number": 3, "count": 1},
    ]);
    set_json(&made, &json);
    let again = made.import("folder");
    let short = Some(GapCause::UsbShort);
    assert_eq!(
        gaps(&again, DEPTH_STREAM),
        [(3, 1, short), (9, 4_294_967_286, short)]
    );
    let source = Some(GapCause::Source);
    assert_eq!(gaps(&again, COLOR_STREAM), [(3, 1, source), (6, 1, source)]);
    let gap = &again.contents().gaps[2];
    assert_eq!(gap.from_nanos, Some(color_nanos(2)));
    assert_eq!(gap.to_nanos, Some(color_nanos(4)));
}

#[test]
fn an_excerpt_takes_the_single_images_and_gaps_between_its_pairs() {
    let made = exported();
    let excerpt = |range| {
        let options = ImportOptions {
            range: Some(range),
            ..options(&made)
        };
        import(&options, &mut |_, _| {}).unwrap();
        Recording::open(&options.output).unwrap()
    };
    let middle = excerpt(3..6);
    assert_eq!(numbers(&middle, DEPTH_STREAM), [4, 5, 6, 7]);
    assert_eq!(numbers(&middle, COLOR_STREAM), [4, 5, 7]);
    assert_eq!(gaps(&middle, DEPTH_STREAM), []);
    assert_eq!(
        gaps(&middle, COLOR_STREAM),
        [(6, 1, Some(GapCause::PacketLoss))]
    );
    // The stored lists name depth frames 4, 7 and the rest.
    assert_eq!(middle.split().train, [0]);
    assert_eq!(middle.split().test, [2]);
    let first = excerpt(0..2);
    assert_eq!(numbers(&first, DEPTH_STREAM), [0, 1]);
    assert_eq!(first.contents().gaps, []);
}

#[test]
fn times_that_go_back_are_kept() {
    let made = exported();
    let mut json = json_of(&made);
    let back = depth_nanos(0) - 1_000_000_000;
    json["unpaired"][0]["device_nanos"] = json!(back.to_string());
    json["unpaired"][1]["device_nanos"] = json!(i64::MIN.to_string());
    set_json(&made, &json);
    let again = made.import("folder");
    assert_eq!(numbers(&again, DEPTH_STREAM), [0, 1, 2, 4, 5, 6, 7, 8]);
    let place = &again.contents().stream(DEPTH_STREAM)[5];
    assert_eq!(place.label.device_nanos, back);
    let place = &again.contents().stream(COLOR_STREAM)[7];
    assert_eq!(place.label.device_nanos, i64::MIN);
}

#[test]
fn a_broken_json_gives_a_sentence_and_never_a_panic() {
    let made = exported();
    let whole = made.read("folder/frames.json");
    let mut random = Pcg64Mcg::seed_from_u64(32);
    let mut refused_count = 0;
    for _ in 0..120 {
        let mut bytes = whole.clone();
        match random.random_range(0..3) {
            0 => bytes.truncate(random.random_range(0..whole.len())),
            1 => {
                let at = random.random_range(0..whole.len());
                bytes[at] = random.random();
            }
            _ => {
                // Other digits and other signs: the JSON stays readable.
                for _ in 0..20 {
                    let at = random.random_range(0..whole.len());
                    if bytes[at].is_ascii_digit() {
                        bytes[at] = random.random_range(b'0'..=b'9');
                    }
                }
            }
        }
        std::fs::write(made.at("folder/frames.json"), &bytes).unwrap();
        match import(&options(&made), &mut |_, _| {}) {
            Ok(_) => drop(Recording::open(&made.at("again.glint")).unwrap()),
            Err(error) => {
                refused_count += 1;
                assert!(!format!("{error:#}").contains('\n'));
            }
        }
    }
    assert!((60..120).contains(&refused_count), "{refused_count}");
}
