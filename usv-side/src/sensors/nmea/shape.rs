//! Number of fields of each kind of sentence. A truncated sentence has fewer, one with decimal commas has more.

use nmea_kit::NmeaFrame;

use super::account::Why;

/// Minimum and maximum number of fields of a sentence.
const FIELDS: [(&str, usize, usize); 15] = [
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
    ("PTNTHPR", 0, 6),
];
/// Fields with a letter: units, hemispheres and modes. A number there belongs to another field.
const LETTERS: [(&str, usize); 10] = [
    ("GGA", 9),
    ("GGA", 11),
    ("GNS", 12),
    ("RMC", 3),
    ("RMC", 5),
    ("GLL", 1),
    ("GLL", 3),
    ("HDG", 2),
    ("HDG", 4),
    ("ROT", 1),
];
/// First field and number of fields of Seatex's sentence.
const PSXN: (&str, usize) = ("23", 5);
const AVR: (&str, usize) = ("AVR", 12);
const XDR: usize = 4;
/// Unsupported kinds with an attitude or a heading: Hemisphere, Furuno, Septentrio, ComNav, Kongsberg, Unicore, NovAtel,
/// Ashtech, iXblue.
const ANGLES: [&str; 17] = [
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
    "INSPVAA",
    "INSATTA",
    "HEADINGA",
    "PASHR-ATT",
    "PIXSE-ATITUD",
    "GPTRA",
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
        "PTNL" if fields.first() == Some(&AVR.0) => Some(AVR.1),
        // Groups are complete; an empty name may follow.
        "XDR" => (count % XDR != 0 && !(fields.len().is_multiple_of(XDR) && count + 1 == fields.len()))
            .then_some(count / XDR * XDR),
        _ => of_kind,
    };
    let is_number = |at: usize| {
        fields
            .get(at)
            .is_some_and(|f| f.starts_with(|c: char| c.is_ascii_digit()))
    };
    match known.filter(|known| count > *known) {
        Some(known) => Err(Why::Fields(count.min(255) as u8, known as u8)),
        None if LETTERS.iter().any(|(of, at)| *of == kind && is_number(*at)) => Err(Why::Shifted),
        None => Ok(()),
    }
}
