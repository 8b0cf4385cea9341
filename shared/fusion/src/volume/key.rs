//! Block coordinates and their 63-bit keys.

/// log₂ of the voxels along a block edge.
pub const BLOCK_SHIFT: u32 = 3;
/// Voxels along a block edge.
pub const BLOCK_EDGE: usize = 1 << BLOCK_SHIFT;
/// Voxels in a block.
pub const BLOCK_VOXELS: usize = BLOCK_EDGE * BLOCK_EDGE * BLOCK_EDGE;

/// Bits of one coordinate in a key.
const COORDINATE_BITS: u32 = 21;
/// Block coordinates run over `-COORDINATE_LIMIT..COORDINATE_LIMIT`.
pub const COORDINATE_LIMIT: i32 = 1 << (COORDINATE_BITS - 1);

/// The key of block `(x, y, z)`, or `None` beyond ±2²⁰ blocks, where bits would wrap onto another
/// block (hard-cases D10). Keys order blocks by x, then y, then z.
#[inline]
pub fn pack(block: [i32; 3]) -> Option<u64> {
    let mut key = 0u64;
    for coordinate in block {
        // Outside the range the sum is negative (huge as u32) or at least 2²¹.
        let biased = coordinate.wrapping_add(COORDINATE_LIMIT) as u32;
        if biased >> COORDINATE_BITS != 0 {
            return None;
        }
        key = key << COORDINATE_BITS | u64::from(biased);
    }
    Some(key)
}

/// The block of a key made by [`pack`].
#[inline]
pub fn unpack(key: u64) -> [i32; 3] {
    let mask = (1u64 << COORDINATE_BITS) - 1;
    let coordinate = |shift: u32| (key >> shift & mask) as i32 - COORDINATE_LIMIT;
    [
        coordinate(2 * COORDINATE_BITS),
        coordinate(COORDINATE_BITS),
        coordinate(0),
    ]
}

/// The block that holds a voxel, and the voxel's index inside it, x fastest.
///
/// Arithmetic shift and mask are Euclidean division: −1 lies in block −1 at 7 (hard-cases D08).
#[inline]
pub fn split_voxel(voxel: [i32; 3]) -> ([i32; 3], usize) {
    let mask = BLOCK_EDGE as i32 - 1;
    let [x, y, z] = voxel.map(|v| (v & mask) as usize);
    (
        voxel.map(|v| v >> BLOCK_SHIFT),
        x + BLOCK_EDGE * (y + BLOCK_EDGE * z),
    )
}

/// The splitmix64 finaliser: every input bit reaches every output bit (hard-cases D09).
#[inline]
pub fn mix(key: u64) -> u64 {
    let key = key.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let key = (key ^ key >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let key = (key ^ key >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
    key ^ key >> 31
}
