//! Points of one pair.

use geometry::DVec2;
use glint::export::{ExportTarget, export};
use sequence::ColorEncoding;

use crate::made::{LOST, Made, depth, streams, world_from_depth};

/// Header and body of a PLY file.
fn split(bytes: &[u8]) -> (String, Vec<u8>) {
    let end = b"end_header\n";
    let at = bytes
        .windows(end.len())
        .position(|window| window == end)
        .unwrap()
        + end.len();
    (
        String::from_utf8(bytes[..at].to_vec()).unwrap(),
        bytes[at..].to_vec(),
    )
}

#[test]
fn the_points_of_a_pair_lie_where_its_pose_says() {
    let made = Made::new(ColorEncoding::Jpeg);
    let mut options = made.options(ExportTarget::Ply, "points.ply");
    options.frame = Some(4);
    let report = export(&options, &mut |_, _| {}).unwrap();
    assert!(
        report.text.contains("of pair 4 in world axes"),
        "{}",
        report.text
    );
    let (header, body) = split(&made.read("points.ply"));
    assert!(header.contains("property uchar red") && header.contains("pair 4; metres; world axes"));
    // Pair 4 is frame 5 of the streams.
    let (streams, samples) = (streams(ColorEncoding::Jpeg), depth(5, false));
    let (camera, color_camera) = (&streams.depth.intrinsics, &streams.color.intrinsics);
    let mut points = body.chunks_exact(15);
    let mut count = 0;
    for y in 0..samples.height() {
        for x in 0..samples.width() {
            let code = samples.at(x, y);
            let z = f64::from(code) * 0.00137;
            if code == 0 || code == u16::MAX || !(0.5..=5.3).contains(&z) {
                continue;
            }
            let ray = camera
                .camera_from_pixel(DVec2::new(f64::from(x), f64::from(y)))
                .unwrap();
            let seen = color_camera
                .pixel_from_camera(streams.color_from_depth.transform_point(ray * z))
                .and_then(|pixel| color_camera.contains(pixel));
            let Some((u, v)) = seen else { continue };
            let point = points.next().unwrap();
            let expected = world_from_depth(5).transform_point(ray * z).to_array();
            for (axis, expected) in expected.into_iter().enumerate() {
                let at = 4 * axis;
                let got = f32::from_le_bytes(point[at..at + 4].try_into().unwrap());
                assert!((f64::from(got) - expected).abs() < 1e-5);
            }
            // JPEG moves the smooth colours by a few codes.
            assert!(point[12].abs_diff((2 * u) as u8) < 12, "{point:?} {u}");
            assert!(point[13].abs_diff((2 * v) as u8) < 12, "{point:?} {v}");
            count += 1;
        }
    }
    assert!(points.next().is_none());
    assert!(header.contains(&format!("element vertex {count}\n")));
}

#[test]
fn a_pair_without_a_pose_gives_points_in_camera_axes() {
    let made = Made::new(ColorEncoding::BayerGrbg);
    let mut options = made.options(ExportTarget::Ply, "points.ply");
    options.frame = Some(LOST[0] as usize);
    let report = export(&options, &mut |_, _| {}).unwrap();
    assert!(
        report.text.contains("axes of the depth camera"),
        "{}",
        report.text
    );
    let (header, body) = split(&made.read("points.ply"));
    assert!(header.contains("red"), "raw colour is developed");
    let z = f64::from(f32::from_le_bytes(body[8..12].try_into().unwrap()));
    let first = depth(LOST[0], false).at(0, 2);
    assert!((z - f64::from(first) * 0.00137).abs() < 1e-5);
}

#[test]
fn a_pair_that_is_not_there_gets_a_sentence() {
    let made = Made::new(ColorEncoding::Jpeg);
    let mut options = made.options(ExportTarget::Ply, "points.ply");
    options.frame = Some(7);
    assert!(made.refusal(&options).contains("has the pairs 0 to 6"));
    let mut options = made.options(ExportTarget::Tum, "tum");
    options.frame = Some(1);
    assert!(made.refusal(&options).contains("--frame"));
}
