//! All scenes by name.
//!
//! `designed` the scenes whose verdicts are known (effects-and-tradeoffs A6) · `sequences` ten that stand for the
//! ten captures of the paper · `things` what they are made of.

mod designed;
mod sequences;
mod things;

use crate::design::Design;
use crate::error::SceneError;

/// Makes a scene.
type Maker = fn() -> Design;

/// Every scene, in the order of the lists in the documents.
const SCENES: &[(&str, Maker)] = &[
    ("matte", designed::matte),
    ("matte-clean", designed::matte_clean),
    ("shiny-plane", designed::shiny_plane),
    ("mirror-ball", designed::mirror_ball),
    ("ball-on-table", designed::ball_on_table),
    ("plastic-ball", designed::plastic_ball),
    ("bowls", designed::bowls),
    ("two-materials", designed::two_materials),
    ("one-material", designed::one_material),
    ("close-room", designed::close_room),
    ("far-room", designed::far_room),
    ("vignette-40", designed::vignette_40),
    ("pose-noise", designed::pose_noise),
    ("bumpy-normals", designed::bumpy_normals),
    ("near-threshold", designed::near_threshold),
    ("cans", sequences::cans),
    ("figure", sequences::figure),
    ("bag", sequences::bag),
    ("bottle", sequences::bottle),
    ("foil", sequences::foil),
    ("plane", sequences::plane),
    ("fruits", sequences::fruits),
    ("laptop", sequences::laptop),
    ("room", sequences::room),
];

/// Names of all scenes.
pub fn names() -> impl Iterator<Item = &'static str> {
    SCENES.iter().map(|(name, _)| *name)
}

/// The scene of that name.
///
/// # Errors
/// [`SceneError::UnknownScene`], with all names.
pub fn design(name: &str) -> Result<Design, SceneError> {
    let found = SCENES.iter().find(|(known, _)| *known == name);
    match found {
        Some((_, make)) => Ok(make()),
        None => Err(SceneError::UnknownScene {
            name: name.to_owned(),
            known: names().collect::<Vec<_>>().join(", "),
        }),
    }
}
