//! A small studio: spheres on a table, filmed along an orbit, written as a recording. Rendered here with
//! closed forms for texture and normal, so that nothing of the estimators judges itself.

use std::path::Path;

use geometry::{DVec3, Intrinsics, PanoramaSize, Pose, direction};
use glam::Vec3;
use imaging::{Image, encode_png_gray16, encode_png_rgb8};
use raytrace::{Hit, MirrorQuery, NO_TRIANGLE, Scene, visibility_buffer};
use sequence::codecs::DepthCodec;
use sequence::encode::{ColorStreamEncoder, DepthStreamEncoder};
use sequence::{
    COLOR_STREAM, ColorCamera, ColorEncoding, Created, DEPTH_STREAM, DepthCamera, Description,
    FileId, FramePose, FrameTimes, RecordingWriter, ResponseCurve, Split, StreamTiming, Streams,
    VignettingCurve,
};

/// Frames of a recording.
pub(crate) const FRAME_COUNT: u32 = 72;
/// Reflectance of shiny spheres: what the trainer assumes, so that maps compare without a factor.
pub(crate) const REFLECTANCE: f32 = 0.3;
const GAMMA: f64 = 2.2;

/// What the spheres are made of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Finish {
    /// Lambertian under constant light.
    Matte,
    /// The same texture, darker, under a mirror of reflectance 0.3.
    Shiny,
}

struct Sphere {
    center: Vec3,
    radius: f32,
}

const SPHERES: [Sphere; 2] = [
    Sphere {
        center: Vec3::new(-0.07, -0.065, 0.0),
        radius: 0.065,
    },
    Sphere {
        center: Vec3::new(0.075, -0.055, 0.03),
        radius: 0.055,
    },
];
/// Half width of the table, metres.
const TABLE: f32 = 0.4;
/// Rings and sectors of a sphere's mesh: facets below a fifth of a millimetre deep.
const RINGS: u32 = 96;

/// The room: grey walls, two windows and a lamp, linear radiance.
pub(crate) fn room(toward: DVec3) -> [f32; 3] {
    let longitude = f64::atan2(toward.x, toward.z);
    let height = -toward.y;
    let mut radiance = [0.22, 0.2, 0.18];
    if height > 0.1 && height < 0.6 && (longitude - 0.6).abs() < 0.35 {
        radiance = [0.75, 0.85, 0.95];
    } else if height > 0.2 && height < 0.7 && (longitude + 1.9).abs() < 0.25 {
        radiance = [0.9, 0.75, 0.4];
    } else if height > 0.85 {
        radiance = [0.6, 0.6, 0.55];
    } else if height < 0.0 {
        radiance = [0.08, 0.07, 0.06];
    }
    radiance
}

/// The room as a panorama.
pub(crate) fn room_panorama(size: PanoramaSize) -> Vec<[f32; 3]> {
    (0..size.texel_count())
        .map(|index| {
            let (row, column) = (index as u32 / size.width(), index as u32 % size.width());
            room(size.direction_from_texel(glam::DVec2::new(f64::from(column), f64::from(row))))
        })
        .collect()
}

struct Studio {
    positions: Vec<Vec3>,
    triangles: Vec<[u32; 3]>,
    /// First triangle of every sphere; the table comes before.
    first_triangle: Vec<u32>,
    scene: Scene,
    finish: Finish,
}

impl Studio {
    fn new(finish: Finish) -> Self {
        let corner = |x: f32, z: f32| Vec3::new(x * TABLE, 0.0, z * TABLE);
        let mut positions = vec![
            corner(-1.0, -1.0),
            corner(1.0, -1.0),
            corner(1.0, 1.0),
            corner(-1.0, 1.0),
        ];
        let mut triangles = vec![[0, 1, 2], [0, 2, 3]];
        let mut first_triangle = Vec::new();
        for sphere in &SPHERES {
            first_triangle.push(triangles.len() as u32);
            push_sphere(sphere, &mut positions, &mut triangles);
        }
        let scene = Scene::new(&positions, &triangles).unwrap();
        Self {
            positions,
            triangles,
            first_triangle,
            scene,
            finish,
        }
    }

    fn position(&self, hit: &Hit) -> Vec3 {
        let [a, b, c] = self.triangles[hit.triangle as usize].map(|v| self.positions[v as usize]);
        a * (1.0 - hit.u - hit.v) + b * hit.u + c * hit.v
    }

    fn sphere_of(&self, triangle: u32) -> Option<&'static Sphere> {
        let index = self
            .first_triangle
            .iter()
            .rposition(|&first| triangle >= first)?;
        Some(&SPHERES[index])
    }

    /// Radiance that leaves the surface at a hit towards everywhere.
    fn diffuse(&self, hit: &Hit) -> [f32; 3] {
        let position = self.position(hit);
        let Some(sphere) = self.sphere_of(hit.triangle) else {
            let odd = ((position.x * 25.0).floor() + (position.z * 25.0).floor()) as i64 % 2 != 0;
            return if odd {
                [0.45, 0.4, 0.33]
            } else {
                [0.3, 0.32, 0.36]
            };
        };
        let normal = (position - sphere.center) / sphere.radius;
        // Soft blobs of ink on black: no edge is finer than a few voxels, and black is what fixes the offset.
        let wave = |phase: f32| {
            let [x, y, z] = normal.to_array();
            ((7.0 * x + phase).sin() * (6.0 * y + 2.0 * phase).sin()
                + (8.0 * z - phase).sin() * 0.5)
                .max(0.0)
        };
        let albedo = [wave(0.3), wave(1.7), wave(4.0)].map(|w| 0.02 + 0.4 * w);
        match self.finish {
            Finish::Matte => albedo.map(|a| a * 1.2),
            Finish::Shiny => albedo.map(|a| a * 0.8),
        }
    }

    fn radiance(&self, hit: &Hit, eye: Vec3) -> [f32; 3] {
        let diffuse = self.diffuse(hit);
        let (Some(sphere), Finish::Shiny) = (self.sphere_of(hit.triangle), self.finish) else {
            return diffuse;
        };
        let position = self.position(hit);
        let normal = (position - sphere.center).normalize();
        let outgoing = (eye - position).normalize();
        let reflection =
            MirrorQuery::for_exact().reflect(&self.scene, position, normal, normal, outgoing);
        let seen = match &reflection.first_bounce {
            Some(bounce) => self.diffuse(bounce),
            None => room(reflection.direction.as_dvec3()),
        };
        [0, 1, 2].map(|c| diffuse[c] + REFLECTANCE * seen[c])
    }
}

fn push_sphere(sphere: &Sphere, positions: &mut Vec<Vec3>, triangles: &mut Vec<[u32; 3]>) {
    let first = positions.len() as u32;
    let sectors = 2 * RINGS;
    for ring in 0..=RINGS {
        let polar = std::f32::consts::PI * ring as f32 / RINGS as f32;
        for sector in 0..sectors {
            let around = std::f32::consts::TAU * sector as f32 / sectors as f32;
            let normal = Vec3::new(
                polar.sin() * around.cos(),
                -polar.cos(),
                polar.sin() * around.sin(),
            );
            positions.push(sphere.center + sphere.radius * normal);
        }
    }
    for ring in 0..RINGS {
        for sector in 0..sectors {
            let next = (sector + 1) % sectors;
            let at = |r: u32, s: u32| first + r * sectors + s;
            triangles.push([at(ring, sector), at(ring + 1, sector), at(ring + 1, next)]);
            triangles.push([at(ring, sector), at(ring + 1, next), at(ring, next)]);
        }
    }
}

/// A ball about the origin, for tests of single rays: positions and triangles.
pub(crate) fn ball(radius: f32) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    let center = Vec3::ZERO;
    push_sphere(&Sphere { center, radius }, &mut positions, &mut triangles);
    (positions, triangles)
}

/// The cameras of the studio: depth and colour are one.
pub(crate) fn streams() -> Streams {
    streams_as(ColorEncoding::Rgb8)
}

fn streams_as(encoding: ColorEncoding) -> Streams {
    let intrinsics = Intrinsics::pinhole(240, 180, 230.0, 230.0, 119.5, 89.5).unwrap();
    Streams {
        depth: DepthCamera::new(intrinsics, 0.001, 0.3..=3.0).unwrap(),
        color: ColorCamera::new(
            intrinsics,
            encoding,
            1.0,
            ResponseCurve::Gamma { gamma: GAMMA },
            VignettingCurve::None,
        )
        .unwrap(),
        color_from_depth: Pose::IDENTITY,
        depth_timing: StreamTiming::at_rate(10.0),
        color_timing: StreamTiming::at_rate(10.0),
        device: None,
    }
}

/// The camera's path: an orbit that rises and falls.
pub(crate) fn path() -> Vec<Pose> {
    (0..FRAME_COUNT)
        .map(|frame| {
            let around = std::f64::consts::TAU * f64::from(frame) / f64::from(FRAME_COUNT);
            let rise = 0.28 + 0.14 * (3.0 * around).sin();
            let eye = DVec3::new(0.5 * around.sin(), -rise, -0.5 * around.cos());
            let forward = (DVec3::new(0.0, -0.05, 0.01) - eye).normalize();
            Pose::from_matrix(direction::look_along(forward, DVec3::Y).unwrap(), eye).unwrap()
        })
        .collect()
}

/// Pixels of one frame.
pub(crate) struct Frame {
    /// Time, nanoseconds.
    pub(crate) time_nanos: i64,
    /// Millimetres.
    pub(crate) depth: Image<u16>,
    /// Codes.
    pub(crate) color: Image<[u8; 3]>,
}

/// Films the studio.
pub(crate) fn film(finish: Finish) -> Vec<Frame> {
    let studio = Studio::new(finish);
    let camera = streams().color.intrinsics;
    path()
        .iter()
        .enumerate()
        .map(|(index, pose)| {
            let buffer = visibility_buffer(
                &studio.scene,
                &studio.positions,
                &studio.triangles,
                &camera,
                pose,
            );
            let eye = pose.translation().as_vec3();
            let at = |x: u32, y: u32| (y * camera.width() + x) as usize;
            let color = Image::from_fn(camera.width(), camera.height(), |x, y| {
                let index = at(x, y);
                if buffer.triangle[index] == NO_TRIANGLE {
                    return [40; 3];
                }
                let hit = Hit {
                    triangle: buffer.triangle[index],
                    t: buffer.depth[index],
                    u: buffer.u[index],
                    v: buffer.v[index],
                };
                studio.radiance(&hit, eye).map(code)
            });
            let depth = Image::from_fn(camera.width(), camera.height(), |x, y| {
                (buffer.depth[at(x, y)] * 1000.0).round() as u16
            });
            Frame {
                time_nanos: index as i64 * 100_000_000,
                depth,
                color,
            }
        })
        .collect()
}

/// The code of a linear value.
pub(crate) fn code(linear: f32) -> u8 {
    (255.0 * f64::from(linear).clamp(0.0, 1.0).powf(1.0 / GAMMA)).round() as u8
}

/// Writes frames with poses as a recording whose last quarter is held out.
pub(crate) fn write(path: &Path, frames: &[Frame], poses: &[Pose]) {
    write_sets_as(path, frames, &[("source", poses)], ColorEncoding::Rgb8);
}

/// The same from a camera that sends colour in another encoding (but JPEG).
pub(crate) fn write_as(path: &Path, frames: &[Frame], poses: &[Pose], encoding: ColorEncoding) {
    write_sets_as(path, frames, &[("source", poses)], encoding);
}

/// The same with several pose sets.
pub(crate) fn write_sets(path: &Path, frames: &[Frame], sets: &[(&str, &[Pose])]) {
    write_sets_as(path, frames, sets, ColorEncoding::Rgb8);
}

fn write_sets_as(path: &Path, frames: &[Frame], sets: &[(&str, &[Pose])], encoding: ColorEncoding) {
    let streams = streams_as(encoding);
    let description = Description {
        writer: "studio".to_owned(),
        created: Created::default(),
        part: None,
        streams: streams.clone(),
        depth_id: DEPTH_STREAM,
        color_id: COLOR_STREAM,
    };
    let id = FileId::of_content(&[b"studio"]);
    let mut writer = RecordingWriter::create_beside(path, id, &description).unwrap();
    let mut depth_encoder = DepthStreamEncoder::new(&streams, DepthCodec::Fast).unwrap();
    let mut color_encoder = ColorStreamEncoder::new(&streams).unwrap();
    for (number, frame) in (0..).zip(frames) {
        let times = FrameTimes {
            number,
            device_nanos: frame.time_nanos,
            ..FrameTimes::default()
        };
        let (payload, table) = depth_encoder.encode(frame.depth.pixels()).unwrap();
        if let Some(table) = table {
            writer.write_table(DEPTH_STREAM, table).unwrap();
        }
        writer.write_frame(DEPTH_STREAM, &times, payload).unwrap();
        let sent = sent_as(&frame.color, encoding);
        let payload = color_encoder.encode(&sent).unwrap();
        writer.write_frame(COLOR_STREAM, &times, payload).unwrap();
        writer.seal_if_due(frame.time_nanos).unwrap();
    }
    for (name, poses) in sets {
        let set = writer.begin_poses(name, "studio", DEPTH_STREAM).unwrap();
        let stored: Vec<FramePose> = (0..)
            .zip(*poses)
            .map(|(number, pose)| FramePose::ok(number, *pose))
            .collect();
        writer.write_poses(set, &stored).unwrap();
    }
    let first_test = FRAME_COUNT * 3 / 4;
    writer
        .write_split(&Split {
            train: (0..first_test).collect(),
            unused: Vec::new(),
            test: (first_test..FRAME_COUNT).collect(),
        })
        .unwrap();
    writer.finish("complete").unwrap();
}

/// What a camera of the encoding sends of an image: one colour a pixel of a mosaic; of YUV (Rec. 601, limited range,
/// chroma at the left pixel of a pair, averaged over 1, 2, 1 pixels) luma of each and chroma of each second pixel.
fn sent_as(image: &Image<[u8; 3]>, encoding: ColorEncoding) -> Vec<u8> {
    let positions = (0..image.height()).flat_map(|y| (0..image.width()).map(move |x| (x, y)));
    match encoding {
        ColorEncoding::Rgb8 => image.pixels().as_flattened().to_vec(),
        ColorEncoding::BayerGrbg => positions
            .map(|(x, y)| image.at(x, y)[[[1, 0], [2, 1]][(y % 2) as usize][(x % 2) as usize]])
            .collect(),
        ColorEncoding::Yuyv => positions
            .flat_map(|(x, y)| {
                let at = |x: u32| yuv(image.at(x.min(image.width() - 1), y));
                let chroma = if x % 2 == 0 { 1 } else { 2 };
                let left = x - x % 2;
                let (before, own, after) = (at(left.saturating_sub(1)), at(left), at(left + 1));
                let mean = (before[chroma] + 2.0 * own[chroma] + after[chroma]) / 4.0;
                [at(x)[0].round() as u8, mean.round() as u8]
            })
            .collect(),
        ColorEncoding::Jpeg | ColorEncoding::Uyvy | ColorEncoding::Infrared10 => {
            panic!("the studio has no such camera")
        }
    }
}

/// Rec. 601 of limited range.
fn yuv(rgb: [u8; 3]) -> [f64; 3] {
    let [r, g, b] = rgb.map(|code| f64::from(code) / 255.0);
    let luma = 0.299 * r + 0.587 * g + 0.114 * b;
    [
        16.0 + 219.0 * luma,
        128.0 + 224.0 * (b - luma) / 1.772,
        128.0 + 224.0 * (r - luma) / 1.402,
    ]
}

/// Rig file of [`streams`].
const RIG: &str = r#"
frame_rate = 10.0
sync = "hardware"
[color]
width = 240
height = 180
format = "png"
fx = 230.0
fy = 230.0
cx = 119.5
cy = 89.5
distortion = []
white_level = 255
[color.response]
type = "gamma"
gamma = 2.2
[color.exposure]
fixed = true
relative = 1.0
[depth]
width = 240
height = 180
format = "png16"
scale = 0.001
fx = 230.0
fy = 230.0
cx = 119.5
cy = 89.5
depth_from_color = "identity"
"#;

/// Writes the plain folder of all frames with masks and truth, or of the training frames alone.
pub(crate) fn write_folder(path: &Path, frames: &[Frame], poses: &[Pose], is_whole: bool) {
    std::fs::create_dir_all(path.join("frames")).unwrap();
    let first_test = FRAME_COUNT as usize * 3 / 4;
    let count = if is_whole { frames.len() } else { first_test };
    let mut lines = String::new();
    for (index, (frame, pose)) in frames.iter().zip(poses).enumerate().take(count) {
        let name = |kind: &str| path.join(format!("frames/{index:06}.{kind}.png"));
        std::fs::write(name("depth"), encode_png_gray16(&frame.depth).unwrap()).unwrap();
        std::fs::write(name("color"), encode_png_rgb8(&frame.color).unwrap()).unwrap();
        let (t, q) = (pose.translation(), pose.rotation());
        lines.push_str(&format!(
            "{:.1} {} {} {} {} {} {} {}\n",
            frame.time_nanos as f64 * 1e-9,
            t.x,
            t.y,
            t.z,
            q.x,
            q.y,
            q.z,
            q.w
        ));
    }
    let train: Vec<usize> = (0..first_test).collect();
    let test: Vec<usize> = (first_test..count).collect();
    let split = format!(r#"{{"train": {train:?}, "unused": [], "test": {test:?}}}"#);
    std::fs::write(path.join("poses.txt"), lines).unwrap();
    std::fs::write(path.join("split.json"), split).unwrap();
    std::fs::write(path.join("rig.toml"), RIG).unwrap();
    if is_whole {
        for (folder, file) in [("masks", "000000.png"), ("truth", "environment.exr")] {
            std::fs::create_dir_all(path.join(folder)).unwrap();
            std::fs::write(path.join(folder).join(file), "never read").unwrap();
        }
    }
}
