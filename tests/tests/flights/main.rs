//! Stories and rates in the simulated world, and the link to its autopilots: one file a subject, one program, which is built and
//! linked once.

// Helpers of tests may panic, as tests do.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod advice;
mod beacon;
mod calibration;
mod contact;
mod deck_reservation;
mod estimate_jumps;
mod estimator;
mod faults;
mod gaps;
mod hulls;
mod identity;
mod interrupted_landing;
mod keep_out;
mod ladder;
mod landing;
mod link;
mod moving_base;
mod night;
mod places;
mod predictor;
mod radio_link;
mod recorded_motion;
mod review;
mod sorties;
mod stated_course;
mod station;
mod storm;
mod takeoff;
mod under_way;
mod witnesses;

use alight_sim::harness::scenario::Scenario;
use alight_uav::autopilot::modes::Firmware;

/// Both autopilots.
const BOTH: [Firmware; 2] = [Firmware::Px4, Firmware::ArduCopter];

/// The default scene in this sea.
fn at_sea(sea: &str) -> Scenario {
    Scenario {
        sea: sea.parse().unwrap(),
        ..Scenario::default()
    }
}
