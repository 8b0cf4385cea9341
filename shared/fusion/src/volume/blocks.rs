//! The blocks of a volume: where they are stored, how they are found, what they take.

use rayon::prelude::*;

use super::key::{pack, unpack};
use super::table::BlockTable;
use crate::kernels::integrate::{Block, ColorBlock, Octants};

/// Blocks per allocation and per parallel task (256 KiB of distances): one bit each in a word.
pub(super) const SLAB_BLOCKS: usize = 64;

/// Blocks that were made one after the other.
pub(super) struct Slab {
    /// Key of each block.
    pub(super) keys: [u64; SLAB_BLOCKS],
    /// Distances.
    pub(super) blocks: Vec<Block>,
    /// Colours, as many as blocks, or none in a volume without colour.
    pub(super) colors: Vec<ColorBlock>,
    /// Colours that each block took, as many as fit.
    pub(super) color_counts: [u8; SLAB_BLOCKS],
    /// Least and greatest coordinates of its blocks.
    pub(super) low: [i32; 3],
    pub(super) high: [i32; 3],
    /// Bit n: a ray of the frame at hand meets block n.
    pub(super) touched: u64,
    /// For each block the octants in which something was once seen to lie behind a surface: there it may be.
    pub(super) behind: [Octants; SLAB_BLOCKS],
}

impl Slab {
    /// Room for blocks, and for their colours.
    fn new(has_color: bool) -> Self {
        Self {
            keys: [0; SLAB_BLOCKS],
            blocks: Vec::with_capacity(SLAB_BLOCKS),
            colors: Vec::with_capacity(if has_color { SLAB_BLOCKS } else { 0 }),
            color_counts: [0; SLAB_BLOCKS],
            low: [i32::MAX; 3],
            high: [i32::MIN; 3],
            touched: 0,
            behind: [0; SLAB_BLOCKS],
        }
    }

    /// The same, with its memory written: a system gives pages when they are first written, and that takes time.
    fn written(has_color: bool) -> Self {
        let mut slab = Self::new(has_color);
        slab.blocks.resize(SLAB_BLOCKS, Block::EMPTY);
        slab.blocks.clear();
        if has_color {
            slab.colors.resize(SLAB_BLOCKS, ColorBlock::EMPTY);
            slab.colors.clear();
        }
        slab
    }
}

/// All blocks, numbered in the order in which they were made.
pub(super) struct BlockStore {
    table: BlockTable,
    slabs: Vec<Slab>,
    /// Slabs whose memory was taken ahead.
    spare: Vec<Slab>,
    block_count: usize,
    has_color: bool,
}

impl BlockStore {
    pub(super) fn new() -> Self {
        Self {
            table: BlockTable::default(),
            slabs: Vec::new(),
            spare: Vec::new(),
            block_count: 0,
            has_color: false,
        }
    }

    /// Number of blocks.
    pub(super) fn len(&self) -> usize {
        self.block_count
    }

    /// Whether blocks have colour.
    pub(super) fn has_color(&self) -> bool {
        self.has_color
    }

    /// Number of the block with a key.
    #[inline]
    pub(super) fn find(&self, key: u64) -> Option<u32> {
        self.table.get(key)
    }

    /// Number of the block at coordinates.
    pub(super) fn index_at(&self, coordinates: [i32; 3]) -> Option<u32> {
        self.table.get(pack(coordinates)?)
    }

    /// Key of a block.
    pub(super) fn key(&self, index: u32) -> u64 {
        self.slabs[index as usize / SLAB_BLOCKS].keys[index as usize % SLAB_BLOCKS]
    }

    /// Coordinates of a block.
    pub(super) fn coordinates(&self, index: u32) -> [i32; 3] {
        unpack(self.key(index))
    }

    /// Distances of a block.
    #[inline]
    pub(super) fn block(&self, index: u32) -> &Block {
        &self.slabs[index as usize / SLAB_BLOCKS].blocks[index as usize % SLAB_BLOCKS]
    }

    /// Colour of a block; `None` in a volume without colour.
    #[inline]
    pub(super) fn color(&self, index: u32) -> Option<&ColorBlock> {
        let colors = &self.slabs[index as usize / SLAB_BLOCKS].colors;
        colors.get(index as usize % SLAB_BLOCKS)
    }

    /// The slabs, to be updated side by side.
    pub(super) fn slabs_mut(&mut self) -> &mut [Slab] {
        &mut self.slabs
    }

    /// The slabs in order.
    pub(super) fn slabs(&self) -> &[Slab] {
        &self.slabs
    }

    /// Numbers of all blocks in the order of their keys: by x, y, z, whatever the order of allocation.
    pub(super) fn sorted(&self) -> Vec<u32> {
        let mut order: Vec<u32> = (0..self.block_count as u32).collect();
        order.par_sort_unstable_by_key(|&index| self.key(index));
        order
    }

    /// Marks a block as met by the frame at hand; `true` the first time.
    #[inline]
    pub(super) fn touch(&mut self, index: u32) -> bool {
        let touched = &mut self.slabs[index as usize / SLAB_BLOCKS].touched;
        let bit = 1 << (index as usize % SLAB_BLOCKS);
        let is_first = *touched & bit == 0;
        *touched |= bit;
        is_first
    }

    /// Makes an empty block under a new key and returns its number.
    pub(super) fn push(&mut self, key: u64) -> u32 {
        let (index, place) = (self.block_count, self.block_count % SLAB_BLOCKS);
        if place == 0 {
            let slab = self.spare.pop();
            let mut slab = slab.unwrap_or_else(|| Slab::new(self.has_color));
            if !self.has_color {
                // What is held is counted by whether there is colour.
                slab.colors = Vec::new();
            }
            self.slabs.push(slab);
        }
        let slab = &mut self.slabs[index / SLAB_BLOCKS];
        slab.keys[place] = key;
        for (axis, coordinate) in unpack(key).into_iter().enumerate() {
            slab.low[axis] = slab.low[axis].min(coordinate);
            slab.high[axis] = slab.high[axis].max(coordinate);
        }
        slab.blocks.push(Block::EMPTY);
        if self.has_color {
            slab.colors.push(ColorBlock::EMPTY);
        }
        self.table.insert(key, index as u32);
        self.block_count += 1;
        index as u32
    }

    /// Takes the memory of `block_count` blocks ahead, and of their colours where they will have some.
    pub(super) fn reserve(&mut self, block_count: usize, with_color: bool) {
        let count = block_count / SLAB_BLOCKS;
        self.spare.reserve_exact(count);
        self.spare
            .extend((0..count).map(|_| Slab::written(with_color)));
        self.slabs.reserve_exact(count);
    }

    /// Gives every block a place for colour.
    pub(super) fn add_color(&mut self) {
        self.has_color = true;
        for slab in self.slabs.iter_mut().chain(&mut self.spare) {
            slab.colors.reserve_exact(SLAB_BLOCKS);
            slab.colors.resize(slab.blocks.len(), ColorBlock::EMPTY);
        }
    }

    /// Bytes held: blocks, colours, keys and the table.
    pub(super) fn bytes(&self) -> usize {
        let written = |slab: &Slab| {
            slab.blocks.capacity() * size_of::<Block>()
                + slab.colors.capacity() * size_of::<ColorBlock>()
        };
        self.slabs.len() * self.slab_bytes()
            + self.spare.iter().map(written).sum::<usize>()
            + self.spare.capacity() * size_of::<Slab>()
            + self.slabs.capacity() * size_of::<Slab>()
            + self.table.bytes()
    }

    /// Most bytes held while and after the next block is made: tables grow by copying.
    pub(super) fn bytes_for_next(&self) -> usize {
        let mut bytes = self.bytes() + self.table.growth_bytes();
        if self.block_count.is_multiple_of(SLAB_BLOCKS) && self.spare.is_empty() {
            bytes += self.slab_bytes();
            if self.slabs.len() == self.slabs.capacity() {
                bytes += 2 * self.slabs.len().max(4) * size_of::<Slab>();
            }
        }
        bytes
    }

    /// Bytes more that colour would take.
    pub(super) fn color_bytes(&self) -> usize {
        let slabs = self.slabs.iter().chain(&self.spare);
        let missing = slabs.map(|slab| SLAB_BLOCKS.saturating_sub(slab.colors.capacity()));
        missing.sum::<usize>() * size_of::<ColorBlock>()
    }

    fn slab_bytes(&self) -> usize {
        let color = if self.has_color {
            size_of::<ColorBlock>()
        } else {
            0
        };
        SLAB_BLOCKS * (size_of::<Block>() + color)
    }
}
