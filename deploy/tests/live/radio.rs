//! Watchdog of the radio, and delivery of an order among many states.

use std::time::Duration;

use alight_shared::admission::Sender;
use alight_transport::radio::{Publication, Radio, RadioConfig, Subscription, TlsConfig, Urgency};

use crate::{
    common::{free_udp, publication},
    ros2::free_tcp_port,
};

fn vessel(endpoint: &str) -> Radio {
    let config = RadioConfig::listening(endpoint, TlsConfig::default());
    Radio::open(
        &config,
        publication("alight/vessel-1/test"),
        vec!["alight/drone-1/test"],
    )
    .expect("opens")
}

fn drone(endpoint: &str) -> Radio {
    let config = RadioConfig {
        reopen_after_s: 1.0,
        ..RadioConfig::dialling(endpoint, TlsConfig::default())
    };
    Radio::open(
        &config,
        publication("alight/drone-1/test"),
        vec!["alight/vessel-1/test"],
    )
    .expect("opens")
}

/// Lets both sides send until each has received the other's newest message.
fn assert_exchange(vessel: &mut Radio, drone: &mut Radio, mark: u8) {
    let mut at_vessel = false;
    let mut at_drone = false;
    for _ in 0..600 {
        vessel.send(0, vec![mark; 300]);
        drone.send(0, vec![mark; 30]);
        while let Some(message) = vessel.receive(Duration::from_millis(20)) {
            at_vessel |= message.bytes == vec![mark; 30] && message.sender == Sender::Drone(1);
        }
        while let Some(message) = drone.receive(Duration::from_millis(20)) {
            at_drone |= message.bytes == vec![mark; 300] && message.sender == Sender::Vessel(1);
        }
        if at_vessel && at_drone {
            return;
        }
        drone.watch(0.0);
    }
    panic!("not received: by the vessel {at_vessel}, by the drone {at_drone}");
}

#[track_caller]
fn assert_reopens(drone: &mut Radio) {
    let before = drone.counts().reopened;
    for _ in 0..600 {
        if drone.counts().reopened > before {
            return;
        }
        drone.watch(0.0);
        std::thread::sleep(Duration::from_millis(20));
    }
    panic!("the watchdog did not open it again");
}

/// The drone does not read while its vessel sends without a pause; states carry an increasing number.
#[test]
fn abort_after_ten_thousand_states() {
    const STATES: &str = "alight/vessel-1/estimate";
    const ORDERS: &str = "alight/vessel-1/command";
    let endpoint = format!("tcp/127.0.0.1:{}", free_tcp_port());
    let publications = vec![
        Publication::new(STATES, Urgency::State),
        Publication::new(ORDERS, Urgency::Order),
    ];
    let listen = RadioConfig::listening(&endpoint, TlsConfig::default());
    let mut vessel = Radio::open(&listen, publications, Vec::<String>::new()).expect("opens");
    let subscriptions = vec![STATES.into(), Subscription::order(ORDERS)];
    let dial = RadioConfig::dialling(&endpoint, TlsConfig::default());
    let mut drone = Radio::open(&dial, publication("alight/drone-1/test"), subscriptions).expect("opens");
    for _ in 0..600 {
        if vessel.count_present(|s| *s == Sender::Drone(1)) > 0 {
            break;
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    let mut sent = 0_u64;
    // Sends until the drone has dropped this number of states; counts the sent ones.
    let mut flood = |vessel: &mut Radio, drone: &Radio, dropped: u64| {
        for _ in 0..10_000_000 {
            sent += 1;
            vessel.send(0, sent.to_le_bytes().into());
            if drone.counts().dropped >= dropped {
                return sent;
            }
        }
        panic!("only {} states were dropped", drone.counts().dropped);
    };
    let before = flood(&mut vessel, &drone, 10_000);
    vessel.send(1, b"abort".into());
    // More states are dropped than were sent before the order, which shares their stream.
    flood(&mut vessel, &drone, before);

    let taken: Vec<_> = std::iter::from_fn(|| drone.receive(Duration::ZERO)).collect();
    assert_eq!((taken[0].subscription, &taken[0].bytes[..]), (1, &b"abort"[..]));
    let state = |bytes: &[u8]| u64::from_le_bytes(bytes.try_into().expect("a number"));
    let states: Vec<u64> = taken[1..].iter().map(|t| state(&t.bytes)).collect();
    assert!(
        states.is_sorted() && states[0] > before,
        "not the newest: {states:?}"
    );
    assert!(taken.len() <= 128, "no step before message {}", taken.len());
}

#[test]
fn radio_session_that_went_silent() {
    let endpoint = format!("udp/{}", free_udp());
    let mut drone = drone(&endpoint);
    // No vessel exists yet.
    assert_reopens(&mut drone);
    let mut vessel = vessel(&endpoint);
    assert_exchange(&mut vessel, &mut drone, 1);
    let flow = vessel.flows()[0];
    assert_eq!(flow.bytes, flow.messages * 348, "payload and headers");
    // A vessel's computer freezes: its session remains open, but sends nothing.
    assert_reopens(&mut drone);
    assert_exchange(&mut vessel, &mut drone, 2);
}
