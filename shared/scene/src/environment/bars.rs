//! Targets that say how fine a detail of the environment was found (effects-and-tradeoffs C1): groups of five bars of
//! known angle at three sites.

use glam::Vec3;
use serde::{Deserialize, Serialize};

use crate::random::{Purpose, Stream};

/// Which way the bars of a group follow each other.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum BarKind {
    /// Along longitude.
    Horizontal,
    /// Along latitude.
    Vertical,
    /// No bars: plain grey.
    Plain,
}

/// Five bars, bright, dark, bright, dark, bright, on grey.
///
/// The point with tangent-plane coordinates (t, s), radians, lies in direction center + t·across + s·along; the bars
/// reach from t = −2.5 to 2.5 widths and over half the length to both sides in s.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BarGroup {
    /// Number of the site.
    pub site: u32,
    /// Which way.
    pub kind: BarKind,
    /// Width of a bar, degrees.
    pub width_deg: f64,
    /// Length of a bar, degrees.
    pub length_deg: f64,
    /// Middle of the group, unit, world axes.
    pub center: [f64; 3],
    /// Across the bars, unit, tangent.
    pub across: [f64; 3],
    /// Along the bars, unit, tangent.
    pub along: [f64; 3],
}

/// All groups, `truth/bars.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Bars {
    /// 1.
    pub version: u32,
    /// Radiance between and around the groups.
    pub grey: f32,
    /// Radiance of dark bars.
    pub dark: f32,
    /// Radiance of bright bars.
    pub bright: f32,
    /// The groups.
    pub groups: Vec<BarGroup>,
}

/// Longitude and latitude of the sites' middles, degrees.
const SITES: [[f64; 2]; 3] = [[20.0, 0.0], [140.0, 30.0], [-100.0, -30.0]];
/// A group's bars are this many widths long …
const LENGTH_WIDTHS: f64 = 3.0;
/// … within these lengths, degrees.
const LENGTHS: [f64; 2] = [2.2, 9.0];
/// Widths that fit three sites with a border as wide as a bar, degrees. The two widest of C1 (11.52 and 8.64) alone
/// would take three quarters of the sphere.
pub const BAR_WIDTHS: [f64; 7] = [5.76, 4.32, 2.88, 2.16, 1.44, 1.08, 0.72];

impl Bars {
    /// Groups of bars of the given widths (degrees, widest first) at three sites, phases at random by `seed`.
    pub fn new(widths_deg: &[f64], seed: u64) -> Self {
        let mut groups = Vec::new();
        for (site, [lon, lat]) in SITES.into_iter().enumerate() {
            let site = site as u32;
            let mut random = Stream::new(seed, Purpose::Design, 0, u64::from(site));
            let mut add = |kind, width: f64, x: f64, y: f64| {
                let jitter = [random.unit(), random.unit()].map(|u| 0.72 * (f64::from(u) - 0.5));
                let latitude = lat + y + jitter[1];
                let longitude = lon + (x + jitter[0]) / latitude.to_radians().cos();
                groups.push(group(site, kind, width, longitude, latitude));
            };
            // Horizontal groups above the middle of the site, vertical ones below, each on shelves.
            let mut shelf = Shelf::new(0.0, 1.0);
            for &width in widths_deg {
                let (x, y) = shelf.place(7.0 * width, length_of(width) + 2.0 * width);
                add(BarKind::Horizontal, width, x, y);
            }
            if let Some(&widest) = widths_deg.get(widths_deg.len() / 2) {
                let (x, y) = shelf.place(7.0 * widest, length_of(widest) + 2.0 * widest);
                add(BarKind::Plain, widest, x, y);
            }
            let mut shelf = Shelf::new(-0.5, -1.0);
            for &width in widths_deg {
                let (x, y) = shelf.place(length_of(width) + 2.0 * width, 7.0 * width);
                add(BarKind::Vertical, width, x, y);
            }
        }
        Self {
            version: 1,
            grey: 0.4,
            dark: 0.1,
            bright: 0.7,
            groups,
        }
    }

    /// Radiance of a direction, where a group or its border lies there.
    pub fn radiance(&self, direction: Vec3) -> Option<f32> {
        let direction = direction.as_dvec3();
        let mut found = None;
        for group in &self.groups {
            let axis = |v: [f64; 3]| direction.dot(glam::DVec3::from_array(v));
            let ahead = axis(group.center);
            // The widest group with its border is 40 degrees across.
            if ahead < 0.9 {
                continue;
            }
            let (t, s) = (axis(group.across) / ahead, axis(group.along) / ahead);
            let width = group.width_deg.to_radians();
            let half_length = 0.5 * group.length_deg.to_radians();
            if t.abs() > 3.5 * width || s.abs() > half_length + width {
                continue;
            }
            let is_inside = t.abs() < 2.5 * width && s.abs() < half_length;
            if !is_inside || group.kind == BarKind::Plain {
                found.get_or_insert(self.grey);
                continue;
            }
            let bar = ((t / width + 2.5).floor() as i64).rem_euclid(2);
            return Some(if bar == 0 { self.bright } else { self.dark });
        }
        found
    }
}

fn length_of(width_deg: f64) -> f64 {
    (LENGTH_WIDTHS * width_deg).clamp(LENGTHS[0], LENGTHS[1])
}

fn group(site: u32, kind: BarKind, width: f64, longitude: f64, latitude: f64) -> BarGroup {
    let (lon, lat) = (longitude.to_radians(), latitude.to_radians());
    // Derivatives of the panorama's direction by longitude and latitude, written out.
    let center = [lat.cos() * lon.sin(), -lat.sin(), lat.cos() * lon.cos()];
    let east = [lon.cos(), 0.0, -lon.sin()];
    let up = [-lat.sin() * lon.sin(), -lat.cos(), -lat.sin() * lon.cos()];
    let (across, along) = match kind {
        BarKind::Vertical => (up, east),
        BarKind::Horizontal | BarKind::Plain => (east, up),
    };
    BarGroup {
        site,
        kind,
        width_deg: width,
        length_deg: length_of(width),
        center,
        across,
        along,
    }
}

/// Rows of a site, filled from the middle of the site outward.
struct Shelf {
    /// Lower (upper) edge of the shelf, degrees from the site's middle.
    edge: f64,
    sign: f64,
    height: f64,
    x: f64,
}

/// Width of a site, degrees.
const SITE_WIDTH: f64 = 86.0;

impl Shelf {
    fn new(edge: f64, sign: f64) -> Self {
        Self {
            edge,
            sign,
            height: 0.0,
            x: -0.5 * SITE_WIDTH,
        }
    }

    /// Middle of a place of the given size.
    fn place(&mut self, width: f64, height: f64) -> (f64, f64) {
        if self.x + width > 0.5 * SITE_WIDTH && self.height > 0.0 {
            self.edge += self.sign * self.height;
            (self.height, self.x) = (0.0, -0.5 * SITE_WIDTH);
        }
        let middle = (self.x + 0.5 * width, self.edge + self.sign * 0.5 * height);
        // Groups are flat and the sphere is not: what is straight bends across latitudes.
        self.x += 1.04 * width;
        self.height = self.height.max(1.3 * height);
        middle
    }
}

#[cfg(test)]
mod tests {
    use geometry::PanoramaSize;

    use super::*;

    #[test]
    fn no_group_lies_on_another() {
        let bars = Bars::new(&BAR_WIDTHS, 11);
        assert_eq!(bars.groups.len(), 3 * (2 * BAR_WIDTHS.len() + 1));
        let size = PanoramaSize::from_height(512).unwrap();
        for index in 0..size.texel_count() {
            let texel = glam::DVec2::new(
                (index % size.width() as usize) as f64,
                (index / size.width() as usize) as f64,
            );
            let direction = size.direction_from_texel(texel);
            let inside: Vec<&BarGroup> = bars
                .groups
                .iter()
                .filter(|group| {
                    let axis = |v: [f64; 3]| direction.dot(glam::DVec3::from_array(v));
                    let (ahead, t, s) = (axis(group.center), axis(group.across), axis(group.along));
                    let half = 0.5 * group.length_deg.to_radians();
                    // The border counts as the group's own.
                    let width = group.width_deg.to_radians();
                    ahead > 0.0
                        && (t / ahead).abs() < 3.5 * width
                        && (s / ahead).abs() < half + width
                })
                .collect();
            // Borders may touch; bars may not lie in another's border.
            assert!(inside.len() < 3, "{inside:?}");
            if let [a, b] = inside[..] {
                let is_core = |group: &BarGroup| {
                    let axis = |v: [f64; 3]| direction.dot(glam::DVec3::from_array(v));
                    let ahead = axis(group.center);
                    (axis(group.across) / ahead).abs() < 2.5 * group.width_deg.to_radians()
                        && (axis(group.along) / ahead).abs() < 0.5 * group.length_deg.to_radians()
                };
                assert!(!is_core(a) && !is_core(b), "{a:?} lies on {b:?}");
            }
        }
    }

    #[test]
    fn a_group_shows_five_bars_between_grey() {
        let bars = Bars::new(&[2.88], 3);
        let group = &bars.groups[0];
        let [center, across] =
            [group.center, group.across].map(|v| glam::DVec3::from_array(v).as_vec3());
        let width = 2.88_f32.to_radians();
        let at = |t: f32| bars.radiance((center + across * t * width).normalize());
        let seen: Vec<Option<f32>> = [-3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 3.0].map(at).to_vec();
        let (dark, bright, grey) = (Some(0.1), Some(0.7), Some(0.4));
        assert_eq!(seen, [grey, bright, dark, bright, dark, bright, grey]);
    }
}
