//! Landings at four places on Earth, using the bytes of all devices. No configuration contains a frame's origin: the
//! vessel's is at its first fix, the drone's where its autopilot was switched on, up to 2 km away.

use alight_shared::msg::State;
use alight_sim::harness::{
    outcome::Ending,
    scenario::{PlaceConfig, Scenario},
    storm::{Fault, FaultKind, Moment},
};

use crate::{assert_lands, landed};

/// Scene at position `k` of the four seas.
fn scene(k: usize) -> Scenario {
    let mut scenario = Scenario::default();
    scenario.place.among = vec![scenario.place.among[k]];
    scenario
}

/// The vessel's computer restarts in every second landing.
#[test]
fn landings_at_four_places() {
    for k in 0..4 {
        let mut scenario = scene(k);
        if k % 2 == 1 {
            let approach = Moment::In(State::Approach);
            scenario.faults = vec![Fault::new(FaultKind::VesselRestarted, approach, 1.0, 0.0)];
        }
        assert_lands(&scenario, 100 * k as u64);
    }
}

#[test]
fn heading_resets_in_every_phase() {
    let phases = [(State::Tracking, 0.3), (State::Descent, 1.0), (State::Flare, 0.3)];
    for (n, (state, after_s)) in phases.into_iter().enumerate() {
        let mut scenario = scene(n % 4);
        scenario.faults = vec![Fault {
            size: 12.0,
            ..Fault::new(FaultKind::HeadingReset, Moment::In(state), after_s, 0.0)
        }];
        assert_lands(&scenario, 40 + n as u64);
    }
}

#[test]
fn drifting_barometer_and_steel_below_the_compass() {
    for seed in 60..64 {
        let mut scenario = scene(seed as usize % 4);
        let navigation = &mut scenario.drone.navigation;
        navigation.barometer_drift_m = 4.0;
        navigation.steel_heading_deg = 15.0;
        assert_lands(&scenario, seed);
    }
}

/// The vessel's receiver omits the geoid height: according to the radio its deck is 31 m, 55 m or 30 m too
/// low, or 21 m too high. No drone may fly into the sea; a drone that detects the deck from a height that is
/// safe under both assumptions lands.
#[test]
fn vessel_height_without_the_geoid() {
    let mut landed_low = 0;
    for (k, sea) in PlaceConfig::default().among.iter().enumerate() {
        let mut scenario = scene(k);
        scenario.sensors.vessel_gnss.height_error_m = -sea.height_m;
        let outcome = landed(&scenario, 300 + k as u64);
        assert!(
            matches!(
                outcome.outcome,
                Ending::Success | Ending::Timeout | Ending::GaveUp
            ),
            "{k}: {outcome:#?}"
        );
        landed_low += u32::from(sea.height_m > 0.0 && outcome.outcome == Ending::Success);
    }
    assert_eq!(landed_low, 3);
}

/// The drone's receiver reports no heights above the ellipsoid; the geoid table, 55 m here, supplies the difference.
#[test]
fn drone_without_ellipsoid_height() {
    let mut scenario = scene(2);
    scenario.drone.navigation.gnss_ellipsoid = false;
    assert_lands(&scenario, 322);
}
