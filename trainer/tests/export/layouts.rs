//! What stands in exported folders, and what is refused.

use std::fs;

use glint::export::{ExportTarget, export};
use sequence::ColorEncoding;
use serde_json::Value;

use crate::made::{
    COLOR_NUMBERS, DEPTH_NUMBERS, FIRST_TICK, Made, color, color_nanos, color_size, depth,
    depth_nanos, millimetres_of_shift, streams, streams_of_shifts, world_from_depth,
};

const FOLDERS: [(ExportTarget, &str); 3] = [
    (ExportTarget::Tum, "tum"),
    (ExportTarget::SevenScenes, "scenes"),
    (ExportTarget::Folder, "folder"),
];

fn lines(text: &str) -> Vec<&str> {
    text.lines().filter(|line| !line.starts_with('#')).collect()
}

#[test]
fn tum_lists_name_every_image_with_its_own_time() {
    let made = Made::new(ColorEncoding::Jpeg);
    made.export(ExportTarget::Tum, "tum");
    let depth_list = made.text("tum/depth.txt");
    assert_eq!(
        lines(&depth_list)[0],
        "1305031102.175304123 depth/1305031102.175304123.png"
    );
    let rgb_list = made.text("tum/rgb.txt");
    for (list, count) in [
        (&depth_list, DEPTH_NUMBERS.len()),
        (&rgb_list, COLOR_NUMBERS.len()),
    ] {
        assert_eq!(lines(list).len(), count);
        for line in lines(list) {
            let name = line.split_once(' ').unwrap().1;
            assert!(made.at("tum").join(name).is_file(), "{name}");
        }
    }
    let associations = made.text("tum/associations.txt");
    assert_eq!(lines(&associations).len(), 7);
    for line in lines(&associations) {
        let words: Vec<&str> = line.split(' ').collect();
        let [rgb_time, rgb_name, depth_time, depth_name] = words[..] else {
            panic!("{line}");
        };
        assert!(rgb_list.contains(&format!("{rgb_time} {rgb_name}\n")));
        assert!(depth_list.contains(&format!("{depth_time} {depth_name}\n")));
        let fraction = |time: &str| time[7..].parse::<f64>().unwrap();
        assert!((fraction(rgb_time) - fraction(depth_time) - 0.004).abs() < 1e-6);
    }
    let path = made.text("tum/groundtruth.txt");
    let numbers: Vec<f64> = lines(&path)[1]
        .split(' ')
        .map(|word| word.parse().unwrap())
        .collect();
    let expected = world_from_depth(1);
    let (t, q) = (
        expected.translation().to_array(),
        expected.rotation().to_array(),
    );
    for (number, expected) in numbers[1..].iter().zip(t.into_iter().chain(q)) {
        // The reader of a recording makes quaternions unit again: the last bit may differ.
        assert!((number - expected).abs() < 1e-15, "{number} {expected}");
    }
}

#[test]
fn every_folder_says_its_units_axes_and_what_it_lacks() {
    let made = Made::new(ColorEncoding::Jpeg);
    for (target, name) in FOLDERS {
        made.export(target, name);
        let readme = made.text(&format!("{name}/README.txt"));
        for part in [
            "metres, seconds",
            "x right, y down, z forward",
            "world from camera",
            "sample x 0.00137 = metres",
            "0 and 65535 are no measurement",
            "NOT registered to colour",
            "device time in seconds",
            "Not carried over",
            "3 gaps with 3 missing frames",
            "8 frames, 1 of them repeat the one before",
        ] {
            assert!(readme.contains(part), "{name}: no `{part}` in\n{readme}");
        }
    }
}

#[test]
fn the_json_of_a_folder_holds_all_times_gaps_and_events() {
    let made = Made::new(ColorEncoding::Jpeg);
    made.export(ExportTarget::Folder, "folder");
    let json: Value = serde_json::from_slice(&made.read("folder/frames.json")).unwrap();
    let pairs = json["pairs"].as_array().unwrap();
    assert_eq!(pairs.len(), 7);
    let pair = &pairs[3];
    assert_eq!(pair["depth_file"], "frames/000003.depth.png");
    assert_eq!(pair["depth"]["number"], 4);
    assert_eq!(pair["depth"]["device_nanos"], depth_nanos(4).to_string());
    assert_eq!(
        pair["depth"]["device_ticks"],
        (FIRST_TICK + 4000).to_string()
    );
    assert_eq!(pair["color"]["device_nanos"], color_nanos(4).to_string());
    assert_eq!(
        pair["color"]["host_nanos"][1],
        (color_nanos(4) + 9_000_000).to_string()
    );
    assert_eq!(pairs[4]["depth"]["is_repeat"], true);
    assert_eq!(pairs[2]["color"]["is_repeat"], true);
    let singles = json["unpaired"].as_array().unwrap();
    let files: Vec<&str> = singles
        .iter()
        .map(|single| single["file"].as_str().unwrap())
        .collect();
    assert_eq!(
        files,
        ["unpaired/000006.depth.png", "unpaired/000009.color.jpg"]
    );
    assert!(
        files
            .iter()
            .all(|file| made.at("folder").join(file).is_file())
    );
    assert_eq!(json["gaps"][0]["cause"], "packet-loss");
    assert_eq!(json["gaps"][0]["first_number"], 3);
    assert_eq!(json["events"][0]["host_nanos"], (i64::MAX - 1).to_string());
    assert_eq!(json["events"][0]["details"]["exposure_us"], 8000);
    assert_eq!(json["notes"][0]["text"], "the lamp was switched on");
    assert_eq!(json["gravity"][0]["down"][1], 1.0);
    assert_eq!(json["pose_sets"][0]["poses"][2]["state"], "lost");
    assert_eq!(json["pose_sets"][1]["poses"][7]["map"], 1);
    assert_eq!(json["description"]["streams"][0]["rate_hz"], 30.0);
}

#[test]
fn raw_colour_is_written_as_it_is_by_the_folder_and_developed_by_the_others() {
    for encoding in [
        ColorEncoding::BayerGrbg,
        ColorEncoding::Yuyv,
        ColorEncoding::Uyvy,
    ] {
        let made = Made::new(encoding);
        made.export(ExportTarget::Folder, "folder");
        let frame = color(4, encoding);
        if encoding == ColorEncoding::BayerGrbg {
            let png = made.read("folder/frames/000003.color.png");
            let mosaic = imaging::decode_png_gray8(&png).unwrap();
            assert_eq!([mosaic.width(), mosaic.height()], color_size(encoding));
            assert_eq!(mosaic.pixels(), frame);
        } else {
            assert_eq!(made.read("folder/frames/000003.color.yuv"), frame);
        }
        let rig = made.text("folder/rig.toml");
        assert!(
            rig.contains(&format!("format = \"{}\"", encoding.name())),
            "{rig}"
        );
        let json: Value = serde_json::from_slice(&made.read("folder/frames.json")).unwrap();
        assert_eq!(json["description"]["streams"][1]["format"], encoding.name());
        let developed = made.open().color(3).unwrap();
        assert_eq!(
            [developed.width(), developed.height()],
            color_size(encoding)
        );
        made.export(ExportTarget::SevenScenes, "scenes");
        let png = made.read("scenes/frame-000003.color.png");
        assert_eq!(imaging::decode_png_rgb8(&png).unwrap(), developed);
        assert!(
            made.text("scenes/README.txt")
                .contains("PNG of 8 bits, developed")
        );
        assert_eq!(made.import("scenes").color(3).unwrap(), developed);
        made.export(ExportTarget::Tum, "tum");
        assert!(made.text("tum/rig.toml").contains("format = \"png\""));
        assert!(made.text("tum/README.txt").contains("`--to folder`"));
    }
}

#[test]
fn infrared_is_written_whole_by_the_folder_and_as_grey_by_the_others() {
    let encoding = ColorEncoding::Infrared10;
    let made = Made::new(encoding);
    let frame = color(4, encoding);
    made.export(ExportTarget::Folder, "folder");
    let png = made.read("folder/frames/000003.color.png");
    let written = imaging::decode_png_gray16(&png).unwrap();
    let samples = written.pixels().iter();
    let bytes: Vec<u8> = samples.flat_map(|sample| sample.to_le_bytes()).collect();
    assert_eq!(bytes, frame);
    assert!(made.text("folder/rig.toml").contains("\"infrared10\""));
    assert!(made.text("folder/README.txt").contains("0 to 1023"));
    made.export(ExportTarget::SevenScenes, "scenes");
    let png = made.read("scenes/frame-000003.color.png");
    let grey = imaging::decode_png_rgb8(&png).unwrap();
    let expected: Vec<[u8; 3]> = written
        .pixels()
        .iter()
        .map(|s| [(s / 4) as u8; 3])
        .collect();
    assert_eq!(grey.pixels(), expected);
    assert!(made.text("scenes/README.txt").contains("infrared"));
    assert_eq!(made.import("scenes").color(3).unwrap(), grey);
}

#[test]
fn shifts_become_millimetres_by_the_table_of_the_device() {
    let made = Made::with(streams_of_shifts());
    for (target, name) in FOLDERS {
        made.export(target, name);
        let readme = made.text(&format!("{name}/README.txt"));
        assert!(
            readme.contains("millimetres from the sensor's shifts"),
            "{readme}"
        );
    }
    let again = made.import("scenes");
    assert_eq!(again.depth_camera().depth_scale, 0.001);
    assert_eq!(
        again.depth_raw(3).unwrap(),
        depth(4, true).map(millimetres_of_shift)
    );
    let mut bare = streams_of_shifts();
    bare.depth.shift = None;
    let made = Made::with(bare);
    for (target, name) in FOLDERS {
        let sentence = made.refusal(&made.options(target, name));
        assert!(sentence.contains("shifts without the table"), "{sentence}");
    }
}

#[test]
fn poses_are_of_the_set_that_is_named() {
    let made = Made::new(ColorEncoding::Jpeg);
    for (target, name) in FOLDERS {
        let mut options = made.options(target, name);
        options.poses = Some("refined".to_owned());
        let sentence = made.refusal(&options);
        assert!(
            sentence.contains("no poses named `refined`; it has source, live"),
            "{sentence}"
        );
        assert!(!made.at(name).exists());
    }
    // Poses of the colour camera, in two worlds: the larger one is taken.
    let recording = made.open();
    let known = recording.poses("live").unwrap().iter().map(Option::is_some);
    let known: Vec<bool> = known.collect();
    assert_eq!(known, [true, true, true, true, true, false, false]);
    let mut options = made.options(ExportTarget::Tum, "tum");
    options.poses = Some("live".to_owned());
    let report = export(&options, &mut |_, _| {}).unwrap();
    assert!(
        report
            .text
            .contains("3 poses of other maps than number 0 left out"),
        "{}",
        report.text
    );
    let path = made.text("tum/groundtruth.txt");
    assert_eq!(lines(&path).len(), 5);
    assert!(lines(&path)[0].starts_with("1305031102.179304124 "));
    assert!(made.text("tum/rig.toml").contains("poses = \"color\""));
    let mut options = made.options(ExportTarget::SevenScenes, "scenes");
    options.poses = Some("live".to_owned());
    export(&options, &mut |_, _| {}).unwrap();
    let again = made.import("scenes");
    let poses = again.poses("source").unwrap();
    let expected = world_from_depth(4) * streams(ColorEncoding::Jpeg).color_from_depth;
    let shift = (poses[3].unwrap().translation() - expected.translation()).length();
    assert!(shift < 1e-9, "{shift}");
    assert!(poses[6].is_none());
}

#[test]
fn a_folder_that_is_not_empty_is_never_touched() {
    let made = Made::new(ColorEncoding::Jpeg);
    fs::create_dir(made.at("full")).unwrap();
    fs::write(made.at("full/mine.txt"), "mine").unwrap();
    fs::write(made.at("file"), "mine").unwrap();
    for (target, name) in FOLDERS {
        let sentence = made.refusal(&made.options(target, "full"));
        assert!(sentence.contains("not empty"), "{sentence}");
        let sentence = made.refusal(&made.options(target, "file"));
        assert!(sentence.contains("is no folder"), "{sentence}");
        fs::create_dir(made.at(name)).unwrap();
        made.export(target, name);
        let sentence = made.refusal(&made.options(target, name));
        assert!(sentence.contains("not empty"), "{sentence}");
    }
    assert_eq!(fs::read_dir(made.at("full")).unwrap().count(), 1);
    assert_eq!(made.text("full/mine.txt") + &made.text("file"), "minemine");
}

#[test]
fn the_bytes_do_not_depend_on_the_number_of_threads() {
    let made = Made::new(ColorEncoding::Rgb8);
    let folders = [1, 4].map(|threads| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        let name = format!("{threads}");
        pool.install(|| made.export(ExportTarget::Folder, &name));
        let mut files: Vec<_> = ["", "frames", "unpaired"]
            .into_iter()
            .flat_map(|folder| fs::read_dir(made.at(&name).join(folder)).unwrap())
            .map(|entry| entry.unwrap().path())
            .filter(|path| path.is_file())
            .map(|path| {
                (
                    path.file_name().unwrap().to_owned(),
                    fs::read(&path).unwrap(),
                )
            })
            .collect();
        files.sort();
        files
    });
    assert!(folders[0] == folders[1]);
}
