use super::*;

#[test]
fn nmea_fix_that_is_none() {
    for (gga, rmc, why) in [
        ("0", "V,A", "no fix"),
        ("7", "A,M", "simulated or set by hand"),
        ("8", "V,S", "simulated or set by hand"),
        ("8", "A,S", "simulated or set by hand"),
        // Before version 2.3 of the standard, there is no mode.
        ("8", "A", "simulated or set by hand"),
    ] {
        let (status, mode) = rmc.split_once(',').unwrap_or((rmc, ""));
        let gga = format!("GPGGA,T,{PLACE},{gga},12,0.8,3.0,M,45.0,M,,");
        let rmc = format!("GPRMC,T,{status},{PLACE},5.0,0.0,010126,,,{mode}");
        for order in [[&gga, &rmc], [&rmc, &gga]] {
            let (all, d) = epochs(&order.map(String::as_str));
            assert!(fixes(&all).is_empty(), "{order:?}: {}", fixes(&all).len());
            assert!(remark(&d, why).remedy.is_some());
            assert!(d.decoded().left_out >= 10);
        }
    }
}

#[test]
fn nmea_height_of_a_two_dimensional_fix() {
    let gga = format!("GPGGA,T,{PLACE},1,4,0.8,3.0,M,45.0,M,,");
    for (mode, heights) in [("2", 0), ("3", 10)] {
        let (all, d) = epochs(&[&gga, &format!("GPGSA,A,{mode},1,2,3,4,,,,,,,,,2.5,1.5,2.0")]);
        let has_height = |fix: &&GnssFix| fix.position_sd[2] < NOT_MEASURED_SD;
        let fixes = fixes(&all);
        assert!(fixes.len() >= 9 && fixes.iter().filter(has_height).count() == heights.min(fixes.len()));
        let is_said = d.remarks().iter().any(|r| r.text.contains("two-dimensional"));
        assert_eq!(is_said, heights == 0);
    }
}

#[test]
fn nmea_modes_of_each_sentence() {
    let zda = "GPZDA,T,01,01,2026,00,00";
    for (body, kind, number, why) in [
        (format!("GNGNS,T,{PLACE},NN,14,0.8,3.0,45.0,,"), 1, 0, "no fix"),
        (format!("GNGNS,T,{PLACE},AS,14,0.8,3.0,45.0,,"), 1, 0, "simulated"),
        (format!("IIGLL,{PLACE},T,V,N"), 1, 0, "no fix"),
        (format!("IIGLL,{PLACE},T,A,M"), 1, 0, "simulated"),
        ("GPVTG,0.0,T,,M,2.0,N,,K,N".into(), 1, 0, "no fix"),
        ("HETHS,97.5,A".into(), 2, 10, ""),
        ("HETHS,97.5,E".into(), 2, 10, ""),
        ("HETHS,97.5,M".into(), 2, 0, "simulated or set by hand"),
        ("HETHS,97.5,S".into(), 2, 0, "simulated or set by hand"),
        ("HETHS,97.5,V".into(), 2, 0, "marked as invalid"),
        ("PTNTHPR,85.9,N,-1.0,N,2.0,N".into(), 3, 10, ""),
        ("PTNTHPR,85.9,N,-1.0,L,2.0,N".into(), 3, 0, "marked as invalid"),
    ] {
        let (all, d) = epochs(&[zda, &body]);
        assert_eq!(count(&all, kind), number, "{body}");
        if number == 0 {
            assert!(remark(&d, why).remedy.is_some(), "{body}");
            assert_eq!(d.decoded().left_out, 10, "{body}");
        }
    }
}

#[test]
fn nmea_position_that_its_receiver_calls_unsafe() {
    for (status, is_unsafe) in [("S", false), ("C", false), ("U", true), ("V", false), ("", false)] {
        for body in [
            format!("GNGNS,T,{PLACE},AA,14,0.8,3.0,45.0,,,{status}"),
            format!("GPRMC,T,A,{PLACE},5.0,0.0,010126,,,A,{status}"),
        ] {
            let (all, d) = epochs(&[&body]);
            let fixes = fixes(&all);
            assert!(fixes.len() >= 9, "{body}");
            let is_named = d
                .remarks()
                .iter()
                .any(|r| r.text.starts_with("10 positions are marked as unsafe"));
            assert_eq!(is_named, is_unsafe, "{body}");
            assert!(
                fixes.iter().all(|g| (g.position_sd[0] >= 10.0) == is_unsafe),
                "{body}"
            );
        }
    }
}

#[test]
fn nmea_heading_of_two_antennas_by_its_quality() {
    let hpr = |quality: u8| format!("GNHPR,T,210.00,-1.00,000.00,{quality},30,0.0,0999");
    let avr = |quality: u8| format!("PTNL,AVR,T,+210.0000,Yaw,-0.0806,Tilt,,,12.575,{quality},1.4,16");
    for (body, number, is_float) in [
        (hpr(4), 10, false),
        (hpr(5), 0, true),
        (hpr(1), 0, false),
        (hpr(0), 0, false),
        (avr(3), 10, false),
        (avr(2), 0, true),
        (avr(1), 0, false),
        (avr(4), 0, false),
    ] {
        let (all, d) = epochs(&[&body]);
        assert_eq!(count(&all, 2), number, "{body}");
        assert_eq!(d.decoded().left_out, if number == 0 { 10 } else { 0 }, "{body}");
        if is_float {
            let float = remark(&d, "moving base: float in 10 of 10 headings: left out");
            assert!(float.remedy.is_some(), "{body}");
        }
    }
}

#[test]
fn nmea_attitude_of_a_sensor_that_is_not_aligned() {
    for (tail, number) in [("2,1", 10), ("0,1", 10), ("2", 10), ("2,0", 0), ("0,0", 0)] {
        let (all, d) = epochs(&[&format!("PASHR,T,90.0,T,1.5,-2.0,0.25,0.1,0.1,0.2,{tail}")]);
        assert_eq!([2, 3].map(|kind| count(&all, kind)), [number; 2], "{tail}");
        if number == 0 {
            assert!(remark(&d, "10 PASHR (marked as invalid)").remedy.is_some());
        }
    }
}

#[test]
fn nmea_seatex_quality() {
    let zda = "GPZDA,T,01,01,2026,00,00";
    let psxn = "PSXN,23,2.00,-1.00,210.00,-0.25";
    for (quality, headings, tilts) in [
        ("PSXN,20,0,0,0,0", 10, 10),
        ("PSXN,20,2,2,1,1", 10, 10),
        ("PSXN,20,0,0,2,0", 0, 10),
        ("PSXN,20,0,0,0,2", 0, 0),
    ] {
        let (all, d) = epochs(&[zda, quality, psxn]);
        assert_eq!(
            [2, 3].map(|kind| count(&all, kind)),
            [headings, tilts],
            "{quality}"
        );
        if headings == 0 {
            assert!(remark(&d, "(marked as invalid)").remedy.is_some(), "{quality}");
        }
    }
}
