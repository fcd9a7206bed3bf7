//! Moving base: sends RTCM from the vessel's receiver to the drone's receiver, and dates the relative
//! position that the drone's receiver measures.
//!
//! If the drone has no receiver of its own (`autopilot.receiver`), the frames go to the autopilot's receiver
//! as `GPS_RTCM_DATA`.
//! Source: MAVLink's definition of `GPS_RTCM_DATA`.

use alight_shared::{
    estimation::{Rollover, SourceClock},
    mavlink::dialect::{GPS_RTCM_DATA_DATA, MavMessage},
    msg::{CarrierSolution, Header, Message as _, RelativePlace, RelativeState, RtcmFrames},
    rtcm,
    time::{DroneClock, Span},
    topics,
};

use super::{
    AutopilotOut, DroneTime, Output, OutputHeaders,
    message::severity,
    receiver::{MAX_SD_M, RelativeReport, WEEK_NS},
};

const FRAGMENT_BYTES: usize = 180;
/// Maximum number of fragments per frame: the fragment number has two bits.
const MAX_FRAGMENTS: usize = 4;
/// Maximum number of messages forwarded per step: the capacity of the topic.
const MAX_RTCM: usize = 32;
/// Validity of the antenna position stated in a frame.
const BASE_LASTS: Span = Span::from_millis(10_000);
const TEXT_PAUSE: Span = Span::from_millis(5000);

#[derive(Clone, Debug, Default)]
pub(super) struct MovingBase {
    /// Sequence number of frames to the autopilot; the low five bits are sent.
    sequence: u8,
    pub(super) passed_on: u32,
    pub(super) dropped: u32,
    /// Header of the newest frame that states the vessel's antenna position, and that position.
    base: Option<(Header<DroneClock>, [f32; 3])>,
    /// Station number of the newest observations, and time of the newest warning about a different one.
    station: Option<u16>,
    warned: Option<DroneTime>,
    week: Rollover<WEEK_NS>,
    clock: SourceClock<DroneClock>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum RtcmTarget {
    Receiver,
    Autopilot,
    Nothing,
}

impl MovingBase {
    pub(super) fn take(
        &mut self,
        now: DroneTime,
        frames: &[RtcmFrames<DroneClock>],
        target: RtcmTarget,
        out: &mut AutopilotOut,
    ) {
        for message in frames.iter().take(MAX_RTCM) {
            let fresh = now - message.header.at <= topics::BRIDGE_RTCM.stale_after;
            let Some(frames) = rtcm::frames(&message.bytes).filter(|_| fresh && message.check().is_ok())
            else {
                self.dropped = self.dropped.saturating_add(1);
                continue;
            };
            self.base = Some((message.header, message.antenna_m));
            for (number, frame) in frames {
                if number.is_observation() {
                    self.station = rtcm::station(frame);
                }
                let passed = self.pass_on(frame, target, out);
                let count = if passed {
                    &mut self.passed_on
                } else {
                    &mut self.dropped
                };
                *count = count.saturating_add(1);
            }
        }
    }
    /// Forwards a frame; returns false if it cannot be sent.
    fn pass_on(&mut self, frame: &[u8], target: RtcmTarget, out: &mut AutopilotOut) -> bool {
        match target {
            RtcmTarget::Receiver => out.rtcm.push(frame.to_vec()),
            RtcmTarget::Autopilot => {
                let Some(parts) = fragments(frame, self.sequence) else {
                    return false;
                };
                self.sequence = self.sequence.wrapping_add(1);
                for part in parts {
                    out.send(MavMessage::GPS_RTCM_DATA(part));
                }
            }
            RtcmTarget::Nothing => return false,
        }
        true
    }
    /// Warns that the receiver's position is relative to a station other than the vessel's.
    pub(super) fn other_station(&mut self, now: DroneTime, report: &RelativeReport) -> Option<String> {
        let (theirs, own) = report
            .station
            .zip(self.station)
            .filter(|(theirs, own)| theirs != own)?;
        if self.warned.is_some_and(|at| now - at < TEXT_PAUSE) {
            return None;
        }
        self.warned = Some(now);
        Some(format!(
            "Moving base not used: receiver has RTCM station {theirs}, vessel sends {own}: stop other corrections"
        ))
    }
    /// Relative position from a report that arrives at `now`, at least `latency` after its measurement, on
    /// the drone's clock. None while the vessel's antenna position is unknown, if the time is implausible, or
    /// if the report contains only the time.
    pub(super) fn place(
        &mut self,
        now: DroneTime,
        report: &RelativeReport,
        latency: Span,
        headers: &mut OutputHeaders,
    ) -> Option<RelativePlace> {
        let at_ns = self.week.unwrap(report.of_week_ns);
        let at = self.clock.local_time(now, at_ns, latency)?;
        let is_own = report.station.is_none() || self.station.is_none() || report.station == self.station;
        let solution = if is_own {
            report.solution?
        } else {
            CarrierSolution::None
        };
        let (base, antenna_m) = self.base.filter(|(base, _)| now - base.at <= BASE_LASTS)?;
        // Without a position only the state of the solution is published.
        let [baseline_m, baseline_sd_m] = report
            .place
            .filter(|_| is_own)
            .unwrap_or([[0.0; 3], [MAX_SD_M; 3]]);
        let place = RelativePlace {
            header: Header {
                vessel: base.vessel,
                ..headers.next(Output::Relative, at)
            },
            baseline_m,
            baseline_sd_m,
            solution,
            antenna_m,
        };
        place.check().is_ok().then_some(place)
    }
}

/// Fragments of a frame with this sequence number; None if the frame is too long. A receiver recognises the
/// end of a frame by a fragment that is not full, or by the fourth fragment.
fn fragments(frame: &[u8], sequence: u8) -> Option<Vec<GPS_RTCM_DATA_DATA>> {
    const FRAGMENTED: u8 = 1;
    let sequence = (sequence & 31) << 3;
    let message = |flags, part: &[u8]| {
        let mut message = GPS_RTCM_DATA_DATA {
            flags,
            len: part.len() as u8,
            ..GPS_RTCM_DATA_DATA::DEFAULT
        };
        for (to, byte) in message.data.iter_mut().zip(part) {
            *to = *byte;
        }
        message
    };
    if frame.len() <= FRAGMENT_BYTES {
        return Some(vec![message(sequence, frame)]);
    }
    let mut parts: Vec<&[u8]> = frame.chunks(FRAGMENT_BYTES).collect();
    if parts.len() > MAX_FRAGMENTS {
        return None;
    }
    if parts.len() < MAX_FRAGMENTS && frame.len().is_multiple_of(FRAGMENT_BYTES) {
        parts.push(&[]);
    }
    let numbered = (0_u8..).zip(parts);
    Some(
        numbered
            .map(|(k, part)| message(sequence | (k << 1) | FRAGMENTED, part))
            .collect(),
    )
}

/// State of the relative position as last reported to ground stations.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum ReportedRelative {
    #[default]
    Lost,
    Fixed,
    Contradicted,
}

#[derive(Clone, Copy, Debug, Default)]
pub(super) struct RelativeReports {
    reported: ReportedRelative,
    at: Option<DroneTime>,
}

impl RelativeReports {
    pub(super) fn change(&mut self, now: DroneTime, state: Option<&RelativeState>) -> Option<(u8, String)> {
        let fresh = state.filter(|r| r.age_s <= topics::RELATIVE.stale_after.secs());
        let (newest, text) = match fresh {
            None => (
                ReportedRelative::Lost,
                "Moving base lost: no measurement".to_owned(),
            ),
            Some(r) => match (r.contradicted_m, r.solution) {
                (Some(m), _) => (
                    ReportedRelative::Contradicted,
                    format!("Moving base {m:.2} m off the tags: not used"),
                ),
                (None, CarrierSolution::Fixed) => (
                    ReportedRelative::Fixed,
                    format!("Moving base fixed: position to {:.0} cm", 100.0 * r.sd_m),
                ),
                (None, CarrierSolution::Float) => (
                    ReportedRelative::Lost,
                    "Moving base lost: float solution".to_owned(),
                ),
                (None, CarrierSolution::None) => (
                    ReportedRelative::Lost,
                    "Moving base lost: no carrier solution".to_owned(),
                ),
            },
        };
        if newest == self.reported || self.at.is_some_and(|at| now - at < TEXT_PAUSE) {
            return None;
        }
        self.reported = newest;
        self.at = Some(now);
        let severity = match newest {
            ReportedRelative::Fixed => severity::INFO,
            ReportedRelative::Lost | ReportedRelative::Contradicted => severity::WARNING,
        };
        Some((severity, text))
    }
}

#[cfg(test)]
mod tests;
