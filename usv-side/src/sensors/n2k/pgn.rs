//! Fields of the supported parameter groups. Numbers, resolutions and signs are from canboat's NMEA 2000 database
//! (`docs/canboat.json`). An integer with all bits set means "not available", the two below it "out of range" and
//! "reserved".

use crate::sensors::bus::{Content, GnssReport};

/// Full turn plus one step, rad.
const TURN: f64 = core::f64::consts::TAU + 1e-4;

/// Manufacturer (11 bits), 2 reserved, and industry (3 bits) of Furuno's own messages: 1855, marine.
const FURUNO: u16 = 1855 | 3 << 11 | 4 << 13;

/// Claim of an address (ISO 11783-5), with the sender's NAME.
pub(super) const ADDRESS_CLAIM: u32 = 60_928;

/// Supported groups: number, name, and whether a message is longer than a frame.
const USED: [(u32, &str, bool); 10] = [
    (ADDRESS_CLAIM, "60928", false),
    (127_250, "127250", false),
    (127_251, "127251", false),
    (127_252, "127252", false),
    (127_257, "127257", false),
    (127_258, "127258", false),
    (129_025, "129025", false),
    (129_026, "129026", false),
    (129_029, "129029", true),
    (130_842, "130842", true),
];

pub(super) fn used(pgn: u32) -> Option<(&'static str, bool)> {
    let of = USED.iter().find(|(number, ..)| *number == pgn);
    of.map(|(_, name, long)| (*name, *long))
}

struct Fields<'a>(&'a [u8]);

impl Fields<'_> {
    fn bytes<const N: usize>(&self, at: usize) -> Option<[u8; N]> {
        self.0.get(at..at + N)?.try_into().ok()
    }
    fn u8(&self, at: usize) -> Option<u8> {
        self.0.get(at).copied()
    }
    fn u16(&self, at: usize) -> Option<f64> {
        let raw = u16::from_le_bytes(self.bytes(at)?);
        (raw < u16::MAX - 2).then_some(f64::from(raw))
    }
    fn i16(&self, at: usize) -> Option<f64> {
        let raw = i16::from_le_bytes(self.bytes(at)?);
        (raw < i16::MAX - 2).then_some(f64::from(raw))
    }
    fn i32(&self, at: usize) -> Option<f64> {
        let raw = i32::from_le_bytes(self.bytes(at)?);
        (raw < i32::MAX - 2).then_some(f64::from(raw))
    }
    fn i64(&self, at: usize) -> Option<f64> {
        let raw = i64::from_le_bytes(self.bytes(at)?);
        (raw < i64::MAX - 2).then_some(raw as f64)
    }
}

/// NAME in an address claim, 64 bits.
pub(super) fn claimed(data: &[u8]) -> Option<u64> {
    Fields(data).bytes(0).map(u64::from_le_bytes)
}

/// Whether this message reports an error of the device, and has no content.
pub(super) fn is_error(pgn: u32, data: &[u8]) -> bool {
    let reference = match pgn {
        127_250 => data.get(7),
        129_026 => data.get(1),
        _ => None,
    };
    reference.is_some_and(|b| b & 3 == 2)
}

/// Content of a supported message; None if its fields are not available.
pub(super) fn read(pgn: u32, data: &[u8]) -> Option<Content> {
    let f = Fields(data);
    /// Resolution of an angle, rad.
    const ANGLE: f64 = 1e-4;
    // Valid directions are from zero to a full turn.
    let direction = |at| f.u16(at).map(|x| x * ANGLE).filter(|x| *x <= TURN);
    // Reference: true or magnetic north; an invalid one makes the angle unusable.
    let magnetic = |at| match f.u8(at)? & 3 {
        0 => Some(false),
        1 => Some(true),
        _ => None,
    };
    Some(match pgn {
        127_250 => Content::Heading {
            heading: direction(1)?,
            deviation: f.i16(3).map(|x| x * ANGLE),
            variation: f.i16(5).map(|x| x * ANGLE),
            magnetic: magnetic(7)?,
        },
        127_251 => Content::Rate(f.i32(1)? * 1e-6 / 32.0),
        127_252 => Content::Heave(f.i16(1)? * 0.01),
        127_257 => Content::Attitude([f.i16(5)? * ANGLE, f.i16(3)? * ANGLE]),
        127_258 => Content::Variation(f.i16(4)? * ANGLE),
        129_025 => Content::Position([f.i32(0)? * 1e-7, f.i32(4)? * 1e-7]),
        129_026 => Content::velocity(f.u16(4)? * 0.01, direction(2).zip(magnetic(1)))?,
        129_029 => Content::Gnss(GnssReport {
            place: [f.i64(7)? * 1e-16, f.i64(15)? * 1e-16],
            altitude_m: f.i64(23).map(|x| x * 1e-6),
            quality: f.u8(31)? >> 4,
            // A receiver without a dilution sends zero.
            hdop: f.i16(34).filter(|x| *x > 0.0).map(|x| x * 0.01),
            // 0: not checked, 1: safe, 2: caution, 3: not available.
            caution: f.u8(32).is_some_and(|b| b & 3 == 2),
            separation_m: f.i32(38).map(|x| x * 0.01),
        }),
        // Furuno's satellite compasses: angular rates in steps of 0.001 deg/s, and unknown fields. Other
        // makers use this number differently.
        130_842 => {
            let own = f.bytes(0).map(u16::from_le_bytes) == Some(FURUNO);
            let rate = |at| f.i32(at).map(|x| (x * 1e-3).to_radians()).filter(|_| own);
            Content::Rates([rate(15)?, rate(19)?, rate(23)?])
        }
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn n2k_fields_of_published_examples() {
        let Some(Content::Position([latitude, longitude])) =
            read(129_025, &[0xa0, 0x7d, 0xe6, 0x18, 0xc0, 0x05, 0xfb, 0xd5])
        else {
            panic!()
        };
        assert!(
            (latitude - 41.775_862_4).abs() < 1e-7 && (longitude + 70.496_928_0).abs() < 1e-7,
            "{latitude} {longitude}"
        );
        let attitude = read(127_257, &[0x00, 0xff, 0x7f, 0x52, 0x00, 0x21, 0xfe, 0xff]);
        assert_eq!(attitude, Some(Content::Attitude([-479.0 * 1e-4, 82.0 * 1e-4])));
        // Not available: the maximum of a signed or unsigned field.
        for (pgn, data) in [
            (127_250, [0, 0xff, 0xff, 0, 0, 0, 0, 0]),
            (127_251, [0, 0xff, 0xff, 0xff, 0x7f, 0, 0, 0]),
            (127_252, [0, 0xff, 0x7f, 0, 0, 0, 0, 0]),
            (127_257, [0, 0, 0, 0xff, 0x7f, 0, 0, 0]),
            (127_258, [0, 0, 0, 0, 0xff, 0x7f, 0, 0]),
            (129_025, [0, 0, 0, 0, 0xff, 0xff, 0xff, 0x7f]),
            (129_026, [0, 0, 0, 0, 0xff, 0xff, 0, 0]),
            (129_026, [0, 0, 0xff, 0xff, 0x64, 0, 0, 0]),
            (127_250, [0, 0x10, 0x27, 0, 0, 0, 0, 0xff]),
            (127_250, [0, 0x00, 0xfa, 0, 0, 0, 0, 0xfc]),
            (127_251, [0, 0xfe, 0xff, 0xff, 0x7f, 0, 0, 0]),
            (127_252, [0, 0xfe, 0x7f, 0, 0, 0, 0, 0]),
            (127_257, [0, 0, 0, 0xfe, 0x7f, 0, 0, 0]),
            (129_025, [0xff, 0xff, 0xff, 0x7f, 0, 0, 0, 0]),
            (127_250, [0, 0x10, 0x27, 0, 0, 0, 0, 0xfe]),
        ] {
            assert_eq!(read(pgn, &data), None, "{pgn}");
            assert_eq!(read(pgn, &[0; 2]), None, "{pgn}");
        }
        assert_eq!(read(129_029, &[0xff; 30]), None);
        // Messages of Furuno and Simrad with one number.
        let mut rates = [0; 29];
        rates[..2].copy_from_slice(&[0x3f, 0x9f]);
        rates[23..27].copy_from_slice(&(-1000_i32).to_le_bytes());
        let yaw = (-1.0_f64).to_radians();
        assert_eq!(read(130_842, &rates), Some(Content::Rates([0.0, 0.0, yaw])));
        rates[0] = 0x41;
        assert_eq!(read(130_842, &rates), None);
        // A vessel at rest, and a slow vessel with a course.
        let velocity = |course, speed| {
            Some(Content::Velocity {
                course,
                speed,
                magnetic: false,
            })
        };
        assert_eq!(
            read(129_026, &[0, 0xff, 0xff, 0xff, 5, 0, 0xff, 0xff]),
            velocity(0.0, 0.0)
        );
        assert_eq!(
            read(129_026, &[0, 0xfc, 0x10, 0x27, 20, 0, 0xff, 0xff]),
            velocity(1.0, 0.2)
        );
    }
}
