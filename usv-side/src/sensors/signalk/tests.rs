use super::*;
use crate::{
    fixtures::{self, damage, damaged, fixes},
    sensors::Mount,
};
use alight_shared::msg::NOT_MEASURED_SD;
use proptest::prelude::*;

const HELLO: &str = r#"{"name":"signalk-server","version":"2.8.0","self":"vessels.urn:mrn:imo:mmsi:230099999","roles":["master"]}
"#;

/// A delta of `source`, this many seconds after noon.
fn delta(at_s: f64, source: &str, values: &[(&str, &str)]) -> String {
    let values: Vec<String> = values
        .iter()
        .map(|(path, value)| format!(r#"{{"path":"{path}","value":{value}}}"#))
        .collect();
    format!(
        r#"{{"context":"vessels.urn:mrn:imo:mmsi:230099999","updates":[{{"$source":"{source}","timestamp":"2026-05-20T12:00:{at_s:06.3}Z","values":[{}]}}]}}
"#,
        values.join(",")
    )
}
fn decode(text: &str) -> (Vec<SourceMeasurement>, SignalKDecoder) {
    let decoder = SignalKDecoder::new(&Mounting::new(&Mount::default()));
    fixtures::decode(decoder, text.as_bytes(), 7)
}
const PLACE: (&str, &str) = ("navigation.position", r#"{"latitude":50.0,"longitude":14.5}"#);

#[test]
fn signalk_greeting_cached_values_and_other_vessels() {
    let other = delta(2.0, "ais", &[PLACE]).replace("230099999", "211000001");
    let place = |at_s| delta(at_s, "gps.GP", &[PLACE]);
    let before = place(0.5) + HELLO + &place(1.0) + &other + &place(2.0);
    let text = before + HELLO + &place(3.0) + &place(4.0);
    let (all, d) = decode(&text);
    let noon = utc_ns("2026-05-20T12:00:00Z").unwrap();
    let at: Vec<i64> = all.iter().map(|m| (m.at_ns - noon) / 1_000_000_000).collect();
    assert_eq!(at, [2, 4]);
    let counts = d.decoded();
    assert_eq!(
        (counts.good, counts.left_out, counts.ignored, counts.corrupted),
        (4, 2, 2, 0)
    );
}

#[test]
fn signalk_position_with_velocity_and_height() {
    let own = |text: String| text.replace("urn:mrn:imo:mmsi:230099999", "self");
    let receiver = [
        PLACE,
        ("navigation.gnss.methodQuality", "\"DGNSS fix\""),
        ("navigation.gnss.antennaAltitude", "2.5"),
        ("navigation.gnss.geoidalSeparation", "44.0"),
        ("navigation.gnss.horizontalDilution", "1.5"),
    ];
    let speed = ("navigation.speedOverGround", "3.0");
    let course = ("navigation.courseOverGroundTrue", "1.5707963");
    let text = [
        delta(1.0, "gps.GP", &[speed, course]),
        delta(1.1, "gps.GP", &receiver),
        // Speed and course in separate updates, another device's speed in between.
        delta(2.0, "gps.GP", &[speed]),
        delta(2.05, "gps.GP", &[course]),
        delta(2.1, "gps.GP", &[PLACE]),
        delta(3.0, "log.VW", &[speed]),
        delta(3.05, "gps.GP", &[course]),
        delta(3.4, "gps.GP", &[PLACE]),
    ]
    .map(own)
    .concat();
    let (all, d) = decode(&text);
    let fixes = fixes(&all);
    assert_eq!((fixes.len(), d.decoded().corrupted), (3, 0), "{all:?}");
    assert!((fixes[0].datum.height_m - 46.5).abs() < 1e-9 && fixes[0].height_spread == 0.0);
    assert!((fixes[0].position_sd[0] - 0.45).abs() < 1e-9, "{:?}", fixes[0]);
    for fix in &fixes[..2] {
        assert!((fix.velocity[1] - 3.0).abs() < 1e-6 && fix.velocity_sd[0] < NOT_MEASURED_SD);
    }
    assert!(fixes[2].velocity_sd[0] >= NOT_MEASURED_SD && fixes[2].position_sd[2] >= NOT_MEASURED_SD);
    // No fix, a simulated fix, and unknown terms.
    for term in ["no GPS", "Simulator mode", "splendid"] {
        let text = own(delta(
            1.0,
            "gps.GP",
            &[PLACE, ("navigation.gnss.methodQuality", &format!("{term:?}"))],
        ));
        let (all, d) = decode(&text);
        assert_eq!((all.len(), d.decoded().left_out), (0, 1), "{term}");
    }
}

#[test]
fn signalk_heading_attitude_and_what_is_null() {
    let text = [
        delta(1.0, "n2k.5", &[("navigation.headingMagnetic", "1.0")]),
        delta(
            1.1,
            "n2k.5",
            &[("navigation.rateOfTurn", "0.02"), ("environment.heave", "0.5")],
        ),
        delta(
            1.2,
            "n2k.5",
            &[
                ("navigation.headingMagnetic", "1.0"),
                ("navigation.magneticVariation", "0.03"),
            ],
        ),
        delta(1.25, "n2k.9", &[("navigation.headingTrue", "2.0")]),
        delta(
            1.3,
            "n2k.5",
            &[("navigation.attitude", r#"{"roll":-0.1,"pitch":0.1,"yaw":null}"#)],
        ),
        delta(
            1.4,
            "n2k.5",
            &[
                ("navigation.attitude", r#"{"roll":null,"pitch":0.1}"#),
                ("environment.wind.speedApparent", "7"),
            ],
        ),
        delta(1.5, "n2k.5", &[("navigation.headingTrue", "null")]),
    ]
    .concat()
    .replace("urn:mrn:imo:mmsi:230099999", "self");
    let (all, d) = decode(&text);
    let [first, second] = &all[..] else {
        panic!("{all:?}")
    };
    assert!(
        matches!(first.measurement, Measurement::Heading(h) if (h.heading - 1.03).abs() < 1e-9 && h.rate == Some(0.02))
    );
    assert!(
        matches!(second.measurement, Measurement::Attitude(a) if (a.tilt[0] + 0.1).abs() < 1e-9 && (a.tilt[1] - 0.1).abs() < 1e-9 && a.heave == Some(-0.5))
    );
    // A magnetic heading before a known variation, the second device, and a null heading.
    let counts = d.decoded();
    assert_eq!(
        (counts.left_out, counts.ignored, counts.corrupted),
        (3, 1, 0),
        "{:?}",
        d.remarks()
    );
}

#[test]
fn signalk_without_stamps_and_overlong() {
    let mut d = SignalKDecoder::new(&Mounting::new(&Mount::default()));
    let line = r#"{"updates":[{"values":[{"path":"navigation.headingTrue","value":1.0}]}]}"#;
    let mut out = Vec::new();
    d.push(format!("{line}\n").as_bytes(), &mut out);
    assert_eq!((out.len(), d.timeless().len(), d.decoded().undated), (0, 0, 1));
    d.arrive(Time::from_secs(100.0));
    d.push(format!("{line}\n").as_bytes(), &mut out);
    assert_eq!((out.len(), d.timeless().len(), d.decoded().by_arrival), (0, 1, 1));
    let long = format!("{{\"updates\":[{}]}}\n", " ".repeat(MAX_MESSAGE));
    let deep = format!("{}\n", "{\"updates\":[".repeat(500));
    d.push((long + &deep + "not JSON\n").as_bytes(), &mut out);
    assert_eq!(d.decoded().corrupted, 3);
    // Sources without a number.
    for k in 0..1000 {
        d.push(
            delta(1.0, &format!("s{k}"), &[PLACE])
                .replace("urn:mrn:imo:mmsi:230099999", "self")
                .as_bytes(),
            &mut out,
        );
    }
    assert_eq!((d.sources.len(), out.len()), (MAX_SOURCES, 1));
}

#[test]
fn signalk_whole_seconds_at_five_hertz() {
    let place =
        |at_s: f64| delta(at_s.floor(), "gps.GP", &[PLACE]).replace("urn:mrn:imo:mmsi:230099999", "self");
    let mut d = SignalKDecoder::new(&Mounting::new(&Mount::default()));
    let (mut out, mut timeless) = (Vec::new(), 0);
    for k in 0..20 {
        d.arrive(Time::from_secs(100.0 + 0.2 * f64::from(k)));
        d.push(place(0.2 * f64::from(k)).as_bytes(), &mut out);
        timeless += d.timeless().len();
    }
    assert_eq!((out.len(), timeless, d.decoded().by_arrival), (4, 16, 16));
}

#[test]
fn signalk_burst_after_the_network_stood_still() {
    let place = |k: i32| {
        let north = format!(r#"{{"latitude":50.{k:03},"longitude":14.5}}"#);
        let at_s = f64::from(k / 5);
        delta(at_s, "gps.GP", &[("navigation.position", &north)])
            .replace("urn:mrn:imo:mmsi:230099999", "self")
    };
    let mut d = SignalKDecoder::new(&Mounting::new(&Mount::default()));
    let mut out = Vec::new();
    for k in 0..20 {
        d.arrive(Time::from_secs(100.0 + 0.2 * f64::from(k)));
        d.push(place(k).as_bytes(), &mut out);
        assert_eq!(d.timeless().len(), usize::from(k % 5 != 0), "{k}");
    }
    // Updates of five seconds arrive at once; only the last update is current.
    out.clear();
    d.arrive(Time::from_secs(108.8));
    let burst: String = (20..45).map(place).collect();
    d.push(burst.as_bytes(), &mut out);
    let newest = d.timeless();
    assert_eq!((out.len(), newest.len(), d.decoded().left_out), (5, 1, 19));
    assert!(
        matches!(newest[0], Measurement::Gnss(fix) if (fix.datum.latitude_deg - 50.044).abs() < 1e-9),
        "{newest:?}"
    );
    assert!(d.remarks().iter().any(|r| r.text.contains("delayed")));
    d.arrive(Time::from_secs(111.0));
    d.push((place(45) + &place(46)).as_bytes(), &mut out);
    assert_eq!((out.len(), d.timeless().len()), (6, 0));
    d.arrive(Time::from_secs(111.2));
    d.push((place(55) + &place(56)).as_bytes(), &mut out);
    assert_eq!((out.len(), d.timeless().len()), (7, 1));
}

#[test]
fn signalk_update_of_another_shape_between_others() {
    let values =
        |value: &str| format!(r#"{{"$source":"a","timestamp":"2026-05-20T12:00:01Z","values":{value}}}"#);
    let heading = r#"[{"path":"navigation.headingTrue","value":1.0}]"#;
    let place = r#"[{"path":"navigation.position","value":{"latitude":50,"longitude":14.5}}]"#;
    let shapes = [r#"{"path":"a"}"#, r#"[{"value":1}]"#, "null", "7"].map(values);
    let mut updates = vec![values(heading)];
    updates.extend(shapes);
    updates.extend(["5".into(), values(place)]);
    let (all, d) = decode(&format!("{{\"updates\":[{}]}}\n", updates.join(",")));
    assert_eq!((all.len(), d.decoded().corrupted), (2, 5), "{all:?}");
}

#[test]
fn signalk_chosen_source_and_what_it_marks_itself() {
    let own = |text: String| text.replace("urn:mrn:imo:mmsi:230099999", "self");
    let mut mount = Mount::default();
    mount.devices.heading = "can0.9".into();
    let turned = |at_s, source, rad| own(delta(at_s, source, &[("navigation.headingTrue", rad)]));
    let cautious = [PLACE, ("navigation.gnss.integrity", "\"Caution\"")];
    let text = [
        turned(1.0, "can0.5", "1.0"),
        turned(1.1, "can0.9", "2.0"),
        turned(1.2, "can0.5", "1.0"),
        own(delta(1.3, "gps.GP", &cautious)),
        own(delta(1.4, "gps.GP", &[("navigation.position", "null")])),
        turned(8.0, "can0.5", "1.0"),
    ]
    .concat();
    let (all, d) = fixtures::decode(SignalKDecoder::new(&Mounting::new(&mount)), text.as_bytes(), 7);
    assert_eq!(fixtures::whole(fixtures::headings(&all)), [1.0, 2.0, 1.0]);
    assert!((fixes(&all)[0].position_sd[0] - 1.5).abs() < 1e-9);
    let remarks: String = d.remarks().into_iter().map(|r| r.text + "\n").collect();
    for expected in [
        "heading: the chosen device can0.9 has sent nothing valid for 7 s; sent by can0.5",
        "1 of 1 whole fixes are marked with caution",
        "1 position (empty)",
    ] {
        assert!(remarks.contains(expected), "{expected}: {remarks}");
    }
}

#[test]
fn signalk_receiver_whose_week_number_rolled_over() {
    // GGA is dated by the server, RMC by the receiver, 1024 weeks ago.
    let height = ("navigation.gnss.antennaAltitude", "2.5");
    let mut text = String::new();
    let mut d = SignalKDecoder::new(&Mounting::new(&Mount::default()));
    let (mut out, mut timeless) = (Vec::new(), 0);
    for k in 0..20 {
        let at_s = f64::from(k);
        let own = |values: &[_]| delta(at_s, "gps.GP", values).replace("urn:mrn:imo:mmsi:230099999", "self");
        let old = own(&[PLACE]).replace("2026-05-20", "2006-10-04");
        let both = own(&[PLACE, height]) + &old;
        d.arrive(Time::from_secs(100.0 + at_s));
        d.push(both.as_bytes(), &mut out);
        timeless += d.timeless().len();
        text += &both;
    }
    let heights = fixes(&out)
        .iter()
        .filter(|f| f.position_sd[2] < NOT_MEASURED_SD)
        .count();
    assert_eq!((out.len(), heights, timeless), (20, 20, 20));
    let noon = utc_ns("2026-05-20T12:00:00Z").unwrap();
    let is_right = |all: &[SourceMeasurement]| {
        all.iter()
            .enumerate()
            .all(|(k, m)| m.at_ns == noon + 1_000_000_000 * k as i64)
    };
    assert!(is_right(&out));
    let (recorded, of_file) = decode(&text);
    assert!(recorded.len() == 20 && is_right(&recorded));
    for d in [d, of_file] {
        let found = d.remarks();
        let named = |r: &&Remark| {
            r.text
                .starts_with("gps.GP: two clocks, 1024 weeks apart (its week number has rolled over)")
        };
        assert!(found.iter().any(|r| named(&r)), "{found:?}");
    }
}

proptest! {
    #[test]
    fn signalk_arbitrary_damage(damage in damage(60), noise in prop::collection::vec(any::<u8>(), 0..600), cut in 1_usize..700) {
        let whole: String = (0..10).map(|k| delta(f64::from(k), "gps.GP", &[PLACE, ("navigation.headingTrue", "1.0")])).collect();
        let bytes = [damaged((HELLO.to_owned() + &whole).into_bytes(), damage), noise].concat();
        let decoder = SignalKDecoder::new(&Mounting::new(&Mount::default()));
        let (all, _) = fixtures::decode(decoder, &bytes, cut);
        prop_assert!(all.len() <= 20);
    }
}

/// Values that `alight signalk` publishes come back: they are neither used nor counted as unused.
#[test]
fn signalk_values_of_this_program() {
    let own = [
        ("alight.status", "\"fine\""),
        ("notifications.alight.deck", "null"),
    ];
    let (all, d) = decode(&(HELLO.to_string() + &delta(1.0, "alight", &own)));
    let counts = d.decoded();
    assert!(all.is_empty());
    assert_eq!((counts.ignored, counts.left_out, counts.corrupted), (0, 0, 0));
}
