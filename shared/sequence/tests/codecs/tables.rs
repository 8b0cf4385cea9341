//! Millimetres that become codes.

use rand::SeedableRng as _;
use rand_pcg::Pcg64Mcg;
use sequence::codecs::{
    CodeTable, CodeTableDetector, CodecError, DepthCodec, DepthEncoder, MAX_CODES, depth_table_id,
};

use crate::frames::*;

fn in_millimetres(frame: &Frame) -> Frame {
    let samples = frame.samples.iter().map(|&shift| match shift {
        0 | u16::MAX => shift,
        _ => millimetres(shift),
    });
    Frame {
        samples: samples.collect(),
        ..*frame
    }
}

#[test]
fn values_of_a_sensor_prove_to_be_a_table_and_cost_less_as_codes() {
    let shifts = shifts(160, 120, &mut Pcg64Mcg::seed_from_u64(8));
    let frame = in_millimetres(&shifts);
    for codec in BOTH {
        let mut encoder = DepthEncoder::of_values(160, 120, None).unwrap();
        let (encoded, decoded) = through(&mut encoder, &frame, codec);
        assert!(encoded.has_new_table);
        assert_eq!(decoded, frame.samples);
        let mut plain = DepthEncoder::of_codes(160, 120).unwrap();
        let (as_they_are, _) = payload_of(&mut plain, &frame, codec);
        assert!(
            encoded.byte_count < as_they_are.byte_count,
            "{encoded:?} {as_they_are:?}"
        );
        let (again, _) = payload_of(&mut encoder, &frame, codec);
        assert!(!again.has_new_table);
    }
}

#[test]
fn a_new_value_makes_a_new_table_and_old_payloads_keep_theirs() {
    let shifts = shifts(80, 60, &mut Pcg64Mcg::seed_from_u64(9));
    let first = in_millimetres(&shifts);
    let mut second = first.clone();
    second.samples[100] = 555;
    second.samples[101] = 9_876;
    let mut encoder = DepthEncoder::of_values(80, 60, None).unwrap();
    let (_, first_payload) = payload_of(&mut encoder, &first, DepthCodec::Dense);
    let first_table = encoder.table().unwrap().clone();
    let (encoded, second_payload) = payload_of(&mut encoder, &second, DepthCodec::Dense);
    let second_table = encoder.table().unwrap().clone();
    assert!(encoded.has_new_table);
    assert_eq!((first_table.id(), second_table.id()), (1, 2));
    assert_eq!(second_table.values().len(), first_table.values().len() + 2);
    assert_eq!(
        decoded(&first_payload, Some(&first_table), 80, 60).unwrap(),
        first.samples
    );
    assert_eq!(
        decoded(&second_payload, Some(&second_table), 80, 60).unwrap(),
        second.samples
    );
    let other = CodecError::Table {
        expected: 1,
        got: Some(2),
    };
    assert_eq!(
        decoded(&first_payload, Some(&second_table), 80, 60),
        Err(other)
    );
    let none = CodecError::Table {
        expected: 2,
        got: None,
    };
    assert_eq!(decoded(&second_payload, None, 80, 60), Err(none));
}

#[test]
fn more_values_than_a_table_has_are_coded_as_they_are() {
    // 2,048 values, then one more: the table stays, the frame goes without.
    let value = |index: u32| (2 + index * 3) as u16;
    let full = Frame::from_fn(128, 128, |x, y| value((y * 128 + x) % MAX_CODES as u32));
    let mut more = full.clone();
    more.samples[5] = 1;
    let mut encoder = DepthEncoder::of_values(128, 128, None).unwrap();
    let (encoded, samples) = through(&mut encoder, &full, DepthCodec::Fast);
    assert!(encoded.has_new_table && samples == full.samples);
    let (encoded, payload) = payload_of(&mut encoder, &more, DepthCodec::Fast);
    assert!(!encoded.has_new_table);
    assert_eq!(depth_table_id(&payload), Ok(None));
    assert_eq!(decoded(&payload, None, 128, 128).unwrap(), more.samples);
    // The table is as it was.
    let (encoded, samples) = through(&mut encoder, &full, DepthCodec::Dense);
    assert!(!encoded.has_new_table && samples == full.samples);
}

#[test]
fn noise_and_ramps_without_steps_are_no_table() {
    let mut detector = CodeTableDetector::new();
    detector.observe(&noise(200, 200, &mut Pcg64Mcg::seed_from_u64(10)).samples);
    assert_eq!(detector.table(), None, "more than 2,048 values");
    let mut detector = CodeTableDetector::new();
    detector.observe(&Frame::from_fn(100, 100, |x, _| 500 + x as u16).samples);
    assert_eq!(
        detector.table(),
        None,
        "every value between the nearest and the farthest"
    );
    let mut detector = CodeTableDetector::new();
    detector.observe(&[700, 900, 1100, 0, u16::MAX]);
    assert_eq!(detector.table(), None, "too few samples to prove anything");
    let mut detector = CodeTableDetector::new();
    detector.observe(&[0, u16::MAX, 0, u16::MAX]);
    assert_eq!(detector.table(), None, "nothing was measured");
    assert!(
        DepthEncoder::of_values(10, 10, None)
            .unwrap()
            .table()
            .is_none()
    );
}

#[test]
fn a_known_table_is_used_from_the_first_frame() {
    let device: Vec<u16> = (1..2047).map(millimetres).collect();
    let table = CodeTable::new(1, &device).unwrap();
    assert_eq!(
        table.values().len(),
        821,
        "distinct depths of the real camera"
    );
    let frame = in_millimetres(&shifts(40, 30, &mut Pcg64Mcg::seed_from_u64(11)));
    let mut encoder = DepthEncoder::of_values(40, 30, Some(table.clone())).unwrap();
    let (encoded, payload) = payload_of(&mut encoder, &frame, DepthCodec::Dense);
    assert!(!encoded.has_new_table);
    assert_eq!(depth_table_id(&payload), Ok(Some(1)));
    assert_eq!(
        decoded(&payload, Some(&table), 40, 30).unwrap(),
        frame.samples
    );
}

#[test]
fn bytes_that_are_no_table_are_refused() {
    let table = CodeTable::new(7, &[900, 800, 800, 0, u16::MAX, 1000]).unwrap();
    let bytes = table.to_bytes();
    assert_eq!(bytes, [7, 0, 3, 0, 32, 3, 132, 3, 232, 3]);
    assert_eq!(CodeTable::from_bytes(&bytes).unwrap(), table);
    assert_eq!(
        (table.sample_of(0), table.sample_of(2)),
        (Some(0), Some(900))
    );
    assert_eq!(
        (table.sample_of(u16::MAX), table.sample_of(4)),
        (Some(u16::MAX), None)
    );
    for length in 0..bytes.len() {
        assert!(CodeTable::from_bytes(&bytes[..length]).is_err());
    }
    for (place, value) in [
        (0, 0),
        (2, 2),
        (2, 4),
        (3, 255),
        (4, 133),
        (8, 132),
        (5, 0xff),
        (9, 0),
    ] {
        let mut bytes = bytes.clone();
        bytes[place] = value;
        if place == 5 {
            bytes[4] = 0xff;
        }
        assert!(
            CodeTable::from_bytes(&bytes).is_err(),
            "byte {place} = {value}"
        );
    }
    assert!(CodeTable::new(1, &[]).is_err());
    assert!(CodeTable::new(0, &[5]).is_err());
    assert!(CodeTable::new(1, &(1..2050).collect::<Vec<u16>>()).is_err());
}
