//! Recordings of networks and serial lines, decoded as in live operation: NMEA 2000 text and Signal K deltas,
//! one message per line; UBX and MAVLink as received.

use std::borrow::Cow;

use alight_shared::time::Time;

use super::{Gather, LogError, SensorRecording, wrapping::Peeled};
use crate::sensors::{Format, Mount, Mounting, SensorDecoder, SourceMeasurement};

/// Number of lines inspected, and minimum number of valid messages in them.
const LOOKED_AT: usize = 40;
const ENOUGH: u64 = 5;
const CHUNK: usize = 512;
/// Length of the time before each packet of a telemetry log (tlog), bytes: microseconds since 1970, big endian.
const STAMP_BYTES: usize = 8;
/// Plausible times, 2001 to 2286, us.
const STAMPS: core::ops::Range<u64> = 1_000_000_000_000_000..10_000_000_000_000_000;

/// Formats with one message per line, and byte streams; NMEA 0183 has its own detection ([`super::sentences`]).
pub(super) const LINES: [Format; 2] = [Format::N2k, Format::SignalK];
pub(super) const STREAMS: [Format; 2] = [Format::Ubx, Format::Mavlink];

/// Format among `these` of a file that begins with `head`.
pub(super) fn format(these: &[Format], head: &[u8]) -> Option<Format> {
    these.iter().copied().find(|format| begins(*format, head))
}
fn begins(format: Format, head: &[u8]) -> bool {
    let mut decoder = format.decoder(&Mounting::default(), 0);
    let most = if has_lines(format) { LOOKED_AT } else { usize::MAX };
    for piece in pieces(format, head).take(most) {
        decoder.push(&piece.content, &mut Vec::new());
    }
    let found = decoder.decoded();
    // A MAVLink decoder drops messages of other systems.
    let others = if format == Format::Mavlink {
        found.left_out
    } else {
        0
    };
    let messages = found.good + found.ignored + others;
    messages >= ENOUGH && messages > found.corrupted
}
fn has_lines(format: Format) -> bool {
    format == Format::Nmea || LINES.contains(&format)
}
/// Pieces of the file: lines without their logger's wrapping, packets, or chunks.
fn pieces(format: Format, bytes: &[u8]) -> Box<dyn Iterator<Item = Peeled<'_>> + '_> {
    let whole = |content| Peeled {
        arrival_ns: None,
        content: Cow::Borrowed(content),
    };
    if has_lines(format) {
        Box::new(bytes.split_inclusive(|b| *b == b'\n').map(Peeled::of))
    } else if format == Format::Mavlink && stamped(bytes).is_some() {
        Box::new(packets(bytes).map(whole))
    } else {
        Box::new(bytes.chunks(CHUNK).map(whole))
    }
}

/// Decodes the bytes as the sensor node does; `each` observes every piece.
pub(super) fn play<D: SensorDecoder + ?Sized>(
    format: Format,
    bytes: &[u8],
    decoder: &mut D,
    mut each: impl FnMut(&[u8], &D),
) -> Gather {
    let mut gather = Gather::default();
    let mut decoded = Vec::new();
    // Only a MAVLink decoder numbers its sensors: those of one autopilot.
    let source = |m: &SourceMeasurement| {
        if format == Format::Mavlink {
            m.measurement.source()
        } else {
            0
        }
    };
    for piece in pieces(format, bytes) {
        // A delta carries the time of its update, and a sentence that of its epoch.
        let arrival_ns = piece.arrival_ns.filter(|_| format == Format::N2k);
        if let Some(at_ns) = arrival_ns {
            decoder.arrive(Time::from_nanos(at_ns));
        }
        decoder.push(&piece.content, &mut decoded);
        each(&piece.content, decoder);
        let own = decoder.timeless().into_iter().zip(arrival_ns.into_iter().cycle());
        decoded.extend(own.map(|(m, at_ns)| SourceMeasurement::new(at_ns, m)));
        for m in decoded.drain(..) {
            gather.push(m, source(&m));
        }
    }
    decoder.finish(&mut decoded);
    for m in decoded.drain(..) {
        gather.push(m, source(&m));
    }
    gather
}

pub(super) fn read(
    format: Format,
    bytes: &[u8],
    origin: &str,
    mount: &Mount,
) -> Result<SensorRecording, LogError> {
    let mut decoder = format.decoder(&Mounting::new(mount), 0);
    let gather = play(format, bytes, &mut *decoder, |_, _| {});
    let count = decoder.decoded();
    let (name, messages, others) = match format {
        Format::N2k => ("NMEA 2000", "messages", "groups"),
        Format::SignalK => ("Signal K", "values", "paths or vessels"),
        Format::Ubx => ("UBX", "messages", "kinds"),
        Format::Nmea | Format::Mavlink | Format::Rtcm => ("MAVLink", "messages", "kinds"),
    };
    let damaged = if has_lines(format) { "lines" } else { "messages" };
    let mut found = format!(
        "{} {messages} that are used, {} of other {others}, {} damaged {damaged}",
        count.good, count.ignored, count.corrupted
    );
    if let (Format::N2k | Format::SignalK, 1..) = (format, count.undated) {
        let remedy = if format == Format::N2k {
            "record with candump -L"
        } else {
            "record the server's timestamps"
        };
        found += &format!("; {} have no time: {remedy}", count.undated);
    }
    if format == Format::Mavlink && gather.missing().contains("no roll and pitch") {
        found += "; ATTITUDE is read by `python -m alight.convert FILE`, which writes a CSV";
    }
    gather.recording(origin, name, &found, count, decoder.remarks())
}

/// Length of the MAVLink packet at the start (mavlink.io, "Packet Serialization"), bytes.
fn packet_bytes(bytes: &[u8]) -> Option<usize> {
    match *bytes {
        [0xfe, payload, ..] => Some(8 + usize::from(payload)),
        [0xfd, payload, flags, ..] => Some(12 + usize::from(payload) + 13 * usize::from(flags & 1)),
        _ => None,
    }
}

/// Length of the packet after the time stamp of a telemetry log, bytes.
fn stamped(bytes: &[u8]) -> Option<usize> {
    let (stamp, rest) = bytes.split_first_chunk::<STAMP_BYTES>()?;
    packet_bytes(rest).filter(|_| STAMPS.contains(&u64::from_be_bytes(*stamp)))
}

/// Packets of a telemetry log without their times; other bytes one by one.
fn packets(bytes: &[u8]) -> impl Iterator<Item = &[u8]> {
    let mut rest = bytes;
    core::iter::from_fn(move || {
        let (skipped, length) = stamped(rest).map_or((0, 1), |length| (STAMP_BYTES, length));
        let from = rest.get(skipped..).filter(|from| !from.is_empty())?;
        let (piece, behind) = from.split_at(length.min(from.len()));
        rest = behind;
        Some(piece)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::mavlink::{self, MavlinkSender, dialect as m};

    #[test]
    fn n2k_recording_of_a_gateway() {
        // Attitude at 10 Hz, a position each second, and wind, which is not read.
        let mut text = String::new();
        for k in 0..300 {
            let at = format!("12:00:{:06.3}", 0.1 * f64::from(k));
            text += &format!("{at} R 09F11923 FF FF 7F 52 00 21 FE FF\r\n");
            if k % 10 == 0 {
                text += &format!("{at} R 09F80115 A0 7D E6 18 C0 05 FB D5\r\n");
                text += &format!("{at} R 09FD0223 FF 64 00 10 27 FA FF FF\r\n");
            }
        }
        let r = crate::log::read(text.as_bytes(), "boat.txt", &Mount::default()).unwrap();
        assert_eq!(
            (r.format, r.decoded.good, r.decoded.ignored),
            ("NMEA 2000", 330, 30)
        );
        assert_eq!(r.measurements.len(), 330);
        let notes = r.notes.join("\n");
        assert!(
            notes.contains("no heading") && notes.contains("30 130306"),
            "{notes}"
        );
    }

    #[test]
    fn n2k_recording_in_a_raw_log_and_in_quotes() {
        let frame = "09F11923 FF FF 7F 52 00 21 FE FF";
        let timeless = "can0  09F11923   [8]  FF FF 7F 52 00 21 FE FF";
        let mut texts = [String::new(), String::new(), String::new()];
        for k in 0..300_u64 {
            let line = format!("12:00:{:02}.{} R {frame}", k / 10, k % 10);
            let [raw, quoted, by_arrival] = &mut texts;
            *raw += &format!("{};A;{line}\n", 1_779_278_400_000 + 100 * k);
            *quoted += &format!("{k},\"{line}\",3\n");
            *by_arrival += &format!("{};A;{timeless}\n", 1_779_278_400_000 + 100 * k);
        }
        for text in texts {
            let r = crate::log::read(text.as_bytes(), "boat.log", &Mount::default()).unwrap();
            assert_eq!(
                (
                    r.format,
                    r.decoded.good,
                    r.decoded.corrupted,
                    r.measurements.len()
                ),
                ("NMEA 2000", 300, 0, 300),
                "{text:.80}"
            );
            let last = r.measurements.last().map(|m| m.at().secs()).unwrap_or_default();
            assert!((last - 29.9).abs() < 0.1, "{last}");
        }
    }

    #[test]
    fn signalk_recording_with_a_loggers_prefix() {
        let mut text = String::from(
            "{\"name\":\"signalk-server\",\"self\":\"urn:mrn:imo:mmsi:1\",\"version\":\"2.8.0\"}\n",
        );
        for k in 0..300 {
            let at = format!("2026-05-20T12:00:{:06.3}Z", 0.1 * f64::from(k));
            text += &format!(
                "1779278400000;I;{{\"updates\":[{{\"$source\":\"n2k.5\",\"timestamp\":\"{at}\",\"values\":[\
                 {{\"path\":\"navigation.attitude\",\"value\":{{\"roll\":0.1,\"pitch\":0.0,\"yaw\":0.0}}}},\
                 {{\"path\":\"environment.wind.speedApparent\",\"value\":7.0}}]}}]}}\n"
            );
        }
        let r = crate::log::read(text.as_bytes(), "boat.log", &Mount::default()).unwrap();
        assert_eq!(
            (r.format, r.decoded.good, r.decoded.ignored, r.measurements.len()),
            ("Signal K", 300, 300, 299)
        );
        let notes = r.notes.join("\n");
        assert!(
            notes.contains("no position, no heading") && notes.contains("300 speedApparent"),
            "{notes}"
        );
    }

    /// A boat's autopilot: attitudes and heartbeats at 10 Hz for 20 s, one per packet.
    fn autopilot() -> Vec<Vec<u8>> {
        let encoded = |k: u32, message: &m::MavMessage| {
            let from = MavlinkSender {
                system: 1,
                component: 1,
                sequence: k as u8,
            };
            mavlink::encode(from, message, None)
        };
        let heartbeat = m::MavMessage::HEARTBEAT(m::HEARTBEAT_DATA {
            mavtype: m::MavType::MAV_TYPE_SURFACE_BOAT,
            autopilot: m::MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA,
            ..m::HEARTBEAT_DATA::DEFAULT
        });
        let attitude = |k: u32| {
            m::MavMessage::ATTITUDE_QUATERNION(m::ATTITUDE_QUATERNION_DATA {
                time_boot_ms: 5000 + 100 * k,
                q1: 1.0,
                ..m::ATTITUDE_QUATERNION_DATA::DEFAULT
            })
        };
        let first = core::iter::once(encoded(0, &heartbeat));
        first
            .chain((0..200).map(|k| encoded(k + 1, &attitude(k))))
            .collect()
    }

    #[test]
    fn mavlink_stream_and_telemetry_log() {
        let packets = autopilot();
        let stamp = |k: usize| (1_779_278_400_000_000 + 100_000 * k as u64).to_be_bytes();
        let stamped = packets
            .iter()
            .enumerate()
            .map(|(k, p)| [&stamp(k)[..], p].concat());
        for bytes in [packets.concat(), stamped.collect::<Vec<_>>().concat()] {
            let r = crate::log::read(&bytes, "boat.tlog", &Mount::default()).unwrap();
            assert_eq!(
                (r.format, r.decoded.good, r.decoded.corrupted),
                ("MAVLink", 200, 0),
                "{:?}",
                r.notes
            );
            let tilts = r.measurements.iter().filter(|m| m.kind() == 3).count();
            let last = r.measurements.last().map(|m| m.at().secs()).unwrap_or_default();
            assert!(tilts == 200 && (last - 19.9).abs() < 0.2, "{tilts} {last}");
        }
    }

    #[test]
    fn ubx_recording_of_a_receiver() {
        let bytes: Vec<u8> = (0..100).flat_map(crate::fixtures::nav_pvt).collect();
        let r = crate::log::read(&bytes, "boat.ubx", &Mount::default()).unwrap();
        assert_eq!(
            (r.format, r.decoded.good, r.measurements.len()),
            ("UBX", 100, 100)
        );
        assert!(r.notes.join("\n").contains("no roll and pitch"), "{:?}", r.notes);
    }
}
