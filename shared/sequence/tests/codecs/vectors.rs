//! The committed vectors: what was written once stays readable.

use std::path::Path;

use sequence::codecs::{CodeTable, ColorFormat};
use serde::Deserialize;

use crate::frames::*;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Vector {
    name: String,
    format: String,
    width: u32,
    height: u32,
    table: Option<String>,
    refused: bool,
    describes: String,
}

#[test]
fn every_vector_decodes_to_its_frame_or_is_refused() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../recordings/vectors/codecs");
    let read = |name: &str| std::fs::read(folder.join(name)).unwrap();
    let vectors: Vec<Vector> = serde_json::from_slice(&read("index.json")).unwrap();
    assert!(vectors.len() >= 40);
    for vector in vectors {
        let (width, height) = (vector.width, vector.height);
        let payload = read(&format!("{}.payload", vector.name));
        let format = match vector.format.as_str() {
            "depth" => None,
            "bayer-grbg" => Some(ColorFormat::BayerGrbg),
            "uyvy" => Some(ColorFormat::Uyvy),
            "yuyv" => Some(ColorFormat::Yuyv),
            "rgb8" => Some(ColorFormat::Rgb8),
            "infrared10" => Some(ColorFormat::Infrared10),
            other => panic!("{}: format {other}", vector.name),
        };
        let decoded = if let Some(format) = format {
            color_decoded(format, width, height, &payload)
        } else {
            let table = vector
                .table
                .map(|name| CodeTable::from_bytes(&read(&name)).unwrap());
            decoded(&payload, table.as_ref(), width, height).map(|samples| {
                samples
                    .iter()
                    .flat_map(|sample| sample.to_le_bytes())
                    .collect()
            })
        };
        assert_eq!(
            decoded.is_err(),
            vector.refused,
            "{}: {} ({decoded:?})",
            vector.name,
            vector.describes
        );
        if let Ok(decoded) = decoded {
            assert!(
                decoded == read(&format!("{}.raw", vector.name)),
                "{}: {}",
                vector.name,
                vector.describes
            );
        }
    }
}
