//! Signing of MAVLink 2 frames (<https://mavlink.io/en/guide/message_signing.html>): one key, and monotonic timestamps.

use core::fmt;
use std::sync::{Arc, Mutex, PoisonError};

use ::mavlink::{MAVLinkMessageRaw, MAVLinkV2MessageRaw};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::msg::Seq;

/// `RADIO_STATUS`: telemetry radios insert it unsigned into a signed link.
const RADIO_STATUS: u32 = 109;
/// Incompatibility flag of a signed frame.
const SIGNED: u8 = 1;

/// Maximum lag of a new stream's first frame behind the latest time, in units of 10 us: one minute.
const NEW_STREAM: u64 = 60 * 100_000;
/// Maximum number of streams with stored times; a new one replaces the oldest.
pub const MAX_STREAMS: usize = 16;

/// Newest timestamp in a stream of signed frames.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct StreamTime {
    /// Link, component and system of the sender.
    pub from: [u32; 3],
    /// Timestamp, 10 us since 2015.
    pub newest: u64,
}

/// Timestamps of a signed link, saved for the next start so that earlier frames stay rejected.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct SigningTimes {
    /// Latest timestamp of all, including our own, 10 us since 2015.
    pub latest: u64,
    /// Newest timestamp of each stream.
    pub streams: Seq<StreamTime, MAX_STREAMS>,
}

impl SigningTimes {
    /// Returns whether a frame of this stream is newer than its predecessors, and stores its time.
    fn admit(&mut self, from: [u32; 3], at: u64) -> bool {
        let known = self.streams.iter_mut().find(|s| s.from == from);
        let later = match &known {
            Some(stream) => at > stream.newest,
            None => at.saturating_add(NEW_STREAM) >= self.latest,
        };
        if !later {
            return false;
        }
        self.latest = self.latest.max(at);
        if let Some(stream) = known {
            stream.newest = at;
        } else {
            let oldest = self.streams.iter().map(|s| s.newest).min().unwrap_or(0);
            let kept = self.streams.iter().copied();
            let full = self.streams.len() == MAX_STREAMS;
            let kept = kept.filter(|s| !full || s.newest != oldest);
            self.streams = Seq::filled(kept.chain([StreamTime { from, newest: at }]));
        }
        true
    }
}

/// Signing of MAVLink 2 frames with one key. Our frames are signed; received ones must be signed with the key
/// and newer than their predecessors. Timestamps are the later of this computer's time and the latest
/// received, so that an autopilot accepts them even if this computer's clock is behind.
#[derive(Clone)]
pub struct Signing {
    key: [u8; 32],
    times: Arc<Mutex<SigningTimes>>,
    clock: fn() -> u64,
    any_time: bool,
}

impl fmt::Debug for Signing {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Signing")
    }
}

impl Signing {
    /// Signing with this key, using the timestamps of received frames as the only clock.
    pub fn new(key: [u8; 32]) -> Signing {
        Signing::with_clock(key, || 0)
    }
    /// Signing with this key and the computer's time, 10 us since 2015.
    pub fn with_clock(key: [u8; 32], clock: fn() -> u64) -> Signing {
        Signing {
            key,
            times: Arc::default(),
            clock,
            any_time: false,
        }
    }
    /// Signing with this key at any timestamp, for an autopilot that learns the time from our replies.
    #[must_use]
    pub fn at_any_time(&self) -> Signing {
        Signing {
            any_time: true,
            ..self.clone()
        }
    }
    /// Timestamps to save for the next start.
    pub fn times(&self) -> SigningTimes {
        *self.times.lock().unwrap_or_else(PoisonError::into_inner)
    }
    /// Merges the timestamps saved by the previous run.
    pub fn recall(&self, before: &SigningTimes) {
        let mut times = self.times.lock().unwrap_or_else(PoisonError::into_inner);
        times.latest = times.latest.max(before.latest);
        for stream in before.streams.iter() {
            match times.streams.iter_mut().find(|s| s.from == stream.from) {
                Some(known) => known.newest = known.newest.max(stream.newest),
                // The list is full only if that many new streams have appeared since the start.
                None => drop(times.streams.push(*stream)),
            }
        }
    }
    /// Whether the frame was signed with the key, at any time.
    fn is_signature(&self, frame: &MAVLinkV2MessageRaw) -> bool {
        let mut signature = [0; 6];
        frame.calculate_signature(&self.key, &mut signature);
        frame.signature_value() == signature
    }
    fn is_later(&self, frame: &MAVLinkV2MessageRaw) -> bool {
        let from = [
            frame.signature_link_id().into(),
            frame.component_id().into(),
            frame.system_id(),
        ];
        let mut times = self.times.lock().unwrap_or_else(PoisonError::into_inner);
        times.latest = times.latest.max((self.clock)());
        times.admit(from, frame.signature_timestamp())
    }
    pub(super) fn sign(&self, frame: &mut MAVLinkV2MessageRaw) {
        let mut times = self.times.lock().unwrap_or_else(PoisonError::into_inner);
        times.latest = times.latest.max((self.clock)());
        let bytes = times.latest.to_le_bytes();
        for (to, byte) in frame.signature_timestamp_bytes_mut().iter_mut().zip(bytes) {
            *to = byte;
        }
        times.latest += 1;
        *frame.signature_link_id_mut() = 0;
        let mut signature = [0; 6];
        frame.calculate_signature(&self.key, &mut signature);
        frame.signature_value_mut().copy_from_slice(&signature);
    }
}

/// Counts of frames by signature.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Signatures {
    /// Unsigned frames rejected while a key is set.
    pub unsigned: u64,
    /// Frames rejected because of another key.
    pub other_key: u64,
    /// Frames rejected because their timestamp was repeated or lies more than a minute before our time.
    pub old: u64,
    /// Frames accepted without a signature check because no key is set.
    pub unchecked: u64,
}

impl Signatures {
    /// Sums each count.
    #[must_use]
    pub fn plus(self, other: Signatures) -> Signatures {
        Signatures {
            unsigned: self.unsigned + other.unsigned,
            other_key: self.other_key + other.other_key,
            old: self.old + other.old,
            unchecked: self.unchecked + other.unchecked,
        }
    }
    /// Fault of the link's signatures, and its remedy; None if they are as configured. If frames are
    /// `admitted`, the rejected ones came from other senders or from before the autopilot had the key.
    pub fn finding(&self, admitted: bool) -> Option<(String, &'static str)> {
        let left_out = |count| if admitted { 0 } else { count };
        let [other_key, old, unsigned] = [self.other_key, self.old, self.unsigned].map(left_out);
        let (count, found, remedy) = if other_key > 0 {
            (
                other_key,
                "rejected: signed with another key than signing_key's",
                "give the autopilot and signing_key's file the same passphrase",
            )
        } else if old > 0 {
            (
                old,
                "rejected: repeated timestamp, or one over a minute before our time",
                "set this computer's clock, and let the autopilot have a GNSS fix",
            )
        } else if unsigned > 0 {
            (
                unsigned,
                "rejected: not signed, as signing_key requires",
                "set up signing at the autopilot for this link (ArduPilot; PX4 had none in March 2026), or leave signing_key empty",
            )
        } else {
            (
                self.unchecked,
                "signed, but neither checked nor answered with a signature",
                "set signing_key to a file with the autopilot's passphrase",
            )
        };
        (count > 0).then(|| (format!("{count} MAVLink frames {found}"), remedy))
    }
    /// Whether this frame is accepted; `whenever` accepts any timestamp.
    pub(super) fn admit(
        &mut self,
        raw: &MAVLinkMessageRaw,
        signing: Option<&Signing>,
        whenever: impl FnOnce() -> bool,
    ) -> bool {
        let signed = match raw {
            MAVLinkMessageRaw::V1(_) => None,
            MAVLinkMessageRaw::V2(frame) => Some(frame).filter(|f| f.incompatibility_flags() & SIGNED != 0),
        };
        let (count, taken) = match (signing, signed) {
            (None, None) => return true,
            (None, Some(_)) => (&mut self.unchecked, true),
            (Some(_), None) if raw.message_id() == RADIO_STATUS => return true,
            (Some(_), None) => (&mut self.unsigned, false),
            (Some(s), Some(frame)) if !s.is_signature(frame) => (&mut self.other_key, false),
            (Some(s), Some(frame)) if !s.any_time && !s.is_later(frame) && !whenever() => {
                (&mut self.old, false)
            }
            (Some(_), Some(_)) => return true,
        };
        *count += 1;
        taken
    }
}

#[cfg(test)]
mod tests {
    use super::{
        super::{Bytes, FrameReader, MavlinkSender, Outgoing, dialect::MavMessage, encode},
        *,
    };

    const SENDER: MavlinkSender = MavlinkSender {
        system: 1,
        component: 1,
        sequence: 7,
    };

    fn heartbeat(signing: Option<&Signing>) -> Vec<u8> {
        encode(
            SENDER,
            Outgoing::new(0, 50, vec![3, 0, 0, 0, 2, 12, 81, 4, 3]),
            signing,
        )
    }
    /// Frames accepted on a link with this key, and counts of the others.
    fn taken(signing: Option<Signing>, frames: &[Vec<u8>]) -> (usize, Signatures) {
        let mut reader = FrameReader::signed(signing);
        for bytes in frames {
            reader.push(bytes);
        }
        let taken = core::iter::from_fn(|| reader.next_frame()).count();
        (taken, reader.signatures())
    }

    #[test]
    fn frames_by_their_signatures() {
        let [ours, other] = [[1; 32], [2; 32]].map(Signing::new);
        let [signed, later] = [(); 2].map(|()| heartbeat(Some(&ours)));
        let mut changed = heartbeat(Some(&ours));
        *changed.last_mut().unwrap() ^= 1;
        let frames = [
            signed.clone(),
            later,
            signed,
            heartbeat(None),
            heartbeat(Some(&other)),
            changed,
        ];
        let counts = Signatures {
            unsigned: 1,
            other_key: 2,
            old: 1,
            unchecked: 0,
        };
        assert_eq!(taken(Some(Signing::new([1; 32])), &frames), (2, counts));
        let unchecked = Signatures {
            unchecked: 5,
            ..Signatures::default()
        };
        assert_eq!(taken(None, &frames), (6, unchecked));
    }

    #[test]
    fn status_of_a_radio_in_a_signed_link() {
        let status = encode(SENDER, Outgoing::new(RADIO_STATUS, 185, vec![1; 9]), None);
        assert_eq!(taken(Some(Signing::new([1; 32])), &[status]).0, 1);
    }

    /// Independent computation from the specification: first six bytes of the SHA-256 of key, frame, link and timestamp.
    #[test]
    fn signature_by_the_specification() {
        let frame = "fd 09 01 00 00 01 01 00 00 00 03 00 00 00 02 0c 51 04 03 95 f8 00 00 00 00 00 00 80 b3 8d 25 8d 8d ca";
        let frame = frame
            .split(' ')
            .map(|b| u8::from_str_radix(b, 16).unwrap())
            .collect();
        assert_eq!(
            taken(Some(Signing::new([0x42; 32])), &[frame]),
            (1, Signatures::default())
        );
    }

    /// A computer whose clock is behind stamps its frames later than those it has received.
    #[test]
    fn timestamp_after_the_latest_received() {
        let autopilot = Signing::new([1; 32]);
        let ours = Signing::new([1; 32]);
        let mut ahead = MAVLinkV2MessageRaw::new();
        let message = Outgoing::new(0, 50, vec![3; 9]);
        ahead
            .serialize_message_with_dialect_for_signing(SENDER.into(), &Bytes(50), &message)
            .unwrap();
        *ahead.signature_timestamp_bytes_mut().last_mut().unwrap() = 0x7f;
        let mut signature = [0; 6];
        ahead.calculate_signature(&[1; 32], &mut signature);
        ahead.signature_value_mut().copy_from_slice(&signature);
        let ahead = ahead.raw_bytes().to_vec();
        let of_ours = || {
            let companion = MavlinkSender {
                component: 191,
                ..SENDER
            };
            encode(companion, Outgoing::new(0, 50, vec![3; 9]), Some(&ours))
        };
        let before = of_ours();
        assert_eq!(taken(Some(ours.clone()), core::slice::from_ref(&ahead)).0, 1);
        // The autopilot has used the same timestamp, and rejects frames that are more than a minute older.
        let frames = [ahead, before, of_ours()];
        assert_eq!(taken(Some(autopilot), &frames).0, 2);
    }

    fn stamped(at: u64) -> Vec<u8> {
        let station = Signing::new([1; 32]);
        station.recall(&SigningTimes {
            latest: at,
            ..SigningTimes::default()
        });
        heartbeat(Some(&station))
    }

    #[test]
    fn times_of_a_signed_link_over_a_restart() {
        const AT: u64 = 1_000_000_000;
        let before = Signing::new([1; 32]);
        let sent = [stamped(AT), stamped(AT + 5)];
        assert_eq!(taken(Some(before.clone()), &sent).0, 2);
        let after = Signing::new([1; 32]);
        after.recall(&before.times());
        let replayed = [&sent[..], &[stamped(AT + 6)]].concat();
        let (count, signatures) = taken(Some(after), &replayed);
        assert_eq!((count, signatures.old), (1, 2));
    }

    /// A signed message that is exempt from the time check is accepted after its sender's clock was set back.
    #[test]
    fn message_that_no_clock_stops() {
        const AT: u64 = 1_000_000_000;
        let frames = [stamped(AT), stamped(5), heartbeat(Some(&Signing::new([2; 32])))];
        let count = |whenever: bool| {
            let mut reader = FrameReader::signed(Some(Signing::new([1; 32])));
            if whenever {
                reader = reader.whenever(|m| matches!(m, MavMessage::HEARTBEAT(_)));
            }
            for bytes in &frames {
                reader.push(bytes);
            }
            core::iter::from_fn(|| reader.next_frame()).count()
        };
        assert_eq!([count(false), count(true)], [1, 2]);
    }

    #[test]
    fn streams_that_are_forgotten() {
        let mut times = SigningTimes::default();
        for k in 0..=MAX_STREAMS as u32 {
            assert!(times.admit([0, 1, k], 1000 + u64::from(k)));
        }
        assert_eq!(times.streams.len(), MAX_STREAMS);
        assert!(!times.admit([0, 1, 1], 1001) && times.admit([0, 1, 1], 2000));
    }
}
