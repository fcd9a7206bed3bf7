use super::*;
use crate::{
    fixtures::{attitudes, count, fixes, headings, sentence},
    sensors::{HeaveSign, Measurement, Mount},
};
use alight_shared::frames::wrap_angle;
use proptest::prelude::*;

mod quality;
mod witnesses;

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
            good: 70,
            ..Decoded::default()
        }
    );
    let last = |kind| *all.iter().rfind(|h| h.measurement.kind() == kind).unwrap();
    assert_eq!(count(&all, 1), 10);
    let at_ns = (12 * 3600 + 1) * 1_000_000_000_i64 + 800_000_000;
    let (fix, heading, attitude) = (last(1), last(2), last(3));
    assert!([fix, heading, attitude].iter().all(|h| h.at_ns == at_ns));
    let (Measurement::Gnss(g), Measurement::Heading(h), Measurement::Attitude(a)) =
        (fix.measurement, heading.measurement, attitude.measurement)
    else {
        panic!("kinds");
    };
    // The ellipsoid is 45 m below the geoid, the antenna 210 m above it.
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
    // A sentence before any time, two in one epoch, and invalid times.
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
    // If sentences without a time lead, they belong to the next time.
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
    let a = all[0].measurement.attitude().unwrap();
    assert!((a.tilt[1].to_degrees() + 10.37).abs() < 1e-4 && (a.tilt[0].to_degrees() - 2.34).abs() < 1e-4);
    assert_eq!((a.heave, all.len(), counts.good), (None, 2, 2));
}

#[test]
fn nmea_sentences_after_damage() {
    let good = stream(1);
    let zda = sentence("GPZDA,120001.00,20,05,2026,00,00");
    // A wrong character, an interrupted sentence, one without a checksum, and one without a terminator.
    let bad = [
        zda.replace("2026", "2025"),
        zda[..20].to_owned(),
        "$GPZDA,120001.00,20,05,2026,00,00\r\n".to_owned(),
        "$".to_owned() + &"x".repeat(5000) + "\n",
        "\u{fffd}\n".to_owned(),
    ]
    .concat();
    let (all, counts) = decode(&(bad + &good), Mount::default());
    assert_eq!((counts.good, counts.corrupted), (7, 5));
    assert_eq!(count(&all, 3), 1);
}

/// Measurements and decoder after ten epochs at 1 Hz of these sentences, with `T` for the time.
fn epochs(sentences: &[&str]) -> (Vec<SourceMeasurement>, NmeaDecoder) {
    let mut d = decoder(Mount::default());
    let mut out = Vec::new();
    for k in 0..10 {
        for body in sentences {
            let body = body.replace(",T,", &format!(",1200{k:02}.00,"));
            d.push(sentence(&body).as_bytes(), &mut out);
        }
    }
    d.finish(&mut out);
    (out, d)
}
fn remark(d: &NmeaDecoder, part: &str) -> Remark {
    let all = d.remarks();
    let found = all.iter().find(|r| r.text.contains(part));
    found.unwrap_or_else(|| panic!("{part}: {all:?}")).clone()
}
const PLACE: &str = "5000.00000,N,01430.00000,E";

#[test]
fn nmea_height_without_a_separation() {
    let (all, d) = epochs(&[&format!("GPGGA,T,{PLACE},1,12,0.8,3.0,M,,,,")]);
    let fixes = fixes(&all);
    assert_eq!(fixes.len(), 10);
    for g in &fixes {
        assert!(
            (g.datum.height_m - 48.25).abs() < 0.01 && (1.0..4.0).contains(&g.height_spread),
            "{g:?}"
        );
    }
    assert!(remark(&d, "by EGM96 45.2 m").remedy.is_some());
    // A default value: exactly zero where the geoid is 45 m from the ellipsoid.
    let (all, d) = epochs(&[&format!("GPGGA,T,{PLACE},1,12,0.8,3.0,M,0.0,M,,")]);
    let heights = crate::fixtures::fixes(&all);
    assert!(
        heights.len() == 10 && heights.iter().all(|g| (g.datum.height_m - 48.25).abs() < 0.01),
        "{heights:?}"
    );
    assert!(
        remark(
            &d,
            "10 of 10 fixes state no height of the sea above the ellipsoid, or (10) exactly 0"
        )
        .remedy
        .is_some()
    );
    let gga = |separation: f64| format!("GPGGA,T,{PLACE},1,12,0.8,3.0,M,{separation},M,,");
    let (_, d) = epochs(&[&gga(45.0), &gga(37.5)]);
    assert!(
        remark(&d, "alternates between 45.0 m and 37.5 m")
            .remedy
            .is_some()
    );
    // The receiver's own table may differ from the model.
    let (all, d) = epochs(&[&format!("GPGGA,T,{PLACE},1,12,0.8,3.0,M,47.0,M,,")]);
    assert!(
        self::fixes(&all)
            .iter()
            .all(|g| g.datum.height_m == 50.0 && g.height_spread == 0.0)
    );
    assert!(remark(&d, "by the receiver").remedy.is_none());
    // A separation of zero where the geoid is 45 m from the ellipsoid has an uncertainty of 45 m.
    let (all, d) = epochs(&[&format!("GPGGA,T,{PLACE},1,12,0.8,48.0,M,0.0,M,,")]);
    assert!(
        self::fixes(&all)
            .iter()
            .all(|g| g.datum.height_m == 48.0 && (g.height_spread - 45.25).abs() < 0.1)
    );
    assert!(remark(&d, "0.0 m above").remedy.is_some());
    // A missing altitude is not a height of zero.
    let (all, _) = epochs(&[&format!("GPGGA,T,{PLACE},1,12,0.8,,M,,M,,")]);
    assert!(
        self::fixes(&all)
            .iter()
            .all(|g| g.position_sd[2] == NOT_MEASURED_SD)
    );
}

#[test]
fn nmea_position_of_each_sentence() {
    for (body, height) in [
        (format!("GNGNS,T,{PLACE},AAN,14,0.8,3.0,45.0,,"), Some(48.0)),
        (format!("GNGNS,T,{PLACE},RR,14,0.8,3.0,,,"), Some(48.25)),
        (format!("GPRMC,T,A,{PLACE},5.0,0.0,010126,,,A"), None),
        (format!("GPRMC,T,A,{PLACE},5.0,0.0,010126,,"), None),
        (format!("IIGLL,{PLACE},T,A,D"), None),
    ] {
        let (all, d) = epochs(&[&body]);
        let fixes = fixes(&all);
        // A position without a height waits for a better one in its epoch.
        assert_eq!(fixes.len(), if height.is_some() { 10 } else { 9 }, "{body}");
        for g in fixes {
            assert!(
                (g.datum.latitude_deg - 50.0).abs() < 1e-9 && (g.datum.longitude_deg - 14.5).abs() < 1e-9
            );
            match height {
                Some(h) => assert!((g.datum.height_m - h).abs() < 0.01, "{body}: {g:?}"),
                None => assert_eq!(g.position_sd[2], NOT_MEASURED_SD, "{body}"),
            }
        }
        assert_eq!(d.decoded().left_out, 0, "{body}");
        if height.is_none() {
            assert!(remark(&d, "height: none of 9 fixes has one").remedy.is_some());
        }
    }
    // If GGA provides the height, RMC and GLL add no fix, in any order.
    let (gga, rmc) = (
        format!("GPGGA,T,{PLACE},1,12,0.8,3.0,M,45.0,M,,"),
        format!("GPRMC,T,A,{PLACE},5.0,0.0,010126,,,A"),
    );
    for order in [[&gga, &rmc], [&rmc, &gga]] {
        let (all, _) = epochs(&order.map(String::as_str));
        let fixes = fixes(&all);
        assert_eq!(fixes.len(), 10);
        assert!(
            fixes
                .iter()
                .skip(3)
                .all(|g| g.datum.height_m == 48.0 && g.velocity_sd[0] < 1.0),
            "{fixes:?}"
        );
    }
}

#[test]
fn nmea_position_in_few_decimals() {
    let of = |place: &str| {
        let (all, _) = epochs(&[&format!("GPRMC,T,A,{place},5.0,0.0,010126,,,A")]);
        fixes(&all)[5].position_sd[0]
    };
    // A hundredth of a minute is 18.5 m.
    assert!((of("5000.00,N,01430.00,E") - 5.37).abs() < 0.1 && of("5000.00000,N,01430.00000,E") < 0.6);
}

#[test]
fn nmea_among_ais_and_unread_kinds() {
    let gga = format!("GPGGA,T,{PLACE},1,12,0.8,3.0,M,45.0,M,,");
    let mut d = decoder(Mount::default());
    let mut out = Vec::new();
    for k in 0..10 {
        d.push(
            sentence(&gga.replace(",T,", &format!(",1200{k:02}.00,"))).as_bytes(),
            &mut out,
        );
        d.push(b"!AIVDM,1,1,,A,1000000P000000000000000000000,0*77\r\n", &mut out);
        d.push(
            b"2026-01-01T00:00:00Z !AIVDM,1,1,,A,1000000P000000000000000000000,0*77\r\n",
            &mut out,
        );
        d.push(sentence("WIMWV,40.0,R,8.0,N,A").as_bytes(), &mut out);
    }
    let n = d.decoded();
    assert_eq!((n.good, n.corrupted, n.ignored), (10, 0, 30));
    assert!(
        remark(&d, "20 AIVDM, 10 WIMWV (an unsupported kind)")
            .remedy
            .is_none()
    );
}

#[test]
fn nmea_stream_without_checksums() {
    let mut d = decoder(Mount::default());
    let mut out = Vec::new();
    for k in 0..30 {
        d.push(
            format!("$GPHDT,10.0,T\r\n$GPGGA,1200{k:02},{PLACE},1,12,0.8,3.0,M,45.0,M,,\r\n").as_bytes(),
            &mut out,
        );
    }
    d.push(b"$GPGGA,120030,5000.0\r\n", &mut out);
    let n = d.decoded();
    assert!(fixes(&out).len() >= 23 && n.corrupted == 10, "{n:?}");
    assert!(remark(&d, "51 sentences without a checksum").remedy.is_none());
}

#[test]
fn nmea_whole_seconds_at_ten_hertz() {
    let mut d = decoder(Mount::default());
    let mut out = Vec::new();
    for k in 0..100 {
        let body = format!("GPGGA,1200{:02},{PLACE},1,12,0.8,3.0,M,45.0,M,,", k / 10);
        d.push(sentence(&body).as_bytes(), &mut out);
    }
    d.finish(&mut out);
    assert_eq!(fixes(&out).len(), 10);
    assert!(
        remark(&d, "90 of 100 GPGGA repeat the previous time")
            .remedy
            .is_some()
    );
}

#[test]
fn nmea_attitudes_of_each_sentence() {
    let zda = "GPZDA,T,01,01,2026,00,00";
    for body in [
        "PSXN,23,2.00,-1.00,210.00,-0.25",
        "YXXDR,A,-1.0,D,PTCH,A,2.0,D,ROLL",
        "IIXDR,A,2.0,D,ROLL,P,1.02,B,Barometer,A,-1.0,D,PITCH,A,9.0,D,ROLLRATE",
        "PTNTHPR,85.9,N,-1.0,N,2.0,N",
        "GNHPR,T,210.00,-1.00,2.00,4,30,0.0,0999",
    ] {
        let (all, d) = epochs(&[zda, body]);
        let tilts = attitudes(&all);
        assert_eq!((tilts.len(), d.decoded().undated), (10, 0), "{body}");
        for (_, a) in tilts {
            let [roll, pitch] = a.tilt.map(f64::to_degrees);
            assert!(
                (roll - 2.0).abs() < 1e-4 && (pitch + 1.0).abs() < 1e-4,
                "{body}: {a:?}"
            );
            // Seatex counts heave positive down.
            assert_eq!(a.heave, body.starts_with("PSXN").then_some(-0.25), "{body}");
        }
    }
    // Zero for the other angle is not a measurement.
    let (all, _) = epochs(&["GNHPR,T,210.00,-1.00,000.00,4,30,0.0,0999"]);
    assert!(all.iter().all(|m| m.measurement.kind() == 2) && all.len() == 10);
}

#[test]
fn nmea_recorded_attitudes_between_two_times() {
    let zda = |k: i64| sentence(&format!("GPZDA,1200{k:02}.00,01,01,2026,00,00"));
    let mut text = String::new();
    for k in 0..20 {
        if k % 5 == 0 {
            text += &zda(k / 5);
        }
        text += &sentence(&format!("PSXN,23,{k}.00,0.00,0.00,0.00"));
    }
    text += &zda(4);
    let (all, counts) = decode(&text, Mount::default());
    let tilts = attitudes(&all);
    assert_eq!((tilts.len(), counts.spread, counts.undated), (20, 16, 0));
    for (k, (at, a)) in tilts.iter().enumerate() {
        let (since_ms, roll) = ((at - tilts[0].0) / 1_000_000, a.tilt[0].to_degrees());
        assert!(
            (since_ms - 200 * k as i64).abs() <= 1 && (roll - k as f64).abs() < 1e-4,
            "{k}: {since_ms} {roll}"
        );
    }
}

#[test]
fn nmea_heading_from_magnetic_north() {
    let of = |sentences: &[&str]| {
        let (all, d) = epochs(sentences);
        (
            headings(&all).iter().map(|h| h.to_degrees()).collect::<Vec<_>>(),
            d,
        )
    };
    let zda = "GPZDA,T,01,01,2026,00,00";
    let (all, _) = of(&[zda, "HCHDG,100.0,1.0,E,4.0,W"]);
    assert!(
        all.len() == 10 && all.iter().all(|h| (h - 97.0).abs() < 1e-4),
        "{all:?}"
    );
    let (all, _) = of(&[
        &format!("GPRMC,T,A,{PLACE},5.0,0.0,010126,4.0,E,A"),
        "HCHDM,100.0,M",
    ]);
    assert!(
        all.len() == 10 && all.iter().all(|h| (h - 104.0).abs() < 1e-4),
        "{all:?}"
    );
    let (all, d) = of(&[zda, "HCHDG,100.0,,,,"]);
    assert!(all.is_empty() && remark(&d, "10 HCHDG (magnetic").remedy.is_some());
    let (all, _) = of(&[zda, "HEHDT,97.5,T", "HCHDG,100.0,1.0,E,4.0,W"]);
    assert!(
        all.len() == 10 && all.iter().all(|h| (h - 97.5).abs() < 1e-4),
        "{all:?}"
    );
}

type Timed = Vec<(f64, Measurement)>;

/// Sentences in bursts (time of arrival (s), body): measurements with times (s after noon), those dated by
/// arrival, and the decoder.
fn live(bursts: &[(f64, String)]) -> (Timed, Timed, NmeaDecoder) {
    let mut d = decoder(Mount::default());
    let (mut all, mut timeless) = (Vec::new(), Vec::new());
    for (at, body) in bursts {
        d.arrive(Time::from_secs(1000.0 + at));
        let mut out = Vec::new();
        d.push(sentence(body).as_bytes(), &mut out);
        let noon = 12 * 3600 * 1_000_000_000_i64;
        all.extend(
            out.iter()
                .map(|m| ((m.at_ns - noon) as f64 * 1e-9, m.measurement)),
        );
        timeless.extend(d.timeless().into_iter().map(|m| (*at, m)));
    }
    (all, timeless, d)
}

#[test]
fn nmea_heading_before_and_velocity_after_the_time() {
    // A compass on a slow line at 2 Hz: HDT, GGA, VTG 60 ms apart; heading and speed are ten times the time.
    let mut bursts = Vec::new();
    for k in 0..40 {
        let t = 0.5 * f64::from(k);
        bursts.push((t + 0.05, format!("GPHDT,{:.2},T", 10.0 * t)));
        bursts.push((
            t + 0.11,
            format!("GPGGA,1200{t:05.2},{PLACE},1,12,0.8,3.0,M,45.0,M,,"),
        ));
        bursts.push((t + 0.17, format!("GPVTG,0.0,T,,M,{:.2},N,,K,A", t)));
    }
    let (all, timeless, d) = live(&bursts);
    assert!(timeless.is_empty());
    let (mut headings, mut velocities) = (0, 0);
    for (at, m) in all.iter().filter(|(at, _)| *at >= 1.0) {
        match m {
            Measurement::Heading(h) => {
                headings += 1;
                let apart = wrap_angle(h.heading - (10.0 * at).to_radians());
                assert!(apart.abs() < 1e-4, "{at}: {h:?}");
            }
            Measurement::Gnss(g) => {
                velocities += 1;
                assert!((g.velocity[0] * 3600.0 / 1852.0 - at).abs() < 1e-3, "{at}: {g:?}");
            }
            Measurement::Imu(_) | Measurement::Attitude(_) => {}
        }
    }
    assert!(
        headings >= 36 && velocities >= 36 && d.decoded().undated <= 1,
        "{headings} {velocities}"
    );
}

#[test]
fn nmea_compass_faster_than_the_receiver() {
    // HDT at 10 Hz with GGA at 1 Hz, then without it: the arrival is the time.
    let mut bursts = Vec::new();
    for k in 0..200 {
        let t = 0.1 * f64::from(k);
        if k % 10 == 0 && k < 100 {
            bursts.push((t, format!("GPGGA,1200{t:05.2},{PLACE},1,12,0.8,3.0,M,45.0,M,,")));
        }
        bursts.push((t + 0.03, format!("HEHDT,{:.2},T", t)));
    }
    let (_, timeless, d) = live(&bursts);
    assert!(timeless.len() >= 170, "{}", timeless.len());
    for (at, m) in &timeless {
        let h = m.heading().unwrap();
        assert!(
            (h.heading.to_degrees() - (at - 0.03)).abs() < 0.006,
            "{at}: {h:?}"
        );
    }
    assert_eq!(d.decoded().by_arrival, timeless.len() as u64);
}

proptest! {
    #[test]
    fn nmea_arbitrary_bytes(bytes in prop::collection::vec(any::<u8>(), 0..4000), cut in 1_usize..40) {
        let mut d = decoder(Mount::default());
        let mut out = Vec::new();
        for part in bytes.chunks(cut) {
            d.push(part, &mut out);
            prop_assert!(d.waiting.len() <= attribution::KINDS);
        }
        d.finish(&mut out);
        prop_assert!(out.len() <= bytes.len());
    }

    #[test]
    fn nmea_arbitrary_fields(
        name in prop::sample::select(vec![
            "GPGGA", "GNGNS", "GPRMC", "GPGLL", "GPVTG", "HEHDT", "HETHS", "HCHDG", "HCHDM", "HEROT", "PASHR", "PRDID", "GPZDA",
            "PSXN,23", "PSXN,20", "PTNL,AVR", "GNHPR", "PTNTHPR", "YXXDR", "AIVDM",
        ]),
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
            // The decoder never outputs NaN; implausible numbers are rejected on admission.
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
