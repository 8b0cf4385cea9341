//! The edits of the vectors: what happened to a file.

use std::io;

use serde_json::Value;

/// `file` after `edits`: a cut, zeros, bytes of a file, bytes that are put or xored. `read` reads a file.
pub(crate) fn edited(
    read: &dyn Fn(&str) -> io::Result<Vec<u8>>,
    file: &str,
    edits: &[Value],
) -> io::Result<Vec<u8>> {
    let mut bytes = read(file)?;
    for edit in edits {
        let number = |key: &str| edit[key].as_u64().map(|number| number as usize);
        if let Some(length) = number("cut") {
            bytes.truncate(length);
            continue;
        }
        let at = number("at").ok_or(io::ErrorKind::InvalidData)?;
        let old = |place: usize| bytes.get(at + place).copied().unwrap_or_default();
        let new = if let Some(count) = number("zeros") {
            vec![0; count]
        } else if let (Some(name), Some(start), Some(count)) =
            (edit["file"].as_str(), number("from"), number("bytes"))
        {
            let other = read(name)?;
            let end = other.len().min(start + count);
            other[start..end].to_vec()
        } else if let Some(digits) = edit["put"].as_str() {
            from_hex(digits)?
        } else {
            let digits = edit["xor"].as_str().ok_or(io::ErrorKind::InvalidData)?;
            let mask = from_hex(digits)?;
            let xored = mask
                .iter()
                .enumerate()
                .map(|(place, mask)| old(place) ^ mask);
            xored.collect()
        };
        let end = at + new.len();
        if bytes.len() < end {
            bytes.resize(end, 0);
        }
        bytes[at..end].copy_from_slice(&new);
    }
    Ok(bytes)
}

fn from_hex(digits: &str) -> io::Result<Vec<u8>> {
    let byte = |pair: &[u8]| {
        let digits = std::str::from_utf8(pair).ok()?;
        u8::from_str_radix(digits, 16).ok()
    };
    let bytes: Option<Vec<u8>> = digits.as_bytes().chunks(2).map(byte).collect();
    bytes.ok_or_else(|| io::ErrorKind::InvalidData.into())
}
