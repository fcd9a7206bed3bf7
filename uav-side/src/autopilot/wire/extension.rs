//! Messages with MAVLink 2 extension fields, or from other dialects, encoded by byte offset.

use alight_shared::mavlink::{CharArray, Fields, dialect as m};

use super::super::message::{
    Address, CommandResult, LandingTarget, MavlinkMessage, OdometryReport, TargetAbsolute, TargetFrame,
    TargetRelative, VelocityFrame, id,
};
use super::chars;

/// Name of the float array that carries the deck.
const DECK: &str = "deck";

/// Consecutive little-endian fields.
#[derive(Default)]
struct Row(Vec<u8>);

impl Row {
    fn floats(mut self, values: &[f64]) -> Row {
        let bytes = values.iter().flat_map(|v| (*v as f32).to_le_bytes());
        self.0.extend(bytes);
        self
    }
    fn bytes(mut self, values: &[u8]) -> Row {
        self.0.extend_from_slice(values);
        self
    }
}

/// Offsets of extension fields in their payloads.
pub(super) const RESET_COUNTER_AT: usize = 230;
pub(super) const ELLIPSOID_HEIGHT_AT: usize = 30;
/// `signal_quality` of `DISTANCE_SENSOR` and its invalid value; 0: unknown.
pub(super) const DISTANCE_QUALITY_AT: usize = 38;
pub(super) const DISTANCE_INVALID: u8 = 1;
const ESTIMATOR_FLAGS_AT: usize = 40;
const EKF_FLAGS_AT: usize = 20;
const TARGET_DISTANCE_AT: usize = 16;
const TARGET_SIZE_AT: usize = 20;
const TARGET_FRAME_AT: usize = 29;
const TARGET_PLACE_AT: usize = 30;
const TARGET_IS_VALID_AT: usize = 59;
const LIST_AT: usize = 20;
const MISSION_TOTAL_AT: usize = 2;
const MISSION_STATE_AT: usize = 4;
/// `target_system` of `COMMAND_ACK`, followed by the component.
pub(super) const ACK_TO_AT: usize = 8;

/// `LANDING_TARGET`: time, angles (unused), distance, size; number, frame; extension: position, attitude,
/// type (2: fiducial marker), position valid.
pub(super) fn landing_target(t: &LandingTarget) -> Vec<u8> {
    Row::default()
        .bytes(&t.time_us.to_le_bytes())
        .floats(&[0.0, 0.0, t.distance_m, t.size_m, t.size_m])
        .bytes(&[0, t.frame.number()])
        .floats(&t.position)
        .floats(&t.attitude)
        .bytes(&[2, 1])
        .0
}
/// `TARGET_RELATIVE`: time, position, its deviations, the heading's deviation, attitudes of the target and of
/// the sensor (none); number, frame (2: `TARGET_OBS_FRAME_LOCAL_OFFSET_NED`), type (2: fiducial marker).
pub(super) fn target_relative(t: &TargetRelative) -> Vec<u8> {
    Row::default()
        .bytes(&t.time_us.to_le_bytes())
        .floats(&t.position)
        .floats(&t.position_sd)
        .floats(&[t.yaw_sd])
        .floats(&t.attitude)
        .floats(&[1.0, 0.0, 0.0, 0.0])
        .bytes(&[0, 2, 2])
        .0
}
/// `TARGET_ABSOLUTE`: time, latitude, longitude, height above the sea, velocity, acceleration (not stated),
/// attitude, rates (not stated), deviations of position, velocity and acceleration; number, validity bits (1:
/// position, 2: velocity). The attitude makes the velocity along the target's axes equal to PX4's NED.
pub(super) fn target_absolute(t: &TargetAbsolute) -> Vec<u8> {
    let degrees = |d: f64| ((d * 1e7).round() as i32).to_le_bytes();
    Row::default()
        .bytes(&t.time_us.to_le_bytes())
        .bytes(&degrees(t.place.latitude_deg))
        .bytes(&degrees(t.place.longitude_deg))
        .floats(&[t.place.height_m])
        .floats(&t.velocity)
        .floats(&[0.0; 3])
        .floats(&[1.0, 0.0, 0.0, 0.0])
        .floats(&[0.0; 3])
        .floats(&t.place_sd)
        .floats(&t.velocity_sd)
        .floats(&[0.0; 3])
        .bytes(&[0, 1 | 2])
        .0
}
fn read_landing_target(payload: Fields<'_>) -> Option<LandingTarget> {
    let number = payload.u8(TARGET_FRAME_AT);
    let frame = TargetFrame::ALL.into_iter().find(|f| f.number() == number)?;
    (payload.u8(TARGET_IS_VALID_AT) == 1).then(|| LandingTarget {
        time_us: payload.u64(0),
        frame,
        position: payload.floats(TARGET_PLACE_AT),
        distance_m: payload.float(TARGET_DISTANCE_AT),
        attitude: payload.floats(TARGET_PLACE_AT + 12),
        size_m: payload.float(TARGET_SIZE_AT),
    })
}
/// Maximum length of one `STATUSTEXT`, bytes.
const TEXT: usize = 50;
/// `STATUSTEXT`s: severity, text; extension: text number (0: single part), part number; the last part is not full.
pub(super) fn status_texts(severity: u8, text: &str, number: u16) -> Vec<Vec<u8>> {
    let number = if text.len() > TEXT { number } else { 0 };
    let full = text.as_bytes().chunks_exact(TEXT);
    let rest = Some(full.remainder()).filter(|rest| number != 0 || !rest.is_empty() || text.is_empty());
    let parts = full.chain(rest);
    let part = |(k, part): (u8, &[u8])| {
        let row = Row::default()
            .bytes(&[severity])
            .bytes(part)
            .bytes(&[0; TEXT][part.len()..]);
        row.bytes(&number.to_le_bytes()).bytes(&[k]).0
    };
    (0..=u8::MAX).zip(parts).map(part).collect()
}
/// `COMMAND_ACK`: command, result; extension: progress (255: unknown), second result, addressee.
pub(super) fn command_ack(command: u16, result: CommandResult, to: Address) -> Vec<u8> {
    let number = match result {
        CommandResult::Accepted => m::MavResult::MAV_RESULT_ACCEPTED,
        CommandResult::TemporarilyRejected => m::MavResult::MAV_RESULT_TEMPORARILY_REJECTED,
        CommandResult::Denied => m::MavResult::MAV_RESULT_DENIED,
        CommandResult::Unsupported => m::MavResult::MAV_RESULT_UNSUPPORTED,
        CommandResult::Failed => m::MavResult::MAV_RESULT_FAILED,
        CommandResult::InProgress => m::MavResult::MAV_RESULT_IN_PROGRESS,
        CommandResult::Other => m::MavResult::MAV_RESULT_CANCELLED,
    };
    let progress = if result == CommandResult::InProgress {
        255
    } else {
        0
    };
    Row::default()
        .bytes(&command.to_le_bytes())
        .bytes(&[number as u8, progress, 0, 0, 0, 0, to.system, to.component])
        .0
}
/// `DEBUG_FLOAT_ARRAY`: time, number, name; extension: 58 floats.
pub(super) fn deck(time_us: u64, values: &[[f64; 3]; 5]) -> Vec<u8> {
    let name: CharArray<10> = chars(DECK);
    Row::default()
        .bytes(&time_us.to_le_bytes())
        .bytes(&[0, 0])
        .bytes(&*name)
        .floats(values.as_flattened())
        .0
}
/// `GPS_RAW_INT`: time, place, height, four unused, fix, satellites; extension: ellipsoidal height.
pub(super) fn gnss_heights(sea_m: f64, ellipsoid_m: f64) -> Vec<u8> {
    let mm = |m: f64| ((m * 1e3).round() as i32).to_le_bytes();
    Row::default()
        .bytes(&[0; 16])
        .bytes(&mm(sea_m))
        .bytes(&[0; 8])
        .bytes(&[3, 10])
        .bytes(&mm(ellipsoid_m))
        .0
}
/// `ODOMETRY`: time, position, attitude, velocity, rates, two covariances, frames; extension: reset counter.
pub(super) fn odometry(o: &OdometryReport) -> Vec<u8> {
    let mut covariances = [[f64::NAN; 21]; 2];
    if let Some([p, a, v]) = o.variances {
        covariances = [[0.0; 21]; 2];
        let [pose, velocity] = &mut covariances;
        (pose[0], pose[6], pose[11]) = (p[0], p[1], p[2]);
        (pose[15], pose[18], pose[20]) = (a[0], a[1], a[2]);
        (velocity[0], velocity[6], velocity[11]) = (v[0], v[1], v[2]);
    }
    let frame = match o.frame {
        VelocityFrame::Ned => m::MavFrame::MAV_FRAME_LOCAL_NED,
        VelocityFrame::Body => m::MavFrame::MAV_FRAME_BODY_FRD,
    };
    Row::default()
        .bytes(&o.time_us.to_le_bytes())
        .floats(&o.position)
        .floats(&o.attitude)
        .floats(&o.velocity)
        .floats(&o.rates)
        .floats(covariances.as_flattened())
        .bytes(&[m::MavFrame::MAV_FRAME_LOCAL_NED as u8, frame as u8, o.resets])
        .0
}

/// `ESTIMATOR_STATUS`: time, eight unused floats, flags.
pub(super) fn estimator_status(flags: u16) -> Vec<u8> {
    let row = Row::default().bytes(&[0; 8]).floats(&[0.1; 8]);
    row.bytes(&flags.to_le_bytes()).0
}
/// `EKF_STATUS_REPORT`: five unused floats, flags.
pub(super) fn ekf_status(flags: u16) -> Vec<u8> {
    Row::default().floats(&[0.1; 5]).bytes(&flags.to_le_bytes()).0
}

/// `MISSION_CURRENT`: item (unused); extension: items, state, mode (unused).
pub(super) fn mission_current(total: u16, state: u8) -> Vec<u8> {
    let row = Row::default().bytes(&[0; 2]).bytes(&total.to_le_bytes());
    row.bytes(&[state, 0]).0
}

/// Decodes messages whose content is in extension fields, and messages specific to ArduPilot.
pub(super) fn read(number: u32, payload: Fields<'_>) -> Option<MavlinkMessage> {
    match number {
        // Decoded by offset, so that an unknown flag does not invalidate the message.
        id::ESTIMATOR_STATUS => Some(MavlinkMessage::EstimatorStatus {
            flags: payload.u16(ESTIMATOR_FLAGS_AT),
        }),
        id::EKF_STATUS_REPORT => Some(MavlinkMessage::EkfStatus {
            flags: payload.u16(EKF_FLAGS_AT),
        }),
        id::MISSION_CURRENT => Some(MavlinkMessage::MissionCurrent {
            total: payload.u16(MISSION_TOTAL_AT),
            state: payload.u8(MISSION_STATE_AT),
        }),
        id::MISSION_ITEM_REACHED => Some(MavlinkMessage::MissionItemReached { item: payload.u16(0) }),
        149 => read_landing_target(payload).map(MavlinkMessage::LandingTarget),
        350 => {
            let name = payload.0.get(10..20)?;
            let rest = name.strip_prefix(DECK.as_bytes())?;
            rest.iter().all(|b| *b == 0).then(|| MavlinkMessage::Deck {
                time_us: payload.u64(0),
                values: core::array::from_fn(|k| payload.floats(LIST_AT + 12 * k)),
            })
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::geodesy::Datum;

    /// Offsets and lengths as in MAVLink's development dialect.
    #[test]
    fn targets_by_their_places() {
        let bytes = target_relative(&TargetRelative {
            time_us: 7,
            position: [1.0, 2.0, 3.0],
            position_sd: [0.5, 0.25, 0.125],
            attitude: [0.5, -0.5, 0.5, -0.5],
            yaw_sd: 0.75,
        });
        let f = Fields(&bytes);
        assert_eq!((bytes.len(), f.u64(0), f.floats(8)), (71, 7, [1.0, 2.0, 3.0]));
        assert_eq!((f.floats(20), f.float(32)), ([0.5, 0.25, 0.125], 0.75));
        assert_eq!(f.floats(36), [0.5, -0.5, 0.5, -0.5]);
        assert_eq!((f.floats(52), f.bytes(68)), ([1.0, 0.0, 0.0, 0.0], [0, 2, 2]));
        let bytes = target_absolute(&TargetAbsolute {
            time_us: 7,
            place: Datum::new(47.5, -8.25, 12.5),
            place_sd: [0.5, 0.25],
            velocity: [1.0, 2.0, 3.0],
            velocity_sd: [4.0, 5.0, 6.0],
        });
        let f = Fields(&bytes);
        let place = [f.i32(8), f.i32(12), f.float(16)];
        assert_eq!((bytes.len(), place), (106, [475e6, -82.5e6, 12.5]));
        assert_eq!((f.floats(20), f.floats(72)), ([1.0, 2.0, 3.0], [0.5, 0.25]));
        assert_eq!((f.floats(80), f.bytes(104)), ([4.0, 5.0, 6.0], [0, 3]));
    }
}
