//! Equipment class of the vessel by its sensors, and fit of the drone on its deck. `docs/envelope.md` has the tables.

use alight_computer::config::DroneComputerConfig;
use alight_shared::{
    geometry::{DeckGeometry, DroneGeometry},
    msg::DeckDimensions,
    tags::are_anybodys,
};
use alight_uav::{camera::layout, mission_config::MissionConfig, settings::DroneSettings};

use crate::{
    explain::advice,
    status::finding::{Finding, FindingTopic},
    tools::check::{
        facts::{CameraImages, SourceCheck},
        received::{KindStatistics, SensorStatistics},
    },
};

/// Rate below which a receiver counts as a plotter's, Hz: between 1 Hz and the 4 or 5 Hz of receivers for autopilots.
const SLOW_HZ: f64 = 2.5;
/// Rate of the inertial sensor and of the inertial navigation system in the measured landings, Hz.
const MOTION_HZ: f64 = 20.0;
/// Minimum rate of an attitude without inertial samples, Hz. Chosen: ten samples in a roll period of 2 s, the
/// shortest of a small boat; compass sentences arrive at 1 or 2 Hz.
pub const MIN_ATTITUDE_HZ: f64 = 5.0;
/// Rate, Hz, and maximum age, s, of the slowest receiver in the measured landings.
const RECEIVER_HZ: f64 = 1.0;
const RECEIVER_AGE_S: f64 = 0.6;
/// Fraction of a rate that suffices, because a rate over a short time is uncertain by one measurement.
const NEARLY: f64 = 0.8;
/// Heading errors in the measured landings, deg: of a compass with an inertial sensor, and of two antennas of an
/// inertial navigation system, by its maker's data sheet.
const COMPASS_DEG: f64 = 3.0;
const ANTENNAS_DEG: f64 = 1.0;
/// Tilt error of an inertial navigation system, deg. Chosen: typical of a small one; the measured landings had less.
const TILT_DEG: f64 = 0.5;
/// Offset of a principal point from the image centre, as a fraction of a side, that indicates another image size.
/// Chosen: real lenses are within some per cent; for images twice as wide the offset is 0.5.
const OFF_MIDDLE: f64 = 0.2;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum VesselClass {
    /// Inertial samples, and a receiver of some hertz.
    AutopilotAboard,
    /// Inertial samples, and a receiver of 1 Hz.
    SlowReceiver,
    /// Attitude, rates and heave of an inertial navigation system.
    InertialNavigation,
}

impl VesselClass {
    const ALL: [VesselClass; 3] = [
        VesselClass::AutopilotAboard,
        VesselClass::SlowReceiver,
        VesselClass::InertialNavigation,
    ];
    /// 99th percentile of a landing's distance from the deck's centre, m, with sensors mounted accurately or with an
    /// error of 2 deg. Source: 400 landings of each at Moderate without wind, seeds from 20000 (scenes of `study
    /// sensors`).
    const fn p99_m(self) -> f64 {
        match self {
            VesselClass::AutopilotAboard => 0.15,
            VesselClass::SlowReceiver => 0.16,
            VesselClass::InertialNavigation => 0.13,
        }
    }
    const fn name(self) -> &'static str {
        match self {
            VesselClass::AutopilotAboard => "an autopilot aboard (inertial sensor, receiver of some hertz)",
            VesselClass::SlowReceiver => "a plotter's receiver with an inertial sensor",
            VesselClass::InertialNavigation => "an inertial navigation system",
        }
    }
}

#[derive(Clone, Debug, PartialEq)]
enum Gap {
    /// Quantity without which the estimator does not start.
    Missing(&'static str),
    /// Quantity that is too slow for the deck's motion: its rate, Hz, and the required rate.
    TooSlow(&'static str, f64, &'static str),
    /// Closest class, and the respects in which the sensors of the measured landings were better.
    Unmeasured(VesselClass, Vec<String>),
}

/// Class of a vessel by rate, age and noise of its measurements.
fn class(given: &SensorStatistics) -> Result<VesselClass, Gap> {
    let (gnss, heading) = match (given.inertial.or(given.attitude), given.gnss, given.heading) {
        (None, _, _) => return Err(Gap::Missing("neither inertial samples nor an attitude")),
        (Some(_), None, _) => return Err(Gap::Missing("no GNSS fixes")),
        (Some(_), Some(_), None) => return Err(Gap::Missing("no heading")),
        (Some(_), Some(gnss), Some(heading)) => (gnss, heading),
    };
    let alone = given.attitude.filter(|_| given.inertial.is_none());
    let navigated = "20 Hz, with angular rates and heave, is the rate of the measured landings";
    let needs = [
        (
            "inertial samples",
            given.inertial,
            NEARLY * MOTION_HZ,
            "20 Hz or more is needed",
        ),
        ("attitude", alone, MIN_ATTITUDE_HZ, navigated),
        (
            "GNSS fixes",
            Some(gnss),
            NEARLY * RECEIVER_HZ,
            "1 Hz or more is needed",
        ),
    ];
    for (what, statistics, min_hz, needed) in needs {
        if let Some(f) = statistics.filter(|f| !(f.rate_hz >= min_hz)) {
            return Err(Gap::TooSlow(what, f.rate_hz, needed));
        }
    }
    let class = match alone {
        Some(_) => VesselClass::InertialNavigation,
        None if gnss.rate_hz < SLOW_HZ => VesselClass::SlowReceiver,
        None => VesselClass::AutopilotAboard,
    };
    let worse = worse(alone, &gnss, &heading);
    if worse.is_empty() {
        return Ok(class);
    }
    Err(Gap::Unmeasured(class, worse))
}

/// Respects in which sensors are worse than in the measured landings. `alone`: attitude without inertial samples.
fn worse(alone: Option<KindStatistics>, gnss: &KindStatistics, heading: &KindStatistics) -> Vec<String> {
    let mut all = Vec::new();
    if let Some(attitude) = alone {
        if !(attitude.rate_hz >= NEARLY * MOTION_HZ) {
            all.push(format!("attitude at {:.1} Hz (20 Hz)", attitude.rate_hz));
        }
        let tilt_deg = attitude.sd.to_degrees();
        if tilt_deg > TILT_DEG {
            all.push(format!("tilt +- {tilt_deg:.1} deg ({TILT_DEG} deg)"));
        }
        all.extend((!attitude.with_rates).then(|| "no angular rates".to_owned()));
        all.extend((!attitude.with_heave).then(|| "no sensor measures heave".to_owned()));
    }
    if gnss.age_s > RECEIVER_AGE_S {
        all.push(format!(
            "GNSS fixes {:.1} s late ({RECEIVER_AGE_S} s)",
            gnss.age_s
        ));
    }
    let most_deg = if alone.is_some() {
        ANTENNAS_DEG
    } else {
        COMPASS_DEG
    };
    let heading_deg = heading.sd.to_degrees();
    if heading_deg > most_deg {
        all.push(format!("heading +- {heading_deg:.1} deg ({most_deg} deg)"));
    }
    all
}

/// Class of a vessel by the measurements of all its sources; None while a source yields no data, which is a separate
/// finding.
pub fn vessel(sources: &[SourceCheck], given: &SensorStatistics) -> Option<Finding> {
    const TOPIC: FindingTopic = FindingTopic("class");
    let gave_some = |source: &SourceCheck| {
        let status = source.received.as_ref().ok();
        status.is_some_and(|(_, status)| status.newest_s.is_some() || status.given.iter().any(|n| *n > 0))
    };
    if sources.is_empty() || !sources.iter().all(gave_some) {
        return None;
    }
    Some(match class(given) {
        Ok(class) => TOPIC.fine(format!(
            "{}: 99 of 100 landings within {:.2} m (Moderate, no wind)",
            class.name(),
            class.p99_m()
        )),
        Err(Gap::Missing(missing)) => TOPIC.broken(
            format!("the sources gave {missing}: the vessel's estimator does not start"),
            "add a source that measures it, or set this one to send it (alight help envelope)",
        ),
        Err(Gap::TooSlow(what, rate_hz, needed)) => TOPIC.broken(
            format!("{what} at {rate_hz:.1} Hz: too slow for a rocking deck ({needed})"),
            "raise the rate of the sensor and of its gateway, or add an inertial sensor (alight help envelope)",
        ),
        Err(Gap::Unmeasured(class, worse)) => TOPIC.warning(
            format!(
                "no landing was measured with these sensors, so no accuracy is stated; {} differs in: {}",
                class.name(),
                worse.join(", ")
            ),
            "set the sensor to the values in brackets, or add an inertial sensor (alight help envelope)",
        ),
    })
}

/// Whether the deck's dimensions match those that the vessel states, and whether 99 of 100 landings have all feet on
/// the deck, on a vessel of the class with the largest errors.
pub fn deck(deck: &DeckGeometry, drone: &DroneGeometry, vessel: Option<DeckDimensions>) -> Finding {
    const TOPIC: FindingTopic = FindingTopic("deck");
    if let Some(why) = vessel.and_then(|vessel| deck.dimensions().differs_from(&vessel)) {
        return TOPIC.broken(why.to_string(), advice(why.code));
    }
    let p99 = VesselClass::ALL
        .map(VesselClass::p99_m)
        .into_iter()
        .fold(0.0, f64::max);
    let sides = [
        ("length_m", deck.length_m, drone.feet_span_m[0]),
        ("width_m", deck.width_m, drone.feet_span_m[1]),
    ];
    let margin = |(_, side, feet): (&str, f64, f64)| 0.5 * (side - feet);
    let [length, width] = sides;
    let smallest = if margin(length) < margin(width) {
        length
    } else {
        width
    };
    let (key, side, feet) = smallest;
    let room = margin(smallest);
    if room < p99 {
        TOPIC.broken(
            format!(
                "drone.deck.{key} {side:.2} m leaves {room:.2} m on each side of feet {feet:.2} m apart; 1 of 100 \
                 landings is {p99:.2} m off"
            ),
            format!("a deck of {:.2} m or more, or a drone with closer feet", feet + 2.0 * p99),
        )
    } else {
        TOPIC.fine(format!(
            "{room:.2} m on each side of the feet; 99 of 100 landings are within {p99:.2} m"
        ))
    }
}

pub fn tags(drone: &DroneSettings) -> Finding {
    const TOPIC: FindingTopic = FindingTopic("tags");
    let tags = drone.tags();
    let faults = layout::faults(&tags, &drone.deck);
    if !faults.is_empty() {
        return TOPIC.broken(
            faults.join("; "),
            "correct drone.deck.tags; `alight tag --suggest` prints the list that is suggested for the deck's size",
        );
    }
    let gaps = layout::gaps(&tags, &drone.camera, &drone.airframe);
    if gaps.is_empty() && are_anybodys(&tags) {
        return TOPIC.warning(
            format!(
                "their numbers are the family's first ({}), which any other boat may use: a drone distinguishes two such boats by \
                 position only",
                tags.iter().map(|t| t.id).min().unwrap_or_default()
            ),
            "print tags of this boat's own numbers: `alight tag --suggest --vessel N`, and set drone.deck.tags to that list",
        );
    }
    if gaps.is_empty() {
        return TOPIC.fine(format!(
            "{} on the deck, one of them in sight from 10 m to contact",
            tags.len()
        ));
    }
    let gaps: Vec<String> = gaps
        .iter()
        .map(|[low, high]| format!("{low:.2} to {high:.2} m"))
        .collect();
    TOPIC.warning(
        format!(
            "with the feet {} above the deck no tag may be whole in the image (drone 0.2 m off the deck's centre or 8 deg \
             against it)",
            gaps.join(" and ")
        ),
        "add tags of a size and place that are in view there; `alight tag --suggest` prints the list that is suggested for the deck's size",
    )
}

/// Finding on an endurance that limits trust in the battery's gauge.
pub fn battery(mission: &MissionConfig) -> Finding {
    const TOPIC: FindingTopic = FindingTopic("battery");
    let full_s = mission.battery_endurance_s;
    if full_s > 0.0 {
        return TOPIC.fine(format!(
            "a full battery is assumed to last {full_s:.0} s of flight, whatever its gauge reads"
        ));
    }
    TOPIC.warning(
        "drone.mission.battery_endurance_s is not set: a gauge that falls too slowly is trusted until the drone falls, and with a \
         silent or stuck one an endurance of 300 s is assumed",
        "hover with the load from a full battery until the gauge reads 0 (or until 50 %, doubled), and set it to that time in seconds",
    )
}

/// Findings on camera calibrations that appear to belong to another image size.
pub fn lenses(drone: &DroneComputerConfig) -> Vec<Finding> {
    let (tag, markers) = (&drone.drone.camera.lens, &drone.drone.camera.uvdar.lens);
    let belly = || {
        let size_px = [tag.width_px, tag.height_px];
        lens("camera", "drone.camera.lens", size_px, tag.centre_px)
    };
    let uvdar = || {
        let size_px = [markers.width_px, markers.height_px];
        lens("uvdar", "drone.camera.uvdar.lens", size_px, markers.centre_px)
    };
    let found = [
        drone.camera.is_there().then(belly).flatten(),
        drone.ultraviolet().is_there().then(uvdar).flatten(),
    ];
    found.into_iter().flatten().collect()
}

fn lens(topic: &'static str, key: &str, size_px: [u32; 2], centre_px: [f64; 2]) -> Option<Finding> {
    let sides = size_px.map(f64::from);
    let parts = centre_px
        .iter()
        .zip(sides)
        .map(|(at, side)| (at / side - 0.5).abs());
    let off = parts.fold(0.0, f64::max);
    let ([width, height], [x, y]) = (size_px, centre_px);
    (off > OFF_MIDDLE).then(|| {
        FindingTopic(topic).warning(
            format!(
                "{key}.centre_px is [{x}, {y}], {:.0} % of a side off the middle of {width} x {height} px: a calibration of \
                 images of another size",
                100.0 * off
            ),
            "set width_px and height_px to the size of the images that were calibrated with, or calibrate again \
             (alight help camera)",
        )
    })
}

pub fn no_tag(topic: FindingTopic, view: &CameraImages, exposure: &str) -> Finding {
    let images = view.images;
    match view.foreign_tag {
        None => topic.fine(format!("{images} images{exposure}; no tag in view")),
        Some(tag) => topic.warning(format!("{images} images{exposure}; {tag}"), tag.remedy()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(rate_hz: f64) -> KindStatistics {
        KindStatistics {
            rate_hz,
            ..KindStatistics::default()
        }
    }
    /// Sensors with these rates, Hz; a rate of zero means that the sensor is absent. The attitude includes every
    /// optional quantity.
    fn given([imu, gnss, heading, attitude]: [f64; 4]) -> SensorStatistics {
        let some = |rate_hz: f64| (rate_hz > 0.0).then(|| at(rate_hz));
        SensorStatistics {
            inertial: some(imu),
            gnss: some(gnss),
            heading: some(heading),
            attitude: some(attitude).map(|f| KindStatistics {
                with_rates: true,
                with_heave: true,
                ..f
            }),
        }
    }

    #[test]
    fn equipment_class_by_rates() {
        let of = |rates| class(&given(rates));
        assert_eq!(of([50.0, 5.0, 10.0, 50.0]), Ok(VesselClass::AutopilotAboard));
        assert_eq!(of([100.0, 1.0, 10.0, 0.0]), Ok(VesselClass::SlowReceiver));
        assert_eq!(of([0.0, 10.0, 10.0, 20.0]), Ok(VesselClass::InertialNavigation));
        for (rates, missing) in [
            ([0.0, 1.0, 10.0, 0.0], "inertial"),
            ([100.0, 0.0, 10.0, 0.0], "GNSS"),
            ([100.0, 10.0, 0.0, 0.0], "heading"),
        ] {
            let gap = of(rates).unwrap_err();
            assert!(matches!(gap, Gap::Missing(m) if m.contains(missing)), "{gap:?}");
        }
        for (rates, slow) in [
            ([0.0, 1.0, 10.0, 1.0], "attitude"),
            ([0.0, 1.0, 10.0, 2.0], "attitude"),
            ([10.0, 5.0, 10.0, 0.0], "inertial samples"),
            ([50.0, 0.5, 10.0, 0.0], "GNSS fixes"),
        ] {
            let gap = of(rates).unwrap_err();
            assert!(matches!(gap, Gap::TooSlow(what, _, _) if what == slow), "{gap:?}");
        }
    }

    #[test]
    fn equipment_class_of_sensors_that_were_not_measured() {
        fn differs(change: fn(&mut SensorStatistics)) -> String {
            let mut sensors = given([0.0, 10.0, 10.0, 20.0]);
            change(&mut sensors);
            match class(&sensors) {
                Err(Gap::Unmeasured(VesselClass::InertialNavigation, worse)) => worse.join(", "),
                other => panic!("{other:?}"),
            }
        }
        assert_eq!(
            differs(|m| m.attitude = Some(at(10.0))),
            "attitude at 10.0 Hz (20 Hz), no angular rates, no sensor measures heave"
        );
        let compass = KindStatistics {
            sd: 0.035,
            ..at(10.0)
        };
        let by_compass = given([0.0, 10.0, 10.0, 20.0]);
        let by_compass = SensorStatistics {
            heading: Some(compass),
            ..by_compass
        };
        let expected = vec!["heading +- 2.0 deg (1 deg)".to_owned()];
        assert_eq!(
            class(&by_compass),
            Err(Gap::Unmeasured(VesselClass::InertialNavigation, expected))
        );
        let late = differs(|m| {
            m.gnss = Some(KindStatistics {
                age_s: 0.9,
                ..at(10.0)
            })
        });
        assert_eq!(late, "GNSS fixes 0.9 s late (0.6 s)");
        // Together with an inertial sensor the same compass suffices.
        let with_inertial = SensorStatistics {
            inertial: Some(at(50.0)),
            ..by_compass
        };
        assert_eq!(class(&with_inertial), Ok(VesselClass::AutopilotAboard));
    }

    #[test]
    fn vessel_with_an_attitude_once_a_second() {
        use crate::status::finding::FindingLevel;
        use alight_shared::msg::SourceStatus;
        let source = |given| SourceCheck {
            name: "nmea".into(),
            connect: "udpin://127.0.0.1:12162".into(),
            received: Ok((
                900,
                SourceStatus {
                    given,
                    ..SourceStatus::default()
                },
            )),
            remarks: Vec::new(),
        };
        let slow = given([0.0, 1.0, 10.0, 1.0]);
        let found = vessel(&[source([0, 3, 25, 3])], &slow).unwrap();
        assert_eq!(found.level, FindingLevel::Broken);
        assert!(
            found
                .found
                .starts_with("attitude at 1.0 Hz: too slow for a rocking deck"),
            "{found}"
        );
        assert_eq!(vessel(&[source([0; 4])], &slow), None);
        // A source that sends only RTCM yields no measurements.
        let mut base = source([0; 4]);
        base.received.as_mut().unwrap().1.newest_s = Some(1.0);
        assert!(vessel(&[source([0, 3, 25, 3]), base], &slow).is_some());
        assert_eq!(vessel(&[], &SensorStatistics::default()), None);
    }

    #[test]
    fn tags_with_a_gap_or_a_fault() {
        use crate::status::finding::FindingLevel;
        use alight_shared::tags::{Tags, of_vessel};
        let mut drone = DroneSettings::default();
        let first = tags(&drone);
        assert_eq!(first.level, FindingLevel::Warning);
        assert!(first.found.contains("the family's first (0)"), "{}", first.found);
        drone.deck.tags = of_vessel(&drone.tags(), 7);
        assert_eq!(tags(&drone).level, FindingLevel::Fine);
        drone.deck.tags = Tags::new();
        drone.deck.tag_side_m = Some(1.0);
        let one = tags(&drone);
        assert_eq!(one.level, FindingLevel::Warning);
        assert!(one.found.starts_with("with the feet 0.00 to 1."), "{}", one.found);
        drone.deck.tag_side_m = Some(1.6);
        let large = tags(&drone);
        assert_eq!(large.level, FindingLevel::Broken);
        assert!(large.found.contains("0.150 m beyond"), "{}", large.found);
    }

    #[test]
    fn lens_of_a_calibration_of_another_size() {
        let mut drone = DroneComputerConfig::default();
        drone.camera.source = "/dev/video0".into();
        drone.drone.camera.lens.centre_px = [317.1, 255.8];
        assert_eq!(lenses(&drone), []);
        // Principal point of an image of 1280 x 720 px, which also lies within one of 640 x 480 px.
        drone.drone.camera.lens.centre_px = [638.2, 358.0];
        let found = lenses(&drone);
        assert!(
            found.len() == 1 && found[0].found.contains("[638.2, 358], 50 % of a side"),
            "{found:?}"
        );
        drone.camera.source.clear();
        assert_eq!(lenses(&drone), []);
    }

    #[test]
    fn deck_too_small_for_the_feet() {
        use crate::status::finding::FindingLevel;
        let drone = DroneGeometry::default();
        let of = |side: f64| DeckGeometry {
            length_m: 2.5,
            width_m: side,
            ..DeckGeometry::default()
        };
        assert_eq!(
            deck(&of(1.7), &drone, Some(of(1.7).dimensions())).level,
            FindingLevel::Fine
        );
        let other = deck(&of(1.7), &drone, Some(of(1.9).dimensions()));
        assert_eq!(other.level, FindingLevel::Broken);
        assert!(
            other.found.contains("1.70 m") && other.found.contains("1.90 m"),
            "{}",
            other.found
        );
        let small = deck(&of(0.6), &drone, None);
        assert_eq!(small.level, FindingLevel::Broken);
        assert!(
            small.found.contains("drone.deck.width_m 0.60 m leaves 0.10 m"),
            "{}",
            small.found
        );
    }
}
