use alight_computer::situation::ObservedSituation;
use alight_shared::frames::wrap_angle;
use alight_shared::geodesy::KNOT_MPS;
use alight_shared::msg::{CourseAdvice, VesselStatus, Wind};
use serde::Serialize;

use super::Figure;
use super::go::descends;

/// Minimum speed for a course over ground to be shown, m/s.
const STILL_MPS: f64 = 0.3;
const CALM: &str = "calm";
/// Half the deviation below which a drone reports the wind, m/s: its report has no deviation.
const REPORTED_SD_MPS: f64 = 1.5;
/// Half-width of the sectors called ahead and astern, deg.
const ABOUT_DEG: f64 = 5.0;

/// Directions clockwise from the bow, -180 to 180 deg; None if unknown.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Compass {
    pub heading_deg: f64,
    pub wind_from_deg: Option<f64>,
    pub waves_from_deg: Option<f64>,
    /// Heading advised before a landing, if turning is worthwhile.
    pub advised_deg: Option<f64>,
    pub text: String,
}

pub fn wind(wind: Wind, knots: bool) -> String {
    let text = wind.to_string();
    if !knots || text == CALM {
        return text;
    }
    format!("{:.0} kn from {}°", wind.speed_mps / KNOT_MPS, wind.from_deg)
}

pub fn known_to(sd_mps: f64, knots: bool) -> String {
    let (scale, unit) = if knots { (KNOT_MPS, "kn") } else { (1.0, "m/s") };
    format!("known to {:.1} {unit} (one standard deviation)", sd_mps / scale)
}

/// Texts of a vessel's speed and its course over ground in deg, the latter None when stationary. Arguments: velocity
/// to north and east, m/s.
pub fn speed([north, east]: [f64; 2], knots: bool) -> (String, Option<f64>) {
    let mps = north.hypot(east);
    let text = if knots {
        format!("{:.1} kn", mps / KNOT_MPS)
    } else {
        format!("{mps:.1} m/s")
    };
    let course_deg = east.atan2(north).to_degrees().rem_euclid(360.0);
    (text, (mps >= STILL_MPS).then_some(course_deg))
}

/// Direction relative to the bow, deg, of a direction clockwise from north, deg.
pub fn from_bow(direction_deg: f64, heading_deg: f64) -> f64 {
    let turn = wrap_angle((direction_deg - heading_deg).to_radians()).to_degrees();
    (10.0 * turn).round() / 10.0
}

pub fn bow_text(from_bow_deg: f64) -> String {
    let size = from_bow_deg.abs();
    let side = if from_bow_deg < 0.0 { "port" } else { "starboard" };
    if size <= ABOUT_DEG {
        "ahead".into()
    } else if size >= 180.0 - ABOUT_DEG {
        "astern".into()
    } else {
        format!("{size:.0}° to {side} of the bow")
    }
}

/// Direction from which the wind blows, deg from the bow, and its text. None if the wind is unknown or calm.
fn wind_from_bow(blows: Option<Wind>, sd_mps: f64, heading_deg: f64, knots: bool) -> (Option<f64>, String) {
    let Some(blows) = blows else {
        return (None, "wind unknown".into());
    };
    if wind(blows, false) == CALM {
        return (None, CALM.into());
    }
    if blows.speed_mps < 2.0 * sd_mps {
        return (None, "light wind from no certain direction".into());
    }
    let from = from_bow(blows.from_deg as f64, heading_deg);
    let speed = wind(blows, knots);
    let speed = speed.split(" from").next().unwrap_or_default();
    (Some(from), format!("wind {speed} from {}", bow_text(from)))
}

/// The vessel's advice, except during a descent, which a turn would break off.
pub fn advised(s: &ObservedSituation) -> Option<CourseAdvice> {
    let descends = s.snapshot.mission.is_some_and(|m| descends(m.state));
    let advice = s.snapshot.wave.fresh(s.now_ns)?.advice;
    if descends { None } else { advice }
}

/// Compass of the drone, from the forecast's heading, the odometry's wind and the vessel's advice.
pub fn of_drone(s: &ObservedSituation) -> Option<Compass> {
    let heading_deg = s
        .snapshot
        .forecast
        .fresh(s.now_ns)?
        .mean_heading
        .to_degrees()
        .rem_euclid(360.0);
    let drone = s.snapshot.drone.fresh(s.now_ns);
    let blows = drone.and_then(|d| d.wind).map(Wind::towards);
    let sd_mps = drone.and_then(|d| d.wind_sd_mps).unwrap_or_default();
    Some(compass(heading_deg, blows, sd_mps, advised(s), s.known.knots))
}

fn compass(
    heading_deg: f64,
    blows: Option<Wind>,
    sd_mps: f64,
    received: Option<CourseAdvice>,
    knots: bool,
) -> Compass {
    let (wind_from_deg, wind) = wind_from_bow(blows, sd_mps, heading_deg, knots);
    let (waves_from_deg, advised_deg) = received.as_ref().map(of_advice).unzip();
    let advice = received.map(|a| format!("; {}", advice(&a, knots)));
    Compass {
        heading_deg,
        wind_from_deg,
        waves_from_deg,
        advised_deg: advised_deg.flatten(),
        text: wind + &advice.unwrap_or_default(),
    }
}

pub fn bearing_deg(rad: f32) -> f64 {
    f64::from(rad).to_degrees().rem_euclid(360.0)
}

/// Text of waves and advised course: `waves from 20° to port of the bow; turn to 030°, ...`.
pub fn advice(a: &CourseAdvice, knots: bool) -> String {
    let [now, best] = a.heading.map(bearing_deg);
    let waves = bow_text(from_bow(bearing_deg(a.waves_to) + 180.0, now));
    let percent = a.likelihood.map(|p| format!("{:.0} %", 100.0 * p));
    let tilt = a.tilt.map(|rad| format!("{:.1}°", rad.to_degrees()));
    if !a.is_change() {
        return format!(
            "waves from {waves}; no other course is better: {} of landings succeed, the deck tilts {}",
            percent[0], tilt[0]
        );
    }
    let turn = from_bow(best, now);
    let heading = if turn == 0.0 {
        "keep the heading".to_owned()
    } else {
        format!("turn to {best:03.0}°, {}", bow_text(turn))
    };
    let slower = if a.speed[0] == a.speed[1] {
        String::new()
    } else {
        let (scale, unit) = if knots { (KNOT_MPS, "kn") } else { (1.0, "m/s") };
        format!(", at {:.0} {unit}", f64::from(a.speed[1]) / scale)
    };
    format!(
        "waves from {waves}; {heading}{slower}: {} of landings succeed instead of {}, the deck tilts {} instead of {} \
         ({:.0} s; {:.0} m of way a minute)",
        percent[1], percent[0], tilt[1], tilt[0], a.turn_s, a.way_lost_m
    )
}

pub fn figure(a: &CourseAdvice, knots: bool) -> Figure {
    Figure::of(
        "heading",
        format!("{:03.0} deg", bearing_deg(a.heading[0])),
        advice(a, knots),
    )
}

/// Direction from which the waves come, and the advised turn, if any, deg from the bow.
fn of_advice(a: &CourseAdvice) -> (f64, Option<f64>) {
    let [now, best] = a.heading.map(bearing_deg);
    let waves = from_bow(bearing_deg(a.waves_to) + 180.0, now);
    (waves, a.is_change().then(|| from_bow(best, now)))
}

/// Advice for the helm, except while a drone descends, which a turn would break off.
pub fn advised_aboard(status: &VesselStatus) -> Option<CourseAdvice> {
    if status.drones.iter().any(|d| descends(d.status.state)) {
        None
    } else {
        status.estimator.advice
    }
}

/// Compass of the vessel, from its estimate and the wind that a drone has reported.
pub fn of_vessel(status: &VesselStatus, blows: Option<Wind>, knots: bool) -> Option<Compass> {
    let heading_deg = bearing_deg(status.estimator.heading?);
    let received = advised_aboard(status);
    Some(compass(heading_deg, blows, REPORTED_SD_MPS, received, knots))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directions_from_the_bow() {
        assert_eq!(bow_text(from_bow(10.0, 350.0)), "20° to starboard of the bow");
        assert_eq!(bow_text(from_bow(300.0, 350.0)), "50° to port of the bow");
        assert_eq!(bow_text(from_bow(352.0, 350.0)), "ahead");
        assert_eq!(bow_text(from_bow(168.0, 350.0)), "astern");
    }

    #[test]
    fn wind_in_knots() {
        let w = Wind::towards([-6.2, 0.0]);
        assert_eq!(
            (wind(w, false), wind(w, true)),
            ("6 m/s from 0°".into(), "12 kn from 0°".into())
        );
        assert_eq!(wind(Wind::towards([0.1, 0.0]), true), "calm");
        assert_eq!(known_to(0.5, true), "known to 1.0 kn (one standard deviation)");
    }

    #[test]
    fn speed_in_knots() {
        assert_eq!(speed([0.0, -2.0], true), ("3.9 kn".into(), Some(270.0)));
        assert_eq!(speed([2.0, 0.0], false), ("2.0 m/s".into(), Some(0.0)));
        assert_eq!(speed([0.1, 0.2], false), ("0.2 m/s".into(), None));
    }

    #[test]
    fn advised_heading_of_a_vessel() {
        let mut status = VesselStatus::default();
        assert_eq!(of_vessel(&status, None, false), None);
        let rad = |deg: f64| deg.to_radians() as f32;
        let mut a = CourseAdvice {
            heading: [rad(350.0), rad(30.0)],
            speed: [5.0, 3.0],
            likelihood: [0.81, 0.97],
            tilt: [rad(4.0), rad(2.0)],
            turn_s: 7.0,
            way_lost_m: 162.0,
            waves_to: rad(210.0),
        };
        status.estimator.advice = Some(a);
        status.estimator.heading = Some(a.heading[0]);
        let compass = of_vessel(&status, Some(Wind::towards([-6.2, 0.0])), false).unwrap();
        assert!(
            compass
                .text
                .starts_with("wind 6 m/s from 10° to starboard of the bow; waves from ")
        );
        assert_eq!(compass.wind_from_deg, Some(10.0));
        assert_eq!(
            (compass.waves_from_deg, compass.advised_deg),
            (Some(40.0), Some(40.0))
        );
        let text = compass.text;
        assert!(
            text.contains("turn to 030°, 40° to starboard of the bow, at 3 m/s: 97 % of landings succeed instead of 81 %"),
            "{text}"
        );
        let in_knots = of_vessel(&status, None, true).unwrap().text;
        assert!(in_knots.contains("of the bow, at 6 kn: 97 %"), "{in_knots}");
        a.heading[1] = a.heading[0];
        assert!(advice(&a, false).contains("keep the heading, at 3 m/s"));
        a.speed[1] = a.speed[0];
        status.estimator.advice = Some(a);
        assert_eq!(of_vessel(&status, None, false).unwrap().advised_deg, None);
    }
}
