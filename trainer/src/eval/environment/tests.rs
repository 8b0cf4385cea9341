//! A whole evaluation from files.

use std::path::Path;

use geometry::{DVec2, DVec3, PanoramaSize};
use glam::DMat3;
use imaging::{ConfidenceMap, Image, PanoramaAttributes, write_confidence_exr, write_rgb_exr};

use super::*;

const ATTRIBUTES: PanoramaAttributes = PanoramaAttributes {
    world_from_panorama: DMat3::IDENTITY,
    origin: DVec3::ZERO,
    radius: f64::INFINITY,
    gain: 1.0,
};

/// Bars of 8 degrees along +z in a room that brightens to one side, and a plain panel to the right.
const BARS: &str = r#"{"version":1,"grey":0.4,"dark":0.1,"bright":0.7,"groups":[
 {"site":0,"kind":"horizontal","width_deg":8,"length_deg":20,"center":[0,0,1],"across":[1,0,0],"along":[0,1,0]},
 {"site":0,"kind":"plain","width_deg":8,"length_deg":20,"center":[1,0,0],"across":[0,0,-1],"along":[0,1,0]}]}"#;

fn radiance(d: DVec3) -> f32 {
    let (t, s) = ((d.x / d.z) / 8_f64.to_radians(), d.y / d.z);
    if d.z > 0.0 && t.abs() <= 2.5 && s.abs() < 0.2 {
        let is_bright = ((t + 2.5).floor() as i64).rem_euclid(2) == 0;
        return if is_bright { 0.7 } else { 0.1 };
    }
    (0.4 - 0.2 * d.y + 0.2 * d.z.min(0.0)) as f32
}

fn room(height: u32, factor: f32) -> LinearImage {
    let size = PanoramaSize::from_height(height).unwrap();
    Image::from_fn(size.width(), height, |x, y| {
        let texel = DVec2::new(f64::from(x), f64::from(y));
        [factor * radiance(size.direction_from_texel(texel)); 3]
    })
}

fn write(folder: &Path) {
    let maps = [
        ("environment.exr", room(256, 1.0)),
        ("reach.exr", Image::new(128, 64, [1.0; 3])),
        ("srm.exr", room(250, 0.25)),
    ];
    for (name, map) in maps {
        write_rgb_exr(&folder.join(name), &map, &ATTRIBUTES).unwrap();
    }
    let confidence = ConfidenceMap {
        confidence: Image::new(500, 250, 1.0),
        sigma: Image::new(500, 250, [0.01; 3]),
        sample_count: Image::new(500, 250, 9.0),
        flags: Image::new(500, 250, 0),
    };
    write_confidence_exr(&folder.join("confidence.exr"), &confidence).unwrap();
}

fn evaluated(folder: &Path) -> anyhow::Result<EnvironmentMetrics> {
    let [srm, confidence] = ["srm.exr", "confidence.exr"].map(|name| folder.join(name));
    evaluate(&srm, &confidence, folder, None, 0.01, None)
}

#[test]
fn a_dimmed_truth_scores_like_the_truth_with_bars_and_without() {
    let desk = tempfile::tempdir().unwrap();
    write(desk.path());
    let without = evaluated(desk.path()).unwrap();
    assert!(without.env_corr > 0.98 && (without.scale_reach - 4.0).abs() < 0.1);
    // This room is its own mirror image: no map of it can be told from a mirrored one.
    let verdict = without.verdict.as_ref().unwrap();
    assert!(!verdict.shows_detail && verdict.best_null.contains("mirrored"));
    let text = serde_json::to_string(&without).unwrap();
    assert!(!text.contains("env_bar_deg") && !text.contains("\"bars\""));

    std::fs::write(desk.path().join("bars.json"), BARS).unwrap();
    let with = evaluated(desk.path()).unwrap();
    assert_eq!(with.env_corr, without.env_corr);
    assert_eq!(with.env_bar_deg_h, Some(BarWidth::AtMost(8.0)));
    assert_eq!(with.env_bar_deg_v, None);
    // The scale of the map is that of its score.
    let mtf = with.bars[0].mtf.unwrap();
    assert!((mtf - 0.95).abs() < 0.08, "{mtf}");
    let text = serde_json::to_string(&with).unwrap();
    assert!(text.contains("\"env_bar_deg_h\":\"≤8\""), "{text}");
    let read: EnvironmentMetrics = serde_json::from_str(&text).unwrap();
    assert_eq!(read.bars, with.bars);
}

#[test]
fn a_list_of_bars_that_is_damaged_is_an_error_with_its_name() {
    let desk = tempfile::tempdir().unwrap();
    write(desk.path());
    for text in [
        "",
        "[]",
        &BARS.replace("\"site\"", "\"sight\""),
        &BARS[..200],
    ] {
        std::fs::write(desk.path().join("bars.json"), text).unwrap();
        let error = format!("{:#}", evaluated(desk.path()).unwrap_err());
        assert!(error.contains("bars.json"), "{error}");
    }
}
