//! Optional publication of the deck on the link, as `LANDING_TARGET` or as `TARGET_RELATIVE` and
//! `TARGET_ABSOLUTE`, and as an array of numbers.

use alight_shared::{
    frames::wxyz,
    mavlink::dialect::{DEBUG_FLOAT_ARRAY_DATA, LANDING_TARGET_DATA, LandingTargetType, MavBool, MavFrame},
    msg::{DeckStage, SetPoint, SetPointKind},
    time::Span,
};
use nalgebra::{UnitQuaternion, Vector3};

use super::{
    AutopilotLink, AutopilotOut, DroneTime,
    config::DeckMessage,
    message::{
        CommandLong, MavCmd, MavMessage, MavlinkMessage, TargetAbsolute, TargetRelative, chars, narrow,
    },
    modes::Firmware,
};

/// Displacement of the deck after which home is sent again, m: the combined error of two receivers.
const HOME_MOVED_M: f64 = 5.0;
const HOME_PERIOD: Span = Span::from_millis(5_000);
/// Repetition period of home: autopilots reset it at arming, and a command may be lost.
const HOME_REPEAT: Span = Span::from_millis(30_000);
const DECK_PERIOD: Span = Span::from_millis(100);

impl AutopilotLink {
    pub(super) fn publish_deck(&mut self, now: DroneTime, out: &mut AutopilotOut) {
        if !self.config.publish_deck || !self.timers.deck.is_ready(now) || !self.clock.is_synchronised() {
            return;
        }
        let Some(d) = self.inputs.known_deck(now) else {
            return;
        };
        self.timers.deck.restart(now, DECK_PERIOD);
        // The forecast is in the frame of the set-points.
        let deck = SetPoint {
            kind: SetPointKind::Trajectory,
            position: d.position,
            velocity: d.velocity,
            ..SetPoint::default()
        };
        let there = self.estimate.for_autopilot(&deck, self.firmware());
        let time_us = self.clock.remote_time_us(now, now);
        let position = there.position;
        let velocity = there.velocity;
        let target = match self.firmware() {
            Some(Firmware::Px4) if self.config.deck_message == DeckMessage::Target => {
                let relative = self.target_relative();
                let absolute = self.target_absolute(now, &d, velocity);
                out.messages.extend(relative.map(MavlinkMessage::TargetRelative));
                out.messages.extend(absolute.map(MavlinkMessage::TargetAbsolute));
                None
            }
            Some(Firmware::Px4) => Some(LANDING_TARGET_DATA {
                time_usec: own_us(now),
                frame: MavFrame::MAV_FRAME_LOCAL_NED,
                ..self.target(position, &attitude(&d))
            }),
            Some(Firmware::ArduCopter) => self.target_from_vehicle(now),
            None => None,
        };
        if let Some(target) = target {
            out.send(MavMessage::LANDING_TARGET(target));
        }
        let mut array = DEBUG_FLOAT_ARRAY_DATA {
            time_usec: time_us,
            name: chars("deck"),
            ..DEBUG_FLOAT_ARRAY_DATA::DEFAULT
        };
        // Position (m) and velocity (m/s) in NED, roll, pitch, yaw (rad), their rates (rad/s), and standard deviation
        // of the position (m).
        let values = [position, velocity, d.euler, d.euler_rates, d.position_sd];
        let numbers = array.data.iter_mut().zip(values.as_flattened());
        for (to, value) in numbers {
            *to = *value as f32;
        }
        // An autopilot would treat ODOMETRY as its own pose.
        out.send(MavMessage::DEBUG_FLOAT_ARRAY(array));
    }
    /// Deck for ArduCopter, relative to the vehicle at its newest odometry, in body axes.
    fn target_from_vehicle(&self, now: DroneTime) -> Option<LANDING_TARGET_DATA> {
        let state = self.estimate.state?;
        let deck = self.inputs.deck(state.header.at)?;
        let body = state.attitude();
        let apart = body.inverse() * (Vector3::from(deck.position) - state.position());
        let distance_m = apart.norm();
        (distance_m > 0.0).then(|| LANDING_TARGET_DATA {
            time_usec: self.clock.remote_time_us(now, state.header.at),
            frame: MavFrame::MAV_FRAME_BODY_FRD,
            distance: distance_m as f32,
            ..self.target(apart.into(), &(body.inverse() * attitude(&deck)))
        })
    }
    /// Centre of the deck, m, and the rotation from the deck to the target's frame.
    fn target(&self, position: [f64; 3], attitude: &UnitQuaternion<f64>) -> LANDING_TARGET_DATA {
        let [x, y, z] = narrow(position);
        let size = self.config.deck_tag_m as f32;
        LANDING_TARGET_DATA {
            x,
            y,
            z,
            q: narrow(wxyz(attitude)),
            size_x: size,
            size_y: size,
            mavtype: LandingTargetType::LANDING_TARGET_TYPE_VISION_FIDUCIAL,
            position_valid: MavBool::MAV_BOOL_TRUE,
            ..LANDING_TARGET_DATA::DEFAULT
        }
    }
    /// Deck as a marker for PX4's vision target estimator, relative to the vehicle at its newest odometry.
    fn target_relative(&self) -> Option<TargetRelative> {
        let state = self.estimate.state?;
        let deck = self.inputs.deck(state.header.at)?;
        let [_, _, yaw_sd] = deck.euler_sd;
        Some(TargetRelative {
            time_us: own_us(state.header.at),
            position: (Vector3::from(deck.position) - state.position()).into(),
            position_sd: deck.position_sd,
            attitude: wxyz(&attitude(&deck)),
            yaw_sd,
        })
    }
    /// Deck as a receiver on the target for PX4's vision target estimator, with its velocity in the
    /// autopilot's frame; None until the origin is known.
    fn target_absolute(&self, now: DroneTime, d: &DeckStage, velocity: [f64; 3]) -> Option<TargetAbsolute> {
        let (mut place, sea_m) = self.estimate.place(d)?;
        place.height_m = sea_m;
        let [north, east, down] = d.position_sd;
        Some(TargetAbsolute {
            time_us: own_us(now),
            place,
            place_sd: [north.max(east), down],
            velocity,
            velocity_sd: d.velocity_sd,
        })
    }
    /// Sends the deck's position as home, if configured. Single precision resolves half a metre.
    pub(super) fn send_home(&mut self, now: DroneTime, out: &mut AutopilotOut) {
        let deck = (self.inputs.known_deck(now)).filter(|_| self.config.send_home);
        let place = deck.and_then(|d| self.estimate.place(&d));
        let (Some((place, sea_m)), Some(peer)) = (place, &self.peer) else {
            return;
        };
        let due = self.commands.home.is_none_or(|(at, sent)| {
            let age = now - at;
            age >= HOME_REPEAT || age >= HOME_PERIOD && place.distance_m(&sent) > HOME_MOVED_M
        });
        if !due {
            return;
        }
        let lat = place.latitude_deg;
        let lon = place.longitude_deg;
        let command = CommandLong::new(
            peer.address,
            MavCmd::MAV_CMD_DO_SET_HOME,
            [0.0, 0.0, 0.0, 0.0, lat, lon, sea_m],
        );
        out.send(command);
        self.commands.home = Some((now, place));
    }
}

/// Companion's time, us. PX4 converts it because the link answers its TIMESYNC
/// (`MavlinkTimesync::sync_stamp`).
fn own_us(at: DroneTime) -> u64 {
    u64::try_from(at.nanos() / 1000).unwrap_or_default()
}
fn attitude(d: &DeckStage) -> UnitQuaternion<f64> {
    let [roll, pitch, yaw] = d.euler;
    UnitQuaternion::from_euler_angles(roll, pitch, yaw)
}
