//! Each failsafe of the autopilot in each state of a flight, over both firmwares.

use super::{BOTH, at_sea};
use alight_shared::msg::State;
use alight_sim::{
    harness::{
        rig::Rig,
        scenario::NodeConfigs,
        storm::{Fault, FaultKind, FlightKind, Flown, Moment, Storm, StormEnding, fly},
    },
    physics::vessel::VesselCourse,
};
use alight_uav::autopilot::modes::Firmware;
use rayon::prelude::*;

const KINDS: [FaultKind; 7] = [
    FaultKind::RemoteLost,
    FaultKind::StickMoved,
    FaultKind::StationLost,
    FaultKind::FenceBreached,
    FaultKind::DeadReckoning,
    FaultKind::EstimatorFailed,
    FaultKind::BatteryReadsLow,
];
const MOMENTS: [(Moment, FlightKind); 8] = [
    (Moment::In(State::Approach), FlightKind::Landing),
    (Moment::In(State::Tracking), FlightKind::Landing),
    (Moment::In(State::Descent), FlightKind::Landing),
    (Moment::In(State::Flare), FlightKind::Landing),
    (Moment::Contact, FlightKind::Landing),
    (Moment::In(State::Landed), FlightKind::Landing),
    (Moment::In(State::TakeOff), FlightKind::TakeOff),
    (Moment::In(State::Hold), FlightKind::Station),
];

/// Storm with this fault alone, 0.2 s after the moment for 10 s, in a sea of three waves of 0.2 m.
fn cell(firmware: Firmware, kind: FaultKind, moment: Moment, flight: FlightKind, stock: bool) -> Storm {
    let fault = Fault {
        size: match kind {
            FaultKind::BatteryReadsLow => 0.03,
            FaultKind::EstimatorFailed | FaultKind::DeadReckoning => 0.2,
            _ => 0.0,
        },
        ..Fault::new(kind, moment, 0.2, 10.0)
    };
    Storm {
        flight,
        autopilot: firmware,
        sea: [0.2, 5.0],
        course: VesselCourse::Drift,
        speed_mps: 0.0,
        wind_mps: 0.0,
        reserved: flight == FlightKind::TakeOff,
        drones: 1,
        mast: false,
        moving_base: false,
        stock,
        version: None,
        faults: vec![fault],
        ..Storm::drawn(1, 0)
    }
}

fn flown(storm: &Storm) -> Flown {
    fly(storm, &mut |_, _| {}).unwrap()
}

/// With the documented parameters these failsafes leave OFFBOARD and GUIDED alone, and the landing goes on.
#[test]
fn failsafes_that_leave_the_landing_alone() {
    let moments = [
        Moment::In(State::Descent),
        Moment::In(State::Flare),
        Moment::Contact,
    ];
    let cells: Vec<Storm> = BOTH
        .into_iter()
        .flat_map(|firmware| KINDS[..4].iter().map(move |kind| (firmware, *kind)))
        .flat_map(|(firmware, kind)| {
            moments.map(|moment| cell(firmware, kind, moment, FlightKind::Landing, false))
        })
        .collect();
    let wrong: Vec<String> = cells
        .par_iter()
        .filter_map(|storm| {
            let f = flown(storm);
            let landed = f.ending == StormEnding::Landed && !f.began.is_empty();
            if landed {
                None
            } else {
                Some(format!("{f:?}\n{}", storm.text()))
            }
        })
        .collect();
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// The failsafe of a lost remote control holds the drone in the flare, as before COM_RCL_EXCEPT was asked for: Alight
/// asks for its mode back, and the drone ends on the deck.
#[test]
fn failsafes_hold_in_the_flare() {
    let flights: Vec<_> = BOTH
        .into_iter()
        .flat_map(|firmware| (1..=6).map(move |seed| (firmware, seed)))
        .collect();
    flights.into_par_iter().for_each(|(firmware, seed)| {
        let mut scenario = at_sea("0.5,5");
        scenario.drone.autopilot.firmware = firmware;
        let mut rig = Rig::landing(&scenario, &NodeConfigs::default(), seed).unwrap();
        let autopilot = &mut rig.world.linked(0).unwrap().autopilot;
        autopilot.channels = Some([1500; 18]);
        for name in ["COM_RCL_EXCEPT", "FS_OPTIONS"] {
            if let Some(value) = autopilot.parameters.get_mut(name) {
                *value = 0.0;
            }
        }
        // Another link reads the parameters again.
        rig.begin(FaultKind::LinkKilled, 0.0);
        rig.run(0.3);
        rig.end(FaultKind::LinkKilled, 0.0);
        assert!(
            rig.until(90.0, |r| r.is_due(State::Flare, 0.2)),
            "{firmware:?}, {seed}"
        );
        rig.begin(FaultKind::RemoteLost, 0.0);
        let stands = |r: &Rig| {
            let o = r.world.observation();
            o.in_water || !o.motors_on
        };
        assert!(
            rig.until(60.0, stands),
            "{firmware:?}, {seed}: {:?}",
            rig.visited(0)
        );
        let o = rig.world.observation();
        let visited = rig.visited(0);
        assert!(
            !o.in_water && o.feet_height_m().abs() < 0.1,
            "{firmware:?}, {seed}: {visited:?}"
        );
    });
}

fn ending(f: &Flown) -> String {
    let warned = f.warned.as_ref().map(|w| w.violation);
    match f.violation.or(warned) {
        Some(violation) => format!("{:?}", violation.rule),
        None if f.began.is_empty() => "-".into(),
        None => format!("{:?}", f.ending).to_lowercase(),
    }
}

#[test]
#[ignore = "flies and prints 224 cells, with the documented parameters and with the makers' defaults"]
fn every_failsafe_in_every_state() {
    let mut broken = Vec::new();
    for (stock, firmware, kind) in [false, true]
        .into_iter()
        .flat_map(|stock| BOTH.map(|firmware| (stock, firmware)))
        .flat_map(|(stock, firmware)| KINDS.map(|kind| (stock, firmware, kind)))
    {
        let cells = MOMENTS.map(|(moment, flight)| cell(firmware, kind, moment, flight, stock));
        let all: Vec<Flown> = cells.par_iter().map(flown).collect();
        let installed = if stock {
            "makers' defaults"
        } else {
            "as documented"
        };
        let row = all.iter().map(ending).collect::<Vec<_>>().join(", ");
        println!("{installed}, {firmware:?}, {}: {row}", kind.name());
        // No FS_EKF_ACTION is good: without an estimate ArduCopter lands where it is, also on the water.
        if kind == FaultKind::EstimatorFailed && firmware == Firmware::ArduCopter {
            continue;
        }
        broken.extend(
            all.into_iter()
                .filter_map(|f| Some((firmware, kind, f.violation?))),
        );
    }
    assert!(broken.is_empty(), "{broken:#?}");
}
