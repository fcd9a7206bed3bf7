use super::*;
use crate::{
    fixtures::{self, damage, damaged, fixes},
    sensors::Mount,
};
use alight_shared::msg::NOT_MEASURED_SD;
use proptest::prelude::*;

/// Frames from the device `source` in the format of Yacht Devices' gateways.
fn raw(at_s: f64, pgn: u32, source: u8, data: &[u8]) -> String {
    let id = 3 << 26 | pgn << 8 | u32::from(source);
    let line = |data: &[u8]| {
        let bytes: String = data.iter().map(|b| format!(" {b:02X}")).collect();
        let (h, m) = ((at_s / 3600.0).floor(), (at_s / 60.0).floor() % 60.0);
        format!("{h:02}:{m:02}:{:06.3} R {id:08X}{bytes}\r\n", at_s % 60.0)
    };
    if data.len() <= 8 {
        return line(data);
    }
    let (first, rest) = data.split_at(6);
    let head = line(&[&[0x40, data.len() as u8], first].concat());
    let more = rest.chunks(7).zip(1..);
    head + &more
        .map(|(part, k)| line(&[&[0x40 | k], part].concat()))
        .collect::<String>()
}
fn heading(at_s: f64, source: u8, rad: f64, reference: u8) -> String {
    let [a, b] = ((rad * 1e4) as u16).to_le_bytes();
    raw(
        at_s,
        127_250,
        source,
        &[0, a, b, 0xff, 0x7f, 0xff, 0x7f, 0xfc | reference],
    )
}
fn position(at_s: f64, latitude: f64) -> String {
    let place = [latitude, 14.5].map(|d| ((d * 1e7).round() as i32).to_le_bytes());
    raw(at_s, 129_025, 1, &place.concat())
}
fn velocity(at_s: f64, course: f64, speed: f64) -> String {
    let [a, b] = ((course * 1e4) as u16).to_le_bytes();
    let [c, d] = ((speed * 100.0) as u16).to_le_bytes();
    raw(at_s, 129_026, 1, &[0, 0xfc, a, b, c, d, 0xff, 0xff])
}
fn gnss(at_s: f64, latitude: f64, altitude_m: f64, quality: u8) -> String {
    let wide = |x: f64, step: f64| ((x / step).round() as i64).to_le_bytes();
    let mut data = vec![0; 7];
    data.extend(wide(latitude, 1e-16));
    data.extend(wide(14.5, 1e-16));
    data.extend(wide(altitude_m, 1e-6));
    data.extend([quality << 4, 0xfc, 12, 80, 0, 120, 0, 0, 0, 0, 0, 0]);
    raw(at_s, 129_029, 1, &data)
}
fn decode(text: &str) -> (Vec<SourceMeasurement>, N2kDecoder) {
    fixtures::decode(
        N2kDecoder::new(&Mounting::new(&Mount::default())),
        text.as_bytes(),
        7,
    )
}

#[test]
fn n2k_position_velocity_and_height() {
    // The sea is 45 m above the ellipsoid here.
    let text = [
        position(10.0, 50.0),
        gnss(10.05, 50.0, 48.0, 2),
        velocity(10.06, core::f64::consts::FRAC_PI_2, 3.0),
        position(10.1, 50.000_001),
        position(10.2, 50.000_002),
    ]
    .concat();
    let (all, d) = decode(&text);
    let fixes = fixes(&all);
    assert_eq!((fixes.len(), d.decoded().corrupted), (3, 0), "{all:?}");
    let measured = |sd: f64| sd < NOT_MEASURED_SD;
    assert!(!measured(fixes[0].position_sd[2]) && !measured(fixes[0].velocity_sd[0]));
    // The height is attached to the next quick position, the velocity to every one.
    assert!(measured(fixes[1].position_sd[2]) && !measured(fixes[2].position_sd[2]));
    assert!((fixes[1].datum.height_m - 48.0).abs() < 1e-3 && fixes[1].height_spread == 0.0);
    assert!((fixes[2].velocity[1] - 3.0).abs() < 1e-3 && measured(fixes[2].velocity_sd[0]));
    assert!((fixes[1].datum.latitude_deg - 50.000_001).abs() < 1e-9);
    assert!(fixes[1].position_sd[0] < fixes[0].position_sd[0], "differential");
}

#[test]
fn n2k_height_above_the_sea() {
    for (altitude_m, height_m) in [(48.0, 48.0), (2.5, 47.6), (430.0, 430.0)] {
        let (all, d) = decode(&gnss(10.0, 50.0, altitude_m, 1));
        let fix = fixes(&all)[0];
        assert!(
            (fix.datum.height_m - height_m).abs() < 1.0,
            "{altitude_m}: {fix:?}"
        );
        let taken = d.remarks().iter().any(|r| r.text.contains("above the sea"));
        assert_eq!(taken, altitude_m == 2.5, "{:?}", d.remarks());
    }
}

#[test]
fn n2k_headings_of_two_devices() {
    let variation = |at_s| raw(at_s, 127_258, 9, &[0, 0xf8, 0, 0, 0x2c, 0x01, 0xff, 0xff]);
    let text = [
        heading(1.0, 5, 1.0, 1),
        variation(1.1),
        heading(1.2, 5, 1.0, 1),
        heading(1.3, 6, 2.0, 0),
        raw(1.35, 127_251, 5, &[0, 0x00, 0x40, 0x06, 0x00, 0xff, 0xff, 0xff]),
        heading(1.4, 5, 1.0, 1),
        heading(4.0, 6, 2.0, 0),
    ]
    .concat();
    let (all, d) = decode(&text);
    let of = |m: &SourceMeasurement| match m.measurement {
        Measurement::Heading(h) => h,
        _ => panic!("{m:?}"),
    };
    let headings: Vec<f64> = all.iter().map(|m| (of(m).heading * 1e3).round()).collect();
    assert_eq!(headings, [1030.0, 1030.0, 2000.0]);
    assert!(of(&all[1]).rate.is_some_and(|r| (r - 0.0128).abs() < 1e-6) && of(&all[2]).rate.is_none());
    assert!(of(&all[0]).heading_sd > of(&all[2]).heading_sd);
    // Not used: a magnetic heading before a known variation, and the second device.
    assert_eq!(d.decoded().left_out, 2, "{:?}", d.remarks());
}

#[test]
fn n2k_attitude_with_heave() {
    let tilt = |at_s| raw(at_s, 127_257, 3, &[0, 0xff, 0x7f, 0xe8, 0x03, 0x18, 0xfc, 0xff]);
    let text = [
        raw(1.0, 127_252, 3, &[0, 0x32, 0x00, 0xff, 0xff, 0xff, 0xff, 0xff]),
        tilt(1.02),
        tilt(2.0),
    ]
    .concat();
    let (all, _) = decode(&text);
    let of = |k: usize| fixtures::attitudes(&all)[k].1;
    assert!(
        (of(0).tilt[0] + 0.1).abs() < 1e-9 && (of(0).tilt[1] - 0.1).abs() < 1e-9,
        "{all:?}"
    );
    assert_eq!((of(0).heave, of(1).heave), (Some(-0.5), None));
}

#[test]
fn n2k_by_arrival_where_lines_have_no_time() {
    let mut d = N2kDecoder::new(&Mounting::new(&Mount::default()));
    let (line, mut out) = (b"can0  09F11205   [8]  00 10 27 FF 7F FF 7F FC\n", Vec::new());
    d.push(line, &mut out);
    assert_eq!((out.len(), d.timeless().len(), d.decoded().undated), (0, 0, 1));
    d.arrive(Time::from_secs(100.0));
    d.push(line, &mut out);
    assert_eq!((out.len(), d.timeless().len(), d.decoded().by_arrival), (0, 1, 1));
}

#[test]
fn n2k_message_with_a_missing_frame() {
    let whole = gnss(1.0, 50.0, 48.0, 1);
    let lines: Vec<&str> = whole.split_inclusive('\n').collect();
    let text = [
        &lines[..3].concat(),
        &lines[4..].concat(),
        &gnss(2.0, 50.0, 48.0, 1),
    ]
    .map(String::as_str)
    .concat();
    let (all, d) = decode(&text);
    assert_eq!(
        (fixes(&all).len(), d.decoded().corrupted),
        (1, 1),
        "{:?}",
        d.decoded()
    );
    // A report without a fix, and a simulated fix.
    let (all, d) = decode(&[gnss(1.0, 50.0, 48.0, 0), gnss(5.0, 50.0, 48.0, 8)].concat());
    assert_eq!((all.len(), d.decoded().left_out), (0, 2));
}

#[test]
fn n2k_log_with_a_date_and_a_night_between() {
    let line = |at: &str| format!("{at},3,127257,17,255,8,00,ff,7f,52,00,21,fe,ff");
    // The last line has no terminator, but is complete.
    let text = [line("2016-04-09T16:41:09.078Z"), line("2016-04-10T08:00:00.078Z")].join("\n");
    let (mut all, mut d) = decode(&text);
    d.finish(&mut all);
    let hours = (all[1].at_ns - all[0].at_ns) as f64 / 3.6e12;
    assert!((hours - 15.314).abs() < 1e-3 && d.decoded().good == 2, "{hours}");
    // A truncated message, and one without its last frame.
    let whole = gnss(1.0, 50.0, 48.0, 1);
    for cut in [whole.len() - 12, whole.len() - 40] {
        let (mut all, mut d) = decode(&whole[..cut]);
        d.finish(&mut all);
        assert!(all.is_empty() && d.decoded().corrupted >= 1, "{cut}: {all:?}");
    }
}

#[test]
fn n2k_attitude_with_rates() {
    let mut rates = vec![0x3f, 0x9f];
    rates.resize(29, 0);
    rates[15..19].copy_from_slice(&2000_i32.to_le_bytes());
    let tilt = |at_s| raw(at_s, 127_257, 3, &[0, 0xff, 0x7f, 0xe8, 0x03, 0x18, 0xfc, 0xff]);
    let (all, _) = decode(&[raw(1.0, 130_842, 3, &rates), tilt(1.02), tilt(2.0)].concat());
    let rates = |k: usize| fixtures::attitudes(&all)[k].1.rates;
    assert_eq!(
        (rates(0), rates(1)),
        (Some([2.0_f64.to_radians(), 0.0, 0.0]), None)
    );
}

#[test]
fn n2k_device_chosen_by_the_name_that_it_claimed() {
    let mut mount = Mount::default();
    mount.devices.heading = "0xC0788C00E7E04312".into();
    let name = 0xc078_8c00_e7e0_4312_u64.to_le_bytes();
    let text = [
        heading(1.0, 5, 1.0, 0),
        raw(1.1, 60_928, 6, &name),
        heading(1.2, 6, 2.0, 0),
        heading(1.3, 5, 1.0, 0),
        // A device without an address, and a truncated claim.
        raw(1.4, 60_928, 254, &name),
        raw(1.5, 60_928, 7, &name[..4]),
    ]
    .concat();
    let (all, d) = fixtures::decode(N2kDecoder::new(&Mounting::new(&mount)), text.as_bytes(), 7);
    assert_eq!(fixtures::whole(fixtures::headings(&all)), [1.0, 2.0]);
    assert_eq!(
        (d.decoded().left_out, d.decoded().ignored),
        (3, 0),
        "{:?}",
        d.remarks()
    );
}

#[test]
fn n2k_what_a_device_marks_itself() {
    // A heading with an invalid reference, and a fix with caution.
    let mut cautious = vec![0; 7];
    for (x, step) in [(50.0, 1e-16), (14.5, 1e-16), (48.0, 1e-6)] {
        cautious.extend(((x / step) as i64).to_le_bytes());
    }
    cautious.extend([0x10, 0xfe, 12, 100, 0, 120, 0, 0, 0, 0, 0, 0]);
    let text = [heading(1.0, 5, 1.0, 2), raw(2.0, 129_029, 1, &cautious)].concat();
    let (all, d) = decode(&text);
    let fix = fixes(&all)[0];
    assert!(
        all.len() == 1 && (fix.position_sd[0] - 1.5).abs() < 1e-9,
        "{all:?}"
    );
    let remarks: String = d.remarks().into_iter().map(|r| r.text).collect();
    assert!(
        remarks.contains("1 of 1 whole fixes are marked with caution")
            && remarks.contains("127250 (marked as invalid)"),
        "{remarks}"
    );
}

proptest! {
    #[test]
    fn n2k_arbitrary_damage(damage in damage(60), noise in prop::collection::vec(any::<u8>(), 0..600), cut in 1_usize..700) {
        let whole = (0..10).flat_map(|k| {
            let at_s = 1.0 + f64::from(k);
            [gnss(at_s, 50.0, 48.0, 1), heading(at_s, 5, 1.0, 0), velocity(at_s, 1.0, 2.0)].concat().into_bytes()
        });
        let bytes = [damaged(whole.collect(), damage), noise].concat();
        let decoder = N2kDecoder::new(&Mounting::new(&Mount::default()));
        let (all, _) = fixtures::decode(decoder, &bytes, cut);
        prop_assert!(all.len() <= 40);
    }
}

#[test]
fn n2k_binary_frames_of_a_gateway() {
    let mut decoder = N2kDecoder::new(&Mounting::new(&Mount::default()));
    let frame = [&ACTISENSE[..], &[8, 2, 0, 0xf1, 1, 10]].concat();
    decoder.push(&frame, &mut Vec::new());
    let remarks = decoder.remarks();
    assert!(remarks[0].text.contains("Actisense-binary"), "{remarks:?}");
    assert_eq!(remarks[0].remedy.as_deref(), Some(BINARY));
}
