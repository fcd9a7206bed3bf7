//! The rates at which the autopilot is asked to send, asked again where it does not.

use alight_shared::time::{DroneClock, Span, Time};

use super::config::AutopilotLinkConfig;
use super::message::{Address, CommandLong, Message, Taken, command, id};
use super::modes::Firmware;

/// Between two questions on the link, s.
const PACE_S: f64 = 0.02;
/// A stream is looked after this often, s.
const REVIEW_S: f64 = 2.0;
/// A change of mode is told within this many times a second.
const MODE_HZ: f64 = 50.0;
/// Below this share of the rate it is asked for again.
const ENOUGH: f64 = 0.7;
/// A refused stream is let be for this long, s.
const LET_BE_S: f64 = 60.0;
/// Refusals that count as a no.
const REFUSALS: u32 = 3;

#[derive(Clone, Copy, Debug)]
struct Stream {
    id: u32,
    hz: f64,
    /// Asked for again below this rate, Hz.
    least_hz: f64,
    heard: u32,
    review_at: Time<DroneClock>,
    refusals: u32,
    wanted: bool,
}

/// The streams of one autopilot.
#[derive(Clone, Debug)]
pub(crate) struct Streams {
    list: Vec<Stream>,
    next: Time<DroneClock>,
    last_asked: Option<u32>,
}

impl Streams {
    /// What this firmware can say of what landing needs.
    pub(crate) fn new(firmware: Firmware, c: &AutopilotLinkConfig, now: Time<DroneClock>) -> Streams {
        let own: &[(u32, f64)] = match firmware {
            Firmware::Px4 => &[
                (id::ODOMETRY, c.odometry_hz),
                (id::HIGHRES_IMU, c.odometry_hz),
                // Its heartbeats keep to 1 Hz whatever is asked; this comes when the mode changes, and twice
                // a second.
                (id::CURRENT_MODE, MODE_HZ),
            ],
            // ArduCopter has no ODOMETRY.
            Firmware::ArduCopter => &[
                (id::HEARTBEAT, c.heartbeat_hz),
                (id::ATTITUDE_QUATERNION, c.odometry_hz),
                (id::LOCAL_POSITION_NED, c.odometry_hz),
                (id::SCALED_IMU, c.odometry_hz),
            ],
        };
        let both = [
            (id::EXTENDED_SYS_STATE, 10.0),
            // The thrust in force. (ArduCopter has it in VFR_HUD too, cut to whole percents.)
            (id::ATTITUDE_TARGET, 50.0),
            (id::DISTANCE_SENSOR, c.range_hz),
            (id::BATTERY_STATUS, 1.0),
        ];
        Streams {
            list: both
                .iter()
                .chain(own)
                .map(|&(id, hz)| Stream {
                    id,
                    hz,
                    least_hz: if id == id::CURRENT_MODE { 1.0 } else { ENOUGH * hz },
                    heard: 0,
                    review_at: now,
                    refusals: 0,
                    wanted: true,
                })
                .collect(),
            next: now,
            last_asked: None,
        }
    }
    /// A message of a stream arrived.
    pub(crate) fn heard(&mut self, id: u32) {
        if let Some(s) = self.list.iter_mut().find(|s| s.id == id) {
            s.heard = s.heard.saturating_add(1);
        }
    }
    /// The last question was answered.
    pub(crate) fn answered(&mut self, now: Time<DroneClock>, taken: Taken) {
        let no = match taken {
            Taken::Denied | Taken::Unsupported | Taken::Failed | Taken::Other => true,
            Taken::Accepted | Taken::InProgress | Taken::TemporarilyRejected => false,
        };
        let asked = self.last_asked.take();
        if let Some(s) = self.list.iter_mut().find(|s| no && Some(s.id) == asked) {
            s.refusals += 1;
            if s.refusals >= REFUSALS {
                s.refusals = 0;
                s.review_at = now + Span::from_secs(LET_BE_S);
            }
        }
    }
    /// The next question, when it is time for one.
    pub(crate) fn ask(&mut self, now: Time<DroneClock>, to: Address) -> Option<Message> {
        if now < self.next {
            return None;
        }
        for s in &mut self.list {
            if now >= s.review_at {
                // The first review finds nothing heard, and so asks.
                s.wanted = f64::from(s.heard) < s.least_hz * REVIEW_S;
                if !s.wanted {
                    s.refusals = 0;
                }
                s.heard = 0;
                s.review_at = now + Span::from_secs(REVIEW_S);
            }
        }
        let s = self.list.iter_mut().find(|s| s.wanted)?;
        s.wanted = false;
        self.next = now + Span::from_secs(PACE_S);
        self.last_asked = Some(s.id);
        Some(Message::Command(CommandLong {
            to,
            command: command::MESSAGE_INTERVAL,
            confirmation: 0,
            parameters: [f64::from(s.id), (1e6 / s.hz).round(), 0.0, 0.0, 0.0, 0.0, 0.0],
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TO: Address = Address {
        system: 1,
        component: 1,
    };

    /// Asked-for ids over `seconds`, when the streams in `sent` come at their rate.
    fn asked(s: &mut Streams, from_s: f64, seconds: f64, sent: &[u32], answer: Taken) -> Vec<u32> {
        let mut all = Vec::new();
        for k in 0..(seconds * 100.0) as u32 {
            let now = Time::from_secs(from_s + 0.01 * f64::from(k));
            sent.iter().for_each(|i| s.heard(*i));
            if let Some(Message::Command(c)) = s.ask(now, TO) {
                all.push(c.parameters[0] as u32);
                s.answered(now, answer);
            }
        }
        all
    }

    #[test]
    fn what_does_not_come_is_asked_for_again_and_what_comes_is_not() {
        let c = AutopilotLinkConfig::default();
        let mut s = Streams::new(Firmware::Px4, &c, Time::from_secs(0.0));
        let first = asked(&mut s, 0.0, 1.0, &[], Taken::Accepted);
        assert_eq!(first.len(), 7, "{first:?}");
        assert!(first.contains(&id::ODOMETRY) && !first.contains(&id::LOCAL_POSITION_NED));
        let all_but_range: Vec<u32> = first.into_iter().filter(|i| *i != id::DISTANCE_SENSOR).collect();
        asked(&mut s, 1.0, 2.0, &all_but_range, Taken::Accepted);
        let again = asked(&mut s, 3.0, 6.0, &all_but_range, Taken::Accepted);
        assert_eq!(again, [id::DISTANCE_SENSOR; 3]);
    }

    #[test]
    fn a_stream_that_is_refused_is_let_be() {
        let c = AutopilotLinkConfig::default();
        let mut s = Streams::new(Firmware::ArduCopter, &c, Time::from_secs(0.0));
        let all = asked(&mut s, 0.0, 50.0, &[], Taken::Failed);
        let odometry = all.iter().filter(|i| **i == id::SCALED_IMU).count();
        assert_eq!(odometry, REFUSALS as usize);
    }
}
