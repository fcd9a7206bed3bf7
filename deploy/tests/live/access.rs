//! Access to the radio: real zenoh clients whose messages must be rejected, next to one that is admitted. Nothing
//! here asserts a time: the bounds on waiting are only against tests that never end.

use std::path::{Path, PathBuf};
use std::time::Duration;

use alight_shared::admission::AccessRejection;
use alight_transport::radio::{Radio, RadioConfig};
use alight_transport::rejections;
use rcgen::{CertificateParams, DnType, ExtendedKeyUsagePurpose, Issuer, KeyPair};
use zenoh::Wait;

use crate::common::{self, free_udp, publication, tls};

/// A client with rules of its own: it connects to `endpoint`, or listens there, and publishes what it is given on
/// `key`, again and again.
struct Intruder(zenoh::Session, String);

impl Intruder {
    fn dial(endpoint: &str, files: &[(&str, PathBuf)], key: &str) -> Intruder {
        Intruder::open(&format!("[{endpoint:?}]"), "[]", files, key)
    }
    fn listen(endpoint: &str, files: &[(&str, PathBuf)], key: &str) -> Intruder {
        Intruder::open("[]", &format!("[{endpoint:?}]"), files, key)
    }
    fn open(connect: &str, listen: &str, files: &[(&str, PathBuf)], key: &str) -> Intruder {
        let mut config = zenoh::Config::default();
        let mut set = |key: &str, value: String| config.insert_json5(key, &value).expect("a setting");
        set("mode", r#""peer""#.into());
        set("connect/endpoints", connect.into());
        set("connect/timeout_ms", "-1".into());
        set("connect/exit_on_failure", "false".into());
        set(
            "connect/retry",
            r#"{ "period_init_ms": 50, "period_max_ms": 100 }"#.into(),
        );
        set("listen/endpoints", listen.into());
        set("scouting/multicast/enabled", "false".into());
        set("scouting/gossip/enabled", "false".into());
        for (key, file) in files {
            set(
                &format!("transport/link/tls/{key}"),
                format!("{:?}", file.display().to_string()),
            );
        }
        if files
            .iter()
            .any(|(key, _)| key.ends_with("_certificate") && *key != "root_ca_certificate")
        {
            set("transport/link/tls/enable_mtls", "true".into());
        }
        Intruder(zenoh::open(config).wait().expect("opens"), key.into())
    }
    fn publish(&self, text: &[u8]) {
        let _rejected = self.0.put(self.1.clone(), text.to_vec()).wait();
    }
}

/// The settings of a client whose files are in `directory`.
fn files(directory: &Path) -> Vec<(&'static str, PathBuf)> {
    vec![
        ("root_ca_certificate", directory.join("authority.pem")),
        ("connect_certificate", directory.join("certificate.pem")),
        ("connect_private_key", directory.join("key.pem")),
    ]
}

/// A vessel and its drone over TLS; both receive each other while `intruders` try the vessel: true when
/// a message of one of them was accepted.
fn accepted(name: &str, intruders: impl Fn(&str, &Path) -> Vec<Intruder>) -> bool {
    rejections::listen();
    let directory = common::certificates(name);
    let address = free_udp();
    let listen = RadioConfig::listening(
        format!("quic/{address}"),
        tls(&directory.join("vessel-1"), &["drone-1", "drone-2"]),
    );
    let dial = RadioConfig::dialling(
        format!("quic/{address}"),
        tls(&directory.join("drone-1"), &["vessel-1"]),
    );
    let all = vec!["alight/**".to_owned()];
    let mut vessel =
        Radio::open(&listen, publication("alight/vessel-1/estimate"), all.clone()).expect("opens");
    let mut drone = Radio::open(&dial, publication("alight/drone-1/status"), all).expect("opens");
    let intruders = intruders(&address, &directory);
    let (mut friend, mut back, mut intruder_accepted) = (0, 0, false);
    // Two hundred exchanges of the peers give the intruders as much time.
    for _ in 0..2000 {
        vessel.send(0, b"estimate".to_vec());
        drone.send(0, b"friend".to_vec());
        for s in &intruders {
            s.publish(b"intruder");
        }
        while let Some(message) = vessel.receive(Duration::from_millis(5)) {
            friend += u32::from(message.bytes == b"friend");
            intruder_accepted |= message.bytes == b"intruder";
        }
        while let Some(message) = drone.receive(Duration::from_millis(5)) {
            back += u32::from(message.bytes == b"estimate");
            intruder_accepted |= message.bytes == b"intruder";
        }
        if friend >= 200 && back >= 200 {
            break;
        }
    }
    assert!(
        friend >= 200 && back >= 200,
        "received from the drone {friend} times, from the vessel {back} times"
    );
    std::fs::remove_dir_all(&directory).expect("removed");
    intruder_accepted
}

const STATUS: &str = "alight/drone-1/status";

/// The rejection was noticed, and for what it was: the operator reads it in `alight status`.
#[track_caller]
fn assert_counted(why: AccessRejection) {
    let counted = rejections::counted();
    assert!(counted.of(why) > 0, "{why:?} was not noticed: {counted:?}");
}

#[test]
fn admitted_certificate_on_its_own_key() {
    assert!(accepted("right", |at, keys| {
        common::keys(keys, "drone 2");
        vec![Intruder::dial(
            &format!("quic/{at}"),
            &files(&keys.join("drone-2")),
            "alight/drone-2/status",
        )]
    }));
}

#[test]
fn peer_without_certificate() {
    assert!(!accepted("none", |at, keys| {
        let trust = vec![("root_ca_certificate", keys.join("authority.pem"))];
        vec![
            Intruder::dial(&format!("tcp/{at}"), &[], STATUS),
            Intruder::dial(&format!("quic/{at}"), &trust, STATUS),
        ]
    }));
    assert_counted(AccessRejection::NotTls);
    assert_counted(AccessRejection::NoCertificate);
}

#[test]
fn certificate_of_another_authority() {
    assert!(!accepted("other", |at, keys| {
        let other = keys.join("other");
        common::keys(&other, "init");
        common::keys(&other, "drone 1");
        let mut files = files(&other.join("drone-1"));
        // It trusts the vessel; the vessel does not trust it.
        files[0].1 = keys.join("authority.pem");
        vec![Intruder::dial(&format!("quic/{at}"), &files, STATUS)]
    }));
    assert_counted(AccessRejection::OtherAuthority);
}

#[test]
fn certificate_with_a_name_not_admitted() {
    assert!(!accepted("name", |at, keys| {
        common::keys(keys, "drone 9");
        vec![
            Intruder::dial(&format!("quic/{at}"), &files(&keys.join("drone-9")), STATUS),
            Intruder::dial(
                &format!("quic/{at}"),
                &files(&keys.join("drone-9")),
                "alight/drone-9/status",
            ),
        ]
    }));
    assert_counted(AccessRejection::Name);
}

#[test]
fn admitted_name_on_the_key_of_another_drone() {
    assert!(!accepted("key", |at, keys| {
        common::keys(keys, "drone 2");
        let own = files(&keys.join("drone-2"));
        [STATUS, "alight/vessel-1/estimate"]
            .map(|key| Intruder::dial(&format!("quic/{at}"), &own, key))
            .into()
    }));
    assert_counted(AccessRejection::Key);
}

#[test]
fn vessel_on_a_key_outside_its_rule() {
    rejections::listen();
    let keys = common::certificates("vessel-key");
    let own = keys.join("vessel-1");
    let files = [
        ("root_ca_certificate", own.join("authority.pem")),
        ("listen_certificate", own.join("certificate.pem")),
        ("listen_private_key", own.join("key.pem")),
    ];
    let address = free_udp();
    // The vessel's certificate admits the vessel's keys and no others.
    let mut vessel = Intruder::listen(&format!("quic/{address}"), &files, "alight/vessel-1/estimate");
    let dial = RadioConfig::dialling(
        format!("quic/{address}"),
        tls(&keys.join("drone-1"), &["vessel-1"]),
    );
    let mut drone = Radio::open(&dial, publication(STATUS), vec!["alight/**".to_owned()]).expect("opens");
    let mut friend = 0;
    for _ in 0..2000 {
        for key in [
            "alight/vessel-2/estimate",
            "alight/drone-2/status",
            "alight/estimate",
        ] {
            vessel.1 = key.into();
            vessel.publish(b"intruder");
        }
        vessel.1 = "alight/vessel-1/estimate".into();
        vessel.publish(b"friend");
        while let Some(message) = drone.receive(Duration::from_millis(5)) {
            assert_eq!(message.bytes, b"friend");
            friend += 1;
        }
        if friend >= 200 {
            break;
        }
    }
    assert!(friend >= 200, "the vessel's own key was received {friend} times");
    assert_counted(AccessRejection::Key);
    std::fs::remove_dir_all(&keys).expect("removed");
}

#[test]
fn expired_certificate() {
    assert!(!accepted("expired", |at, keys| {
        let key = std::fs::read_to_string(keys.join("authority-key.pem")).expect("the authority's key");
        let key = KeyPair::from_pem(&key).expect("a key");
        let named = |name: &str| {
            let mut params = CertificateParams::default();
            params.distinguished_name = rcgen::DistinguishedName::new();
            params.distinguished_name.push(DnType::CommonName, name);
            params
        };
        let authority = named("Alight private authority");
        let mut params = named("drone-1");
        params.not_before = rcgen::date_time_ymd(2020, 1, 1);
        params.not_after = rcgen::date_time_ymd(2020, 1, 2);
        params.extended_key_usages = vec![ExtendedKeyUsagePurpose::ClientAuth];
        let own = KeyPair::generate().expect("a key");
        let signed = params
            .signed_by(&own, &Issuer::from_params(&authority, &key))
            .expect("signed");
        let directory = keys.join("expired");
        std::fs::create_dir_all(&directory).expect("a directory");
        std::fs::write(directory.join("certificate.pem"), signed.pem()).expect("written");
        std::fs::write(directory.join("key.pem"), own.serialize_pem()).expect("written");
        std::fs::copy(keys.join("authority.pem"), directory.join("authority.pem")).expect("copied");
        vec![Intruder::dial(&format!("quic/{at}"), &files(&directory), STATUS)]
    }));
    assert_counted(AccessRejection::Expired);
}
