//! Stations near a turning vessel.

use alight_shared::msg::{CommandKind, ReasonCode, State, Station};
use alight_sim::{
    harness::{
        rig::Rig,
        scenario::{NodeConfigs, Scenario},
    },
    physics::vessel::VesselCourse,
};
use nalgebra::Vector3;

use super::{sorties::apart_m, takeoff::until};

const ABEAM: Station = Station {
    ahead_m: 0,
    right_m: 20,
    height_m: 15,
    for_min: 10,
};

/// Distance of the drone from its station, which is relative to the true deck and heading, without heave, m.
fn off_m(rig: &Rig) -> f64 {
    let physics = rig.world.physics();
    let deck = physics.deck();
    let drone = physics.drone(0).unwrap();
    let yaw = deck.euler().z + ABEAM.bearing_rad();
    let place = Vector3::new(yaw.cos(), yaw.sin(), 0.0) * ABEAM.distance_m();
    (drone.position.0 - deck.position.0 - place).xy().norm()
}

/// The vessel follows a square at 2 m/s in Moderate and wind; the drone keeps its station for a minute, then
/// lands when ordered.
#[test]
fn station_off_a_vessel_that_turns() {
    let mut scenario = Scenario::default();
    scenario.vessel.course = VesselCourse::Square;
    scenario.drone.wind.mean_mps = 5.0;
    let mut rig = Rig::new(&scenario, &NodeConfigs::default(), 81).unwrap();
    rig.run(5.0);
    rig.world.command(CommandKind::Station(ABEAM));
    let there = rig.until(90.0, |r| off_m(r) < 2.0 && r.state(0) == State::Hold);
    assert!(there, "{:.1} m off, {}", off_m(&rig), rig.mission(0).waiting);
    rig.run(5.0);
    let mut off = Vec::new();
    rig.each(60.0, |rig| {
        off.push(off_m(rig));
        rig.mission(0).waiting.code != ReasonCode::OnStation
    });
    let kept = rig.mission(0).waiting;
    assert_eq!(kept.code, ReasonCode::OnStation, "{kept}");
    off.sort_by(f64::total_cmp);
    let part = |p: f64| off.get((p * off.len() as f64) as usize).copied().unwrap_or(0.0);
    let quantiles = [0.5, 0.75, 0.9, 0.999].map(part);
    println!("off its station, quantiles 0.5, 0.75, 0.9, 0.999: {quantiles:.2?} m");
    assert!(part(0.9) < 3.0, "{quantiles:.2?} m off");
    rig.world.command(CommandKind::Land);
    let (landed, met) = until(&mut rig, 200.0, State::Landed);
    assert!(landed, "{:?}, {}", rig.visited(0), rig.mission(0).waiting);
    assert!(met.others == 0 && !met.water, "{met:?}");
}

/// Two drones are ordered to one station above both waiting places: one keeps it, the other reports why it
/// cannot, and they keep their distance.
#[test]
fn one_station_of_two_drones() {
    let scenario = Scenario {
        drones: 2,
        ..Scenario::default()
    };
    let high = CommandKind::Station(Station {
        height_m: 35,
        ..ABEAM
    });
    let mut rig = Rig::new(&scenario, &NodeConfigs::default(), 83).unwrap();
    rig.run(5.0);
    rig.world.command_to(0, high);
    rig.world.command_to(1, high);
    let mut nearest_m = f64::INFINITY;
    let mut reasons = Vec::new();
    rig.each(90.0, |rig| {
        nearest_m = nearest_m.min(apart_m(rig));
        for m in [rig.mission(0), rig.mission(1)] {
            reasons.extend([m.entered.code].into_iter().chain(m.rejected.map(|why| why.code)));
        }
        false
    });
    let kept = (0..2).filter(|k| rig.mission(*k).station.is_some()).count();
    assert_eq!(kept, 1);
    assert!(reasons.contains(&ReasonCode::StationTaken));
    assert!(nearest_m > 4.0, "{nearest_m:.1} m apart");
}
