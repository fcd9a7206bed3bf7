//! Origin of the autopilot's NED, which the drone also uses.

use alight_shared::{
    admission::Periodic,
    geodesy::Datum,
    geoid,
    mavlink::{MessageData as _, dialect as m},
    time::{DroneClock, Span},
};
use nalgebra::Vector3;

use super::{
    DroneTime,
    message::{Address, CommandLong},
    modes::Firmware,
};

/// Request period once the origin is known; a restarted estimator moves the origin.
const KNOWN: Span = Span::from_millis(5000);
const UNKNOWN: Span = Span::from_millis(1000);
/// Maximum height of the geoid relative to the ellipsoid, m (EGM2008: -107 to 86).
const MAX_GEOID_M: f64 = 120.0;
/// Number of origin reports that are held back until the receiver reports both heights.
const REPORTS_WITHOUT_GEOID: u8 = 3;
/// Displacement that makes an origin count as new, m; the message resolves centimetres.
const MOVED_M: f64 = 0.05;

#[derive(Clone, Copy, Debug, Default)]
pub(super) struct AutopilotOrigin {
    pub(super) datum: Option<Datum>,
    /// Height of the sea above the ellipsoid, m; None until determined.
    pub(super) geoid_m: Option<f64>,
    reports: u8,
    /// Reset when the origin may have changed, so that it is requested at once.
    pub(super) timer: Periodic<DroneClock>,
}

impl AutopilotOrigin {
    pub(super) fn ask(&mut self, now: DroneTime, to: Address) -> impl Iterator<Item = CommandLong> {
        let period = if self.datum.is_some() { KNOWN } else { UNKNOWN };
        let due = self.timer.is_due_spaced(now, period);
        let heights = (due && self.geoid_m.is_none()).then_some(m::GPS_RAW_INT_DATA::ID);
        // An autopilot sets home at arming or on command.
        let home = (due && self.datum.is_some()).then_some(m::HOME_POSITION_DATA::ID);
        let all = (heights.into_iter().chain(home)).chain(due.then_some(m::GPS_GLOBAL_ORIGIN_DATA::ID));
        all.map(move |id| CommandLong::request(to, id))
    }
    /// Stores the difference between the receiver's two heights, once per flight so that the origin stays
    /// constant.
    pub(super) fn on_heights(&mut self, sea_m: f64, ellipsoid_m: f64) {
        let geoid_m = ellipsoid_m - sea_m;
        if ellipsoid_m != 0.0 && geoid_m.abs() <= MAX_GEOID_M {
            self.geoid_m.get_or_insert(geoid_m);
        }
    }
    /// Processes a reported origin and its height above the sea. If the receiver reports no heights, the
    /// geoid model is used from the third report on. Returns whether the origin has changed.
    pub(super) fn on_report(&mut self, reported: &Datum) -> bool {
        self.reports = self.reports.saturating_add(1);
        if self.geoid_m.is_none() && self.reports < REPORTS_WITHOUT_GEOID {
            return false;
        }
        let by_model = || {
            let [latitude, longitude] = [reported.latitude_deg, reported.longitude_deg].map(f64::to_radians);
            geoid::undulation(latitude, longitude).height_m
        };
        let geoid_m = *self.geoid_m.get_or_insert_with(by_model);
        let mut origin = *reported;
        origin.height_m += geoid_m;
        let known = self.datum;
        if !origin.is_on_earth() || known.is_some_and(|k| !(k.distance_m(&origin) > MOVED_M)) {
            return false;
        }
        self.datum = Some(origin);
        known.is_some()
    }
    /// Map scale of `firmware` north, east and down: 0.994 to 1.004, an error of 5 m per kilometre.
    pub(super) fn map_scale(&self, firmware: Option<Firmware>) -> Vector3<f64> {
        let known = self.datum.zip(firmware);
        let scale = known.map(|(datum, firmware)| datum.metres_per_map_metre(firmware.map_radius_m()));
        scale.map_or(Vector3::repeat(1.0), |[north, east]| {
            Vector3::new(north, east, 1.0)
        })
    }
}
