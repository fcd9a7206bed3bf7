//! Detection of other formats among sentences, so that the crew learns what the source sends.

use super::{
    account::{JSON, Why},
    shape::has_angles,
};
use crate::sensors::n2k::is_line;

const N2K: &str = "set format = \"n2k\" for this source";
const SIGNAL_K: &str = "set format = \"signalk\" for this source";
pub(super) const UBX: &str =
    "set format = \"ubx\" for this source, or switch UBX off at this port of the receiver";
/// Length of TSS1, which starts with a colon.
const TSS1: core::ops::RangeInclusive<usize> = 22..=27;
/// Maximum length of a skipped UBX message, bytes, and number of bytes around its payload.
const MAX_UBX: usize = 2048;
const HEAD: usize = 6;
const CHECKSUM: usize = 2;

/// Name of a line of another format, and the remedy.
pub(super) fn line(text: &str) -> Option<(&str, Why)> {
    let text = text.trim();
    Some(match text.as_bytes().first()? {
        b':' if TSS1.contains(&text.len()) => ("TSS1", not_read("TSS1")),
        b'#' | b'%' => {
            let (name, _) = text.get(1..)?.split_once(',').filter(|_| text.contains(';'))?;
            (name, not_read(name))
        }
        b'{' if text.contains("\"pgn\"") => ("canboat-JSON", Why::Foreign(JSON)),
        b'{' if text.contains("\"updates\"") => ("Signal-K", Why::Foreign(SIGNAL_K)),
        _ if !text.contains(['$', '!']) && is_line(text) => ("NMEA-2000", Why::Foreign(N2K)),
        _ => return None,
    })
}
/// Name of an unsupported sentence; a proprietary one includes a name in its first field.
pub(super) fn name(address: &str, fields: &[&str]) -> String {
    let own = fields
        .first()
        .filter(|f| f.starts_with(|c: char| c.is_ascii_alphabetic()));
    match own.filter(|_| address.starts_with('P')) {
        Some(own) => format!("{address}-{own}"),
        None => address.into(),
    }
}
/// Reason why an unsupported kind is not used.
pub(super) fn not_read(name: &str) -> Why {
    if has_angles(name) {
        Why::Angles
    } else {
        Why::NotRead
    }
}

/// Skips UBX messages among sentences: 0xb5, 0x62, class, number, length, payload, checksum.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct UbxSkip {
    count: usize,
    length: usize,
}

impl UbxSkip {
    pub(super) fn is_inside(&mut self, byte: u8) -> bool {
        let is_it = match (self.count, byte) {
            (0, 0xb5) | (1, 0x62) => true,
            (0 | 1, _) => false,
            (4, low) => {
                self.length = usize::from(low);
                true
            }
            (5, high) => {
                self.length |= usize::from(high) << 8;
                self.length <= MAX_UBX
            }
            _ => true,
        };
        self.count = if is_it { self.count + 1 } else { 0 };
        if self.count > HEAD && self.count >= HEAD + self.length + CHECKSUM {
            self.count = 0;
        }
        is_it
    }
    /// Whether the newest byte was the second of a message.
    pub(super) fn begins(&self) -> bool {
        self.count == 2
    }
}
