//! Position of the vessel from its beacon or its last known position. Each horizontal axis has a Kalman filter of
//! position and velocity. Once the camera detects the deck, it measures the beacon's slow error.
//!
//! ```text
//! x = (q, v),  q' = v,  v' = w          the beacon's position and velocity
//! z = x + white                         white: a third of the beacon's stated error, and velocity error
//! p = q + b,  b ~ Gauss-Markov          b: the rest of the stated error, and the drone's own receiver's
//! ```

use alight_shared::{
    frames::{DroneNed, Vector},
    geodesy::Datum,
    msg::{
        BeaconSource, DeckBeacon, DeckStage, DroneState, FORECAST_STAGES, Header, MAX_BEACON_MPS,
        MAX_POSITION_M, MIN_BEACON_SD_M, Message as _, Seq,
    },
    time::DroneTime,
};
use nalgebra::{Matrix2, Vector2};

use super::{agreement::PLACE_SD, observation::DeckObservation, track::FrameJump};

/// Correlation time of a receiver's slow error, s, as for the vessel's receiver.
const BIAS_TIME_S: f64 = 300.0;
/// Fraction of a beacon's stated error that is white between messages.
const WHITE: f64 = 1.0 / 3.0;
/// Random walk of a vessel's velocity after 1 s: for a vessel at rest, m/s, and as a fraction of the speed.
const VELOCITY_WALK_MPS: f64 = 0.02;
const SPEED_WALK: f64 = 0.1;
/// Error of the drone's own receiver per axis, m.
const OWN_SD_M: f64 = 1.0;
/// Difference between mean sea level and the water level, m: tides, geoid, and the receiver's height. It is half of the
/// mission's limit for heights relative to the sea.
const SEA_SD_M: f64 = 4.0;
/// Tilt (rad) and heave rate (m/s) of an undetected deck: an unknown boat in a moderate sea.
const TILT_SD_RAD: f64 = 0.15;
const HEAVE_SD_MPS: f64 = 0.5;
/// Silence after which another beacon of equal or better accuracy takes over, s: three messages of slow beacons.
const REPLACED_AFTER_S: f64 = 3.0;
/// Maximum error of a beacon that replaces an active one, as a fraction of the active one's error: half the variance. A
/// change discards velocity and offset of the track, so two beacons of similar accuracy must not alternate.
const MORE_EXACT: f64 = 0.7;
/// Time after the last message or detection for which its velocity is extrapolated, s. After that, even a vessel at
/// rest may be outside the range of a search.
const LAST_KNOWN_S: f64 = 300.0;
/// Minimum speed at which the course is used as heading, m/s.
const COURSE_MPS: f64 = 0.5;

#[derive(Clone, Copy, Debug)]
struct Axis {
    x: Vector2<f64>,
    p: Matrix2<f64>,
}

impl Axis {
    fn new(m: &DeckBeacon, place: f64, velocity: f64) -> Axis {
        Axis {
            x: Vector2::new(place, velocity),
            p: Matrix2::from_diagonal(&noise(m)),
        }
    }
    /// State after another `dt` seconds at this speed, m/s.
    fn after(&self, dt: f64, speed_mps: f64) -> Axis {
        let f = Matrix2::new(1.0, dt, 0.0, 1.0);
        let walk = (VELOCITY_WALK_MPS + SPEED_WALK * speed_mps).powi(2);
        let cross = 0.5 * walk * dt * dt;
        let place = walk * dt.powi(3) / 3.0;
        let q = Matrix2::new(place, cross, cross, walk * dt);
        Axis {
            x: f * self.x,
            p: f * self.p * f.transpose() + q,
        }
    }
    fn update(&mut self, m: &DeckBeacon, z: Vector2<f64>) {
        let s = self.p + Matrix2::from_diagonal(&noise(m));
        let Some(inverse) = s.try_inverse() else { return };
        let gain = self.p * inverse;
        self.x += gain * (z - self.x);
        self.p = (Matrix2::identity() - gain) * self.p;
    }
}

fn noise(m: &DeckBeacon) -> Vector2<f64> {
    Vector2::new((WHITE * m.place_sd_m).powi(2), m.velocity_sd_mps.powi(2))
}

#[derive(Clone, Copy, Debug)]
pub(super) struct BeaconEstimate {
    /// Centre of the deck, north and east in the drone's NED, m.
    pub(super) place: Vector2<f64>,
    /// Standard deviation of the position per axis, m.
    pub(super) sd_m: f64,
    velocity: Vector2<f64>,
    velocity_sd_mps: f64,
    /// Age of the newest message, s.
    pub(super) age_s: f64,
}

#[derive(Clone, Copy, Debug)]
pub(super) struct BeaconTrack {
    /// Origin of the local frame: the first message's position, so that jumps of the drone's frame have no effect.
    origin: Datum,
    newest: DeckBeacon,
    axes: [Axis; 2],
    /// Deck position by vision minus that by the beacon, m, and its time.
    offset: Option<(DroneTime, Vector2<f64>)>,
}

/// Position or velocity of a vessel, north and east, m or m/s, and its standard deviation per axis.
#[derive(Clone, Copy, Debug)]
pub(super) struct Level {
    pub(super) value: [f64; 2],
    pub(super) sd: f64,
}

impl BeaconTrack {
    /// Track that starts from radio and camera: `place` of the deck in the drone's NED, and mean `velocity`. None for a
    /// vessel that is too fast or too far away for a beacon message.
    pub(super) fn of_vessel(
        now: DroneTime,
        drone: &DroneState,
        place: &Level,
        velocity: &Level,
    ) -> Option<BeaconTrack> {
        let local = Vector2::from(place.value) - drone.datum_offset().xy();
        let origin = Datum {
            height_m: 0.0,
            ..drone.datum
        };
        let there = origin.at(&Vector::<DroneNed>::new(local.x, local.y, 0.0));
        let m = DeckBeacon {
            header: Header::new(drone.header.vessel, drone.header.drone, 0, 0, now),
            source: BeaconSource::Vessel,
            latitude_deg: there.latitude_deg,
            longitude_deg: there.longitude_deg,
            velocity: velocity.value,
            place_sd_m: place.sd.max(MIN_BEACON_SD_M),
            velocity_sd_mps: velocity.sd.clamp(0.01, MAX_BEACON_MPS),
            lasts_s: LAST_KNOWN_S,
        };
        m.check().is_ok().then(|| BeaconTrack::new(&m))
    }
    fn new(m: &DeckBeacon) -> BeaconTrack {
        let v = m.velocity();
        BeaconTrack {
            origin: m.place(),
            newest: *m,
            axes: [0, 1].map(|i| Axis::new(m, 0.0, v[i])),
            offset: None,
        }
    }
    fn lasts(&self, now: DroneTime) -> bool {
        (now - self.newest.header.at).secs() <= self.newest.lasts_s
    }
    fn axes_at(&self, t: DroneTime) -> [Axis; 2] {
        let dt = (t - self.newest.header.at).secs().max(0.0);
        let [north, east] = self.axes.map(|a| a.x[1]);
        self.axes.map(|a| a.after(dt, north.hypot(east)))
    }
    /// Standard deviation of the position at `t` without the camera's correction, m.
    fn sd_m(&self, t: DroneTime) -> f64 {
        let [n, e] = self.axes_at(t).map(|a| a.p[(0, 0)]);
        n.max(e).sqrt().hypot(self.newest.place_sd_m)
    }
    /// Standard deviation of a message's position at `t`, m: as stated, plus possible velocity changes since.
    fn message_sd_m(m: &DeckBeacon, t: DroneTime) -> f64 {
        let variance = |t| BeaconTrack::new(m).sd_m(t).powi(2);
        (m.place_sd_m.powi(2) + (variance(t) - variance(m.header.at))).sqrt()
    }
    /// Adds a checked message. A message from another source replaces the track if the current track has ended, is
    /// clearly less accurate, or is silent and not more accurate. Returns whether the message is used.
    pub(super) fn receive(track: &mut Option<BeaconTrack>, now: DroneTime, m: &DeckBeacon) -> bool {
        let fresh = (now - m.header.at).secs() <= m.lasts_s;
        let known = track.filter(|t| t.lasts(now));
        let Some(mut known) = known.filter(|_| fresh) else {
            *track = fresh.then(|| BeaconTrack::new(m));
            return fresh;
        };
        if known.newest.source != m.source || m.source == BeaconSource::Operator {
            let silent = (now - known.newest.header.at).secs() > REPLACED_AFTER_S;
            let sd_m = BeaconTrack::message_sd_m(m, now);
            let counts = m.source == known.newest.source
                || sd_m <= MORE_EXACT * known.newest.place_sd_m
                || silent && sd_m <= known.sd_m(now);
            if counts {
                *track = Some(BeaconTrack::new(m));
            }
            return counts;
        }
        if m.header.at <= known.newest.header.at {
            return false;
        }
        let place: Vector<DroneNed> = known.origin.to(&m.place());
        let v = m.velocity();
        let mut axes = known.axes_at(m.header.at);
        for (i, axis) in axes.iter_mut().enumerate() {
            axis.update(m, Vector2::new(place.0[i], v[i]));
        }
        known.axes = axes;
        known.newest = *m;
        *track = Some(known);
        true
    }
    /// Updates the beacon's error from the deck's position by vision (north and east in the drone's NED, m).
    pub(super) fn learn(&mut self, now: DroneTime, drone: &DroneState, detected: Vector2<f64>) {
        if let Some(at) = self.placed(now, drone) {
            self.offset = Some((now, detected - at));
        }
    }
    /// Applies a jump of the autopilot's estimate, which moves detection and beacon differently.
    pub(super) fn shift(&mut self, jump: &FrameJump) {
        if let Some((_, offset)) = &mut self.offset {
            *offset += jump.moved.xy() - jump.datum.xy();
        }
    }
    /// Position from the beacon alone, in the drone's NED, m. None if it is too far away for a tangent plane.
    fn placed(&self, now: DroneTime, drone: &DroneState) -> Option<Vector2<f64>> {
        let origin = Datum {
            height_m: 0.0,
            ..drone.datum
        };
        let begins: Vector<DroneNed> = origin.to(&self.origin);
        let local = self.axes_at(now).map(|a| a.x[0]);
        let place = begins.0.xy() + Vector2::from(local) + drone.datum_offset().xy();
        (place.norm() < MAX_POSITION_M).then_some(place)
    }
    /// Current estimate; None once the track has ended.
    pub(super) fn known(&self, now: DroneTime, drone: &DroneState) -> Option<BeaconEstimate> {
        let place = self.placed(now, drone).filter(|_| self.lasts(now))?;
        let axes = self.axes_at(now);
        let slow = self.newest.place_sd_m.hypot(OWN_SD_M).powi(2);
        // The measured part of the slow error decays with its correlation time.
        let (offset, slow) = self.offset.map_or((Vector2::zeros(), slow), |(at, offset)| {
            let keeps = (-(now - at).secs().max(0.0) / BIAS_TIME_S).exp();
            (offset * keeps, slow * (1.0 - keeps * keeps))
        });
        let most = |k: usize| axes.iter().map(|a| a.p[(k, k)]).fold(0.0, f64::max);
        Some(BeaconEstimate {
            place: place + offset,
            sd_m: (most(0) + slow).sqrt(),
            velocity: Vector2::new(axes[0].x[1], axes[1].x[1]),
            velocity_sd_mps: most(1).sqrt(),
            age_s: (now - self.newest.header.at).secs().max(0.0),
        })
    }
}

impl BeaconEstimate {
    /// Distance between `o` and the beacon's position, and its limit, m.
    pub(super) fn apart(&self, o: &DeckObservation) -> Option<[f64; 2]> {
        let [Some((north, _)), Some((east, _)), ..] = o.value else {
            return None;
        };
        let apart = (Vector2::new(north, east) - self.place).norm();
        let limit = PLACE_SD * self.sd_m;
        Some([apart, limit])
    }
    /// Course of the vessel, rad; north for a vessel at rest.
    pub(super) fn course_rad(&self) -> f64 {
        let [north, east] = self.velocity.into();
        if self.velocity.norm() > COURSE_MPS {
            f64::atan2(east, north)
        } else {
            0.0
        }
    }
    /// Stages every `step_s`: a level deck at height `deck_z` (NED, m) on a straight course.
    pub(super) fn stages(&self, deck_z: f64, step_s: f64) -> Seq<DeckStage, FORECAST_STAGES> {
        let v = self.velocity;
        let v_sd = self.velocity_sd_mps;
        Seq::filled((0..FORECAST_STAGES).map(|k| {
            let ahead_s = step_s * k as f64;
            let place = self.place + v * ahead_s;
            let sd = self.sd_m.hypot(v_sd * ahead_s);
            DeckStage {
                position: [place.x, place.y, deck_z],
                velocity: [v.x, v.y, 0.0],
                euler: [0.0, 0.0, self.course_rad()],
                position_sd: [sd, sd, SEA_SD_M],
                velocity_sd: [v_sd, v_sd, HEAVE_SD_MPS],
                acceleration_sd: [HEAVE_SD_MPS; 3],
                euler_sd: [TILT_SD_RAD, TILT_SD_RAD, core::f64::consts::PI],
                euler_rates_sd: [TILT_SD_RAD; 3],
                ..DeckStage::default()
            }
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::{msg::Header, time::Time};

    const ORIGIN: Datum = Datum::new(47.6, -122.4, 12.0);

    fn message(source: BeaconSource, at_s: f64, north_m: f64, place_sd_m: f64) -> DeckBeacon {
        let place = ORIGIN.at(&Vector::<DroneNed>::new(north_m, 300.0, 0.0));
        DeckBeacon {
            header: Header::new(1, 1, 1, at_s as u32, Time::from_secs(at_s)),
            source,
            latitude_deg: place.latitude_deg,
            longitude_deg: place.longitude_deg,
            velocity: [2.0, 0.0],
            place_sd_m,
            velocity_sd_mps: 0.3,
            lasts_s: 10.0,
        }
    }
    fn drone() -> DroneState {
        DroneState {
            datum: ORIGIN,
            ..DroneState::default()
        }
    }
    /// Track of a vessel that moves north at 2 m/s, with one message per second until `until_s`.
    fn followed(until_s: u32) -> Option<BeaconTrack> {
        let mut track = None;
        for k in 0..=until_s {
            let t = f64::from(k);
            let m = message(BeaconSource::GlobalPosition, t, 2.0 * t, 5.0);
            assert!(BeaconTrack::receive(&mut track, Time::from_secs(t), &m));
        }
        track
    }

    #[test]
    fn beacon_predicted_until_it_ends() {
        let track = followed(20).unwrap();
        let known = track.known(Time::from_secs(22.0), &drone()).unwrap();
        assert!(
            (known.place - Vector2::new(44.0, 300.0)).norm() < 0.3,
            "{known:?}"
        );
        assert!(
            (5.0..7.0).contains(&known.sd_m) && known.age_s == 2.0,
            "{known:?}"
        );
        assert!(track.known(Time::from_secs(30.5), &drone()).is_none());
        let later = track.known(Time::from_secs(29.0), &drone()).unwrap();
        assert!(later.sd_m > known.sd_m + 0.5, "{later:?}");
    }

    /// When reception ends, the vessel is known to 0.3 m and 0.1 m/s. Its position then becomes as uncertain as that of
    /// a sortie's beacon.
    #[test]
    fn vessel_known_last() {
        let level = |value, sd| Level { value, sd };
        let of = |speed: f64| {
            let velocity = level([speed, 0.0], 0.1);
            BeaconTrack::of_vessel(
                Time::from_secs(20.0),
                &drone(),
                &level([40.0, 300.0], 0.3),
                &velocity,
            )
        };
        let at = |speed: f64, t: f64| of(speed).unwrap().known(Time::from_secs(20.0 + t), &drone());
        let known = at(2.0, 10.0).unwrap();
        assert!(
            (known.place - Vector2::new(60.0, 300.0)).norm() < 0.1,
            "{known:?}"
        );
        for (speed, t) in [(0.0_f64, 0.0_f64), (0.0, 60.0), (2.0, 10.0), (2.0, 60.0)] {
            let walk = 0.02 + 0.1 * speed;
            let propagated = walk * (t.powi(3) / 3.0_f64).sqrt();
            let expected = propagated.hypot(0.1 * t).hypot(2.0_f64.sqrt()).hypot(1.0 / 3.0);
            let sd_m = at(speed, t).unwrap().sd_m;
            assert!((sd_m - expected).abs() < 0.01, "{speed} {t}: {sd_m} {expected}");
        }
        assert!(at(0.0, LAST_KNOWN_S + 1.0).is_none());
        assert!(of(f64::NAN).is_none() && of(50.0).is_none());
        let jumped = DroneState {
            datum_offset: [7.0, 0.0, 0.0],
            ..drone()
        };
        let known = of(0.0).unwrap().known(Time::from_secs(20.0), &jumped).unwrap();
        assert!(
            (known.place - Vector2::new(47.0, 300.0)).norm() < 0.01,
            "{known:?}"
        );
    }

    #[test]
    fn beacon_error_measured_by_the_camera() {
        let mut track = followed(20).unwrap();
        let now = Time::from_secs(20.0);
        track.learn(now, &drone(), Vector2::new(46.0, 296.0));
        let known = track.known(Time::from_secs(21.0), &drone()).unwrap();
        assert!(
            (known.place - Vector2::new(48.0, 296.0)).norm() < 0.3,
            "{known:?}"
        );
        assert!(known.sd_m < 2.5, "{known:?}");
    }

    #[test]
    fn less_exact_beacon_next_to_another() {
        let mut track = followed(20);
        let now = Time::from_secs(20.5);
        let phone = message(BeaconSource::FollowTarget, 20.4, 500.0, 50.0);
        assert!(!BeaconTrack::receive(&mut track, now, &phone));
        let late = Time::from_secs(32.0);
        let phone = message(BeaconSource::FollowTarget, 32.0, 500.0, 50.0);
        assert!(BeaconTrack::receive(&mut track, late, &phone));
        assert!((track.unwrap().known(late, &drone()).unwrap().place.x - 500.0).abs() < 0.1);
        // Of two beacons with similar accuracy the active one is kept. A clearly more accurate one replaces it at once.
        let mut track = followed(20);
        for (place_sd_m, at_s, counts) in [(5.0, 20.5, false), (4.9, 21.0, false), (3.0, 21.5, true)] {
            let m = message(BeaconSource::FollowTarget, at_s, 40.0, place_sd_m);
            let taken = BeaconTrack::receive(&mut track, Time::from_secs(at_s), &m);
            assert_eq!(taken, counts, "{place_sd_m} m at {at_s} s");
        }
        let mut track = followed(20);
        let now = Time::from_secs(23.5);
        let alike = message(BeaconSource::FollowTarget, 23.5, 40.0, 5.0);
        assert!(BeaconTrack::receive(&mut track, now, &alike), "silent for 3.5 s");
        // The error of an old message exceeds its stated error.
        let now = Time::from_secs(200.0);
        for (at_s, counts) in [(20.0, false), (200.0, true)] {
            let mut track = None;
            let named = message(BeaconSource::Operator, 200.0, 400.0, 12.0);
            assert!(BeaconTrack::receive(&mut track, now, &named));
            let ais = DeckBeacon {
                lasts_s: 200.0,
                ..message(BeaconSource::Ais, at_s, 40.0, 8.0)
            };
            let taken = BeaconTrack::receive(&mut track, now, &ais);
            assert_eq!(taken, counts, "AIS of {at_s} s");
        }
        let mut none = None;
        let old = message(BeaconSource::GlobalPosition, 0.0, 0.0, 5.0);
        assert!(!BeaconTrack::receive(&mut none, now, &old) && none.is_none());
    }
}
