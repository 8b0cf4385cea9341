//! One pair of a recording as points, binary PLY.

use anyhow::{Context as _, bail, ensure};
use geometry::{DVec2, Pose};
use imaging::{DepthImage, Rgb8Image, is_measured, metres_from_raw};
use sequence::Recording;

use crate::run_folder::write_atomically;

use super::files::{ColorForm, FrameFiles};
use super::poses::ExportPoses;
use super::{ExportOptions, ExportReport, counted};

/// Writes the points of the pair that the options name, in world axes if it has a pose, else in those of the
/// depth camera. Points that the colour camera does not see are left out; nothing hides another.
pub(crate) fn export(
    recording: &Recording,
    options: &ExportOptions,
) -> anyhow::Result<ExportReport> {
    let pair_count = recording.frame_count();
    let path = recording.path().display();
    ensure!(pair_count > 0, "{path} has no pair of depth and colour");
    let index = options.frame.unwrap_or(pair_count / 2);
    ensure!(
        index < pair_count,
        "--frame {index} does not exist: {path} has the pairs 0 to {}",
        pair_count - 1
    );
    let poses = ExportPoses::choose(recording, options.poses.as_deref())?;
    let files = FrameFiles::new(recording, ColorForm::AsSent)?;
    let camera = files.streams().depth;
    let codes = files.depth(recording.depth_place(index)?);
    let codes = codes.with_context(|| format!("depth of pair {index} of {path}"))?;
    let depth = metres_from_raw(&codes, camera.depth_scale, camera.depth_range.clone()).0;
    let color = recording.color(index)?;
    let world_from_depth = poses.of_pair(index);
    let cloud = points(recording, &depth, &color, world_from_depth);
    if cloud.is_empty() {
        bail!("pair {index} of {path} has no depth that can be drawn; choose another with --frame");
    }
    let axes = match world_from_depth {
        Some(_) => "world axes",
        None => "axes of the depth camera (the pair has no pose): x right, y down, z forward",
    };
    let bytes = ply_bytes(&cloud, index, axes);
    write_atomically(&options.output, &bytes)?;
    Ok(ExportReport {
        text: format!(
            "{} of pair {index} in {axes}, metres, to {}",
            counted(cloud.len(), "point"),
            options.output.display()
        ),
        missing: Vec::new(),
    })
}

/// A point with the colour codes of the pixel that sees it.
struct Point {
    position: [f32; 3],
    color: [u8; 3],
}

fn points(
    recording: &Recording,
    depth: &DepthImage,
    color: &Rgb8Image,
    world_from_depth: Option<Pose>,
) -> Vec<Point> {
    let depth_camera = &recording.depth_camera().intrinsics;
    let color_camera = &recording.color_camera().intrinsics;
    let color_from_depth = recording.color_from_depth();
    let world_from_depth = world_from_depth.unwrap_or(Pose::IDENTITY);
    let mut points = Vec::new();
    for y in 0..depth.height() {
        for x in 0..depth.width() {
            let z = depth.at(x, y);
            if !is_measured(z) {
                continue;
            }
            let pixel = DVec2::new(f64::from(x), f64::from(y));
            let Some(ray) = depth_camera.camera_from_pixel(pixel) else {
                continue;
            };
            let in_depth = ray * f64::from(z);
            let seen = color_camera
                .pixel_from_camera(color_from_depth.transform_point(in_depth))
                .and_then(|pixel| color_camera.contains(pixel));
            let Some((u, v)) = seen else { continue };
            points.push(Point {
                position: world_from_depth
                    .transform_point(in_depth)
                    .as_vec3()
                    .to_array(),
                color: color.at(u, v),
            });
        }
    }
    points
}

fn ply_bytes(points: &[Point], index: usize, axes: &str) -> Vec<u8> {
    let mut header = format!(
        "ply\nformat binary_little_endian 1.0\ncomment pair {index}; metres; {axes}\nelement vertex {}\n",
        points.len()
    );
    for name in ["x", "y", "z"] {
        header.push_str(&format!("property float {name}\n"));
    }
    for name in ["red", "green", "blue"] {
        header.push_str(&format!("property uchar {name}\n"));
    }
    header.push_str("end_header\n");
    let mut bytes = header.into_bytes();
    for point in points {
        for value in point.position {
            bytes.extend_from_slice(&value.to_le_bytes());
        }
        bytes.extend_from_slice(&point.color);
    }
    bytes
}
