//! What `glint import` refuses: with one sentence, without a file, never with a panic.

use std::fs;
use std::process::Command;

use crate::folders::{FRAME_COUNT, Folder, matrix_text, tum_line, world_from_camera};
use glint::import::import;
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64Mcg;

/// The sentence with which `folder` is refused. Nothing may be left of the recording.
fn sentence(folder: &Folder) -> String {
    let error = folder.import().expect_err("the folder is broken");
    let left = fs::read_dir(folder.root())
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .filter(|name| name.ends_with(".glint") || name.ends_with(".part"));
    assert_eq!(left.collect::<Vec<_>>(), [""; 0], "{error:#}");
    let sentence = format!("{error:#}");
    assert!(!sentence.contains('\n'), "{sentence}");
    sentence
}

/// Breaks a whole plain folder and expects all of `expected` in the refusal.
#[track_caller]
fn refuses(expected: &[&str], damage: impl FnOnce(&Folder)) {
    let folder = Folder::plain();
    damage(&folder);
    let sentence = sentence(&folder);
    for part in expected {
        assert!(sentence.contains(part), "no `{part}` in: {sentence}");
    }
}

fn cut(folder: &Folder, name: &str) {
    let bytes = folder.read(name);
    folder.write(name, &bytes[..bytes.len() / 2]);
}

#[test]
fn damaged_images() {
    refuses(&["000004.depth.png", "copy the file again"], |folder| {
        cut(folder, "frames/000004.depth.png");
    });
    refuses(&["000006.color.jpg", "end-of-image"], |folder| {
        cut(folder, "frames/000006.color.jpg");
    });
    refuses(&["000001.color.jpg", "start-of-image"], |folder| {
        folder.copy("frames/000001.depth.png", "frames/000001.color.jpg");
    });
    refuses(&["000002.depth.png"], |folder| {
        folder.write("frames/000002.depth.png", b"");
    });
    refuses(&["000003.depth.png", "ordinary file"], |folder| {
        folder.remove("frames/000003.depth.png");
        fs::create_dir(folder.path("frames/000003.depth.png")).unwrap();
    });
}

#[test]
fn images_of_another_size() {
    let small = imaging::Image::new(64, 48, 1500_u16);
    refuses(&["000005.depth.png has 64x48 pixels", "128x96"], |folder| {
        let png = imaging::encode_png_gray16(&small).unwrap();
        folder.write("frames/000005.depth.png", &png);
    });
    refuses(
        &["000005.color.jpg has 64x48 pixels", "color camera"],
        |folder| {
            let jpeg = imaging::encode_jpeg(&small.map(|_| [9, 9, 9]), 90).unwrap();
            folder.write("frames/000005.color.jpg", &jpeg);
        },
    );
    refuses(&["000005.depth.png", "16 bits"], |folder| {
        let png = imaging::encode_png_rgb8(&small.map(|_| [9, 9, 9])).unwrap();
        folder.write("frames/000005.depth.png", &png);
    });
}

/// A plain folder of raw colour: what `made` says of each frame, under the name `frames/NNNNNN` + suffix.
fn raw(format: &str, suffix: &str, made: impl Fn(u32) -> Vec<u8>) -> Folder {
    let folder = Folder::plain();
    for frame in 0..FRAME_COUNT {
        folder.remove(&format!("frames/{frame:06}.color.jpg"));
        folder.write(&format!("frames/{frame:06}{suffix}"), &made(frame));
    }
    folder.edit("rig.toml", "\"jpeg\"", &format!("\"{format}\""));
    folder
}

#[test]
fn raw_colour_that_is_not_what_the_rig_says() {
    let grey = |_| {
        let samples = imaging::Image::new(128, 96, false);
        imaging::encode_png_mask(&samples).unwrap()
    };
    let rgb = |frame| imaging::encode_png_rgb8(&crate::folders::color(frame)).unwrap();
    let yuv = |frame| vec![frame as u8; 2 * 128 * 96];
    raw("bayer-grbg", ".color.png", grey).import().unwrap();
    raw("uyvy", ".color.yuv", yuv).import().unwrap();

    let refuses = |folder: &Folder, expected: &[&str]| {
        let sentence = sentence(folder);
        for part in expected {
            assert!(sentence.contains(part), "no `{part}` in: {sentence}");
        }
    };
    // Colour is no mosaic, and bits or a palette are no samples.
    let folder = raw("bayer-grbg", ".color.png", rgb);
    refuses(
        &folder,
        &["000000.color.png", "RGB, 8 bits", "grey, 8 bits"],
    );
    let folder = raw("bayer-grbg", ".color.yuv", yuv);
    refuses(&folder, &["000000.color.yuv", "other colour images (png)"]);
    let folder = raw("yuyv", ".color.png", grey);
    refuses(&folder, &["000000.color.png", "other colour images (yuv)"]);
    let folder = raw("yuyv", ".color.yuv", |frame| {
        yuv(frame)[frame as usize..].to_vec()
    });
    refuses(&folder, &["000001.color.yuv: 24575 bytes", "has 24576"]);
    let folder = raw("yuyv", ".color.yuv", yuv);
    folder.edit("rig.toml", "width = 128", "width = 127");
    folder.edit("rig.toml", "cx = 63.5", "cx = 63.0");
    refuses(
        &folder,
        &["rig.toml: a frame of 127x96 pixels", "even in width"],
    );
    let folder = raw("nv12", ".color.yuv", yuv);
    refuses(
        &folder,
        &["unknown variant `nv12`", "`bayer-grbg`", "`uyvy`"],
    );
    let meaning =
        "[color.yuv]\nmatrix = \"bt601\"\nrange = \"wide\"\nsiting = \"left\"\n[color.exposure]";
    let folder = raw("uyvy", ".color.yuv", yuv);
    folder.edit("rig.toml", "[color.exposure]", meaning);
    refuses(&folder, &["color.yuv", "\"limited\""]);
    folder.edit("rig.toml", "wide", "limited");
    folder.import().unwrap();
    let folder = raw("bayer-grbg", ".color.png", grey);
    folder.edit(
        "rig.toml",
        "[color.exposure]",
        &meaning.replace("wide", "full"),
    );
    refuses(&folder, &["color.yuv belongs to the formats uyvy and yuyv"]);
}

#[test]
fn missing_and_doubled_files() {
    refuses(&["frame 3 has no depth image", "copy it again"], |folder| {
        folder.remove("frames/000003.depth.png");
    });
    refuses(&["frame 7 has no colour image"], |folder| {
        folder.remove("frames/000007.color.jpg");
    });
    refuses(&["frame 8 has no"], |folder| {
        folder.copy("frames/000007.color.jpg", "frames/4294967295.color.jpg");
    });
    refuses(&["frame 2 has two files"], |folder| {
        folder.copy("frames/000002.color.jpg", "frames/2.color.jpg");
    });
    refuses(
        &["000002.color.png", "format of the other colour images"],
        |folder| {
            fs::rename(
                folder.path("frames/000002.color.jpg"),
                folder.path("frames/000002.color.png"),
            )
            .unwrap();
        },
    );
    refuses(&["no layout that is known", "--format"], |folder| {
        folder.remove("poses.txt");
    });
    refuses(&["no rig file", "--rig"], |folder| {
        folder.remove("rig.toml");
    });
    refuses(&["holds no images"], |folder| {
        fs::remove_dir_all(folder.path("frames")).unwrap();
        fs::create_dir(folder.path("frames")).unwrap();
    });
}

#[test]
fn wrong_pose_files() {
    let line = |frame| tum_line(frame, &world_from_camera(frame));
    refuses(&["7 poses for 8 frames"], |folder| {
        folder.edit("poses.txt", &line(4), "");
    });
    refuses(&["9 poses for 8 frames"], |folder| {
        folder.edit("poses.txt", &line(7), &(line(7) + &line(8)));
    });
    refuses(&["poses.txt, line 4", "not a number"], |folder| {
        folder.edit("poses.txt", "0.200000 0.100000000", "0.200000 NaN");
    });
    refuses(&["line 3", "`x` is no number"], |folder| {
        folder.edit("poses.txt", "0.100000 0.050000000", "0.100000 x");
    });
    refuses(&["line 3", "expected 8"], |folder| {
        folder.edit("poses.txt", "0.100000 ", "0.100000 1.0 ");
    });
    refuses(&["line 2", "length zero"], |folder| {
        folder.edit("poses.txt", " 1.000000000\n", " 0.0\n");
    });
    refuses(&["line 2", "has length 2.0000"], |folder| {
        folder.edit("poses.txt", " 1.000000000\n", " 2.0\n");
    });
    refuses(&["line 5", "is not after the time before"], |folder| {
        folder.edit("poses.txt", "0.300000 ", "0.200000 ");
    });
    refuses(&["line 5", "is not after the time before"], |folder| {
        folder.edit("poses.txt", "0.300000 ", "0.100000 ");
    });
    refuses(&["line 5", "`now` is no time"], |folder| {
        folder.edit("poses.txt", "0.300000 ", "now ");
    });
    refuses(&["poses.txt", "no UTF-8"], |folder| {
        folder.write("poses.txt", &[0xC3, 0x28]);
    });
}

#[test]
fn poses_the_wrong_way_round() {
    refuses(
        &["wrong way round", "invert every pose", "poses.txt"],
        |folder| {
            let inverted: String = (0..FRAME_COUNT)
                .map(|frame| tum_line(frame, &world_from_camera(frame).inverse()))
                .collect();
            folder.write("poses.txt", inverted.as_bytes());
        },
    );
}

#[test]
fn wrong_depth_units() {
    for scale in ["0.00001", "0.01"] {
        refuses(&["median depth", "depth.scale"], |folder| {
            folder.edit("rig.toml", "scale = 0.001", &format!("scale = {scale}"));
        });
    }
    refuses(&["only 0 % of the depth", "depth.range"], |folder| {
        folder.edit("rig.toml", "scale = 0.001", "scale = 0.0001");
    });
    refuses(
        &["only", "% of the depth", "between 0.4 and 1.5"],
        |folder| {
            folder.edit(
                "rig.toml",
                "scale = 0.001",
                "scale = 0.001\nrange = [0.4, 1.5]",
            );
        },
    );
    refuses(&["depth scale is 1000"], |folder| {
        folder.edit("rig.toml", "scale = 0.001", "scale = 1000.0");
    });
    refuses(&["none of the depth images"], |folder| {
        let empty = imaging::Image::new(128, 96, 0_u16);
        for frame in 0..FRAME_COUNT {
            let png = imaging::encode_png_gray16(&empty).unwrap();
            folder.write(&format!("frames/{frame:06}.depth.png"), &png);
        }
    });
}

#[test]
fn wrong_rig_files() {
    let refuses_rig = |expected: &[&str], from: &str, to: &str| {
        refuses(expected, |folder| folder.edit("rig.toml", from, to));
    };
    refuses_rig(
        &["rig.toml, line", "unknown field `focal`", "`fx`"],
        "fx = 110.0",
        "focal = 110.0",
    );
    refuses_rig(
        &["rig.toml, line", "`full_wel`", "`full_well`"],
        "full_well",
        "full_wel",
    );
    refuses_rig(&["missing field `scale`"], "scale = 0.001", "");
    refuses_rig(
        &["rig.toml, line 2"],
        "frame_rate = 10.0",
        "frame_rate = ten",
    );
    refuses_rig(
        &["frame_rate is 0"],
        "frame_rate = 10.0",
        "frame_rate = 0.0",
    );
    refuses_rig(
        &["frame_rate is NaN"],
        "frame_rate = 10.0",
        "frame_rate = nan",
    );
    refuses_rig(&["unknown variant `png8`"], "png16", "png8");
    refuses_rig(
        &["color camera would see"],
        "fx = 110.0\nfy = 111.0",
        "fx = 500.0\nfy = 500.0",
    );
    refuses_rig(&["focal length of 5 pixels"], "fx = 110.0", "fx = 5.0");
    refuses_rig(&["fy / fx"], "fy = 111.0", "fy = 220.0");
    refuses_rig(&["cx / width"], "cx = 63.5", "cx = 10.0");
    refuses_rig(&["outside the image"], "cx = 63.5", "cx = 319.5");
    refuses_rig(&["not usable"], "width = 128", "width = 0");
    refuses_rig(
        &["000000.color.jpg has 128x96", "160x96"],
        "width = 128",
        "width = 160",
    );
    refuses_rig(
        &["number of distortion coefficients is 2"],
        "distortion = []",
        "distortion = [0.1, 0.2]",
    );
    refuses_rig(&["exactly one of"], "depth_from_color = \"identity\"", "");
    refuses_rig(&["expected \"identity\""], "\"identity\"", "\"none\"");
    refuses_rig(
        &["unknown field `shift`"],
        "\"identity\"",
        "{ shift = [1, 2, 3] }",
    );
    refuses_rig(
        &["translation is 24.4", "1 metre"],
        "\"identity\"",
        "{ translation = [24.4, 0.0, 0.0] }",
    );
    refuses_rig(
        &["rotation is 2"],
        "\"identity\"",
        "{ rotation = [0.0, 0.0, 0.0, 2.0] }",
    );
    refuses_rig(&["response gamma"], "gamma = 2.2", "gamma = 0.0");
    refuses_rig(&["vignetting radius"], "radius = 80.0", "radius = -1.0");
    refuses_rig(
        &["white_level is 1023"],
        "white_level = 255",
        "white_level = 1023",
    );
    refuses_rig(&["relative exposure"], "relative = 1.0", "relative = 0.0");
    refuses_rig(&["min_depth"], "min_depth = 0.4", "min_depth = -1.0");
    refuses_rig(
        &["nearest depth"],
        "min_depth = 0.4",
        "min_depth = 0.4\nmax_depth = 0.3",
    );
}

#[test]
fn wrong_splits_and_ranges() {
    let refuses_split = |expected: &[&str], split: &str| {
        refuses(expected, |folder| {
            folder.write("split.json", split.as_bytes());
        });
    };
    refuses_split(
        &["frame 2 is named twice"],
        r#"{"train": [0, 1, 2], "test": [2]}"#,
    );
    refuses_split(&["frame 1 is named twice"], r#"{"train": [0, 1, 1]}"#);
    refuses_split(&["names frame 8", "0..8"], r#"{"train": [0, 8]}"#);
    refuses_split(&["no training frame"], r#"{"train": [], "test": [1]}"#);
    refuses_split(
        &["unknown field `tests`"],
        r#"{"train": [0], "tests": [1]}"#,
    );
    refuses_split(&["missing field `train`"], r#"{"test": [1]}"#);
    refuses_split(&["split.json, line 1"], r#"{"train": [-1]}"#);
    for range in [5..9, 8..9, 100..200, usize::MAX - 1..usize::MAX] {
        let folder = Folder::plain();
        let mut options = folder.options();
        options.range = Some(range.clone());
        let error = import(&options, &mut |_, _| {}).unwrap_err().to_string();
        assert!(
            error.contains("leaves the folder, which has the frames 0..8"),
            "{error}"
        );
    }
    let folder = Folder::plain();
    let mut options = folder.options();
    options.range = Some(5..8);
    let error = import(&options, &mut |_, _| {}).unwrap_err().to_string();
    assert!(error.contains("no training frame"), "{error}");
}

#[test]
fn wrong_seven_scenes_poses() {
    let refuses_pose = |expected: &[&str], text: &str| {
        let folder = Folder::seven_scenes();
        folder.write("frame-000004.pose.txt", text.as_bytes());
        let sentence = sentence(&folder);
        for part in ["frame-000004.pose.txt"].iter().chain(expected) {
            assert!(sentence.contains(part), "no `{part}` in: {sentence}");
        }
    };
    let pose = world_from_camera(4);
    refuses_pose(&["not orthonormal"], &matrix_text(&pose, 1.01));
    refuses_pose(&["not a number"], "1 0 0 nan\n0 1 0 0\n0 0 1 0\n0 0 0 1\n");
    refuses_pose(&["4 numbers", "16"], "1 0 0 0\n");
    refuses_pose(&["line 1", "`-1.#IND` is no number"], "-1.#IND 0 0 0\n");
    let transposed = "1 0 0 0\n0 1 0 0\n0 0 1 0\n0.1 0.2 0.3 1\n";
    refuses_pose(&["transposed"], transposed);
    refuses_pose(&["mirrors"], "1 0 0 0\n0 1 0 0\n0 0 -1 0\n0 0 0 1\n");
    let folder = Folder::seven_scenes();
    folder.remove("frame-000004.pose.txt");
    assert!(sentence(&folder).contains("frame 4 has no pose"));
}

#[test]
fn places_that_cannot_be_read_or_written() {
    let folder = Folder::plain();
    let mut options = folder.options();
    options.output = folder.path("no/such/folder/out.glint");
    let error = import(&options, &mut |_, _| {}).unwrap_err().to_string();
    assert!(error.contains("no/such/folder/out.glint"), "{error}");
    let mut options = folder.options();
    options.input = folder.path("nothing");
    let error = import(&options, &mut |_, _| {}).unwrap_err().to_string();
    assert!(error.contains("nothing"), "{error}");
    let mut options = folder.options();
    options.input = folder.path("poses.txt");
    assert!(import(&options, &mut |_, _| {}).is_err());
}

#[test]
fn a_refusal_is_exit_code_2_and_one_line() {
    let folder = Folder::plain();
    folder.edit("rig.toml", "scale = 0.001", "scale = 0.01");
    let output = Command::new(env!("CARGO_BIN_EXE_glint"))
        .arg("import")
        .arg(folder.root())
        .arg("-o")
        .arg(folder.path("out.glint"))
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(2));
    let message = String::from_utf8(output.stderr).unwrap();
    assert_eq!(message.trim_end().lines().count(), 1, "{message}");
    assert!(message.contains("depth.scale"), "{message}");
    assert!(!folder.path("out.glint").exists());
}

/// Damage by chance: whatever it does, the import ends with a recording or a sentence.
#[test]
fn random_damage_never_panics() {
    let plain = [
        "rig.toml",
        "poses.txt",
        "split.json",
        "frames/000000.depth.png",
        "frames/000003.color.jpg",
    ];
    damage_by_chance(&Folder::plain(), &plain, 150);
    damage_by_chance(
        &Folder::tum(),
        &["rgb.txt", "depth.txt", "groundtruth.txt"],
        80,
    );
}

fn damage_by_chance(folder: &Folder, names: &[&str], round_count: usize) {
    let whole: Vec<Vec<u8>> = names.iter().map(|name| folder.read(name)).collect();
    let mut random = Pcg64Mcg::seed_from_u64(20);
    let mut refused_count = 0;
    for _ in 0..round_count {
        let which = random.random_range(0..names.len());
        let mut bytes = whole[which].clone();
        for _ in 0..random.random_range(1..4) {
            let at = random.random_range(0..bytes.len());
            match random.random_range(0..4) {
                0 => bytes.truncate(at.max(1)),
                1 => bytes[at] ^= 1 << random.random_range(0..8),
                2 => bytes[at] = random.random(),
                _ => bytes.insert(at, random.random()),
            }
        }
        folder.write(names[which], &bytes);
        refused_count += usize::from(folder.import().is_err());
        folder.write(names[which], &whole[which]);
    }
    println!("{refused_count} of {round_count} damaged folders were refused");
    assert!(refused_count > round_count / 4);
    folder.import().unwrap();
}
