//! Volumes with given values, for the tests of the mesher.

use super::blocks::SLAB_BLOCKS;
use super::key::pack;
use super::*;

impl Volume {
    /// A volume whose voxels from −`reach` to `reach` hold `field` (distance in truncations, weight).
    pub(crate) fn from_field(
        config: VolumeConfig,
        reach: i32,
        mut field: impl FnMut([i32; 3]) -> (f32, f32),
    ) -> Self {
        let mut volume = Self::new(config).expect("a usable config");
        for z in -reach..=reach {
            for y in -reach..=reach {
                for x in -reach..=reach {
                    let (block, index) = split_voxel([x, y, z]);
                    let key = pack(block).expect("in range");
                    let place = volume.store.find(key);
                    let place = place.unwrap_or_else(|| volume.store.push(key)) as usize;
                    let slab = &mut volume.store.slabs_mut()[place / SLAB_BLOCKS];
                    let block = &mut slab.blocks[place % SLAB_BLOCKS];
                    (block.tsdf[index], block.weight[index]) = field([x, y, z]);
                    if block.tsdf[index] < 0.0 {
                        let octant = index >> 2 & 1 | index >> 4 & 2 | index >> 6 & 4;
                        slab.behind[place % SLAB_BLOCKS] |= 1 << octant;
                    }
                }
            }
        }
        volume
    }
}

#[test]
fn a_written_field_reads_back() {
    let field = |[x, y, z]: [i32; 3]| ((x + 10 * y + 100 * z) as f32 / 2000.0, 1.0);
    let volume = Volume::from_field(VolumeConfig::default(), 9, field);
    for voxel in [[-9, -9, -9], [0, 0, 0], [-1, 8, -8], [9, -9, 7]] {
        let (tsdf, weight) = field(voxel);
        assert_eq!(volume.voxel(voxel), Some(Voxel { tsdf, weight }));
    }
    assert_eq!(volume.voxel([40, 0, 0]), None);
}

#[test]
fn memory_taken_ahead_changes_nothing_and_keeps_the_limit() {
    let camera = Intrinsics::pinhole(96, 72, 96.0, 96.0, 47.5, 35.5).expect("usable");
    let depth: Vec<f32> = (0..96 * 72).map(|n| 0.5 + 1e-3 * (n % 96) as f32).collect();
    let config = VolumeConfig {
        voxel_size: 0.01,
        memory_limit_bytes: 4 << 20,
        ..VolumeConfig::default()
    };
    let fused = |reserved: usize| {
        let mut volume = Volume::new(config.clone()).expect("usable");
        volume.reserve(reserved, true);
        let taken = volume.memory_bytes();
        for _ in 0..3 {
            let pixels = vec![LinearPixel::from_radiance([0.5; 3], false); depth.len()];
            volume
                .integrate_colored(&depth, &pixels, &camera, &Pose::IDENTITY)
                .expect("one value per pixel");
        }
        assert!(volume.memory_bytes() <= config.memory_limit_bytes);
        (volume, taken)
    };
    // Depth alone first: what was taken for colours is given back, not hidden, and colour still finds its place.
    let mut late = Volume::new(config.clone()).expect("usable");
    late.reserve(128, true);
    late.integrate(&depth, &camera, &Pose::IDENTITY)
        .expect("fits");
    late.integrate(&depth, &camera, &Pose::IDENTITY)
        .expect("fits");
    let held = |volume: &Volume| -> usize {
        let slabs = volume.store.slabs().iter();
        slabs.map(|slab| slab.colors.capacity()).sum()
    };
    assert!(late.block_count() > 64 && held(&late) == 0);
    let pixels = vec![LinearPixel::from_radiance([0.5; 3], false); depth.len()];
    late.integrate_colored(&depth, &pixels, &camera, &Pose::IDENTITY)
        .expect("fits");
    assert!(late.has_color() && late.memory_bytes() <= config.memory_limit_bytes);

    let (plain, bare) = fused(0);
    assert!(plain.block_count() > 64, "more than a slab");
    for reserved in [64, 256, usize::MAX] {
        let (volume, taken) = fused(reserved);
        assert!(taken > bare && taken <= config.memory_limit_bytes);
        assert_eq!(volume.block_count(), plain.block_count());
        for index in 0..plain.block_count() as u32 {
            assert_eq!(volume.block(index).tsdf, plain.block(index).tsdf);
            let colors = [&volume, &plain].map(|v| v.color(index).expect("colour").channels);
            assert_eq!(colors[0], colors[1]);
        }
    }
}
