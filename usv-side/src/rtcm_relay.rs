//! Relay of the vessel receiver's RTCM 3 frames to the radio, within a budget.
//!
//! A token bucket holds one second of the radio's budget. The base position is small and essential: it passes
//! while the bucket lasts, and other messages leave room for it. An observation that does not fit is dropped
//! with all following ones until the bucket is full, so that epochs pass completely or not at all. Other
//! messages are dropped with them, and must leave a third of the bucket.

use alight_shared::{
    msg::{Header, RtcmFrames, Seq},
    rtcm::{MAX_FRAME_BYTES, number},
    time::{Time, VesselClock, VesselTime},
};

/// Data rate limit for frames, bytes/s; the bucket holds one second of it.
pub const BYTES_PER_S: f64 = 3000.0;
/// Overhead of message and radio headers, bytes.
const HEADER_BYTES: usize = 46 + 50;
/// Reserve for two base positions, bytes.
const BASE_BYTES: f64 = 320.0;

#[derive(Clone, Debug)]
pub struct RtcmRelay {
    /// Header of the newest relayed message.
    header: Header<VesselClock>,
    /// Bytes in the bucket, and time of the update.
    bucket: f64,
    at: Option<VesselTime>,
    /// An observation was dropped since the bucket was last full.
    waits: bool,
    dropped: u64,
}

impl RtcmRelay {
    pub fn new(vessel: u32, boot: u32) -> Self {
        RtcmRelay {
            header: Header::new(vessel, 0, boot, 0, Time::EPOCH),
            bucket: BYTES_PER_S,
            at: None,
            waits: false,
            dropped: 0,
        }
    }
    pub fn dropped(&self) -> u64 {
        self.dropped
    }
    /// Frames that fit, in order, as messages with the headers of this process.
    pub fn pass(
        &mut self,
        now: VesselTime,
        frames: &[RtcmFrames<VesselClock>],
    ) -> Vec<RtcmFrames<VesselClock>> {
        let since_s = self.at.replace(now).map_or(0.0, |at| (now - at).secs().max(0.0));
        self.bucket = (self.bucket + since_s * BYTES_PER_S).min(BYTES_PER_S);
        self.waits &= self.bucket < BYTES_PER_S;
        let mut passed: Vec<RtcmFrames<VesselClock>> = Vec::new();
        for frame in frames {
            let open = (passed.last_mut()).filter(|m| m.bytes.len() + frame.bytes.len() <= MAX_FRAME_BYTES);
            if !self.takes(frame, open.is_none()) {
                self.dropped += 1;
                continue;
            }
            if let Some(message) = open {
                message.bytes = Seq::filled(message.bytes.iter().chain(frame.bytes.iter()).copied());
                continue;
            }
            self.header.at = frame.header.at;
            self.header.sequence = self.header.sequence.wrapping_add(1);
            passed.push(RtcmFrames {
                header: self.header,
                ..*frame
            });
        }
        passed
    }
    /// Whether a frame fits and is taken from the bucket. `begins`: it is the first of a message.
    fn takes(&mut self, frame: &RtcmFrames<VesselClock>, begins: bool) -> bool {
        let Some(number) = number(&frame.bytes) else {
            return false;
        };
        let headers = if begins { HEADER_BYTES } else { 0 };
        let left = self.bucket - (frame.bytes.len() + headers) as f64;
        let fits = if number.is_base() {
            left >= 0.0
        } else if number.is_observation() {
            self.waits |= left < BASE_BYTES;
            !self.waits
        } else {
            !self.waits && left >= BYTES_PER_S / 3.0
        };
        if fits {
            self.bucket = left;
        }
        fits
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixtures::rtcm_frame;
    use alight_shared::rtcm::frames;

    fn frame(message: u16, bytes: usize) -> RtcmFrames<VesselClock> {
        RtcmFrames {
            bytes: Seq::filled(rtcm_frame(message, bytes - 6)),
            ..RtcmFrames::default()
        }
    }
    /// Numbers of passed frames in 20 s of epochs with four systems and the base position, at `rate_hz`.
    fn passed(relay: &mut RtcmRelay, rate_hz: f64, bytes: usize) -> Vec<Vec<u16>> {
        let epoch = [1077, 1087, 1097, 1127].map(|message| frame(message, bytes));
        let epoch = [vec![frame(1005, 25)], epoch.to_vec(), vec![frame(1230, 14)]].concat();
        let numbers = |k: f64| -> Vec<u16> {
            let passed = relay.pass(Time::from_secs(k / rate_hz), &epoch);
            let whole = passed.iter().flat_map(|m| frames(&m.bytes).unwrap());
            whole.map(|(n, _)| n.message).collect()
        };
        (0..(20.0 * rate_hz) as u32).map(f64::from).map(numbers).collect()
    }

    #[test]
    fn frames_within_the_budget() {
        let mut relay = RtcmRelay::new(1, 9);
        let all = passed(&mut relay, 1.0, 300);
        assert!(
            all.iter()
                .all(|epoch| *epoch == [1005, 1077, 1087, 1097, 1127, 1230]),
            "{all:?}"
        );
        assert_eq!(relay.dropped(), 0);
    }

    #[test]
    fn whole_epochs_beyond_the_budget() {
        let mut relay = RtcmRelay::new(1, 9);
        let all = passed(&mut relay, 5.0, 400);
        assert!(
            all.iter().all(|epoch| epoch.contains(&1005)),
            "a base position was dropped: {all:?}"
        );
        let observations = |epoch: &Vec<u16>| epoch.iter().filter(|n| (1070..1200).contains(*n)).count();
        let observed: Vec<usize> = all.iter().map(observations).collect();
        let count = |low: usize, high: usize| observed.iter().filter(|n| (low..=high).contains(*n)).count();
        let [whole, parts] = [count(4, 4), count(1, 3)];
        assert!(whole >= 10 && parts <= whole, "{observed:?}");
        let bytes: f64 = observed.iter().map(|n| *n as f64 * 400.0).sum();
        assert!(bytes <= 21.0 * BYTES_PER_S, "{bytes} bytes in 20 s");
    }

    #[test]
    fn longest_frame_with_a_header_of_its_own() {
        let mut relay = RtcmRelay::new(1, 9);
        let mut longest = frame(1077, alight_shared::rtcm::MAX_FRAME_BYTES);
        longest.header = Header::new(1, 0, 77, 5, Time::from_secs(3.0));
        let passed: Vec<_> = (0..2)
            .flat_map(|_| relay.pass(Time::from_secs(3.0), &[longest]))
            .collect();
        let headers: Vec<_> = passed.iter().map(|f| f.header).collect();
        assert_eq!(
            headers,
            [1, 2].map(|sequence| Header::new(1, 0, 9, sequence, Time::from_secs(3.0)))
        );
        assert!(passed.iter().all(|f| f.bytes == longest.bytes));
        let mut damaged = longest;
        damaged.bytes[9] ^= 1;
        assert!(relay.pass(Time::from_secs(9.0), &[damaged]).is_empty());
    }
}
