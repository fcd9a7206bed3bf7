//! Radio for other programs, late peers, and a router between vessel and drone.

use std::{fs, path::Path, time::Duration};

use alight_shared::{
    admission::Sender,
    topics::{self, Topic},
};
use alight_transport::{
    Received,
    radio::{Publication, Radio, RadioConfig, Subscription, TlsConfig, Urgency},
};
use zenoh::{Wait, sample::Sample};

use crate::{
    common::{self, free_udp, tls},
    ros2::free_tcp_port,
};

const WAVE: &str = "alight/vessel-1/wave";
const STATUS: &str = "alight/drone-1/status";
/// Timeout of a hanging test, in steps.
const TRIES: usize = 1000;
const STEP: Duration = Duration::from_millis(20);

fn vessel(config: &RadioConfig) -> Radio {
    let publications = vec![Publication::new(WAVE, Urgency::Model).of(&topics::WAVE).held()];
    Radio::open(config, publications, vec![STATUS]).expect("opens")
}
fn drone(config: &RadioConfig) -> Radio {
    let publications = vec![Publication::new(STATUS, Urgency::Status).of(&topics::DRONE_STATUS)];
    Radio::open(config, publications, vec![Subscription::asked(WAVE)]).expect("opens")
}
/// First message that the radio receives while it queries; None without one.
fn asked(radio: &mut Radio, tries: usize) -> Option<Received> {
    (0..tries).find_map(|_| {
        radio.ask();
        radio.receive(STEP)
    })
}
#[track_caller]
fn assert_until(what: &str, mut is_so: impl FnMut() -> bool) {
    for _ in 0..TRIES {
        if is_so() {
            return;
        }
        std::thread::sleep(STEP);
    }
    panic!("{what}");
}
/// Session of a program without knowledge of Alight.
fn foreign(settings: &[(&str, String)]) -> zenoh::Session {
    let mut config = zenoh::Config::default();
    for (key, value) in settings {
        config.insert_json5(key, value).expect("a setting");
    }
    zenoh::open(config).wait().expect("opens")
}
fn client(endpoint: &str) -> zenoh::Session {
    foreign(&[
        ("mode", "'client'".into()),
        ("connect/endpoints", format!("[{endpoint:?}]")),
        ("scouting/multicast/enabled", "false".into()),
    ])
}
fn router(endpoint: &str) -> zenoh::Session {
    foreign(&[
        ("mode", "'router'".into()),
        ("listen/endpoints", format!("[{endpoint:?}]")),
        ("scouting/multicast/enabled", "false".into()),
    ])
}
fn through(endpoint: &str, tls: TlsConfig) -> RadioConfig {
    RadioConfig {
        router: true,
        ..RadioConfig::dialling(endpoint, tls)
    }
}
fn answers(session: &zenoh::Session, key: &str) -> Vec<Sample> {
    let replies = session.get(key).wait().expect("asks");
    replies.into_iter().filter_map(|r| r.into_result().ok()).collect()
}
fn text(sample: &Sample) -> String {
    String::from_utf8_lossy(&sample.payload().to_bytes()).into_owned()
}
/// Asserts that both receive the other's message, sent repeatedly.
#[track_caller]
fn assert_exchange(vessel: &mut Radio, drone: &mut Radio, mark: u8) {
    let mut at_vessel = false;
    let mut at_drone = false;
    assert_until("vessel and drone do not receive each other", || {
        vessel.send(0, vec![mark; 300]);
        drone.send(0, vec![mark; 30]);
        let is = |r: Received, n| r.bytes == vec![mark; n];
        at_vessel |= vessel
            .receive(STEP)
            .is_some_and(|r| r.sender == Sender::Drone(1) && is(r, 30));
        at_drone |= drone
            .receive(STEP)
            .is_some_and(|r| r.sender == Sender::Vessel(1) && is(r, 300));
        at_vessel && at_drone
    });
}

#[test]
fn foreign_program_on_the_radio() {
    let endpoint = format!("tcp/127.0.0.1:{}", free_tcp_port());
    let mut vessel = vessel(&RadioConfig::listening(&endpoint, TlsConfig::default()));
    vessel.hold(0, vec![7; 100]);
    let unauthorised = client(&endpoint);
    assert_until("no schema is answered", || {
        !answers(&unauthorised, "alight/vessel-1/@schema/**").is_empty()
    });
    // Only the schemas of the published topics are returned.
    let mut schemas = Vec::new();
    assert_until("no schema is answered a second time", || {
        schemas = answers(&unauthorised, "alight/*/@schema/**");
        !schemas.is_empty()
    });
    assert_eq!(schemas.len(), 1);
    assert_eq!(schemas[0].key_expr().as_str(), "alight/vessel-1/@schema/wave");
    assert_eq!(schemas[0].encoding().to_string(), "application/json");
    let schema: serde_json::Value = serde_json::from_str(&text(&schemas[0])).expect("JSON");
    assert_eq!(schema, topics::WAVE.described());
    assert!(answers(&unauthorised, "alight/vessel-1/@schema/estimate").is_empty());
    // The client queries the newest message, which was published before the client connected.
    let encoding = format!("application/octet-stream;{}", Topic::encoding_schema());
    let newest_for = |bytes: usize| -> Vec<Sample> {
        let replies = unauthorised.get(WAVE).payload(vec![0_u8; bytes]).wait();
        let replies = replies.expect("asks").into_iter();
        replies.filter_map(|r| r.into_result().ok()).collect()
    };
    assert!(newest_for(1000).is_empty(), "a query with so large a payload");
    let mut newest = Vec::new();
    assert_until("no message is answered", || {
        newest = newest_for(0);
        !newest.is_empty()
    });
    assert_eq!(
        (newest.len(), &newest[0].payload().to_bytes()[..]),
        (1, &[7; 100][..])
    );
    assert_eq!(newest[0].encoding().to_string(), encoding);
    // The client also receives the liveliness token of each peer.
    let alive = unauthorised.liveliness().get("alight/*").wait().expect("asks");
    let alive = alive.into_iter().filter_map(|r| r.into_result().ok());
    let alive: Vec<String> = alive.map(|s| s.key_expr().to_string()).collect();
    assert_eq!(alive, ["alight/vessel-1"]);
    // A broadcast states its type.
    let broadcasts = unauthorised
        .declare_subscriber("alight/**")
        .wait()
        .expect("reads");
    let mut received = None;
    assert_until("no broadcast is received", || {
        vessel.send(0, vec![8; 100]);
        received = broadcasts.try_recv().ok().flatten();
        received.is_some()
    });
    assert_eq!(received.expect("received").encoding().to_string(), encoding);
    assert_eq!(
        vessel.flows()[0].bytes / vessel.flows()[0].messages,
        148 + Topic::encoding_schema().len() as u64
    );
}

/// A late drone receives the message that the vessel holds, whatever the vessel has broadcast since.
#[test]
fn drone_that_comes_late() {
    let keys = common::certificates("late");
    let endpoint = format!("quic/{}", free_udp());
    let listen = RadioConfig::listening(&endpoint, tls(&keys.join("vessel-1"), &["drone-1"]));
    let dial = RadioConfig::dialling(&endpoint, tls(&keys.join("drone-1"), &["vessel-1"]));
    let mut vessel = vessel(&listen);
    vessel.send(0, vec![1; 100]);
    vessel.hold(0, vec![2; 100]);
    vessel.send(0, vec![3; 100]);
    let mut drone = drone(&dial);
    let answer = asked(&mut drone, TRIES).expect("an answer");
    assert_eq!((answer.bytes, answer.sender), (vec![2; 100], Sender::Vessel(1)));
    assert_eq!((answer.subscription, drone.counts().asked), (0, 1), "once");
    assert!(asked(&mut drone, 20).is_none(), "once");
    let sees = |radio: &Radio, who| radio.count_present(|s| *s == who);
    assert_until("the vessel sees no drone", || {
        sees(&vessel, Sender::Drone(1)) == 1
    });
    assert_until("the drone sees no vessel", || {
        sees(&drone, Sender::Vessel(1)) == 1
    });
    drop(vessel);
    assert_until("the drone sees a vessel that has gone", || {
        sees(&drone, Sender::Vessel(1)) == 0
    });
    fs::remove_dir_all(&keys).expect("removed");
}

#[test]
fn answer_on_the_key_of_another_vessel() {
    let keys = common::certificates("answer");
    common::keys(&keys, "vessel 2 --address 127.0.0.1");
    let endpoint = format!("quic/{}", free_udp());
    let own = |file: &str| format!("{:?}", keys.join("vessel-2").join(file).display().to_string());
    // An admitted vessel offers messages on another peer's key.
    let intruder = foreign(&[
        ("listen/endpoints", format!("[\"{endpoint}?mixed_rel=auto\"]")),
        ("scouting/multicast/enabled", "false".into()),
        ("transport/link/tls/root_ca_certificate", own("authority.pem")),
        ("transport/link/tls/listen_certificate", own("certificate.pem")),
        ("transport/link/tls/listen_private_key", own("key.pem")),
        ("transport/link/tls/enable_mtls", "true".into()),
    ]);
    let answer = |query: zenoh::query::Query| {
        let _gone = query.reply(WAVE, vec![9; 100]).wait();
    };
    let _answers = intruder
        .declare_queryable(WAVE)
        .callback(answer)
        .wait()
        .expect("declared");
    let peers = ["vessel-1", "vessel-2"];
    let dial = RadioConfig::dialling(&endpoint, tls(&keys.join("drone-1"), &peers));
    let publications = vec![Publication::new(STATUS, Urgency::Status)];
    let subscriptions = vec![Subscription::asked(WAVE), "alight/vessel-2/estimate".into()];
    let mut drone = Radio::open(&dial, publications, subscriptions).expect("opens");
    // Messages on its own key are received, for long enough that it would have been queried.
    let mut own_key = 0;
    for _ in 0..TRIES {
        let _put = intruder.put("alight/vessel-2/estimate", vec![2; 10]).wait();
        if let Some(received) = asked(&mut drone, 1) {
            assert_eq!((received.subscription, received.sender), (1, Sender::Vessel(2)));
            own_key += 1;
        }
        if own_key == 100 {
            break;
        }
    }
    assert_eq!((own_key, drone.counts().asked), (100, 0));
    fs::remove_dir_all(&keys).expect("removed");
}

#[test]
fn router_that_comes_late_and_starts_again() {
    let endpoint = format!("tcp/127.0.0.1:{}", free_tcp_port());
    let config = through(&endpoint, TlsConfig::default());
    // Neither side waits for a missing router.
    let mut vessel = vessel(&config);
    let mut drone = drone(&config);
    vessel.hold(0, vec![0; 10]);
    vessel.send(0, vec![0; 10]);
    assert_eq!(vessel.counts().unsent, 1);
    // A watchdog restores a suspended session; a vessel has none.
    drone.watch(0.0);
    assert!(drone.survives_pause(100.0) && !vessel.survives_pause(100.0) && vessel.survives_pause(1.0));
    let first = router(&endpoint);
    assert_exchange(&mut vessel, &mut drone, 1);
    assert_eq!((vessel.counts().reopened, drone.counts().reopened), (0, 0));
    let mut answer = None;
    assert_until("no answer through the router", || {
        answer = answer.take().or(asked(&mut drone, 1));
        answer.as_ref().is_some_and(|_| drone.counts().asked == 1)
    });
    assert_until("no token through the router", || {
        drone.count_present(|s| *s == Sender::Vessel(1)) == 1
    });
    first.close().wait().expect("closes");
    let _second = router(&endpoint);
    assert_exchange(&mut vessel, &mut drone, 2);
}

#[test]
fn router_with_certificates() {
    let keys = common::certificates("router");
    common::keys(&keys, "vessel 9 --address 127.0.0.1");
    common::keys(&keys, "drone 2");
    let endpoint = format!("quic/{}", free_udp());
    // The shipped file, with this test's address and files.
    let shipped = Path::new(env!("CARGO_MANIFEST_DIR")).join("vessel/zenohd.json5");
    let shipped = fs::read_to_string(shipped).expect("the shipped file");
    let text = shipped
        .replace("quic/0.0.0.0:7447", &endpoint)
        .replace("/etc/alight/keys", &keys.join("vessel-9").display().to_string());
    assert!(text.contains(&endpoint) && text.contains("vessel-9"));
    let _router = zenoh::open(zenoh::Config::from_json5(&text).expect("a configuration"))
        .wait()
        .expect("opens");
    let of = |name: &str, peer: &str| {
        let tls = TlsConfig {
            router: "vessel-9".into(),
            ..tls(&keys.join(name), &[peer])
        };
        through(&endpoint, tls)
    };
    let (mut vessel, mut drone) = (
        vessel(&of("vessel-1", "drone-1")),
        drone(&of("drone-1", "vessel-1")),
    );
    assert_exchange(&mut vessel, &mut drone, 1);
    vessel.hold(0, vec![2; 10]);
    assert!(asked(&mut drone, TRIES).is_some());
    // A certificate of the authority without a rule in the router; the peer also publishes on another peer's key.
    let mut unauthorised = Radio::open(
        &of("drone-2", "vessel-1"),
        vec![
            Publication::new("alight/drone-2/status", Urgency::Status),
            Publication::new(STATUS, Urgency::Status),
        ],
        vec![WAVE],
    )
    .expect("opens");
    // The session must be established before the assertions.
    assert_until("the unauthorised peer has no session", || {
        unauthorised.send(0, vec![6; 30]);
        unauthorised.send(1, vec![6; 30]);
        assert!(unauthorised.receive(STEP).is_none());
        unauthorised.flows().iter().all(|flow| flow.messages > 0)
    });
    for _ in 0..100 {
        unauthorised.send(0, vec![6; 30]);
        unauthorised.send(1, vec![6; 30]);
        vessel.send(0, vec![5; 300]);
        while let Some(received) = vessel.receive(Duration::from_millis(1)) {
            assert_ne!(received.bytes, vec![6; 30]);
        }
        assert!(unauthorised.receive(Duration::from_millis(1)).is_none());
    }
    assert_exchange(&mut vessel, &mut drone, 3);
    fs::remove_dir_all(&keys).expect("removed");
}
