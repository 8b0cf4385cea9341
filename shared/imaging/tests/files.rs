//! Files: round trips, hostile input, real files where they are at hand.

use std::fs;
use std::path::{Path, PathBuf};

use geometry::{DMat3, DVec3};
use imaging::{
    ConfidenceMap, Image, ImagingError, PanoramaAttributes, decode_jpeg, decode_png_gray8,
    decode_png_gray16, decode_png_mask, decode_png_rgb8, encode_jpeg, encode_png_gray16,
    encode_png_mask, encode_png_rgb8, jpeg_is_subsampled, read_channel_exr, read_confidence_exr,
    read_rgb_exr, write_confidence_exr, write_rgb_exr, write_whole_file,
};
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;
use tempfile::tempdir;

fn picture(width: u32, height: u32) -> Image<[u8; 3]> {
    Image::from_fn(width, height, |x, y| {
        [(5 * x) as u8, (7 * y) as u8, (3 * (x + y)) as u8]
    })
}

fn panorama(width: u32, height: u32) -> Image<[f32; 3]> {
    let mut rng = Pcg64::seed_from_u64(20);
    Image::from_fn(width, height, |_, _| {
        std::array::from_fn(|_| 4.0 * rng.random::<f32>() - 0.1)
    })
}

fn attributes() -> PanoramaAttributes {
    PanoramaAttributes {
        // A turn that f32 holds exactly, so that the round trip can be compared bit for bit.
        world_from_panorama: DMat3::from_cols(DVec3::Z, DVec3::Y, DVec3::NEG_X),
        origin: DVec3::new(0.25, -1.5, 3.0),
        radius: 2.5,
        gain: 0.375,
    }
}

/// A PNG of stored (uncompressed) deflate blocks, for forms that our encoder does not write.
fn stored_png(
    width: u32,
    height: u32,
    depth: u8,
    color_type: u8,
    extra: &[(&[u8; 4], &[u8])],
    rows: &[u8],
) -> Vec<u8> {
    fn chunk(png: &mut Vec<u8>, kind: &[u8; 4], data: &[u8]) {
        let body = [kind.as_slice(), data].concat();
        let check = !body.iter().fold(u32::MAX, |crc, &byte| {
            (0..8).fold(crc ^ u32::from(byte), |crc, _| {
                if crc & 1 == 1 {
                    (crc >> 1) ^ 0xEDB8_8320
                } else {
                    crc >> 1
                }
            })
        });
        png.extend((data.len() as u32).to_be_bytes());
        png.extend(body);
        png.extend(check.to_be_bytes());
    }
    let (mut a, mut b) = (1_u32, 0_u32);
    for &byte in rows {
        a = (a + u32::from(byte)) % 65521;
        b = (b + a) % 65521;
    }
    let length = rows.len() as u16;
    let mut stream = vec![0x78, 0x01, 1];
    stream.extend(length.to_le_bytes());
    stream.extend((!length).to_le_bytes());
    stream.extend(rows);
    stream.extend((b << 16 | a).to_be_bytes());
    let mut png = vec![137, 80, 78, 71, 13, 10, 26, 10];
    let header = [
        &width.to_be_bytes()[..],
        &height.to_be_bytes(),
        &[depth, color_type, 0, 0, 0],
    ]
    .concat();
    chunk(&mut png, b"IHDR", &header);
    for (kind, data) in extra {
        chunk(&mut png, kind, data);
    }
    chunk(&mut png, b"IDAT", &stream);
    chunk(&mut png, b"IEND", &[]);
    png
}

#[test]
fn png_round_trips_are_exact_and_repeatable() {
    let image = picture(37, 21);
    let bytes = encode_png_rgb8(&image).unwrap();
    assert_eq!(bytes, encode_png_rgb8(&image).unwrap());
    assert_eq!(decode_png_rgb8(&bytes).unwrap(), image);
    let depth = Image::from_fn(37, 21, |x, y| (1771 * x + 401 * y) as u16);
    assert_eq!(
        decode_png_gray16(&encode_png_gray16(&depth).unwrap()).unwrap(),
        depth
    );
    let mask = Image::from_fn(37, 21, |x, y| (x * y) % 3 == 0);
    assert_eq!(
        decode_png_mask(&encode_png_mask(&mask).unwrap()).unwrap(),
        mask
    );
    assert!(matches!(
        decode_png_gray16(&bytes),
        Err(ImagingError::PixelType { .. })
    ));
    assert!(matches!(
        decode_png_rgb8(&encode_png_gray16(&depth).unwrap()),
        Err(ImagingError::PixelType { .. })
    ));
    assert!(matches!(
        decode_png_gray8(&bytes),
        Err(ImagingError::PixelType { .. })
    ));
}

#[test]
fn palette_images_give_their_indices_and_one_bit_masks_their_bits() {
    // 5x2 pixels of 4 bits: indices 0 1 2 3 4 / 4 0 2 0 1; the palette makes index 1 black, as index 0.
    let palette = [0, 0, 0, 0, 0, 0, 9, 9, 9, 200, 0, 0, 0, 200, 0];
    let rows = [0, 0x01, 0x23, 0x40, 0, 0x40, 0x20, 0x10];
    let png = stored_png(5, 2, 4, 3, &[(b"PLTE", &palette), (b"tRNS", &[0])], &rows);
    assert_eq!(
        decode_png_gray8(&png).unwrap().pixels(),
        &[0, 1, 2, 3, 4, 4, 0, 2, 0, 1]
    );
    let mask = decode_png_mask(&png).unwrap();
    assert_eq!(mask.pixels().iter().filter(|&&m| m).count(), 7);
    assert_eq!(decode_png_rgb8(&png).unwrap().at(3, 0), [200, 0, 0]);
    for (depth, rows, expected) in [
        (1, [0, 0b0100_0000], [0, 1]),
        (2, [0, 0b1101_0000], [3, 1]),
        (8, [7, 0], [255, 0]),
    ] {
        let palette = vec![50; 768 / (256 >> depth)];
        let rows = if depth == 8 {
            vec![0, 255, 0]
        } else {
            rows.to_vec()
        };
        let png = stored_png(2, 1, depth, 3, &[(b"PLTE", &palette)], &rows);
        assert_eq!(
            decode_png_gray8(&png).unwrap().pixels(),
            &expected,
            "{depth} bits"
        );
    }
    let one_bit = stored_png(10, 1, 1, 0, &[], &[0, 0b1010_0000, 0b0100_0000]);
    let expected: Vec<bool> = (0..10).map(|x| [0, 2, 9].contains(&x)).collect();
    assert_eq!(decode_png_mask(&one_bit).unwrap().pixels(), expected);
}

#[test]
fn jpeg_round_trip_is_close_and_keeps_full_chroma() {
    let image = picture(48, 32);
    let bytes = encode_jpeg(&image, 95).unwrap();
    assert!(!jpeg_is_subsampled(&bytes).unwrap());
    let back = decode_jpeg(&bytes).unwrap();
    let worst = image
        .pixels()
        .iter()
        .flatten()
        .zip(back.pixels().iter().flatten())
        .map(|(&a, &b)| a.abs_diff(b))
        .max();
    assert!(worst <= Some(12), "{worst:?}");
    // The same frame header with luma sampled twice as finely.
    let at = bytes
        .windows(2)
        .position(|pair| pair == [0xFF, 0xC0])
        .unwrap();
    let mut subsampled = bytes.clone();
    subsampled[at + 11] = 0x22;
    assert!(jpeg_is_subsampled(&subsampled).unwrap());
}

#[test]
fn a_cut_jpeg_or_png_is_an_error_at_every_length() {
    let image = picture(24, 16);
    let (jpeg, png) = (
        encode_jpeg(&image, 80).unwrap(),
        encode_png_rgb8(&image).unwrap(),
    );
    let depth = encode_png_gray16(&Image::new(9, 7, 700)).unwrap();
    for length in 0..jpeg.len() {
        assert!(
            decode_jpeg(&jpeg[..length]).is_err(),
            "jpeg cut to {length} bytes"
        );
    }
    // The end chunk carries no pixels; everything before it must be there.
    for length in 0..png.len() - 12 {
        assert!(
            decode_png_rgb8(&png[..length]).is_err(),
            "png cut to {length} bytes"
        );
    }
    for length in 0..depth.len() - 12 {
        assert!(
            decode_png_gray16(&depth[..length]).is_err(),
            "16-bit png cut to {length} bytes"
        );
        assert!(decode_png_mask(&depth[..length]).is_err());
    }
}

#[test]
fn absurd_sizes_are_refused_before_allocation() {
    let mut jpeg = encode_jpeg(&picture(8, 8), 80).unwrap();
    let at = jpeg
        .windows(2)
        .position(|pair| pair == [0xFF, 0xC0])
        .unwrap();
    for size in [[0xFF; 4], [0x40, 0x00, 0x40, 0x00], [0; 4]] {
        jpeg[at + 5..at + 9].copy_from_slice(&size);
        assert!(
            matches!(decode_jpeg(&jpeg), Err(ImagingError::TooLarge { .. })),
            "{size:?}"
        );
    }
    for (width, height, depth, color_type) in [
        (u32::MAX, u32::MAX, 16, 6),
        (16384, 16384, 8, 2),
        (16384, 16384, 1, 0),
        (16385, 1, 8, 0),
        (0, 1, 8, 0),
    ] {
        let png = stored_png(width, height, depth, color_type, &[], &[0; 8]);
        for error in [
            decode_png_rgb8(&png).err(),
            decode_png_gray16(&png).err(),
            decode_png_mask(&png).err(),
        ] {
            assert!(
                matches!(error, Some(ImagingError::TooLarge { .. })),
                "{width}x{height} {error:?}"
            );
        }
    }
}

#[test]
fn flipped_bytes_never_panic() {
    let mut rng = Pcg64::seed_from_u64(21);
    let image = picture(24, 16);
    let folder = tempdir().unwrap();
    let path = folder.path().join("map.exr");
    write_rgb_exr(&path, &panorama(24, 12), &attributes()).unwrap();
    let exr = fs::read(&path).unwrap();
    let palette = stored_png(
        5,
        2,
        4,
        3,
        &[(b"PLTE", &[0; 48])],
        &[0, 1, 2, 3, 0, 4, 5, 6],
    );
    let originals = [
        encode_jpeg(&image, 80).unwrap(),
        encode_png_rgb8(&image).unwrap(),
        palette,
        exr,
    ];
    let mut refused_count = 0;
    for round in 0..4000 {
        let mut bytes = originals[round % 4].clone();
        for _ in 0..1 + rng.random::<u32>() % 3 {
            let at = rng.random::<u32>() as usize % bytes.len();
            bytes[at] = rng.random();
        }
        if rng.random::<f64>() < 0.2 {
            bytes.truncate(rng.random::<u32>() as usize % bytes.len());
        }
        let refused = match round % 4 {
            0 => decode_jpeg(&bytes).is_err() | jpeg_is_subsampled(&bytes).is_err(),
            1 => decode_png_rgb8(&bytes).is_err(),
            2 => decode_png_gray8(&bytes).is_err(),
            _ => {
                fs::write(&path, &bytes).unwrap();
                read_rgb_exr(&path).is_err() | read_channel_exr(&path, None).is_err()
            }
        };
        refused_count += usize::from(refused);
    }
    println!("{refused_count} of 4000 damaged files are refused");
    assert!(refused_count > 1000);
}

#[test]
fn a_panorama_keeps_pixels_attributes_and_bytes() {
    let folder = tempdir().unwrap();
    let (path, again) = (
        folder.path().join("map.exr"),
        folder.path().join("again.exr"),
    );
    let mut map = panorama(64, 32);
    *map.at_mut(3, 4) = [f32::INFINITY, 1e-30, -0.0];
    write_rgb_exr(&path, &map, &attributes()).unwrap();
    write_rgb_exr(&again, &map, &attributes()).unwrap();
    assert_eq!(fs::read(&path).unwrap(), fs::read(&again).unwrap());
    assert_eq!(
        read_rgb_exr(&path).unwrap(),
        (map.clone(), Some(attributes()))
    );
    let distant = PanoramaAttributes::default();
    write_rgb_exr(&path, &map, &distant).unwrap();
    assert_eq!(read_rgb_exr(&path).unwrap().1, Some(distant));
    assert_eq!(distant.radius, f64::INFINITY);
    let names: Vec<_> = fs::read_dir(folder.path())
        .unwrap()
        .map(|e| e.unwrap().file_name())
        .collect();
    assert_eq!(names.len(), 2, "no part is left behind: {names:?}");
    // The attributes stand in the order of their names: no hash map decides.
    let bytes = fs::read(&path).unwrap();
    let positions: Vec<usize> = [
        b"channels\0".as_slice(),
        b"glint.axes\0",
        b"glint.gain\0",
        b"glint.world_from_panorama\0",
        b"lineOrder\0",
    ]
    .iter()
    .map(|name| bytes.windows(name.len()).position(|w| w == *name).unwrap())
    .collect();
    assert!(positions.is_sorted(), "{positions:?}");
}

#[test]
fn unusable_attributes_are_refused_on_both_sides() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("map.exr");
    let map = panorama(8, 4);
    let bad = [
        PanoramaAttributes {
            world_from_panorama: DMat3::from_diagonal(DVec3::new(1.0, 1.0, -1.0)),
            ..attributes()
        },
        PanoramaAttributes {
            world_from_panorama: 2.0 * DMat3::IDENTITY,
            ..attributes()
        },
        PanoramaAttributes {
            origin: DVec3::new(f64::NAN, 0.0, 0.0),
            ..attributes()
        },
        PanoramaAttributes {
            radius: 0.0,
            ..attributes()
        },
        PanoramaAttributes {
            gain: f64::NAN,
            ..attributes()
        },
    ];
    for attributes in bad {
        assert!(matches!(
            write_rgb_exr(&path, &map, &attributes),
            Err(ImagingError::Attribute { .. })
        ));
    }
    assert!(!path.exists());
    write_rgb_exr(&path, &map, &attributes()).unwrap();
    let mut bytes = fs::read(&path).unwrap();
    let at = bytes.windows(7).position(|w| w == b"x-right").unwrap();
    bytes[at..at + 7].copy_from_slice(b"x-wrong");
    fs::write(&path, &bytes).unwrap();
    let error = read_rgb_exr(&path).unwrap_err();
    assert!(error.to_string().contains("glint.axes"), "{error}");
}

#[test]
fn a_confidence_map_keeps_every_channel() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("confidence.exr");
    let mut sigma = panorama(20, 10);
    *sigma.at_mut(0, 0) = [f32::INFINITY; 3];
    let map = ConfidenceMap {
        confidence: Image::from_fn(20, 10, |x, _| x as f32 / 20.0),
        sigma,
        sample_count: Image::from_fn(20, 10, |x, y| (x * y) as f32),
        flags: Image::from_fn(20, 10, |x, y| u32::MAX - (x << 20) - y),
    };
    write_confidence_exr(&path, &map).unwrap();
    assert_eq!(read_confidence_exr(&path).unwrap(), map);
    assert_eq!(
        read_channel_exr(&path, Some("confidence")).unwrap(),
        map.confidence
    );
    let error = read_channel_exr(&path, Some("depth")).unwrap_err();
    assert!(error.to_string().contains("sample_count"), "{error}");
    let uneven = ConfidenceMap {
        flags: Image::new(20, 9, 0),
        ..map
    };
    assert!(write_confidence_exr(&path, &uneven).is_err());
}

#[test]
fn a_cut_or_oversized_exr_is_an_error() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("map.exr");
    write_rgb_exr(&path, &panorama(40, 20), &attributes()).unwrap();
    let bytes = fs::read(&path).unwrap();
    for length in (0..bytes.len()).step_by(7) {
        fs::write(&path, &bytes[..length]).unwrap();
        assert!(
            read_rgb_exr(&path).is_err(),
            "cut to {length} of {} bytes",
            bytes.len()
        );
    }
    // dataWindow: the corner (39, 19) becomes (2³¹ − 2, 2³¹ − 2), then 16383 squared.
    let at = bytes
        .windows(11)
        .position(|w| w == b"dataWindow\0")
        .unwrap()
        + 11
        + 6
        + 4
        + 8;
    for corner in [i32::MAX - 1, 16383] {
        let mut huge = bytes.clone();
        huge[at..at + 4].copy_from_slice(&corner.to_le_bytes());
        huge[at + 4..at + 8].copy_from_slice(&corner.to_le_bytes());
        fs::write(&path, &huge).unwrap();
        assert!(read_rgb_exr(&path).is_err(), "{corner}");
    }
    assert!(matches!(
        read_rgb_exr(&folder.path().join("absent.exr")),
        Err(ImagingError::Io { .. })
    ));
}

#[test]
fn a_file_appears_whole_or_not_at_all() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("result.bin");
    write_whole_file(&path, b"old").unwrap();
    write_whole_file(&path, b"new").unwrap();
    assert_eq!(fs::read(&path).unwrap(), b"new");
    // A folder of that name cannot be replaced: the part is removed, the error names the target.
    let taken = folder.path().join("taken");
    fs::create_dir(&taken).unwrap();
    fs::write(taken.join("inside"), b"x").unwrap();
    let error = write_whole_file(&taken, b"new").unwrap_err();
    assert!(error.to_string().contains("taken"), "{error}");
    assert!(write_whole_file(&folder.path().join("no/such/folder"), b"new").is_err());
    assert!(write_whole_file(Path::new("/"), b"new").is_err());
    let mut names: Vec<_> = fs::read_dir(folder.path())
        .unwrap()
        .map(|e| e.unwrap().file_name())
        .collect();
    names.sort();
    assert_eq!(names, ["result.bin", "taken"]);
}

/// The shared data beside the checkout, or `None` with a line that says so.
fn shared_data(part: &str) -> Option<PathBuf> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../../shared/data")
        .join(part);
    if path.exists() {
        return Some(path);
    }
    println!("skipped: {} is not there", path.display());
    None
}

#[test]
fn files_of_an_independent_renderer_are_read() {
    let Some(data) = shared_data("mitsuba-dev") else {
        return;
    };
    let read = |name: &str| fs::read(data.join(name)).unwrap();
    let jpeg = read("frames/000000.color.jpg");
    assert!(!jpeg_is_subsampled(&jpeg).unwrap());
    let color = decode_jpeg(&jpeg).unwrap();
    assert_eq!((color.width(), color.height()), (640, 480));
    let depth = decode_png_gray16(&read("frames/000000.depth.png")).unwrap();
    let (depth, counts) = imaging::metres_from_raw(&depth, 0.001, 0.4..=8.0);
    assert!(counts.measured_count > 100_000, "{counts:?}");
    assert!(
        depth
            .pixels()
            .iter()
            .all(|&d| d == 0.0 || (0.4..=8.0).contains(&d))
    );
    // The mask marks exactly the objects 1 to 3; object 4 is the table.
    let mask = decode_png_mask(&read("masks/000000.png")).unwrap();
    let objects = decode_png_gray8(&read("truth/objects/000000.png")).unwrap();
    assert!(objects.pixels().iter().all(|&id| id <= 4));
    for (&marked, &id) in mask.pixels().iter().zip(objects.pixels()) {
        assert_eq!(marked, (1..=3).contains(&id));
    }
    let (environment, attributes) = read_rgb_exr(&data.join("truth/environment.exr")).unwrap();
    assert_eq!((environment.width(), environment.height()), (512, 256));
    assert_eq!(attributes, Some(PanoramaAttributes::default()));
    let reach = read_channel_exr(&data.join("truth/reach.exr"), None).unwrap();
    assert_eq!((reach.width(), reach.height()), (128, 64));
    assert!(reach.pixels().iter().all(|&v| v == 0.0 || v == 1.0));
    assert!(read_rgb_exr(&data.join("truth/reach.exr")).is_err());
}

#[test]
fn jpegs_of_a_real_camera_are_read() {
    let Some(data) = shared_data("redkitchen") else {
        return;
    };
    let jpeg = fs::read(data.join("frame-000000.color.jpg")).unwrap();
    let color = decode_jpeg(&jpeg).unwrap();
    assert_eq!((color.width(), color.height()), (640, 480));
    println!("subsampled: {}", jpeg_is_subsampled(&jpeg).unwrap());
    let depth = decode_png_gray16(&fs::read(data.join("frame-000000.depth.png")).unwrap()).unwrap();
    let (_, counts) = imaging::metres_from_raw(&depth, 0.001, 0.4..=8.0);
    assert!(
        counts.measured_count > 100_000 && counts.missing_count > 0,
        "{counts:?}"
    );
}
