//! Random numbers by counter: a number depends on what it is for, never on the order of the work (hard-cases I10).

/// What numbers are drawn for. Purposes never share numbers, so an effect that is switched off leaves all others
/// as they were.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u64)]
pub enum Purpose {
    /// Where in a pixel and when in the exposure a sample looks.
    Lens = 1,
    /// Directions of reflected light.
    Lobe = 2,
    /// Directions of the environment's light.
    Environment = 3,
    /// Photons and electrons of the colour sensor.
    ColorNoise = 4,
    /// Disparity of the depth sensor, smooth over some pixels.
    DepthNoise = 5,
    /// Measurements that the depth sensor loses at edges.
    DepthHoles = 6,
    /// Errors of the poses.
    PoseNoise = 7,
    /// Displacement of the vertices.
    MeshNoise = 8,
    /// Light on matte surfaces.
    Irradiance = 9,
    /// Forms and colours of a scene.
    Design = 10,
}

/// The numbers of one (seed, purpose, frame, item): dimension after dimension.
#[derive(Clone, Debug)]
pub struct Stream {
    key: u64,
    dimension: u64,
}

/// Odd constant near 2⁶⁴ / φ: successive multiples spread over the whole range.
const GOLDEN: u64 = 0x9e37_79b9_7f4a_7c15;

/// The finaliser of SplitMix64 (Steele, Lea and Flood 2014): every bit depends on every bit.
fn mix(mut value: u64) -> u64 {
    value = (value ^ (value >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    value = (value ^ (value >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    value ^ (value >> 31)
}

impl Stream {
    /// The numbers of `item` (a pixel, a vertex) in `frame`.
    pub fn new(seed: u64, purpose: Purpose, frame: u64, item: u64) -> Self {
        let mut key = mix(seed.wrapping_add(GOLDEN));
        for part in [purpose as u64, frame, item] {
            key = mix(key ^ part.wrapping_mul(GOLDEN).wrapping_add(GOLDEN));
        }
        Self { key, dimension: 0 }
    }

    /// The next 64 bits.
    pub fn bits(&mut self) -> u64 {
        self.dimension += 1;
        mix(self.key.wrapping_add(self.dimension.wrapping_mul(GOLDEN)))
    }

    /// Leaves out `count` numbers.
    pub fn skip(&mut self, count: u64) {
        self.dimension += count;
    }

    /// Uniform in [0, 1), a multiple of 2⁻²⁴.
    pub fn unit(&mut self) -> f32 {
        (self.bits() >> 40) as f32 * (1.0 / 16_777_216.0)
    }

    /// Two of them.
    pub fn pair(&mut self) -> [f32; 2] {
        [self.unit(), self.unit()]
    }

    /// Normal with mean 0 and deviation 1 (Box and Muller), within ±8.7.
    pub fn normal(&mut self) -> f32 {
        // (0, 1]: the logarithm of 0 is none.
        let radius = (((self.bits() >> 11) + 1) as f64 * (1.0 / 9_007_199_254_740_992.0)).ln();
        let angle =
            std::f64::consts::TAU * (self.bits() >> 11) as f64 * (1.0 / 9_007_199_254_740_992.0);
        ((-2.0 * radius).sqrt() * angle.cos()) as f32
    }
}
