//! Small folders of frames for the tests of the import: a camera that turns and walks in a room.

use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

use geometry::{DVec2, DVec3, Intrinsics, Pose};
use glint::import::{ImportOptions, ImportReport, import};
use imaging::{Image, Rgb8Image, encode_jpeg, encode_png_gray16, encode_png_rgb8};

pub(crate) const FRAME_COUNT: u32 = 8;
pub(crate) const WIDTH: u32 = 128;
pub(crate) const HEIGHT: u32 = 96;

pub(crate) const RIG: &str = r#"
frame_rate = 10.0
sync = "hardware"
[color]
width = 128
height = 96
format = "jpeg"
fx = 110.0
fy = 111.0
cx = 63.5
cy = 47.5
distortion = []
white_level = 255
[color.response]
type = "gamma"
gamma = 2.2
[color.vignetting]
type = "even-polynomial"
center = [63.5, 47.5]
radius = 80.0
a = [-0.5, 0.2, -0.04]
[color.exposure]
fixed = true
relative = 1.0
[color.noise]
full_well = 7000.0
read = 0.0025
[depth]
width = 128
height = 96
format = "png16"
scale = 0.001
fx = 110.0
fy = 110.0
cx = 63.5
cy = 47.5
depth_from_color = "identity"
[depth.sensor]
min_depth = 0.4
"#;

/// A folder that a test may break. Removed when dropped.
pub(crate) struct Folder {
    directory: tempfile::TempDir,
}

impl Folder {
    /// A plain folder, whole.
    pub(crate) fn plain() -> Self {
        let folder = Self::empty();
        fs::create_dir(folder.path("frames")).unwrap();
        let mut poses = String::from("# timestamp tx ty tz qx qy qz qw\n");
        for frame in 0..FRAME_COUNT {
            folder.write(&format!("frames/{frame:06}.depth.png"), &depth_png(frame));
            folder.write(&format!("frames/{frame:06}.color.jpg"), &color_jpeg(frame));
            poses.push_str(&tum_line(frame, &world_from_camera(frame)));
        }
        folder.write("poses.txt", poses.as_bytes());
        folder.write("rig.toml", RIG.as_bytes());
        let split = r#"{"train": [0, 1, 2, 3, 4], "unused": [5], "test": [6, 7]}"#;
        folder.write("split.json", split.as_bytes());
        folder
    }

    /// A 7-Scenes folder with the original's PNG colour.
    pub(crate) fn seven_scenes() -> Self {
        let folder = Self::empty();
        for frame in 0..FRAME_COUNT {
            let stem = format!("frame-{frame:06}");
            folder.write(&format!("{stem}.depth.png"), &depth_png(frame));
            let color = encode_png_rgb8(&color(frame)).unwrap();
            folder.write(&format!("{stem}.color.png"), &color);
            folder.write(
                &format!("{stem}.pose.txt"),
                matrix_text(&world_from_camera(frame), 1.0).as_bytes(),
            );
        }
        let rig = RIG.replace("format = \"jpeg\"", "format = \"png\"");
        folder.write("rig.toml", rig.replace("frame_rate = 10.0", "").as_bytes());
        folder
    }

    /// A TUM folder: depth at 10 Hz, PNG colour at 15 Hz, poses of the colour camera at 50 Hz, all from
    /// [`TUM_START`]; nothing has the same stamp as anything else but by design.
    pub(crate) fn tum() -> Self {
        let folder = Self::empty();
        for name in ["rgb", "depth"] {
            fs::create_dir(folder.path(name)).unwrap();
        }
        let mut lists = [
            "# depth maps\n# timestamp filename\n",
            "# color images\n",
            "# path\n",
        ]
        .map(str::to_owned);
        for frame in 0..FRAME_COUNT {
            let name = format!("depth/{frame}.png");
            folder.write(&name, &depth_png(frame));
            writeln!(lists[0], "{} {name}", tum_time(tum_depth_micros(frame))).unwrap();
        }
        for frame in 0..TUM_COLOR_COUNT {
            let name = format!("rgb/{frame}.png");
            folder.write(&name, &encode_png_rgb8(&color(frame)).unwrap());
            writeln!(lists[1], "{} {name}", tum_time(tum_color_micros(frame))).unwrap();
        }
        for step in 0..40 {
            let micros = 20_000 * step;
            let pose = world_from_camera_at(micros as f64 * 1e-5);
            let (t, q) = (pose.translation(), pose.rotation());
            let time = tum_time(micros);
            writeln!(
                lists[2],
                "{time} {} {} {} {} {} {} {}",
                t.x, t.y, t.z, q.x, q.y, q.z, q.w
            )
            .unwrap();
        }
        for (name, text) in ["depth.txt", "rgb.txt", "groundtruth.txt"]
            .iter()
            .zip(lists)
        {
            folder.write(name, text.as_bytes());
        }
        let rig = RIG
            .replace("format = \"jpeg\"", "format = \"png\"")
            .replace("fy = 111.0", "fy = 110.0")
            .replace("frame_rate = 10.0", "poses = \"color\"")
            .replace("scale = 0.001", "scale = 0.001\nregistered = true");
        folder.write("rig.toml", rig.as_bytes());
        folder
    }

    pub(crate) fn empty() -> Self {
        Self {
            directory: tempfile::tempdir().unwrap(),
        }
    }

    pub(crate) fn root(&self) -> &Path {
        self.directory.path()
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.root().join(name)
    }

    pub(crate) fn write(&self, name: &str, bytes: &[u8]) {
        fs::write(self.path(name), bytes).unwrap();
    }

    pub(crate) fn read(&self, name: &str) -> Vec<u8> {
        fs::read(self.path(name)).unwrap()
    }

    pub(crate) fn remove(&self, name: &str) {
        fs::remove_file(self.path(name)).unwrap();
    }

    pub(crate) fn copy(&self, from: &str, to: &str) {
        fs::copy(self.path(from), self.path(to)).unwrap();
    }

    /// Replaces the first `from` in a text file, which must hold it.
    pub(crate) fn edit(&self, name: &str, from: &str, to: &str) {
        let text = String::from_utf8(self.read(name)).unwrap();
        assert!(text.contains(from), "{name} has no `{from}`");
        self.write(name, text.replacen(from, to, 1).as_bytes());
    }

    /// Options that import this folder to `out.glint` inside it.
    pub(crate) fn options(&self) -> ImportOptions {
        ImportOptions {
            input: self.root().to_path_buf(),
            output: self.path("out.glint"),
            format: None,
            rig: None,
            split: None,
            range: None,
        }
    }

    /// Imports with the default options.
    pub(crate) fn import(&self) -> anyhow::Result<ImportReport> {
        import(&self.options(), &mut |_, _| {})
    }
}

/// Microseconds since 1970 of a time that counts from the start of the TUM folder.
pub(crate) const TUM_START: i64 = 1_305_031_102_175_304;
pub(crate) const TUM_COLOR_COUNT: u32 = 12;

/// Depth `frame` was taken by the camera at `world_from_camera(frame)`.
pub(crate) fn tum_depth_micros(frame: u32) -> i64 {
    100_000 * i64::from(frame)
}

/// 7 ms after every second depth image, and half a period away from the others.
pub(crate) fn tum_color_micros(frame: u32) -> i64 {
    7_000 + 200_000 * i64::from(frame) / 3
}

fn tum_time(micros: i64) -> String {
    let micros = TUM_START + micros;
    format!("{}.{:06}", micros / 1_000_000, micros % 1_000_000)
}

pub(crate) fn world_from_camera(frame: u32) -> Pose {
    world_from_camera_at(f64::from(frame))
}

/// The pose at `t` times the period of the depth camera.
pub(crate) fn world_from_camera_at(t: f64) -> Pose {
    Pose::from_translation(DVec3::new(0.05 * t, 0.01 * t, 0.2 - 0.02 * t))
        * Pose::from_axis_angle(DVec3::new(0.2, 1.0, 0.1), 0.05 * t)
}

pub(crate) fn depth_camera() -> Intrinsics {
    Intrinsics::pinhole(WIDTH, HEIGHT, 110.0, 110.0, 63.5, 47.5).unwrap()
}

/// Depth in millimetres of the inside of a box of 4 x 3 x 5 m around the world's origin; column 0 says 0 and
/// row 0 says 65535.
pub(crate) fn depth(frame: u32) -> Image<u16> {
    let (camera, pose) = (depth_camera(), world_from_camera(frame));
    let half = DVec3::new(2.0, 1.5, 2.5);
    Image::from_fn(WIDTH, HEIGHT, |x, y| {
        if x == 0 {
            return 0;
        }
        if y == 0 {
            return u16::MAX;
        }
        let pixel = DVec2::new(f64::from(x), f64::from(y));
        let ray = pose.transform_vector(camera.camera_from_pixel(pixel).unwrap());
        // The ray has z = 1 in the camera, so its parameter is the depth.
        let wall = (half * ray.signum() - pose.translation()) / ray;
        (1000.0 * wall.min_element()).round() as u16
    })
}

pub(crate) fn depth_png(frame: u32) -> Vec<u8> {
    encode_png_gray16(&depth(frame)).unwrap()
}

pub(crate) fn color(frame: u32) -> Rgb8Image {
    Image::from_fn(WIDTH, HEIGHT, |x, y| {
        [2 * x as u8, 2 * y as u8, 10 * frame as u8]
    })
}

pub(crate) fn color_jpeg(frame: u32) -> Vec<u8> {
    encode_jpeg(&color(frame), 90).unwrap()
}

pub(crate) fn tum_line(frame: u32, pose: &Pose) -> String {
    let (t, q) = (pose.translation(), pose.rotation());
    format!(
        "{}.{}00000 {:.9} {:.9} {:.9} {:.9} {:.9} {:.9} {:.9}\n",
        frame / 10,
        frame % 10,
        t.x,
        t.y,
        t.z,
        q.x,
        q.y,
        q.z,
        q.w
    )
}

/// A 4x4 matrix as text, its rotation scaled.
pub(crate) fn matrix_text(pose: &Pose, scale: f64) -> String {
    let (rotation, t) = (pose.matrix() * scale, pose.translation());
    let mut text = String::new();
    for row in 0..3 {
        let r = rotation.row(row);
        writeln!(text, "{:e}\t{:e}\t{:e}\t{:e}", r.x, r.y, r.z, t[row]).unwrap();
    }
    text.push_str("0 0 0 1\n");
    text
}

/// A folder of the data beside the repository, or `None` with the reason printed.
pub(crate) fn shared_data(name: &str) -> Option<PathBuf> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../shared/data")
        .join(name);
    if path.is_dir() {
        return Some(path);
    }
    eprintln!("skipped: ../shared/data/{name} is not there");
    None
}
