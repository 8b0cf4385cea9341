//! Requests as bytes.

use crate::bytes::{FieldWriter, u16_at, u32_at};
use crate::host::{
    HOST_HEADER_BYTES, MAX_HOST_PACKET_BYTES, Opcode, REQUEST_MAGIC, Request, RequestError,
    WordList,
};

impl Request {
    /// The packet, for the data stage of [`crate::usb::REQUEST_TYPE_OUT`]: how many bytes of `packet`.
    pub fn encode(&self, id: u16, packet: &mut [u8; MAX_HOST_PACKET_BYTES]) -> usize {
        let mut payload = [0; 64];
        // The largest payload is a list with three words before it.
        let payload_bytes = self.encode_payload(&mut payload).unwrap_or(0);
        let payload = payload.get(..payload_bytes).unwrap_or_default();
        let mut fields = FieldWriter::new(packet);
        let header = [payload_bytes as u16 / 2, self.opcode().code(), id];
        let written = fields.bytes(&REQUEST_MAGIC).and_then(|()| {
            header.iter().try_for_each(|&word| fields.u16(word))?;
            fields.bytes(payload)
        });
        written.map_or(0, |()| fields.filled())
    }

    fn encode_payload(&self, payload: &mut [u8]) -> Option<usize> {
        let mut fields = FieldWriter::new(payload);
        let mut words = |words: &[u16]| words.iter().try_for_each(|&word| fields.u16(word));
        match *self {
            Self::GetVersion
            | Self::KeepAlive
            | Self::GetMode
            | Self::GetLog
            | Self::GetSerialNumber
            | Self::GetPlatformString
            | Self::GetUsbCoreType => {}
            Self::GetParam { id: word }
            | Self::GetFixedParams { offset: word }
            | Self::SetMode { mode: word }
            | Self::GetCmosBlanking { cmos: word }
            | Self::GetCmosPresets { cmos: word }
            | Self::EnableEmitter { on: word } => words(&[word])?,
            Self::SetParam { ref pairs } => words(pairs.as_slice())?,
            Self::I2cWrite {
                bus,
                slave,
                words: ref data,
            } => {
                words(&[bus, slave])?;
                words(data.as_slice())?;
            }
            Self::I2cRead {
                bus,
                slave,
                read_count,
                words: ref data,
            } => {
                words(&[bus, slave, read_count])?;
                words(data.as_slice())?;
            }
            Self::AlgorithmParams {
                kind,
                resolution,
                fps,
                offset,
            } => {
                // The second word is a format that is always 0.
                words(&[kind, 0, resolution, fps, offset])?;
            }
            Self::SetCmosBlanking {
                units,
                cmos,
                frames,
            } => words(&[units, cmos, frames])?,
            Self::SetLedState { led, state } => words(&[led, state])?,
            Self::ReadAhb { address } => fields.u32(address)?,
            Self::WriteAhb {
                address,
                value,
                mask,
            } => {
                [address, value, mask]
                    .iter()
                    .try_for_each(|&word| fields.u32(word))?;
            }
        }
        Some(fields.filled())
    }

    /// Id and request of a packet.
    ///
    /// # Errors
    /// What is wrong with it: the camera answers [`crate::host::Nack::BadPacketSize`],
    /// [`crate::host::Nack::InvalidCommand`] or [`crate::host::Nack::BadCommandSize`].
    pub fn decode(packet: &[u8]) -> Result<(u16, Self), RequestError> {
        let header = |at| u16_at(packet, at).ok_or(RequestError::NotARequest);
        let (size, opcode, id) = (header(2)?, header(4)?, header(6)?);
        if !packet.starts_with(&REQUEST_MAGIC) {
            return Err(RequestError::NotARequest);
        }
        let payload = packet
            .get(HOST_HEADER_BYTES..)
            .filter(|payload| payload.len() == 2 * usize::from(size))
            .ok_or(RequestError::Size { opcode, id })?;
        let known = Opcode::from_code(opcode).ok_or(RequestError::Unknown { opcode, id })?;
        let request = Self::decode_payload(known, payload);
        Ok((id, request.ok_or(RequestError::Payload { opcode, id })?))
    }

    fn decode_payload(opcode: Opcode, payload: &[u8]) -> Option<Self> {
        let word = |index: usize| u16_at(payload, 2 * index);
        let list_from = |index: usize| WordList::decode(payload.get(2 * index..)?);
        let request = match opcode {
            Opcode::GetVersion => Self::GetVersion,
            Opcode::KeepAlive => Self::KeepAlive,
            Opcode::GetParam => Self::GetParam { id: word(0)? },
            Opcode::SetParam => {
                let pairs = list_from(0)?;
                let count = pairs.as_slice().len();
                if count == 0 || !count.is_multiple_of(2) {
                    return None;
                }
                Self::SetParam { pairs }
            }
            Opcode::GetFixedParams => Self::GetFixedParams { offset: word(0)? },
            Opcode::GetMode => Self::GetMode,
            Opcode::SetMode => Self::SetMode { mode: word(0)? },
            Opcode::GetLog => Self::GetLog,
            Opcode::I2cWrite => Self::I2cWrite {
                bus: word(0)?,
                slave: word(1)?,
                words: list_from(2)?,
            },
            Opcode::I2cRead => Self::I2cRead {
                bus: word(0)?,
                slave: word(1)?,
                read_count: word(2)?,
                words: list_from(3)?,
            },
            Opcode::ReadAhb => Self::ReadAhb {
                address: u32_at(payload, 0)?,
            },
            Opcode::WriteAhb => Self::WriteAhb {
                address: u32_at(payload, 0)?,
                value: u32_at(payload, 4)?,
                mask: u32_at(payload, 8)?,
            },
            Opcode::AlgorithmParams => Self::AlgorithmParams {
                kind: word(0)?,
                resolution: word(2)?,
                fps: word(3)?,
                offset: word(4)?,
            },
            Opcode::SetCmosBlanking => Self::SetCmosBlanking {
                units: word(0)?,
                cmos: word(1)?,
                frames: word(2)?,
            },
            Opcode::GetCmosBlanking => Self::GetCmosBlanking { cmos: word(0)? },
            Opcode::GetCmosPresets => Self::GetCmosPresets { cmos: word(0)? },
            Opcode::GetSerialNumber => Self::GetSerialNumber,
            Opcode::GetPlatformString => Self::GetPlatformString,
            Opcode::GetUsbCoreType => Self::GetUsbCoreType,
            Opcode::SetLedState => Self::SetLedState {
                led: word(0)?,
                state: word(1)?,
            },
            Opcode::EnableEmitter => Self::EnableEmitter { on: word(0)? },
        };
        // Nothing more than what the request has.
        let mut again = [0; 64];
        let byte_count = request.encode_payload(&mut again)?;
        (byte_count == payload.len()).then_some(request)
    }
}
