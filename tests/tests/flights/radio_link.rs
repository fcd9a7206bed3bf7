//! Load, loss and recovery of the radio link in the complete system.

use alight_shared::msg::State;
use alight_sim::{
    harness::{
        observer::NoObserver,
        scenario::{NodeConfigs, Scenario},
        storm::{Fault, FaultKind, Moment},
        world::World,
    },
    radio::Transport,
};

use crate::{assert_lands, at_sea};

/// Bytes per second to the drone, and fraction of packets dropped by a full queue, in the second half of a
/// warm-up of one minute.
fn load(scenario: &Scenario) -> (f64, f64) {
    let mut world = World::new(scenario, &NodeConfigs::default(), 102).unwrap();
    let mut counts = Vec::new();
    for _ in 0..2 {
        for _ in 0..3000 {
            world.tick(&mut NoObserver);
        }
        counts.push(world.drones()[0].radio_counts()[0]);
    }
    let a = counts[0];
    let b = counts[1];
    let sent = (b.sent - a.sent) as f64;
    (
        (b.sent_bytes - a.sent_bytes) as f64 / 30.0,
        (b.overflowed - a.overflowed) as f64 / sent,
    )
}

#[test]
fn broadcast_load_at_full_rates() {
    let (bytes_per_s, overflowed) = load(&at_sea("slight"));
    // At full rates: estimates 4.6 kB/s, predictions 1.0 kB/s, wave models at least 1.4 kB/s.
    assert!((7_000.0..9_500.0).contains(&bytes_per_s), "{bytes_per_s}");
    assert_eq!(overflowed, 0.0);
}

#[test]
fn landing_over_a_narrow_link() {
    let mut scenario = at_sea("slight");
    scenario.radio.rate_bps = 32_000.0;
    scenario.radio.queue_bytes = 4096;
    let (bytes_per_s, overflowed) = load(&scenario);
    // The link's 32 kbit/s are 4000 bytes/s.
    assert!((2_000.0..4_200.0).contains(&bytes_per_s), "{bytes_per_s}");
    assert!(overflowed < 0.03, "{overflowed}");
    assert_lands(&scenario, 102);
}

#[test]
fn landing_after_a_long_outage_in_any_state() {
    let states = [
        (State::GetAltitude, Transport::Udp),
        (State::Approach, Transport::Quic),
        (State::Tracking, Transport::Udp),
        (State::Descent, Transport::Quic),
        (State::Flare, Transport::Udp),
    ];
    for (state, transport) in states {
        let mut scenario = at_sea("slight");
        scenario.radio.transport = transport;
        scenario.faults = vec![Fault::new(FaultKind::RadioLost, Moment::In(state), 0.0, 10.0)];
        println!("{state:?} over {transport:?}");
        assert_eq!(assert_lands(&scenario, 104).unsafe_contacts, 0);
    }
}
