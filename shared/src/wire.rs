//! Wire format of the radio: bincode 2, little endian, fixed-width integers, at most [`MAX_WIRE_BYTES`]. No
//! other module uses bincode.

use bincode::config::Config;
use serde::{Serialize, de::DeserializeOwned};
use thiserror::Error;
use xxhash_rust::xxh3::Xxh3Default;

/// Maximum size of a message on the wire, bytes.
pub const MAX_WIRE_BYTES: usize = 4096;

/// Reason for rejecting bytes.
#[derive(Debug, Error)]
pub enum WireError {
    /// Longer than any message.
    #[error("decoding {name}: {got} bytes, at most {MAX_WIRE_BYTES} are accepted")]
    Oversized {
        /// Message type.
        name: &'static str,
        /// Bytes received.
        got: usize,
    },
    /// The bytes cannot be decoded.
    #[error("decoding {name} from {got} bytes: {source}")]
    Malformed {
        /// Message type.
        name: &'static str,
        /// Bytes received.
        got: usize,
        /// Error of bincode.
        source: bincode::error::DecodeError,
    },
    /// Bytes remain after decoding.
    #[error("decoding {name}: {left} of {got} bytes left over")]
    Trailing {
        /// Message type.
        name: &'static str,
        /// Bytes received.
        got: usize,
        /// Number of remaining bytes.
        left: usize,
    },
    /// The message cannot be encoded.
    #[error("encoding {name}: {source}")]
    Encode {
        /// Message type.
        name: &'static str,
        /// Error of bincode.
        source: bincode::error::EncodeError,
    },
}

fn config() -> impl Config {
    bincode::config::standard()
        .with_little_endian()
        .with_fixed_int_encoding()
        .with_limit::<MAX_WIRE_BYTES>()
}

/// Maximum length of a record of a process's inputs or outputs: two images of 1920 x 1080 px.
pub const MAX_RECORD_BYTES: usize = 4 << 20;

fn record_config() -> impl Config {
    bincode::config::standard()
        .with_little_endian()
        .with_fixed_int_encoding()
        .with_limit::<MAX_RECORD_BYTES>()
}

/// Encodes a record for a local log, up to [`MAX_RECORD_BYTES`].
pub fn encode_record<T: Serialize>(record: &T) -> Result<Vec<u8>, WireError> {
    encode_with(record, record_config())
}

/// Decodes a log record; all bytes must be consumed.
pub fn decode_record<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, WireError> {
    decode_with(bytes, record_config(), MAX_RECORD_BYTES)
}

/// Hash of a value's record (XXH3); different records have the same hash with probability 1/2^64.
pub fn hash_record<T: Serialize>(record: &T) -> Result<u64, WireError> {
    let mut hash = Xxh3Default::new();
    append_record(&mut hash, record)?;
    Ok(hash.digest())
}

/// XXH3 of bytes.
pub fn hash_bytes(bytes: &[u8]) -> u64 {
    let mut hash = Xxh3Default::new();
    hash.update(bytes);
    hash.digest()
}

/// Appends a record to `to`, like [`encode_record`] but without an allocation.
pub fn append_record<T: Serialize>(to: &mut impl std::io::Write, record: &T) -> Result<(), WireError> {
    bincode::serde::encode_into_std_write(record, to, record_config())
        .map(|_| ())
        .map_err(|source| WireError::Encode {
            name: short_name::<T>(),
            source,
        })
}

/// Encodes a message as a radio payload.
pub fn encode<T: Serialize>(message: &T) -> Result<Vec<u8>, WireError> {
    encode_with(message, config())
}

/// Decodes a message; all bytes must be consumed.
pub fn decode<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, WireError> {
    decode_with(bytes, config(), MAX_WIRE_BYTES)
}

fn encode_with<T: Serialize>(message: &T, config: impl Config) -> Result<Vec<u8>, WireError> {
    bincode::serde::encode_to_vec(message, config).map_err(|source| WireError::Encode {
        name: short_name::<T>(),
        source,
    })
}

fn decode_with<T: DeserializeOwned>(bytes: &[u8], config: impl Config, most: usize) -> Result<T, WireError> {
    let name = short_name::<T>();
    let got = bytes.len();
    if got > most {
        return Err(WireError::Oversized { name, got });
    }
    let (message, used) = bincode::serde::decode_from_slice(bytes, config)
        .map_err(|source| WireError::Malformed { name, got, source })?;
    match got - used {
        0 => Ok(message),
        left => Err(WireError::Trailing { name, got, left }),
    }
}

fn short_name<T>() -> &'static str {
    let full = core::any::type_name::<T>();
    let head = full.split('<').next().unwrap_or(full);
    head.rsplit("::").next().unwrap_or(head)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        msg::{
            CourseAdvice, EstimateUpdate, PredictedStage, Seq, VesselEstimate, VesselPrediction, WaveMode,
            WaveModel, WaveSender, WaveUpdate, f16,
        },
        time::VesselClock,
    };

    fn estimate() -> VesselEstimate<VesselClock> {
        VesselEstimate {
            header: crate::msg::Header::new(1, 0, 7, 3, crate::time::Time::from_secs(1.5)),
            eta: [1.0, 2.0, 3.0, 0.1, 0.2, 0.3],
            eta_dot: [0.5; 6],
            eta_ddot: [f16::from_f32(0.25); 6],
            uncertainty: [[f16::ONE, f16::ONE, f16::ZERO]; 6],
            deck_centre: [0.0, 0.0, -1.3],
            ..VesselEstimate::default()
        }
    }

    #[test]
    fn estimate_within_300_bytes_round_trip() {
        let whole = EstimateUpdate::whole(&estimate());
        let bytes = encode(&whole).unwrap();
        // Size in the layout table of `alight_shared::msg::update`.
        assert_eq!(bytes.len(), 161);
        assert_eq!(bytes[12..16], 3u32.to_le_bytes(), "sequence");
        assert_eq!(bytes[26..30], 1.0f32.to_le_bytes(), "position north");
        assert_eq!(bytes[50..52], f16::from_f32(0.5).to_le_bytes(), "eta_dot north");
        assert_eq!(decode::<EstimateUpdate<VesselClock>>(&bytes).unwrap(), whole);
        let mut later = estimate();
        later.header.sequence += 1;
        assert_eq!(encode(&EstimateUpdate::of(&later)).unwrap().len(), 77);
    }

    #[test]
    fn wave_model_and_prediction_within_1200_bytes() {
        let waves = WaveModel::<VesselClock> {
            header: Default::default(),
            significant_height_m: 1.0,
            confidence: 1.0,
            modes: Seq::filled([WaveMode::default(); 12]),
            slopes: Seq::filled([10; 60]),
            advice: None,
        };
        let mut sender = WaveSender::default();
        assert_eq!(encode(&sender.update(&waves)).unwrap().len(), 63 + 12 * 32 + 60);
        let mut next = waves;
        next.header.sequence += 1;
        assert_eq!(encode(&sender.update(&next)).unwrap().len(), 63 + 12 * 4);
        let advised = WaveModel {
            advice: Some(CourseAdvice::default()),
            modes: Seq::filled([WaveMode::default(); 24]),
            ..waves
        };
        let longest = encode(&WaveUpdate::whole(&advised)).unwrap().len();
        assert_eq!(longest, 63 + 24 * 32 + 60 + 44);
        assert!(longest <= crate::topics::WAVE.bytes);
        let prediction = VesselPrediction::<VesselClock> {
            header: Default::default(),
            step_s: 0.2,
            origin: [0.0; 3],
            stages: Seq::filled([PredictedStage::default(); 16]),
        };
        assert_eq!(encode(&prediction).unwrap().len(), 62 + 16 * 54);
    }

    #[test]
    fn decoding_of_truncated_and_padded_bytes() {
        let mut bytes = encode(&estimate()).unwrap();
        assert!(decode::<VesselEstimate<VesselClock>>(&bytes[..bytes.len() - 1]).is_err());
        bytes.push(0);
        assert!(matches!(
            decode::<VesselEstimate<VesselClock>>(&bytes),
            Err(WireError::Trailing { left: 1, .. })
        ));
    }

    #[test]
    fn record_round_trip_and_hash() {
        let bytes = encode_record(&estimate()).unwrap();
        assert_eq!(
            decode_record::<VesselEstimate<VesselClock>>(&bytes).unwrap(),
            estimate()
        );
        let mut appended = vec![9];
        append_record(&mut appended, &estimate()).unwrap();
        assert_eq!((appended[0], &appended[1..]), (9, &bytes[..]));
        let hash = hash_record(&estimate()).unwrap();
        assert_eq!(hash, hash_record(&estimate()).unwrap());
        for dof in 0..6 {
            for bit in 0..64 {
                let mut other = estimate();
                other.eta[dof] = f64::from_bits(other.eta[dof].to_bits() ^ (1 << bit));
                assert_ne!(
                    hash_record(&other).unwrap(),
                    hash,
                    "degree of freedom {dof}, bit {bit}"
                );
            }
        }
    }
}
