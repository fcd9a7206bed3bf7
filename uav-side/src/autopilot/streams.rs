//! Message rates; they are requested from the autopilot again when they are too low.

use alight_shared::{
    mavlink::{EKF_STATUS_REPORT, MessageData as _, dialect as m},
    time::Span,
};

use super::{
    DroneTime,
    config::AutopilotLinkConfig,
    message::{Address, CommandLong, MavCmd, MavResult},
    modes::Firmware,
};

const REQUEST_SPACING_S: f64 = 0.02;
/// Period of the check of each stream's rate, s.
const REVIEW_S: f64 = 2.0;
/// Requested rate of CURRENT_MODE, Hz; a mode change is reported within one period.
const MODE_HZ: f64 = 50.0;
/// Requested rate of the remote control's channels and of sensor health, for the switch, Hz.
const CHANNELS_HZ: f64 = 10.0;
const STATUS_HZ: f64 = 5.0;
const OUTPUTS_HZ: f64 = 20.0;
const ESTIMATOR_HZ: f64 = 5.0;
/// Fraction of the requested rate below which a stream is requested again.
const MIN_RATE_FRACTION: f64 = 0.7;
const DENIED_PAUSE_S: f64 = 60.0;
const MAX_DENIALS: u32 = 3;

#[derive(Clone, Copy, Debug)]
struct Stream {
    id: u32,
    hz: f64,
    min_hz: f64,
    received: u32,
    review_at: DroneTime,
    denials: u32,
    wanted: bool,
}

#[derive(Clone, Debug)]
pub(crate) struct MessageStreams {
    list: Vec<Stream>,
    next: DroneTime,
    last_asked: Option<u32>,
}

impl MessageStreams {
    /// Streams that a landing needs and this firmware can send.
    pub(crate) fn new(firmware: Firmware, c: &AutopilotLinkConfig, now: DroneTime) -> MessageStreams {
        let own: &[(u32, f64)] = match firmware {
            Firmware::Px4 => &[
                (m::ODOMETRY_DATA::ID, c.odometry_hz),
                (m::HIGHRES_IMU_DATA::ID, c.odometry_hz),
                (m::ESTIMATOR_STATUS_DATA::ID, ESTIMATOR_HZ),
                // PX4's heartbeats stay at 1 Hz; CURRENT_MODE is sent at a mode change and at 2 Hz.
                (m::CURRENT_MODE_DATA::ID, MODE_HZ),
            ],
            // ArduCopter has no ODOMETRY.
            Firmware::ArduCopter => &[
                (m::HEARTBEAT_DATA::ID, c.heartbeat_hz),
                (m::ATTITUDE_QUATERNION_DATA::ID, c.odometry_hz),
                (m::LOCAL_POSITION_NED_DATA::ID, c.odometry_hz),
                (m::SCALED_IMU_DATA::ID, c.odometry_hz),
                (EKF_STATUS_REPORT, ESTIMATOR_HZ),
                // Outputs that show the rotors' spin-up; PX4's rotors start at once.
                (m::SERVO_OUTPUT_RAW_DATA::ID, OUTPUTS_HZ),
            ],
        };
        let both = [
            (m::EXTENDED_SYS_STATE_DATA::ID, 10.0),
            // Applied thrust. ArduCopter's VFR_HUD truncates it to whole percent.
            (m::ATTITUDE_TARGET_DATA::ID, 50.0),
            (m::DISTANCE_SENSOR_DATA::ID, c.range_hz),
            (m::BATTERY_STATUS_DATA::ID, 1.0),
            // State of the remote control's receiver.
            (m::SYS_STATUS_DATA::ID, STATUS_HZ),
        ];
        let switch: &[(u32, f64)] = if c.rc_switch == 0 {
            &[]
        } else {
            &[(m::RC_CHANNELS_DATA::ID, CHANNELS_HZ)]
        };
        MessageStreams {
            list: both
                .iter()
                .chain(own)
                .chain(switch)
                .map(|&(id, hz)| Stream {
                    id,
                    hz,
                    min_hz: match id {
                        m::CURRENT_MODE_DATA::ID => 1.0,
                        _ => MIN_RATE_FRACTION * hz,
                    },
                    received: 0,
                    review_at: now,
                    denials: 0,
                    wanted: true,
                })
                .collect(),
            next: now,
            last_asked: None,
        }
    }
    pub(crate) fn received(&mut self, id: u32) {
        if let Some(s) = self.list.iter_mut().find(|s| s.id == id) {
            s.received = s.received.saturating_add(1);
        }
    }
    pub(crate) fn answered(&mut self, now: DroneTime, result: MavResult) {
        let denied = !matches!(
            result,
            MavResult::MAV_RESULT_ACCEPTED
                | MavResult::MAV_RESULT_IN_PROGRESS
                | MavResult::MAV_RESULT_TEMPORARILY_REJECTED
        );
        let asked = self.last_asked.take();
        if let Some(s) = self.list.iter_mut().find(|s| denied && Some(s.id) == asked) {
            s.denials += 1;
            if s.denials >= MAX_DENIALS {
                s.denials = 0;
                s.review_at = now + Span::from_secs(DENIED_PAUSE_S);
            }
        }
    }
    pub(crate) fn ask(&mut self, now: DroneTime, to: Address) -> Option<CommandLong> {
        if now < self.next {
            return None;
        }
        for s in &mut self.list {
            if now >= s.review_at {
                // Nothing has been received before the first check, so it requests the stream.
                s.wanted = f64::from(s.received) < s.min_hz * REVIEW_S;
                if !s.wanted {
                    s.denials = 0;
                }
                s.received = 0;
                s.review_at = now + Span::from_secs(REVIEW_S);
            }
        }
        let s = self.list.iter_mut().find(|s| s.wanted)?;
        s.wanted = false;
        self.next = now + Span::from_secs(REQUEST_SPACING_S);
        self.last_asked = Some(s.id);
        let interval = [f64::from(s.id), (1e6 / s.hz).round()];
        Some(CommandLong::new(
            to,
            MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL,
            interval,
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::time::Time;

    const TO: Address = Address::new(1, 1);

    /// Message ids requested within `seconds` while the streams in `sent` arrive at their rates.
    fn asked(s: &mut MessageStreams, from_s: f64, seconds: f64, sent: &[u32], answer: MavResult) -> Vec<u32> {
        let mut all = Vec::new();
        for k in 0..(seconds * 100.0) as u32 {
            let now = Time::from_secs(from_s + 0.01 * f64::from(k));
            for i in sent {
                s.received(*i);
            }
            if let Some(c) = s.ask(now, TO) {
                all.push(c.parameters[0] as u32);
                s.answered(now, answer);
            }
        }
        all
    }

    #[test]
    fn missing_streams() {
        let c = AutopilotLinkConfig::default();
        let mut s = MessageStreams::new(Firmware::Px4, &c, Time::from_secs(0.0));
        let first = asked(&mut s, 0.0, 1.0, &[], MavResult::MAV_RESULT_ACCEPTED);
        assert_eq!(first.len(), 9, "{first:?}");
        assert!(first.contains(&m::ODOMETRY_DATA::ID) && !first.contains(&m::LOCAL_POSITION_NED_DATA::ID));
        let all_but_range: Vec<u32> = first
            .into_iter()
            .filter(|i| *i != m::DISTANCE_SENSOR_DATA::ID)
            .collect();
        asked(&mut s, 1.0, 2.0, &all_but_range, MavResult::MAV_RESULT_ACCEPTED);
        let again = asked(&mut s, 3.0, 6.0, &all_but_range, MavResult::MAV_RESULT_ACCEPTED);
        assert_eq!(again, [m::DISTANCE_SENSOR_DATA::ID; 3]);
    }

    #[test]
    fn denied_stream() {
        let c = AutopilotLinkConfig::default();
        let mut s = MessageStreams::new(Firmware::ArduCopter, &c, Time::from_secs(0.0));
        let all = asked(&mut s, 0.0, 50.0, &[], MavResult::MAV_RESULT_FAILED);
        let odometry = all.iter().filter(|i| **i == m::SCALED_IMU_DATA::ID).count();
        assert_eq!(odometry, MAX_DENIALS as usize);
    }
}
