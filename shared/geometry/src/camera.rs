//! Pinhole intrinsics with Brown–Conrady distortion.

use glam::{DVec2, DVec3};

/// Nearest depth that counts as in front of a camera, metres (hard-cases A12).
pub const Z_NEAR: f64 = 0.01;

/// Brown–Conrady distortion: radial k1, k2, k3 and tangential p1, p2, on normalised coordinates.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Distortion {
    /// Radial coefficient of r².
    pub k1: f64,
    /// Radial coefficient of r⁴.
    pub k2: f64,
    /// First tangential coefficient.
    pub p1: f64,
    /// Second tangential coefficient.
    pub p2: f64,
    /// Radial coefficient of r⁶.
    pub k3: f64,
}

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
            Self::Size { width, height } => write!(f, "an image of {width} x {height} pixels is not usable"),
            Self::Focal { focal, width } => write!(
                f,
                "a focal length of {focal} pixels is implausible for an image {width} pixels wide"
            ),
            Self::PrincipalPoint { cx, cy } => {
                write!(f, "the principal point ({cx}, {cy}) lies outside the image")
            }
            Self::Distortion => write!(f, "the distortion folds the image onto itself inside its frame"),
        }
    }
}

impl std::error::Error for CameraError {}

impl Distortion {
    /// No distortion.
    pub const NONE: Self = Self { k1: 0.0, k2: 0.0, p1: 0.0, p2: 0.0, k3: 0.0 };

    /// Whether every coefficient is zero.
    pub fn is_none(&self) -> bool {
        *self == Self::NONE
    }

    /// Distorted normalised coordinates of undistorted ones.
    pub fn distort(&self, p: DVec2) -> DVec2 {
        let r2 = p.length_squared();
        let radial = 1.0 + r2 * (self.k1 + r2 * (self.k2 + r2 * self.k3));
        DVec2::new(
            p.x * radial + 2.0 * self.p1 * p.x * p.y + self.p2 * (r2 + 2.0 * p.x * p.x),
            p.y * radial + self.p1 * (r2 + 2.0 * p.y * p.y) + 2.0 * self.p2 * p.x * p.y,
        )
    }

    /// The undistorted radius at which the radial map folds: first positive root of
    /// 1 + 3k₁r² + 5k₂r⁴ + 7k₃r⁶, infinite where there is none below 10 (hard-cases A13).
    pub fn fold_radius(&self) -> f64 {
        let slope = |r: f64| {
            let r2 = r * r;
            1.0 + r2 * (3.0 * self.k1 + r2 * (5.0 * self.k2 + r2 * 7.0 * self.k3))
        };
        let steps = 4000;
        let mut low = 0.0;
        for step in 1..=steps {
            let mut high = 10.0 * f64::from(step) / f64::from(steps);
            if slope(high) <= 0.0 {
                for _ in 0..60 {
                    let middle = 0.5 * (low + high);
                    if slope(middle) > 0.0 { low = middle } else { high = middle }
                }
                return low;
            }
            low = high;
        }
        f64::INFINITY
    }

    /// Undistorted coordinates of distorted ones by Newton iteration, or `None` beyond `fold_radius`
    /// (as [`Distortion::fold_radius`] gives it) or where Newton does not converge.
    pub fn undistort(&self, distorted: DVec2, fold_radius: f64) -> Option<DVec2> {
        if self.is_none() {
            return distorted.is_finite().then_some(distorted);
        }
        let mut p = distorted;
        let longest = if fold_radius.is_finite() { fold_radius * 0.999 } else { 10.0 };
        if p.length() > longest {
            p *= longest / p.length();
        }
        for _ in 0..50 {
            let error = self.distort(p) - distorted;
            if error.length() < 1e-13 {
                break;
            }
            let r2 = p.length_squared();
            let radial = 1.0 + r2 * (self.k1 + r2 * (self.k2 + r2 * self.k3));
            let slope = 2.0 * (self.k1 + r2 * (2.0 * self.k2 + 3.0 * r2 * self.k3));
            let xx = radial + p.x * p.x * slope + 2.0 * self.p1 * p.y + 6.0 * self.p2 * p.x;
            let yy = radial + p.y * p.y * slope + 6.0 * self.p1 * p.y + 2.0 * self.p2 * p.x;
            let xy = p.x * p.y * slope + 2.0 * self.p1 * p.x + 2.0 * self.p2 * p.y;
            let determinant = xx * yy - xy * xy;
            if determinant.abs() < 1e-12 {
                return None;
            }
            let step = DVec2::new(yy * error.x - xy * error.y, xx * error.y - xy * error.x) / determinant;
            // Half steps keep the iterate on this side of the fold.
            let mut scale = 1.0;
            while (p - step * scale).length() >= longest && scale > 1e-3 {
                scale *= 0.5;
            }
            p -= step * scale;
        }
        let converged = (self.distort(p) - distorted).length() < 1e-10;
        (converged && p.length() < fold_radius).then_some(p)
    }
}

impl Intrinsics {
    /// A camera without distortion.
    pub fn pinhole(width: u32, height: u32, fx: f64, fy: f64, cx: f64, cy: f64) -> Result<Self, CameraError> {
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
        let fold_radius = if distortion.is_none() { f64::INFINITY } else { distortion.fold_radius() };
        let camera = Self { width, height, fx, fy, cx, cy, distortion, fold_radius };
        let corners = [(0.0, 0.0), (w - 1.0, 0.0), (0.0, f64::from(height) - 1.0), (w - 1.0, f64::from(height) - 1.0)];
        if corners.iter().any(|&(x, y)| camera.camera_from_pixel(DVec2::new(x, y)).is_none()) {
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
        // Written so that NaN fails.
        if !(point.z >= Z_NEAR) {
            return None;
        }
        let p = DVec2::new(point.x / point.z, point.y / point.z);
        if !p.is_finite() || p.length() >= self.fold_radius {
            return None;
        }
        let p = if self.distortion.is_none() { p } else { self.distortion.distort(p) };
        Some(DVec2::new(self.fx * p.x + self.cx, self.fy * p.y + self.cy))
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
        let inside = x >= 0.0 && y >= 0.0 && x < f64::from(self.width) && y < f64::from(self.height);
        inside.then_some((x as u32, y as u32))
    }
}
