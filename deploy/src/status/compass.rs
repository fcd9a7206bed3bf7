//! Wind, waves and advised heading relative to the vessel's bow, as far as they are known.

use alight_shared::frames::wrap_angle;
use alight_shared::msg::{VesselStatus, Wind};
use serde::Serialize;

use super::situation::Situation;

/// A turn that takes less than a tenth of the tilt away is not worth it.
pub const WORTH_TURNING: f64 = 0.9;
/// A slower vessel has no course over ground, m/s.
const STILL_MPS: f64 = 0.3;
/// A knot, m/s.
const KNOT_MPS: f64 = 1852.0 / 3600.0;
/// What a wind is called that is too light for a direction.
const CALM: &str = "calm";
/// A direction this close to the bow or the stern is named after it, deg.
const ABOUT_DEG: f64 = 5.0;

/// Directions clockwise from the bow, -180 to 180 deg; None: not known.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Compass {
    /// The vessel's mean heading, deg from north.
    pub heading_deg: f64,
    /// Where the wind comes from.
    pub wind_from_deg: Option<f64>,
    /// Where the waves come from.
    pub waves_from_deg: Option<f64>,
    /// The heading to turn to before a landing, where one is worth it.
    pub advised_deg: Option<f64>,
    /// All of it in words.
    pub text: String,
}

/// A wind for people: in knots where the configuration asks for them.
pub fn wind(wind: Wind, knots: bool) -> String {
    let text = wind.to_string();
    if !knots || text == CALM {
        return text;
    }
    format!("{:.0} kn from {}°", wind.speed_mps / KNOT_MPS, wind.from_deg)
}

/// A vessel's speed over ground for the operator, by its velocity to north and east, m/s; and where to, unless it lies still.
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

/// A direction (deg, clockwise from north) seen from the bow.
fn from_bow(direction_deg: f64, heading_deg: f64) -> f64 {
    let turn = wrap_angle((direction_deg - heading_deg).to_radians()).to_degrees();
    (10.0 * turn).round() / 10.0
}

/// In words: `40° to starboard of the bow`.
fn words(from_bow_deg: f64) -> String {
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

/// What the drone knows: the forecast's heading, the mission's wind.
pub fn of_drone(s: &Situation) -> Option<Compass> {
    let heading_deg = s
        .seen
        .forecast
        .fresh(s.now_ns)?
        .mean_heading
        .to_degrees()
        .rem_euclid(360.0);
    let blows = s
        .seen
        .mission
        .fresh(s.now_ns)
        .and_then(|m| m.wind)
        .map(Wind::towards);
    // A calm comes from nowhere.
    let comes = blows.filter(|w| wind(*w, false) != CALM);
    let wind_from_deg = comes.map(|w| from_bow(w.from_deg as f64, heading_deg));
    let text = match (comes, wind_from_deg) {
        (Some(w), Some(from)) => {
            let speed = wind(w, s.known.knots);
            let speed = speed.split(" from").next().unwrap_or_default();
            format!("wind {speed} from {}", words(from))
        }
        _ if blows.is_some() => CALM.into(),
        _ => "wind unknown".into(),
    };
    Some(Compass {
        heading_deg,
        wind_from_deg,
        text,
        ..Compass::default()
    })
}

/// What the vessel knows: the waves and the quietest heading of its own estimate.
pub fn of_vessel(status: &VesselStatus) -> Option<Compass> {
    let h = status.estimator.heading?;
    let [now, there] = h.tilt_deg;
    let waves = from_bow(h.waves_from_deg, h.now_deg);
    let turn = from_bow(h.quietest_deg, h.now_deg);
    let advised_deg = (there < WORTH_TURNING * now).then_some(turn);
    let advice = match advised_deg {
        Some(turn) => format!(
            "turn to {:03.0}°, {}: the deck tilts {there:.1}° instead of {now:.1}°",
            h.quietest_deg,
            words(turn)
        ),
        None => format!("this heading is as quiet as any: the deck tilts {now:.1}°"),
    };
    Some(Compass {
        heading_deg: h.now_deg,
        waves_from_deg: Some(waves),
        advised_deg,
        text: format!("waves from {}; {advice}", words(waves)),
        wind_from_deg: None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::msg::HeadingAdvice;

    #[test]
    fn directions_from_the_bow() {
        assert_eq!(words(from_bow(10.0, 350.0)), "20° to starboard of the bow");
        assert_eq!(words(from_bow(300.0, 350.0)), "50° to port of the bow");
        assert_eq!(words(from_bow(352.0, 350.0)), "ahead");
        assert_eq!(words(from_bow(168.0, 350.0)), "astern");
    }

    #[test]
    fn wind_in_knots() {
        let w = Wind::towards([-6.2, 0.0]);
        assert_eq!(
            (wind(w, false), wind(w, true)),
            ("6 m/s from 0°".into(), "12 kn from 0°".into())
        );
        assert_eq!(wind(Wind::towards([0.1, 0.0]), true), "calm");
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
        assert_eq!(of_vessel(&status), None);
        let mut advice = HeadingAdvice {
            now_deg: 350.0,
            quietest_deg: 30.0,
            tilt_deg: [4.0, 2.0],
            waves_from_deg: 30.0,
        };
        status.estimator.heading = Some(advice);
        let compass = of_vessel(&status).unwrap();
        assert_eq!(
            (compass.waves_from_deg, compass.advised_deg),
            (Some(40.0), Some(40.0))
        );
        assert!(
            compass.text.contains("turn to 030°, 40° to starboard"),
            "{}",
            compass.text
        );
        advice.tilt_deg = [4.0, 3.9];
        status.estimator.heading = Some(advice);
        assert_eq!(of_vessel(&status).unwrap().advised_deg, None);
    }
}
