//! Access control of the radio: real Zenoh clients whose messages must be rejected, next to one that is admitted.

use std::{
    fs,
    path::{Path, PathBuf},
    time::Duration,
};

use alight_shared::admission::AccessRejection;
use alight_transport::{
    radio::{Radio, RadioConfig},
    rejections,
};
use rcgen::{CertificateParams, DnType, ExtendedKeyUsagePurpose, Issuer, KeyPair};
use zenoh::Wait;

use crate::common::{self, free_udp, publication, tls};

/// Client that connects to `endpoint` or listens there, and repeatedly publishes on `key`.
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

fn files(directory: &Path) -> Vec<(&'static str, PathBuf)> {
    vec![
        ("root_ca_certificate", directory.join("authority.pem")),
        ("connect_certificate", directory.join("certificate.pem")),
        ("connect_private_key", directory.join("key.pem")),
    ]
}

/// Signs an expired certificate with an admitted name, using the authority in `keys`; returns its directory.
fn expired(keys: &Path) -> PathBuf {
    let key = fs::read_to_string(keys.join("authority-key.pem")).expect("the authority's key");
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
    fs::create_dir_all(&directory).expect("a directory");
    fs::write(directory.join("certificate.pem"), signed.pem()).expect("written");
    fs::write(directory.join("key.pem"), own.serialize_pem()).expect("written");
    fs::copy(keys.join("authority.pem"), directory.join("authority.pem")).expect("copied");
    directory
}

const STATUS: &str = "alight/drone-1/status";

#[track_caller]
fn assert_counted(why: AccessRejection) {
    let counted = rejections::counted();
    assert!(counted.of(why) > 0, "{why:?} was not noticed: {counted:?}");
}

/// Peers that the vessel at `address` must reject: without a certificate, with one of another authority, with an
/// expired one, with a name that is not admitted, and with an admitted certificate on other peers' keys.
fn intruders(address: &str, keys: &Path) -> Vec<Intruder> {
    common::keys(keys, "drone 9");
    let other = keys.join("other");
    common::keys(&other, "init");
    common::keys(&other, "drone 1");
    // The intruder trusts the vessel; the vessel does not trust the intruder.
    let mut of_another = files(&other.join("drone-1"));
    of_another[0].1 = keys.join("authority.pem");
    let trust = vec![("root_ca_certificate", keys.join("authority.pem"))];
    let named = |name: &str| files(&keys.join(name));
    let over_quic = [
        (trust, STATUS),
        (of_another, STATUS),
        (files(&expired(keys)), STATUS),
        (named("drone-9"), STATUS),
        (named("drone-9"), "alight/drone-9/status"),
        (named("drone-2"), STATUS),
        (named("drone-2"), "alight/vessel-1/estimate"),
    ];
    let over_quic = over_quic.map(|(files, key)| Intruder::dial(&format!("quic/{address}"), &files, key));
    let in_plain_text = Intruder::dial(&format!("tcp/{address}"), &[], STATUS);
    over_quic.into_iter().chain([in_plain_text]).collect()
}

#[test]
fn intruders_among_admitted_peers() {
    rejections::listen();
    let directory = common::certificates("intruders");
    common::keys(&directory, "drone 2");
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
    let mut drone = Radio::open(&dial, publication(STATUS), all).expect("opens");
    // The same kind of client, with an admitted certificate on its own key.
    let admitted = Intruder::dial(
        &format!("quic/{address}"),
        &files(&directory.join("drone-2")),
        "alight/drone-2/status",
    );
    let intruders = intruders(&address, &directory);
    let [mut friend, mut second, mut back] = [0; 3];
    // The intruders have as much time as two hundred exchanges of the admitted peers take.
    for _ in 0..4000 {
        vessel.send(0, b"estimate".to_vec());
        drone.send(0, b"friend".to_vec());
        admitted.publish(b"second");
        for s in &intruders {
            s.publish(b"intruder");
        }
        while let Some(message) = vessel.receive(Duration::from_millis(5)) {
            assert_ne!(message.bytes, b"intruder");
            friend += u32::from(message.bytes == b"friend");
            second += u32::from(message.bytes == b"second");
        }
        while let Some(message) = drone.receive(Duration::from_millis(5)) {
            assert_ne!(message.bytes, b"intruder");
            back += u32::from(message.bytes == b"estimate");
        }
        if [friend, second, back].iter().all(|n| *n >= 200) {
            break;
        }
    }
    assert!(
        [friend, second, back].iter().all(|n| *n >= 200),
        "received from the drones {friend} and {second} times, from the vessel {back} times"
    );
    let none_of = AccessRejection::Handshake;
    let expected = AccessRejection::ALL.into_iter().filter(|why| *why != none_of);
    expected.for_each(assert_counted);
    fs::remove_dir_all(&directory).expect("removed");
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
    fs::remove_dir_all(&keys).expect("removed");
}
