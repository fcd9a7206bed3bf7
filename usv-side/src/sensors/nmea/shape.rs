//! Number of fields of each kind of sentence. A truncated sentence has fewer, one with decimal commas has more.

use nmea_kit::NmeaFrame;

use super::account::Why;

/// Minimum and maximum number of fields of a sentence.
const FIELDS: [(&str, usize, usize); 14] = [
    ("GGA", 14, 14),
    ("GNS", 12, 13),
    ("RMC", 11, 13),
    ("GLL", 6, 7),
    ("VTG", 8, 9),
    ("HDT", 2, 2),
    ("HDM", 0, 2),
    ("THS", 0, 2),
    ("HDG", 5, 5),
    ("ROT", 2, 2),
    ("ZDA", 6, 6),
    ("PASHR", 0, 11),
    ("PRDID", 0, 3),
    ("HPR", 0, 8),
];
/// First field and number of fields of Seatex's sentence.
const PSXN: (&str, usize) = ("23", 5);
const XDR: usize = 4;
/// Unsupported kinds with an attitude or a heading: Hemisphere, Furuno, Septentrio, ComNav, Kongsberg, Unicore.
const ANGLES: [&str; 11] = [
    "PSAT-HPR",
    "PSAT-INTLT",
    "PFEC-GPATT",
    "PFEC-GPHVE",
    "PSSN-HRP",
    "KSXT",
    "PHTRO",
    "PHINF",
    "TSS1",
    "UNIHEADINGA",
    "INSPVAXA",
];

pub(super) fn has_angles(name: &str) -> bool {
    ANGLES.iter().any(|known| known.eq_ignore_ascii_case(name))
}
/// Whether a sentence without a checksum has all fields, if their number is known.
pub(super) fn is_whole(frame: &NmeaFrame<'_>) -> bool {
    let known = FIELDS.iter().find(|(kind, ..)| *kind == frame.sentence_type);
    known.is_none_or(|(_, min, _)| frame.fields.len() >= *min)
}
/// Checks that a sentence has no more fields than its kind, except empty ones at the end.
pub(super) fn is_shifted(frame: &NmeaFrame<'_>) -> Result<(), Why> {
    let (kind, fields) = (frame.sentence_type, &frame.fields);
    let count = fields.iter().rposition(|f| !f.is_empty()).map_or(0, |k| k + 1);
    let of_kind = FIELDS.iter().find(|known| known.0 == kind).map(|known| known.2);
    let known = match kind {
        "PSXN" if fields.first() == Some(&PSXN.0) => Some(PSXN.1),
        // Groups are complete; an empty name may follow.
        "XDR" => (count % XDR != 0 && !(fields.len().is_multiple_of(XDR) && count + 1 == fields.len()))
            .then_some(count / XDR * XDR),
        _ => of_kind,
    };
    match known.filter(|known| count > *known) {
        Some(known) => Err(Why::Fields(count.min(255) as u8, known as u8)),
        None => Ok(()),
    }
}
