use super::*;
use crate::fixtures::sentence;
use crate::sensors::{HeaveSign, Measurement, Mount};
use proptest::prelude::*;

fn decoder(mount: Mount) -> NmeaDecoder {
    NmeaDecoder::new(&Mounting::new(&mount))
}
fn decode(text: &str, mount: Mount) -> (Vec<SourceMeasurement>, Decoded) {
    let mut d = decoder(mount);
    let mut out = Vec::new();
    d.push(text.as_bytes(), &mut out);
    d.finish(&mut out);
    (out, d.decoded())
}
/// A receiver with two antennas and a motion sensor, at 5 Hz.
fn stream(epochs: usize) -> String {
    let mut text = String::new();
    for k in 0..epochs {
        let time = format!("1200{:02}.{}00", (k / 5) % 60, 2 * (k % 5));
        text += &sentence(&format!(
            "GPGGA,{time},5000.0000,N,01430.0000,E,4,12,0.8,210.0,M,45.0,M,1.0,0001"
        ));
        text += &sentence(&format!(
            "GPRMC,{time},A,5000.0000,N,01430.0000,E,3.9,90.0,200526,,,D"
        ));
        text += &sentence("GPVTG,90.0,T,,M,3.9,N,7.2,K,D");
        text += &sentence("HEHDT,91.5,T");
        text += &sentence("HEROT,60.0,A");
        text += &sentence(&format!(
            "PASHR,{time},91.50,T,2.00,-1.00,0.25,0.020,0.020,0.100,2,1"
        ));
        text += &sentence("GPGSA,A,3,01,02,03,,,,,,,,,,1.5,0.8,1.2");
    }
    text
}

#[test]
fn nmea_epoch() {
    let (all, counts) = decode(&stream(10), Mount::default());
    assert_eq!(
        counts,
        Decoded {
            good: 60,
            ignored: 10,
            ..Decoded::default()
        }
    );
    let last = |kind| *all.iter().rfind(|h| h.measurement.kind() == kind).unwrap();
    assert_eq!(all.iter().filter(|h| h.measurement.kind() == 1).count(), 10);
    let at_ns = (12 * 3600 + 1) * 1_000_000_000_i64 + 800_000_000;
    let (fix, heading, attitude) = (last(1), last(2), last(3));
    assert!([fix, heading, attitude].iter().all(|h| h.at_ns == at_ns));
    let (Measurement::Gnss(g), Measurement::Heading(h), Measurement::Attitude(a)) =
        (fix.measurement, heading.measurement, attitude.measurement)
    else {
        panic!("kinds");
    };
    // The ellipsoid lies 45 m below the geoid's 210 m.
    let place = [g.datum.latitude_deg, g.datum.longitude_deg, g.datum.height_m];
    assert!(
        place
            .iter()
            .zip([50.0, 14.5, 255.0])
            .all(|(a, b)| (a - b).abs() < 1e-9),
        "{g:?}"
    );
    assert!(
        (g.velocity[1] - 2.006).abs() < 1e-3 && g.velocity[0].abs() < 1e-9,
        "{g:?}"
    );
    assert_eq!(g.velocity_sd[2], NOT_MEASURED_SD);
    assert!((h.heading - 91.5_f64.to_radians()).abs() < 1e-9);
    assert!(
        (h.rate.unwrap() - 1_f64.to_radians()).abs() < 1e-9,
        "60 degrees a minute"
    );
    assert!((a.tilt[0] - 2_f64.to_radians()).abs() < 1e-6 && (a.tilt[1] + 1_f64.to_radians()).abs() < 1e-6);
    assert_eq!(a.heave, Some(-0.25));
    assert!((a.tilt_sd - 0.02_f64.to_radians()).abs() < 1e-9);
}

#[test]
fn nmea_without_time() {
    let hdt = sentence("HEHDT,10.0,T");
    let zda = |t: &str| sentence(&format!("GPZDA,{t},20,05,2026,00,00"));
    // Before any time; twice in one epoch; invalid times.
    let text = [
        hdt.clone(),
        zda("120000.00"),
        hdt.clone(),
        hdt.clone(),
        zda("250000.00"),
        zda("12000x.00"),
    ];
    let (all, counts) = decode(&text.concat(), Mount::default());
    assert_eq!((all.len(), counts.undated, counts.corrupted), (1, 2, 2));
    // Where sentences without a time lead, they belong to the next time.
    let lead = Mount {
        untimed_lead: true,
        ..Mount::default()
    };
    let text = [hdt.clone(), zda("120000.00"), hdt, zda("120001.00")];
    let (all, counts) = decode(&text.concat(), lead);
    let noon = 12 * 3600 * 1_000_000_000_i64;
    assert_eq!(
        all.iter().map(|h| h.at_ns - noon).collect::<Vec<_>>(),
        [0, 1_000_000_000]
    );
    assert_eq!(counts.undated, 0);
}

#[test]
fn nmea_across_midnight() {
    let at = |t: &str| sentence(&format!("PASHR,{t},0.0,T,1.0,1.0,0.0,0.1,0.1,0.1,1,1"));
    let text = [at("235959.50"), at("000000.00"), at("235959.75"), at("000000.50")].concat();
    let (all, _) = decode(&text, Mount::default());
    let times: Vec<i64> = all
        .iter()
        .filter(|h| h.measurement.kind() == 3)
        .map(|h| (h.at_ns - all[0].at_ns) / 1_000_000)
        .collect();
    assert_eq!(times, [0, 500, 250, 1000]);
}

#[test]
fn nmea_sentence_with_the_time_of_its_epoch() {
    let mount = Mount {
        heave: HeaveSign::None,
        ..Mount::default()
    };
    let text = [
        sentence("GPZDA,120000.00,20,05,2026,00,00"),
        sentence("PRDID,-10.37,2.34,230.34"),
    ]
    .concat();
    let (all, counts) = decode(&text, mount);
    let Measurement::Attitude(a) = all[0].measurement else {
        panic!("{all:?}")
    };
    assert!((a.tilt[1].to_degrees() + 10.37).abs() < 1e-4 && (a.tilt[0].to_degrees() - 2.34).abs() < 1e-4);
    assert_eq!((a.heave, all.len(), counts.good), (None, 2, 2));
}

#[test]
fn nmea_sentences_after_damage() {
    let good = stream(1);
    let zda = sentence("GPZDA,120001.00,20,05,2026,00,00");
    // A wrong letter, a sentence cut by another, one without a checksum, one without an end.
    let bad = [
        zda.replace("2026", "2025"),
        zda[..20].to_owned(),
        "$GPZDA,120001.00,20,05,2026,00,00\r\n".to_owned(),
        "$".to_owned() + &"x".repeat(5000) + "\n",
        "\u{fffd}\n".to_owned(),
    ]
    .concat();
    let (all, counts) = decode(&(bad + &good), Mount::default());
    assert_eq!((counts.good, counts.corrupted), (6, 5));
    assert_eq!(all.iter().filter(|h| h.measurement.kind() == 3).count(), 1);
}

proptest! {
    #[test]
    fn nmea_arbitrary_bytes(bytes in prop::collection::vec(any::<u8>(), 0..4000), cut in 1_usize..40) {
        let mut d = decoder(Mount::default());
        let mut out = Vec::new();
        for part in bytes.chunks(cut) {
            d.push(part, &mut out);
            prop_assert!(d.line.len() <= MAX_LINE && d.waiting.len() <= MAX_WAITING);
        }
        d.finish(&mut out);
        prop_assert!(out.len() <= bytes.len());
    }

    #[test]
    fn nmea_arbitrary_fields(
        name in prop::sample::select(vec!["GPGGA", "GPRMC", "GPVTG", "HEHDT", "HETHS", "HEROT", "PASHR", "PRDID", "GPZDA"]),
        time in prop::sample::select(vec!["120000.00", "235959.99", "", "996099", "12"]),
        fields in prop::collection::vec("[-+0-9.eENSAWTMVinf]{0,8}", 0..15),
    ) {
        let text = sentence("GPZDA,120000.00,20,05,2026,00,00")
            + &sentence(&format!("{name},{time},{}", fields.join(",")))
            + &sentence(&format!("{name},{}", fields.join(",")));
        let (all, counts) = decode(&text, Mount::default());
        prop_assert_eq!(counts.good + counts.corrupted + counts.ignored, 3);
        for m in all {
            prop_assert!(m.at_ns.abs() < 2 * DAY_NS);
            // Implausible numbers are rejected where measurements are admitted; NaN never leaves the decoder.
            if let Measurement::Gnss(g) = m.measurement {
                prop_assert!(g.datum.latitude_deg.abs() <= 90.0 && g.velocity.iter().all(|v| v.is_finite()));
            }
        }
    }

    #[test]
    fn nmea_stream_in_any_pieces(cuts in prop::collection::vec(1_usize..200, 1..60)) {
        let text = stream(4);
        let (whole, counts) = decode(&text, Mount::default());
        let mut d = decoder(Mount::default());
        let (mut out, mut rest) = (Vec::new(), text.as_bytes());
        for cut in cuts {
            let (part, later) = rest.split_at(cut.min(rest.len()));
            d.push(part, &mut out);
            rest = later;
        }
        d.push(rest, &mut out);
        d.finish(&mut out);
        prop_assert_eq!((out, d.decoded()), (whole, counts));
    }
}
