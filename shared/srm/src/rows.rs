//! What one pixel says about D and S.

/// One pixel as one linear equation per channel.
///
/// Linear radiance in units of the white level. `taps` already carry gain, visibility and Fresnel factor,
/// `known` is gain · (1 − V) · first bounce.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Row {
    /// Vertices of the triangle that the pixel sees, compact indices below the problem's vertex count.
    pub vertices: [u32; 3],
    /// Barycentric weights of the three vertices, sum 1.
    pub barycentric: [f32; 3],
    /// Row-major texel indices of the panorama.
    pub texels: [u32; 4],
    /// Coefficients of the four texels.
    pub taps: [f32; 4],
    /// Linear radiance seen, RGB.
    pub observed: [f32; 3],
    /// Linear radiance that is known beforehand, RGB.
    pub known: [f32; 3],
    /// Base weight, 1 for an ordinary pixel; smaller next to a visibility edge (hard-cases H03).
    pub weight: f32,
    /// Bit c is set when channel c is clipped: the observation is then a lower bound.
    pub clipped: u8,
    /// Frame of the recording, for held-out choices.
    pub frame: u32,
    /// Segment of the object, for on/off choices.
    pub segment: u16,
}

/// Observations, in the order in which the pixels were visited (frame by frame, in scan order).
#[derive(Clone, Debug, Default)]
pub struct Rows {
    rows: Vec<Row>,
}

/// Weights of the channels in luminance (Rec. 709).
pub const LUMINANCE: [f64; 3] = [0.2126, 0.7152, 0.0722];

/// Luminance of a linear RGB value.
pub fn luminance(rgb: [f64; 3]) -> f64 {
    rgb[0] * LUMINANCE[0] + rgb[1] * LUMINANCE[1] + rgb[2] * LUMINANCE[2]
}

impl Rows {
    /// Appends a row. Rows that hold a number that is not finite are left out; returns whether it was kept.
    pub fn push(&mut self, row: Row) -> bool {
        let finite = row
            .barycentric
            .iter()
            .chain(&row.taps)
            .chain(&row.observed)
            .chain(&row.known)
            .all(|value| value.is_finite());
        let kept = finite && row.weight > 0.0 && row.weight.is_finite();
        if kept {
            self.rows.push(row);
        }
        kept
    }

    /// Appends all rows of `other`.
    pub fn append(&mut self, mut other: Self) {
        self.rows.append(&mut other.rows);
    }

    /// Number of rows.
    pub fn len(&self) -> usize {
        self.rows.len()
    }

    /// Whether there is no row.
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// The rows in order.
    pub fn iter(&self) -> std::slice::Iter<'_, Row> {
        self.rows.iter()
    }

    /// The rows as a slice.
    pub fn as_slice(&self) -> &[Row] {
        &self.rows
    }

    /// The rows for which `keep` says so, in order.
    #[must_use]
    pub fn filtered(&self, mut keep: impl FnMut(&Row) -> bool) -> Self {
        Self {
            rows: self.rows.iter().copied().filter(|row| keep(row)).collect(),
        }
    }

    /// The distinct frames, ascending.
    pub fn frames(&self) -> Vec<u32> {
        let set: std::collections::BTreeSet<u32> = self.rows.iter().map(|row| row.frame).collect();
        set.into_iter().collect()
    }

    /// The distinct segments, ascending.
    pub fn segments(&self) -> Vec<u16> {
        let set: std::collections::BTreeSet<u16> =
            self.rows.iter().map(|row| row.segment).collect();
        set.into_iter().collect()
    }
}

impl FromIterator<Row> for Rows {
    fn from_iter<I: IntoIterator<Item = Row>>(iter: I) -> Self {
        let mut rows = Self::default();
        for row in iter {
            rows.push(row);
        }
        rows
    }
}
