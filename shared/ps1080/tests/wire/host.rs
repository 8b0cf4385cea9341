//! Requests and replies, blocks, texts: round trips, and everything that the control endpoint may give instead.

use ps1080::blocks::{
    BlankingBlock, BlockCollector, BlockError, CmosPreset, FixedParams, PaddingBlock, Presets,
    Text, decode_constant_shift, decode_platform_string, decode_tick_rate, encode_platform_string,
    encode_tick_rate,
};
use ps1080::color::ColorFormat;
use ps1080::host::{
    MAX_HOST_PACKET_BYTES, MAX_REPLY_DATA_BYTES, Nack, Opcode, Received, ReplyError, ReplyReader,
    Request, RequestError, WordList, encode_reply,
};
use ps1080::mode::Resolution;
use ps1080::parameter::{PARAMETERS, Parameter};
use ps1080::stream::TickRate;
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64Mcg;

use super::made;

/// One of every kind, with random numbers.
fn requests(random: &mut Pcg64Mcg) -> Vec<Request> {
    let mut word = || random.random::<u16>();
    let [a, b, c, d] = [word(), word(), word(), word()];
    let words: Vec<u16> = (0..2 * (word() % 8 + 1)).map(|_| word()).collect();
    let words = WordList::new(&words).unwrap();
    let [address, value, mask] = [a, b, c].map(|word| u32::from(word) << 16 | u32::from(d));
    vec![
        Request::GetVersion,
        Request::KeepAlive,
        Request::GetParam { id: a },
        Request::SetParam { pairs: words },
        Request::GetFixedParams { offset: a },
        Request::GetMode,
        Request::SetMode { mode: a },
        Request::GetLog,
        Request::I2cWrite {
            bus: a,
            slave: b,
            words,
        },
        Request::I2cRead {
            bus: a,
            slave: b,
            read_count: c,
            words,
        },
        Request::ReadAhb { address },
        Request::WriteAhb {
            address,
            value,
            mask,
        },
        Request::AlgorithmParams {
            kind: a,
            resolution: b,
            fps: c,
            offset: d,
        },
        Request::SetCmosBlanking {
            units: a,
            cmos: b,
            frames: c,
        },
        Request::GetCmosBlanking { cmos: a },
        Request::GetCmosPresets { cmos: a },
        Request::GetSerialNumber,
        Request::GetPlatformString,
        Request::GetUsbCoreType,
        Request::SetLedState { led: a, state: b },
        Request::EnableEmitter { on: a },
    ]
}

#[test]
fn every_request_is_what_it_was() {
    let mut random = Pcg64Mcg::seed_from_u64(1);
    let mut packet = [0; MAX_HOST_PACKET_BYTES];
    for _ in 0..100 {
        let requests = requests(&mut random);
        assert_eq!(requests.len(), Opcode::ALL.len());
        for (request, opcode) in requests.into_iter().zip(Opcode::ALL) {
            let id = random.random();
            let byte_count = request.encode(id, &mut packet);
            assert_eq!(request.opcode(), opcode);
            assert_eq!(Request::decode(&packet[..byte_count]), Ok((id, request)));
            // One byte less or more is not.
            for length in [byte_count - 1, byte_count + 1] {
                assert!(Request::decode(&packet[..length]).is_err());
            }
        }
    }
}

#[test]
fn what_is_no_request_says_what_to_answer() {
    let decode = |bytes: &[u8]| Request::decode(bytes).unwrap_err();
    assert_eq!(decode(&[]), RequestError::NotARequest);
    assert_eq!(
        decode(&[0x47, 0x4D, 0, 0, 0, 0, 7]),
        RequestError::NotARequest
    );
    assert_eq!(
        decode(&[0x52, 0x42, 0, 0, 0, 0, 7, 0]),
        RequestError::NotARequest
    );
    let (opcode, id) = (2, 7);
    assert_eq!(
        decode(&[0x47, 0x4D, 2, 0, 2, 0, 7, 0, 1, 0]),
        RequestError::Size { opcode, id }
    );
    assert_eq!(
        decode(&[0x47, 0x4D, 0, 0, 2, 0, 7, 0]),
        RequestError::Payload { opcode, id }
    );
    // 999 stops the camera; 13 writes its flash: neither is a request here.
    for opcode in [999_u16, 13, 14, 15, 17] {
        let [low, high] = opcode.to_le_bytes();
        assert_eq!(
            decode(&[0x47, 0x4D, 0, 0, low, high, 7, 0]),
            RequestError::Unknown { opcode, id }
        );
    }
    // A parameter without a value.
    let opcode = 3;
    assert_eq!(
        decode(&[0x47, 0x4D, 1, 0, 3, 0, 7, 0, 5, 0]),
        RequestError::Payload { opcode, id }
    );
}

#[test]
fn cropping_is_one_request() {
    let values = [
        (Parameter::DepthCropWidth, 320),
        (Parameter::DepthCropHeight, 240),
        (Parameter::DepthCropX, 8),
        (Parameter::DepthCropY, 16),
        (Parameter::DepthCropMode, 1),
    ];
    let Some(Request::SetParam { pairs }) = Request::set_all(&values) else {
        panic!("five pairs fit");
    };
    assert_eq!(pairs.as_slice(), [51, 320, 52, 240, 53, 8, 54, 16, 55, 1]);
    assert_eq!(
        Request::set_all(&values[..1]),
        Some(Request::set(values[0].0, 320))
    );
    assert_eq!(Request::set_all(&[values[0]; 9]), None);
    assert_eq!(WordList::new(&[0; 17]), None);
}

#[test]
fn replies_of_any_size_in_any_pieces() {
    let mut packet = [0; MAX_HOST_PACKET_BYTES];
    let mut random = Pcg64Mcg::seed_from_u64(2);
    for byte_count in 0..=MAX_REPLY_DATA_BYTES {
        let data: Vec<u8> = (0..byte_count).map(|_| random.random()).collect();
        let length = encode_reply(2, 9, Ok(&data), &mut packet).unwrap();
        // The magic is not looked for in two transfers: the header comes at once.
        let (head, rest) = packet[..length].split_at(8);
        let mut reader = ReplyReader::new(Opcode::GetParam, 9);
        assert_eq!(reader.receive(head), Ok(Received::Partial));
        let mut got = None;
        for piece in made::pieces(rest, &mut random) {
            match reader.receive(piece) {
                Ok(Received::Data(data)) => got = Some(data.to_vec()),
                Ok(Received::Partial | Received::NotYet) => {}
                other => panic!("{other:?}"),
            }
        }
        let got = got.unwrap();
        assert_eq!(got[..byte_count], data);
        assert!(got[byte_count..].iter().all(|&byte| byte == 0) && got.len() - byte_count < 2);
    }
    let too_much = [0; MAX_REPLY_DATA_BYTES + 1];
    assert_eq!(encode_reply(2, 9, Ok(&too_much), &mut packet), None);
}

#[test]
fn what_is_not_the_reply_yet_is_waited_out() {
    let mut packet = [0; MAX_HOST_PACKET_BYTES];
    let mut reader = ReplyReader::new(Opcode::GetMode, 9);
    assert_eq!(reader.receive(&[]), Ok(Received::NotYet));
    assert_eq!(
        reader.receive(&[1, 2, 3, 4, 5, 6, 7, 8, 9, 10]),
        Ok(Received::Garbage)
    );
    assert_eq!(
        reader.receive(&[0x52, 0x42, 2, 0, 5, 0, 9]),
        Ok(Received::Garbage)
    );
    let length = encode_reply(5, 8, Ok(&[1, 0]), &mut packet).unwrap();
    assert_eq!(
        reader.receive(&packet[..length]),
        Ok(Received::Stale { id: 8 })
    );
    // Behind garbage, half a magic and a magic by chance.
    let length = encode_reply(5, 9, Ok(&[1, 0]), &mut packet).unwrap();
    for garbage in [
        &[7, 7, 7, 7, 7][..],
        &[0x52],
        &[0x52, 0x42],
        &[0x52, 0x42, 1, 0, 0x52],
    ] {
        let bytes = [garbage, &packet[..length], &[3, 3, 3]].concat();
        assert_eq!(
            reader.receive(&bytes),
            Ok(Received::Data(&[1, 0])),
            "{garbage:?}"
        );
    }
}

#[test]
fn refusals_and_what_cannot_be_the_reply() {
    let mut packet = [0; MAX_HOST_PACKET_BYTES];
    for code in 1..=300 {
        let nack = Nack::from_code(code).unwrap();
        assert_eq!(nack.code(), code);
        let length = encode_reply(5, 9, Err(nack), &mut packet).unwrap();
        let mut reader = ReplyReader::new(Opcode::GetMode, 9);
        assert_eq!(
            reader.receive(&packet[..length]),
            Ok(Received::Refused(nack))
        );
    }
    assert_eq!(Nack::from_code(0), None);
    let mut reader = ReplyReader::new(Opcode::GetMode, 9);
    assert_eq!(
        reader.receive(&[0x52, 0x42, 1, 0, 2, 0, 9, 0, 0, 0]),
        Err(ReplyError::Opcode {
            expected: 5,
            got: 2
        })
    );
    assert_eq!(
        reader.receive(&[0x52, 0x42, 0, 0, 5, 0, 9, 0]),
        Err(ReplyError::NoErrorWord)
    );
    assert_eq!(
        reader.receive(&[0x52, 0x42, 253, 0, 5, 0, 9, 0]),
        Err(ReplyError::TooLong { word_count: 253 })
    );
    // Still ready for the right one.
    let length = encode_reply(5, 9, Ok(&[1, 0]), &mut packet).unwrap();
    assert_eq!(
        reader.receive(&packet[..length]),
        Ok(Received::Data(&[1, 0]))
    );
}

#[test]
fn blocks_come_in_parts() {
    let block = FixedParams::xtion().encode();
    for part_bytes in [4, 8, 100, 168] {
        let mut collector = BlockCollector::<{ FixedParams::BYTES }>::of_double_words();
        let mut request_count = 0;
        while let Some(offset) = collector.next_offset() {
            let from = 4 * usize::from(offset);
            let to = (from + part_bytes).min(block.len());
            collector.push(&block[from..to]).unwrap();
            request_count += 1;
        }
        assert_eq!(request_count, 168_usize.div_ceil(part_bytes));
        assert_eq!(collector.block(), Some(&block));
    }
    let mut collector = BlockCollector::<6>::of_words();
    assert_eq!(
        collector.push(&[1; 3]),
        Err(BlockError::PartSize { part_bytes: 3 })
    );
    collector.push(&[1; 4]).unwrap();
    assert_eq!(collector.next_offset(), Some(2));
    assert_eq!(
        collector.push(&[1; 4]),
        Err(BlockError::PartSize { part_bytes: 4 })
    );
    let short = BlockError::Short {
        got_bytes: 4,
        expected_bytes: 6,
    };
    assert_eq!(collector.push(&[]), Err(short));
    assert_eq!(collector.block(), None);
}

#[test]
fn small_blocks_are_what_they_were() {
    let padding = PaddingBlock {
        start_lines: 2,
        end_lines: 1,
        cropping_lines: 5,
    };
    assert_eq!(padding.encode(), [2, 0, 1, 0, 5, 0]);
    assert_eq!(PaddingBlock::decode(&padding.encode()), padding);
    let blanking = BlankingBlock {
        lines: [(0.5, 3.0), (-1.25, 1e6)],
    };
    assert_eq!(BlankingBlock::decode(&blanking.encode()), blanking);
    assert_eq!(decode_constant_shift(&[200, 0]), 200);
    assert_eq!(encode_tick_rate(TickRate::PS1080), 60_f32.to_le_bytes());
    assert_eq!(
        decode_tick_rate(&60_f32.to_le_bytes()),
        Some(TickRate::PS1080)
    );
    for no_rate in [0.0, -60.0, f32::NAN, f32::INFINITY, 1e30] {
        assert_eq!(decode_tick_rate(&no_rate.to_le_bytes()), None);
    }
}

#[test]
fn presets_of_no_frames_are_left_out() {
    let preset = |format, resolution, fps| CmosPreset {
        format,
        resolution,
        fps,
    };
    let sent = [
        preset(1, 1, 30),
        preset(6, 2, 0),
        preset(6, 2, 30),
        preset(99, 99, 30),
    ];
    let mut data: Vec<u8> = sent.iter().flat_map(CmosPreset::encode).collect();
    data.extend([1, 2, 3]);
    let read: Vec<CmosPreset> = Presets::decode(&data).collect();
    assert_eq!(read, [sent[0], sent[2], sent[3]]);
    assert_eq!(
        read[1].color_mode(),
        Some((ColorFormat::Bayer, Resolution::Sxga))
    );
    assert_eq!(read[2].color_mode(), None);
}

#[test]
fn texts_end_at_a_zero_and_are_printable() {
    let text = Text::<8>::decode(b"AB\x1b\xff 1\0zz");
    assert_eq!(text.as_str(), "AB?? 1");
    assert_eq!(format!("{text} {text:?}"), "AB?? 1 \"AB?? 1\"");
    assert_eq!(Text::<4>::decode(b"12345678").as_str(), "1234");
    let mut data = [0xEE; 14];
    let platform = decode_platform_string(&[b'P', 0, b'S', 0, 0x34, 0x12, 0, 0, b'x', 0]);
    assert_eq!(platform.as_str(), "PS?");
    let byte_count = encode_platform_string(&platform, &mut data);
    assert_eq!(data[..byte_count], [b'P', 0, b'S', 0, b'?', 0]);
    assert_eq!(encode_platform_string(&platform, &mut data[..3]), 2);
}

#[test]
fn parameters_have_the_ids_and_limits_of_section_4() {
    assert!(
        PARAMETERS
            .windows(2)
            .all(|pair| pair[0].id() < pair[1].id())
    );
    for parameter in PARAMETERS {
        assert_eq!(Parameter::from_id(parameter.id()), Some(parameter));
    }
    for (id, parameter) in [
        (5, Parameter::Stream0Mode),
        (12, Parameter::ImageFormat),
        (18, Parameter::DepthFormat),
        (55, Parameter::DepthCropMode),
        (84, Parameter::CloseRange),
    ] {
        assert_eq!(parameter.id(), id);
    }
    // What the maker alone should touch.
    assert!(
        (37..=44)
            .chain([85])
            .all(|id| Parameter::from_id(id).is_none())
    );
    assert!(Parameter::Stream0Mode.accepts(3) && !Parameter::Stream0Mode.accepts(2));
    assert!(Parameter::Stream1Mode.accepts(2) && !Parameter::Stream1Mode.accepts(1));
    assert!(!Parameter::DepthFps.accepts(29) && !Parameter::FrameSync.accepts(2));
    assert!(Parameter::ExposureBar.accepts(u16::MAX));
}
