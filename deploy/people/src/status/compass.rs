use alight_computer::situation::ObservedSituation;
use alight_shared::{
    frames::wrap_angle,
    geodesy::KNOT_MPS,
    msg::{CourseAdvice, DeckForecast, DroneContact, VesselStatus, Wind},
};
use serde::Serialize;

use super::{Figure, LOST_CONTACT_S, go::descends};

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
    /// Drones that the vessel receives.
    pub drones: Vec<DroneBearing>,
    pub text: String,
}

#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DroneBearing {
    pub number: u32,
    /// Position relative to the deck's centre: forward and to starboard, m.
    pub at: [f64; 2],
    pub stale: bool,
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

/// Wind as a drone has measured it, and the vessel's way: velocities to north and east, m/s.
#[derive(Clone, Copy, Default)]
pub struct Air {
    pub wind: [f64; 2],
    pub sd_mps: f64,
    /// Greatest speed of the last minutes.
    pub gust_mps: Option<f64>,
    pub way: Option<[f64; 2]>,
}

/// Gust of the last minutes, unless it is close to the mean `speed`, both m/s.
pub fn gust(gust_mps: Option<f64>, speed: f64, knots: bool) -> String {
    let (scale, unit) = if knots { (KNOT_MPS, "kn") } else { (1.0, "m/s") };
    let gust = gust_mps.filter(|gust| *gust >= speed + 1.0);
    gust.map_or_else(String::new, |gust| format!(", gusts {:.0} {unit}", gust / scale))
}

/// Text of the wind that a deck under way feels; empty for a vessel at rest.
fn over_the_deck(air: &Air, heading_deg: f64, knots: bool) -> String {
    let [north, east] = air.way.unwrap_or_default();
    if north.hypot(east) < STILL_MPS {
        return String::new();
    }
    let felt = Wind::towards([air.wind[0] - north, air.wind[1] - east]);
    let text = wind(felt, knots);
    let speed = text.split(" from").next().unwrap_or_default();
    let from = bow_text(from_bow(felt.from_deg as f64, heading_deg));
    if text == CALM {
        return "; none over the deck".into();
    }
    format!("; over the deck {speed} from {from}")
}

/// Direction from which the wind blows, deg from the bow, and its text. None if the wind is unknown or calm.
fn wind_from_bow(air: Option<Air>, heading_deg: f64, knots: bool) -> (Option<f64>, String) {
    let Some(air) = air else {
        return (None, "wind unknown".into());
    };
    let blows = Wind::towards(air.wind);
    if wind(blows, false) == CALM {
        return (None, CALM.into());
    }
    if blows.speed_mps < 2.0 * air.sd_mps {
        return (None, "light wind from no certain direction".into());
    }
    let from = from_bow(blows.from_deg as f64, heading_deg);
    let speed = wind(blows, knots);
    let speed = speed.split(" from").next().unwrap_or_default();
    let gust = gust(air.gust_mps, blows.speed_mps, knots);
    let over = over_the_deck(&air, heading_deg, knots);
    (
        Some(from),
        format!("wind {speed}{gust} from {}{over}", bow_text(from)),
    )
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
    let way = mean_velocity(s.snapshot.forecast.as_ref()?);
    let air = s.snapshot.drone.fresh(s.now_ns).and_then(|d| {
        Some(Air {
            wind: d.wind?,
            sd_mps: d.wind_sd_mps.unwrap_or_default(),
            gust_mps: d.gust_mps,
            way: Some(way),
        })
    });
    Some(compass(heading_deg, air, advised(s), s.known.knots))
}

/// Mean velocity of the vessel in the forecast, north and east, m/s.
pub fn mean_velocity(forecast: &DeckForecast) -> [f64; 2] {
    let n = forecast.stages.len().max(1) as f64;
    [0, 1].map(|k: usize| forecast.stages.iter().map(|s| s.velocity[k]).sum::<f64>() / n)
}

fn compass(heading_deg: f64, air: Option<Air>, received: Option<CourseAdvice>, knots: bool) -> Compass {
    let (wind_from_deg, wind) = wind_from_bow(air, heading_deg, knots);
    let (waves_from_deg, advised_deg) = received.as_ref().map(of_advice).unzip();
    let advice = received.map(|a| format!("; {}", advice(&a, knots)));
    Compass {
        heading_deg,
        wind_from_deg,
        waves_from_deg,
        advised_deg: advised_deg.flatten(),
        drones: Vec::new(),
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

/// Compass of the vessel, from its estimate and the drones' reports; `blowing`: wind and gust that a drone has reported.
pub fn of_vessel(
    status: &VesselStatus,
    blowing: Option<([f64; 2], Option<f64>)>,
    knots: bool,
) -> Option<Compass> {
    let heading = status.estimator.heading?;
    let air = blowing.map(|(wind, gust_mps)| Air {
        wind,
        sd_mps: REPORTED_SD_MPS,
        gust_mps,
        way: status.estimator.mean_velocity,
    });
    let drones = status.drones.iter().filter_map(|d| seen(d, heading));
    Some(Compass {
        drones: drones.collect(),
        ..compass(bearing_deg(heading), air, advised_aboard(status), knots)
    })
}

/// Position of a drone in the plan view of a vessel with this heading, rad.
fn seen(d: &DroneContact, heading: f32) -> Option<DroneBearing> {
    let (sin, cos) = (d.status.bearing? - heading).sin_cos();
    let away = d.status.deck_distance_m?;
    Some(DroneBearing {
        number: d.status.header.drone,
        at: [away * cos, away * sin].map(|m| f64::from((10.0 * m).round() / 10.0)),
        stale: d.age_s > LOST_CONTACT_S,
    })
}

#[cfg(test)]
mod tests {
    use alight_shared::msg::{DroneStatus, Seq};

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
    fn wind_over_a_deck_under_way() {
        let over = |wind: [f64; 2], way: [f64; 2]| {
            let air = Air {
                wind,
                way: Some(way),
                ..Air::default()
            };
            over_the_deck(&air, 90.0, false)
        };
        assert_eq!(over([-6.2, 0.0], [0.0; 2]), "");
        assert_eq!(over([0.0, 5.0], [0.0, 5.0]), "; none over the deck");
        assert_eq!(over([0.0, -5.0], [0.0, 3.0]), "; over the deck 8 m/s from ahead");
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
        let drone = DroneStatus {
            deck_distance_m: Some(20.0),
            bearing: Some(rad(80.0)),
            ..DroneStatus::default()
        };
        status.drones = Seq::filled([DroneContact {
            age_s: 0.1,
            status: drone,
        }]);
        let blowing = Some(([-6.2, 0.0], Some(9.0)));
        let compass = of_vessel(&status, blowing, false).unwrap();
        assert_eq!(
            (compass.drones[0].at, compass.drones[0].stale),
            ([0.0, 20.0], false)
        );
        assert!(
            compass
                .text
                .starts_with("wind 6 m/s, gusts 9 m/s from 10° to starboard of the bow; waves from ")
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
