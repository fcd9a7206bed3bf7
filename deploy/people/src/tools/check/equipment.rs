//! Equipment class of the vessel by its sensors, and fit of the drone to its deck: `docs/equipment.md` has the tables
//! of these figures.

use alight_shared::geometry::{DeckGeometry, DroneGeometry};
use alight_shared::tags::are_anybodys;
use alight_uav::camera::layout;
use alight_uav::settings::DroneSettings;

use crate::status::finding::{Finding, Topic};
use crate::tools::check::facts::SourceCheck;
use crate::tools::check::sources::LISTEN_S;

/// A receiver that reports less often is a plotter's, Hz: between 1 Hz and the 4 or 5 Hz of those for autopilots.
const SLOW_HZ: f64 = 2.5;

/// What a vessel measures its motion with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum VesselClass {
    /// Inertial samples, and a receiver of some hertz.
    AutopilotAboard,
    /// Inertial samples, and a receiver of 1 Hz.
    SlowReceiver,
    /// Attitude, rates and heave of a system that integrates for itself.
    InertialNavigation,
}

impl VesselClass {
    const ALL: [VesselClass; 3] = [
        VesselClass::AutopilotAboard,
        VesselClass::SlowReceiver,
        VesselClass::InertialNavigation,
    ];
    /// Distance from the deck's centre that one landing of a hundred exceeds, m, mounted well or 2 deg askew.
    /// Source: 400 landings of each at Moderate without wind, seeds from 20000 (`study sensors`' scenes).
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
            VesselClass::SlowReceiver => "a plotter's receiver with an inertial sensor beside it",
            VesselClass::InertialNavigation => "an inertial navigation system",
        }
    }
}

/// The class of a vessel by what all its sources gave, or what is missing.
fn class(given: [u64; 4]) -> Result<VesselClass, &'static str> {
    let [imu, gnss, heading, attitude] = given;
    let slow = gnss as f64 / LISTEN_S < SLOW_HZ;
    match (imu > 0 || attitude > 0, gnss > 0, heading > 0) {
        (false, _, _) => Err("neither inertial samples nor an attitude"),
        (true, false, _) => Err("no GNSS fixes"),
        (true, true, false) => Err("no heading"),
        (true, true, true) if imu == 0 => Ok(VesselClass::InertialNavigation),
        (true, true, true) if slow => Ok(VesselClass::SlowReceiver),
        (true, true, true) => Ok(VesselClass::AutopilotAboard),
    }
}

/// The class of a vessel whose sources were listened to; nothing while one of them gave nothing, which is a finding of its
/// own.
pub fn vessel(sources: &[SourceCheck]) -> Option<Finding> {
    const TOPIC: Topic = Topic("class");
    let mut given = [0; 4];
    for source in sources {
        let (_, status) = source.received.as_ref().ok()?;
        if status.given.iter().all(|n| *n == 0) {
            return None;
        }
        given.iter_mut().zip(status.given).for_each(|(sum, n)| *sum += n);
    }
    if sources.is_empty() {
        return None;
    }
    Some(match class(given) {
        Ok(class) => TOPIC.fine(format!(
            "{}: 99 of 100 landings within {:.2} m (Moderate, no wind)",
            class.name(),
            class.p99_m()
        )),
        Err(missing) => TOPIC.broken(
            format!("the sources gave {missing}: the vessel's estimator does not start"),
            "add a source that measures it, or set this one to send it (docs/equipment.md)",
        ),
    })
}

/// Whether 99 of 100 landings have all feet on the deck, on a vessel of the least exact class.
pub fn deck(deck: &DeckGeometry, drone: &DroneGeometry) -> Finding {
    const TOPIC: Topic = Topic("deck");
    let p99 = VesselClass::ALL
        .map(VesselClass::p99_m)
        .into_iter()
        .fold(0.0, f64::max);
    let sides = [
        ("length_m", deck.length_m, drone.feet_span_m[0]),
        ("width_m", deck.width_m, drone.feet_span_m[1]),
    ];
    let beside = |(_, side, feet): (&str, f64, f64)| 0.5 * (side - feet);
    let [length, width] = sides;
    let least = if beside(length) < beside(width) {
        length
    } else {
        width
    };
    let (key, side, feet) = least;
    let room = beside(least);
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

/// Whether the deck's tags are sound, and seen from every height.
pub fn tags(drone: &DroneSettings) -> Finding {
    const TOPIC: Topic = Topic("tags");
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
                "their numbers are the family's first ({}), as any other boat's may be: a drone tells two such boats apart by \
                 their places alone",
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
        "add tags of a size and place that are seen there; `alight tag --suggest` prints the list that is suggested for the deck's size",
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equipment_class_by_sources() {
        // What each class gives while listening: imu, gnss, heading, attitude.
        assert_eq!(class([125, 12, 25, 125]), Ok(VesselClass::AutopilotAboard));
        assert_eq!(class([250, 3, 25, 0]), Ok(VesselClass::SlowReceiver));
        assert_eq!(class([0, 25, 25, 50]), Ok(VesselClass::InertialNavigation));
        assert!(class([0, 3, 25, 0]).is_err_and(|e| e.contains("inertial")));
        assert!(class([250, 0, 25, 0]).is_err_and(|e| e.contains("GNSS")));
        assert!(class([250, 25, 0, 0]).is_err_and(|e| e.contains("heading")));
    }

    #[test]
    fn tags_with_a_gap_or_a_fault() {
        use crate::status::finding::Level;
        use alight_shared::tags::{Tags, of_vessel};
        let mut drone = DroneSettings::default();
        let first = tags(&drone);
        assert_eq!(first.level, Level::Warning);
        assert!(first.found.contains("the family's first (0)"), "{}", first.found);
        drone.deck.tags = of_vessel(&drone.tags(), 7);
        assert_eq!(tags(&drone).level, Level::Fine);
        drone.deck.tags = Tags::new();
        drone.deck.tag_side_m = Some(1.0);
        let one = tags(&drone);
        assert_eq!(one.level, Level::Warning);
        assert!(one.found.starts_with("with the feet 0.00 to 1."), "{}", one.found);
        drone.deck.tag_side_m = Some(1.6);
        let large = tags(&drone);
        assert_eq!(large.level, Level::Broken);
        assert!(large.found.contains("0.150 m beyond"), "{}", large.found);
    }

    #[test]
    fn deck_too_small_for_the_feet() {
        use crate::status::finding::Level;
        let drone = DroneGeometry::default();
        let of = |side: f64| DeckGeometry {
            length_m: 2.5,
            width_m: side,
            ..DeckGeometry::default()
        };
        assert_eq!(deck(&of(1.7), &drone).level, Level::Fine);
        let small = deck(&of(0.6), &drone);
        assert_eq!(small.level, Level::Broken);
        assert!(
            small.found.contains("drone.deck.width_m 0.60 m leaves 0.10 m"),
            "{}",
            small.found
        );
    }
}
