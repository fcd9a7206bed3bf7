//! Contradicting devices in one stream, and foreign content between sentences.

use super::*;
use crate::sensors::config::BusDevices;

/// Decoder, headings and tilts (deg) of a live stream at 10 Hz: GGA and RMC once per second, and `each`.
fn boat(seconds: u32, mount: Mount, each: impl Fn(f64) -> Vec<String>) -> (NmeaDecoder, Vec<f64>, Vec<f64>) {
    let mut d = decoder(mount);
    let (mut headings, mut rolls) = (Vec::new(), Vec::new());
    for k in 0..10 * seconds {
        let t = 0.1 * f64::from(k);
        d.arrive(Time::from_secs(1000.0 + t));
        let mut out = Vec::new();
        let time = format!("12{:02}{:05.2}", k / 600, t % 60.0);
        let mut text = String::new();
        if k % 10 == 0 {
            text += &sentence(&format!("GPGGA,{time},{PLACE},4,12,0.8,3.0,M,45.0,M,,"));
        }
        each(t)
            .iter()
            .for_each(|body| text += &sentence(&body.replace('T', &time).replace('t', "T")));
        d.push(text.as_bytes(), &mut out);
        let timeless = d.timeless();
        for m in out.iter().map(|m| m.measurement).chain(timeless) {
            match m {
                Measurement::Heading(h) => headings.push(h.heading.to_degrees()),
                Measurement::Attitude(a) => rolls.push(a.tilt[0].to_degrees()),
                Measurement::Imu(_) | Measurement::Gnss(_) => {}
            }
        }
    }
    (d, headings, rolls)
}
fn chosen(heading: &str) -> Mount {
    Mount {
        devices: BusDevices {
            heading: heading.into(),
            ..BusDevices::default()
        },
        ..Mount::default()
    }
}

#[test]
fn two_talkers_of_a_heading_and_of_an_attitude() {
    let each = |t: f64| {
        let roll = 6.0 * t.sin();
        vec![
            "HEHDt,40.0,t".to_owned(),
            format!("IIXDR,A,1.0,D,PtCH,A,{roll:.1},D,ROLL"),
            "GPHDt,48.0,t".into(),
            format!("YXXDR,A,1.0,D,PItCH,A,{:.1},D,HEEL", roll + 5.0),
        ]
    };
    let (d, headings, rolls) = boat(80, Mount::default(), each);
    assert!(headings.iter().all(|h| (h - 40.0).abs() < 1e-4) && headings.len() > 700);
    assert!(rolls.len() > 700 && rolls.len() <= 800, "{}", rolls.len());
    assert!(
        remark(&d, "heading of devices HE and GP differ by 8.0 deg")
            .remedy
            .is_some()
    );
    assert!(
        remark(&d, "attitude of devices II and YX differ by 5.0 deg")
            .remedy
            .is_some()
    );
    let (_, headings, _) = boat(30, chosen("GP"), each);
    assert!(headings.iter().skip(1).all(|h| (h - 48.0).abs() < 1e-4));
}

#[test]
fn makers_heading_that_repeats_next_to_a_gyrocompass() {
    let each = |t: f64| {
        vec![
            format!("PRDID,1.0,{:.2},42.90", 5.0 * t.sin()),
            format!("HEHDt,{:.1},t", 40.0 + 3.0 * (0.7 * t).sin()),
        ]
    };
    let (d, headings, _) = boat(60, Mount::default(), each);
    let late = headings.get(headings.len() / 2..).unwrap_or_default();
    assert!(late.iter().all(|h| (h - 42.9).abs() > 1e-6), "{late:?}");
    assert!(
        remark(&d, "heading of device PRDID has not changed")
            .remedy
            .is_some()
    );
}

#[test]
fn variation_of_zero_next_to_another() {
    let rmc = |v: &str| format!("GPRMC,T,A,{PLACE},5.0,0.0,010126,{v},A");
    for (hdg, rmc, heading, text) in [
        (
            "0.0,E",
            rmc("14.2,W"),
            40.0,
            "magnetic variation: -14.2 deg by GP, +0.0 deg by HC, taken as not set",
        ),
        (
            "10.0,W",
            rmc("14.2,W"),
            44.2,
            "magnetic variation: -14.2 deg by GP, -10.0 deg by HC",
        ),
        ("14.0,W", rmc("14.2,W"), 40.2, ""),
        (
            "0.0,E",
            rmc(","),
            54.2,
            "magnetic variation: exactly 0.0 deg by HC and stated by no other device",
        ),
    ] {
        let (d, headings, _) = boat(10, Mount::default(), |_| {
            vec![rmc.clone(), format!("HCHDG,54.2,,,{hdg}")]
        });
        let late = headings.last().copied().unwrap_or_default();
        assert!((late - heading).abs() < 1e-3, "{hdg}: {late}");
        let found: Vec<Remark> = d
            .remarks()
            .into_iter()
            .filter(|r| r.text.starts_with("magnetic"))
            .collect();
        match text {
            "" => assert!(found.is_empty(), "{found:?}"),
            text => assert!(remark(&d, text).remedy.is_some()),
        }
    }
}

#[test]
fn decimal_commas_negative_headings_and_qualities() {
    let zda = "GPZDA,T,01,01,2026,00,00";
    for (body, what) in [
        (
            "PRDID,-1,20,5,50,42,90",
            "10 PRDID (6 fields, 3 are known: a decimal comma?)",
        ),
        ("PSXN,23,5,50,-1,20,42,90,0,10", "10 PSXN (9 fields, 5 are known"),
        (
            "PASHR,T,42,90,T,5,50,-1,20,0,10,0,050,0,050,0,200,2,1",
            "10 PASHR (18 fields, 11 are known",
        ),
        (
            "GNHPR,T,42,90,-1,20,5,50,4,20,0,00,0999",
            "10 GNHPR (12 fields, 8 are known",
        ),
        ("HEHDT,42,9,T", "10 HEHDT (3 fields, 2 are known"),
        (
            "IIXDR,A,-1,2,D,PTCH,A,5,5,D,ROLL",
            "10 IIXDR (10 fields, 8 are known",
        ),
        ("HEHDT,-12.3,T", "10 HEHDT (a heading outside of 0 to 360 deg)"),
        (
            "GPGGA,T,5000.0,N,01430.0,E,12,12,0.8,3.0,M,45.0,M,,",
            "10 GPGGA (of unknown quality 12)",
        ),
        (
            "PSAT,HPR,120000.00,42.9,1.2,5.5,N",
            "10 PSAT-HPR (attitude or heading",
        ),
        ("PFEC,GPatt,42.9,1.2,5.5", "10 PFEC-GPatt (attitude or heading"),
        (
            "PSSN,HRP,120000.00,010126,42.9,5.5,1.2",
            "10 PSSN-HRP (attitude or heading",
        ),
        (
            "KSXT,20260101120000.00,14.5,50.0,3.0,42.9",
            "10 KSXT (attitude or heading",
        ),
        ("PHTRO,1.20,M,5.50,T", "10 PHTRO (attitude or heading"),
        (
            "PASHR,ATT,216000.0,42.9,1.2,5.5,0.001,0.002,0",
            "10 PASHR-ATT (attitude or heading",
        ),
        (
            "PASHR,POS,3,10,120000.00,5000.0,N,01430.0,E,3.0,5.0,40.0,2.0,0.0,1.0,0.8,0.6,0.5,HA00",
            "10 PASHR-POS (an unsupported kind)",
        ),
        ("PTNTHPR,42,9,N,1,2,N,5,5,N", "10 PTNTHPR (9 fields, 6 are known"),
        (
            "PTNL,AVR,T,42,90,Yaw,1,20,Tilt,,,1,2,3,1,1,12",
            "10 PTNL (16 fields, 12 are known",
        ),
        // Coordinates with points, empty fields at the end.
        (
            "GPGGA,T,5000.0,N,01430.0,E,4,14,0,7,2,M,39,M,,",
            "10 GPGGA (a number in place of a letter",
        ),
        (
            "GNGNS,T,5000.0,N,01430.0,E,RR,14,0,7,2,00,39,4,,",
            "10 GNGNS (a number in place of a letter",
        ),
        (
            "IIXDR,A,-0.02,R,PTCH,A,0.1,R,ROLL",
            "10 IIXDR (angles not in degrees (D))",
        ),
        (
            "GPGGA,T,0000.0,N,00000.0,E,1,12,0.8,0.0,M,0.0,M,,",
            "10 GPGGA (at 0 N 0 E",
        ),
    ] {
        let (all, d) = epochs(&[zda, body]);
        assert!(all.is_empty(), "{body}: {all:?}");
        remark(&d, what);
    }
    let sbas = format!("GPGGA,T,{PLACE},9,12,0.8,3.0,M,45.0,M,,");
    assert!(fixes(&epochs(&[&sbas]).0).len() >= 9);
    // Surplus fields that are empty do not count.
    let (all, _) = epochs(&[
        zda,
        "HEHDT,42.9,T,,",
        "IIXDR,A,-1.2,D,PTCH,A,5.5,D,ROLL,C,19.5,C,",
    ]);
    assert_eq!((count(&all, 2), count(&all, 3)), (10, 10));
}

#[test]
fn other_formats_among_sentences() {
    let mut d = decoder(Mount::default());
    let mut out = Vec::new();
    let lines = [
        ":050000 0000F-0123 0045",
        "#UNIHEADINGA,97,GPS,FINE,2190,375570000,0,0,18,12;SOL_COMPUTED,NARROW_INT,0.3718*f1bb3e1f",
        "#HEADINGA,COM1,0,60.0,FINESTEERING,1709,313811.000,02000008,0000,9423;SOL_COMPUTED,NARROW_INT*0b0a1d2e",
        "%BESTPOSA,1709,313811.000;SOL_COMPUTED,NARROW_INT*0b0a1d2e",
        "{\"timestamp\":\"2026-01-01T12:00:00Z\",\"prio\":3,\"src\":35,\"dst\":255,\"pgn\":127257,\"fields\":{}}",
        " (1436509052.250000)  can0  09F80115   [8]  A0 7D E6 18 C0 05 FB D5",
    ];
    for _ in 0..5 {
        lines
            .iter()
            .for_each(|line| d.push(format!("{line}\r\n").as_bytes(), &mut out));
        // UBX whose payload contains the start and end of sentences.
        let ubx = [&[0xb5, 0x62, 1, 7, 12, 0][..], b"$GP\r\n$GNTXT,", &[1, 2]].concat();
        d.push(
            &[&ubx[..], sentence("GNTXT,01,01,02,ANT").as_bytes()].concat(),
            &mut out,
        );
    }
    for name in [
        "5 TSS1",
        "5 UNIHEADINGA",
        "5 HEADINGA",
        "5 BESTPOSA",
        "5 canboat-JSON",
        "5 NMEA-2000",
        "5 UBX",
        "5 GNTXT",
    ] {
        assert!(
            d.remarks().iter().any(|r| r.text.contains(name)),
            "{name}: {:?}",
            d.remarks()
        );
    }
    assert_eq!((d.decoded().corrupted, d.decoded().ignored), (0, 40));
    // A sender of these sentences is admitted, to be reported; a wind sensor is not.
    let speaks = crate::sensors::Format::Nmea.speaks();
    assert!(speaks(format!("{}\r\n", lines[5]).as_bytes()));
    assert!(speaks(&[0xb5, 0x62, 1, 7, 0, 0, 8, 25]) && !speaks(sentence("WIMWV,40.0,R,8.0,N,A").as_bytes()));
}

#[test]
fn instrument_with_a_clock_in_local_time() {
    // Two of three sentences per second agree, and are used, in any order.
    for order in [[0, 1, 2], [2, 0, 1]] {
        let (mut d, mut out) = (decoder(Mount::default()), Vec::new());
        for k in 0..60 {
            let all = [
                format!("GPGGA,1200{k:02},{PLACE},1,12,0.8,3.0,M,45.0,M,,"),
                format!("GPRMC,1200{k:02},A,{PLACE},5.0,0.0,010126,,,A"),
                format!("IIGLL,{PLACE},1400{k:02},A,A"),
            ];
            order
                .iter()
                .for_each(|i| d.push(sentence(&all[*i]).as_bytes(), &mut out));
        }
        let noon = 12 * 3600 * 1_000_000_000_i64;
        let right = out
            .iter()
            .filter(|m| (0..60_000_000_000).contains(&(m.at_ns - noon)))
            .count();
        assert!(
            right >= 45 && out.len() - right <= 12,
            "{order:?}: {right} of {}",
            out.len()
        );
        assert!(remark(&d, "of another clock").text.contains("IIGLL"));
    }
}

#[test]
fn receiver_in_gps_time_next_to_one_in_utc() {
    let (mut d, mut out) = (decoder(Mount::default()), Vec::new());
    for k in 0..40 {
        for body in [
            format!("GPGGA,1200{k:02},{PLACE},1,12,0.8,3.0,M,45.0,M,,"),
            format!("GPRMC,1200{k:02},A,{PLACE},5.0,0.0,010126,,,A"),
            format!("GNGGA,1200{:02},{PLACE},1,12,0.8,3.0,M,45.0,M,,", k + 18),
        ] {
            d.push(sentence(&body).as_bytes(), &mut out);
        }
    }
    assert!(remark(&d, "of another clock").text.contains("GNGGA"));
    let ahead = (12 * 3600 + 41) * 1_000_000_000_i64;
    assert!(out.len() > 30 && out.iter().all(|m| m.at_ns < ahead), "{out:?}");
}

#[test]
fn separation_of_the_other_sign_or_in_the_height() {
    // Near Stockholm, where EGM96 has 23.1 m; 210 m is a lake.
    for (height, text) in [
        ("3.0,M,23.1,M", "height above the ellipsoid by the receiver"),
        (
            "26.1,M,23.1,M",
            "states 26.1 m above the sea, and the sea 23.1 m above the ellipsoid",
        ),
        (
            "3.0,M,-23.1,M",
            "the sea lies -23.1 m above the ellipsoid, by EGM96 it is 23.1 m",
        ),
        ("210.0,M,23.1,M", "height above the ellipsoid by the receiver"),
    ] {
        let gga = format!("GPGGA,T,5918.0,N,01806.0,E,4,12,0.8,{height},,");
        let (all, d) = epochs(&[&gga]);
        let spread = fixes(&all).last().map(|f| f.height_spread);
        let is_fine = remark(&d, text).remedy.is_none();
        assert_eq!(spread.map(|s| s == 0.0), Some(is_fine), "{height}: {spread:?}");
    }
}
