//! Pinhole intrinsics: points in camera axes and pixels.

pub use crate::distortion::Distortion;
use glam::{DVec2, DVec3};

/// Nearest depth that counts as in front of a camera, metres (hard-cases A12).
pub const Z_NEAR: f64 = 0.01;

/// Usable pinhole intrinsics. Pixels; pixel (0, 0) is the centre of the first pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Intrinsics {
    width: u32,
    height: u32,
    fx: f64,
    fy: f64,
    cx: f64,
    cy: f64,
    distortion: Distortion,
    fold_radius: f64,
}

/// Why numbers do not describe a camera.
#[derive(Clone, Debug, PartialEq)]
pub enum CameraError {
    /// Width or height is 0 or beyond 16384.
    Size {
        /// Columns given.
        width: u32,
        /// Rows given.
        height: u32,
    },
    /// A focal length outside 0.2 to 10 image widths, or not a number.
    Focal {
        /// The value given, pixels.
        focal: f64,
        /// The image width, pixels.
        width: u32,
    },
    /// A principal point outside the image.
    PrincipalPoint {
        /// Column given.
        cx: f64,
        /// Row given.
        cy: f64,
    },
    /// The distortion is not a number, or folds the image onto itself inside its frame.
    Distortion,
}

impl std::fmt::Display for CameraError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Size { width, height } => {
                write!(f, "an image of {width} x {height} pixels is not usable")
            }
            Self::Focal { focal, width } => write!(
                f,
                "a focal length of {focal} pixels is implausible for an image {width} pixels wide"
            ),
            Self::PrincipalPoint { cx, cy } => {
                write!(f, "the principal point ({cx}, {cy}) lies outside the image")
            }
            Self::Distortion => write!(
                f,
                "the distortion folds the image onto itself inside its frame"
            ),
        }
    }
}

impl std::error::Error for CameraError {}

impl Intrinsics {
    /// A camera without distortion.
    pub fn pinhole(
        width: u32,
        height: u32,
        fx: f64,
        fy: f64,
        cx: f64,
        cy: f64,
    ) -> Result<Self, CameraError> {
        Self::new(width, height, fx, fy, cx, cy, Distortion::NONE)
    }

    /// A camera with distortion; refuses what cannot be one.
    pub fn new(
        width: u32,
        height: u32,
        fx: f64,
        fy: f64,
        cx: f64,
        cy: f64,
        distortion: Distortion,
    ) -> Result<Self, CameraError> {
        if !(1..=16_384).contains(&width) || !(1..=16_384).contains(&height) {
            return Err(CameraError::Size { width, height });
        }
        let w = f64::from(width);
        for focal in [fx, fy] {
            if !(focal >= 0.2 * w && focal <= 10.0 * w) {
                return Err(CameraError::Focal { focal, width });
            }
        }
        if !(cx >= 0.0 && cx <= w && cy >= 0.0 && cy <= f64::from(height)) {
            return Err(CameraError::PrincipalPoint { cx, cy });
        }
        let Distortion { k1, k2, p1, p2, k3 } = distortion;
        if ![k1, k2, p1, p2, k3].iter().all(|k| k.is_finite()) {
            return Err(CameraError::Distortion);
        }
        let fold_radius = if distortion.is_none() {
            f64::INFINITY
        } else {
            distortion.fold_radius()
        };
        let camera = Self {
            width,
            height,
            fx,
            fy,
            cx,
            cy,
            distortion,
            fold_radius,
        };
        let corners = [
            (0.0, 0.0),
            (w - 1.0, 0.0),
            (0.0, f64::from(height) - 1.0),
            (w - 1.0, f64::from(height) - 1.0),
        ];
        if corners
            .iter()
            .any(|&(x, y)| camera.camera_from_pixel(DVec2::new(x, y)).is_none())
        {
            return Err(CameraError::Distortion);
        }
        Ok(camera)
    }

    /// Columns.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Rows.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// Focal lengths (fx, fy), pixels.
    pub fn focal(&self) -> DVec2 {
        DVec2::new(self.fx, self.fy)
    }

    /// Principal point (cx, cy), pixels.
    pub fn center(&self) -> DVec2 {
        DVec2::new(self.cx, self.cy)
    }

    /// The distortion.
    pub fn distortion(&self) -> Distortion {
        self.distortion
    }

    /// The pixel that sees a point in camera axes, or `None` when the point is not in front of the camera
    /// by [`Z_NEAR`], not finite, or beyond the fold of the distortion. The pixel may lie outside the image:
    /// see [`Intrinsics::contains`].
    pub fn pixel_from_camera(&self, point: DVec3) -> Option<DVec2> {
        if !point.is_finite() || point.z < Z_NEAR {
            return None;
        }
        let p = DVec2::new(point.x / point.z, point.y / point.z);
        if !p.is_finite() || p.length() >= self.fold_radius {
            return None;
        }
        let p = if self.distortion.is_none() {
            p
        } else {
            self.distortion.distort(p)
        };
        let pixel = DVec2::new(self.fx * p.x + self.cx, self.fy * p.y + self.cy);
        // Far off axis r⁷ overflows.
        pixel.is_finite().then_some(pixel)
    }

    /// The ray direction of a pixel in camera axes with z = 1 (not unit), or `None` beyond the fold.
    pub fn camera_from_pixel(&self, pixel: DVec2) -> Option<DVec3> {
        let p = DVec2::new((pixel.x - self.cx) / self.fx, (pixel.y - self.cy) / self.fy);
        let p = self.distortion.undistort(p, self.fold_radius)?;
        Some(DVec3::new(p.x, p.y, 1.0))
    }

    /// The integer pixel nearest to continuous coordinates, or `None` outside the image. Rounds in float
    /// before the cast, so that −0.6 is outside and not column 0 (hard-cases A12).
    pub fn contains(&self, pixel: DVec2) -> Option<(u32, u32)> {
        let (x, y) = ((pixel.x + 0.5).floor(), (pixel.y + 0.5).floor());
        let inside =
            x >= 0.0 && y >= 0.0 && x < f64::from(self.width) && y < f64::from(self.height);
        inside.then_some((x as u32, y as u32))
    }
}
