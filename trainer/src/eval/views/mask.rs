//! Which pixels of a held-out photograph count (effects-and-tradeoffs.md C2).

use std::path::Path;

use imaging::{Image, Mask, decode_png_mask};

/// Where the object is in each frame.
#[derive(Clone, Copy, Debug)]
pub(super) enum MaskSource<'a> {
    /// A folder of 1-bit PNGs named by frame.
    Given(&'a Path),
    /// The segments that training found to be shiny, as the camera sees them.
    ShinySegments,
}

impl MaskSource<'_> {
    /// In words, for the metrics.
    pub(super) fn description(self) -> &'static str {
        match self {
            Self::Given(_) => "given masks, eroded by 1 pixel",
            Self::ShinySegments => "shiny segments of the mesh, eroded by 1 pixel",
        }
    }

    /// The scored pixels of frame `index`: the object eroded by a pixel, and there only where the model has a
    /// surface.
    pub(super) fn mask(
        self,
        index: usize,
        has_surface: &Mask,
        is_shiny: &Mask,
    ) -> anyhow::Result<Mask> {
        let object = match self {
            Self::Given(folder) => read(folder, index, has_surface)?,
            Self::ShinySegments => is_shiny.clone(),
        };
        let mut mask = eroded(&object);
        for (inside, &valid) in mask.pixels_mut().iter_mut().zip(has_surface.pixels()) {
            *inside &= valid;
        }
        Ok(mask)
    }
}

fn read(folder: &Path, index: usize, like: &Mask) -> anyhow::Result<Mask> {
    let path = folder.join(format!("{index:06}.png"));
    let bytes = std::fs::read(&path)
        .map_err(|error| anyhow::anyhow!("cannot read the mask {}: {error}", path.display()))?;
    let given = decode_png_mask(&bytes)?;
    anyhow::ensure!(
        (given.width(), given.height()) == (like.width(), like.height()),
        "the mask {} has another size than the photographs",
        path.display()
    );
    Ok(given)
}

/// The pixels of `mask` whose four neighbours are in it too: edges of a mask mix object and background.
fn eroded(mask: &Mask) -> Mask {
    Image::from_fn(mask.width(), mask.height(), |x, y| {
        let (x, y) = (i64::from(x), i64::from(y));
        [(0, 0), (1, 0), (-1, 0), (0, 1), (0, -1)]
            .iter()
            .all(|(dx, dy)| mask.get(x + dx, y + dy).unwrap_or(false))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mask_loses_its_rim_and_what_has_no_surface() {
        let object = Image::from_fn(7, 7, |x, y| (1..6).contains(&x) && (1..6).contains(&y));
        let has_surface = Image::from_fn(7, 7, |x, _| x != 3);
        let mask = MaskSource::ShinySegments
            .mask(0, &has_surface, &object)
            .unwrap();
        let expected = Image::from_fn(7, 7, |x, y| (x == 2 || x == 4) && (2..5).contains(&y));
        assert_eq!(mask.pixels(), expected.pixels());
        // Beyond the picture there is no object.
        assert!(!eroded(&Image::new(3, 3, true)).at(0, 1));
    }
}
