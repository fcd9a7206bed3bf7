use super::*;
use crate::{
    fixtures::{self, damage, damaged, ubx as message},
    sensors::Mount,
};
use proptest::prelude::*;

fn put(payload: &mut [u8], at: usize, bytes: &[u8]) {
    payload[at..at + bytes.len()].copy_from_slice(bytes);
}
fn pvt(tow_ms: u32) -> Vec<u8> {
    let mut p = [0; 92];
    put(&mut p, 0, &tow_ms.to_le_bytes());
    (p[20], p[21]) = (3, 1);
    put(&mut p, 24, &145_000_000_i32.to_le_bytes());
    put(&mut p, 28, &500_000_000_i32.to_le_bytes());
    put(&mut p, 32, &255_000_i32.to_le_bytes());
    put(&mut p, 40, &1000_u32.to_le_bytes());
    put(&mut p, 44, &2000_u32.to_le_bytes());
    put(&mut p, 52, &(-1500_i32).to_le_bytes());
    put(&mut p, 68, &100_u32.to_le_bytes());
    message(1, 7, &p)
}
fn pulse(tow_ms: u32) -> Vec<u8> {
    let mut p = [0; 16];
    put(&mut p, 0, &tow_ms.to_le_bytes());
    message(0x0d, 1, &p)
}
/// NAV-RELPOSNED east of a moving base with a fixed solution.
fn relative(tow_ms: u32, valid: bool) -> Vec<u8> {
    relative_with(tow_ms, 0b11_0111 | u32::from(valid) << 8)
}
fn relative_with(tow_ms: u32, flags: u32) -> Vec<u8> {
    let mut p = [0; 64];
    p[0] = 1;
    put(&mut p, 4, &tow_ms.to_le_bytes());
    put(&mut p, 24, &9_000_000_i32.to_le_bytes());
    put(&mut p, 52, &50_000_u32.to_le_bytes());
    put(&mut p, 60, &flags.to_le_bytes());
    message(1, 0x3c, &p)
}
fn decode(bytes: &[u8], cut: usize) -> (Vec<SourceMeasurement>, UbxDecoder) {
    let mount = Mount {
        heading_offset_deg: 90.0,
        ..Mount::default()
    };
    fixtures::decode(UbxDecoder::new(&Mounting::new(&mount)), bytes, cut)
}

#[test]
fn ubx_moving_base() {
    let week_ms = 604_800_000;
    let bytes = [
        pvt(week_ms - 200),
        relative(week_ms - 200, true),
        pulse(0),
        message(1, 0x35, &[0; 8]),
        relative(0, false),
        pvt(0),
    ]
    .concat();
    let (all, d) = decode(&bytes, 7);
    let n = d.decoded();
    assert_eq!((n.good, n.corrupted, n.pulses, n.mismatched_pulses), (5, 0, 1, 0));
    let times: Vec<i64> = all.iter().map(|h| h.at_ns - all[0].at_ns).collect();
    assert_eq!(times, [0, 0, 200_000_000], "a new week");
    let (Measurement::Gnss(g), Measurement::Heading(h)) = (all[0].measurement, all[1].measurement) else {
        panic!("{all:?}");
    };
    assert!((g.datum.latitude_deg - 50.0).abs() < 1e-9 && (g.datum.height_m - 255.0).abs() < 1e-9);
    assert!((g.velocity[1] + 1.5).abs() < 1e-9 && (g.position_sd[0] - 0.3).abs() < 1e-9);
    assert!(h.heading.abs() < 1e-9 && (h.heading_sd - 0.5_f64.to_radians()).abs() < 1e-9);
}

#[test]
fn ubx_moving_base_with_a_float_carrier_solution() {
    const FIXED: u32 = 0b1_0011_0111;
    const FLOAT: u32 = 0b1_0010_1111;
    let flags = |k: u32| if k < 143 { FLOAT } else { FIXED };
    let bytes: Vec<u8> = (0..150).flat_map(|k| relative_with(200 * k, flags(k))).collect();
    let (all, d) = decode(&bytes, 64);
    assert_eq!((all.len(), d.decoded().good, d.decoded().left_out), (7, 150, 143));
    let remarks = d.remarks();
    let remark = remarks.iter().find(|r| r.text.contains("moving base"));
    let remark = remark.unwrap_or_else(|| panic!("{remarks:?}"));
    assert_eq!(remark.text, "moving base: float in 143 of 150 headings: left out");
    assert!(remark.remedy.is_some());
    // A float solution for a short time at the start is not a fault.
    let bytes: Vec<u8> = (140..180)
        .flat_map(|k| relative_with(200 * k, flags(k)))
        .collect();
    let (all, d) = decode(&bytes, 64);
    assert_eq!((all.len(), d.remarks()[0].remedy.is_none()), (37, true));
    // Invalid flags: no fix, position, heading or carrier solution; both solution bits; a base ashore.
    for (flag, why) in [
        (1, "marked as invalid"),
        (1 << 2, "marked as invalid"),
        (1 << 8, "marked as invalid"),
        (1 << 4, "marked as invalid"),
        (1 << 3, "marked as invalid"),
        (1 << 5, "of a fixed base"),
    ] {
        let (all, d) = decode(&relative_with(200, FIXED ^ flag), 64);
        assert!(all.is_empty() && d.decoded().left_out == 1, "{flag:b}: {all:?}");
        assert!(d.remarks()[0].text.contains(why), "{flag:b}: {:?}", d.remarks());
    }
}

#[test]
fn ubx_fix_by_each_of_its_flags() {
    // Kind, flags, and flags3 beginning with invalidLlh.
    for (kind, flags, flags3, is_one) in [
        (3, 1, 0, true),
        (4, 1, 0, true),
        (2, 1, 0, true),
        (3, 1, 1, false),
        (3, 0, 0, false),
        (1, 1, 0, false),
        (5, 1, 0, false),
        (0, 1, 0, false),
    ] {
        let whole = pvt(200);
        let mut p: Vec<u8> = whole[6..whole.len() - 2].to_vec();
        (p[20], p[21], p[78]) = (kind, flags, flags3);
        let (all, d) = decode(&message(1, 7, &p), 64);
        assert_eq!(all.len(), usize::from(is_one), "{kind} {flags} {flags3}");
        assert_eq!(d.remarks().is_empty(), is_one, "{:?}", d.remarks());
    }
}

#[test]
fn ubx_receiver_with_the_solution_in_parts() {
    let epoch = |k: u32, kind: u8| {
        let tow_ms = 200 * k;
        let mut sol = [0; 52];
        put(&mut sol, 0, &tow_ms.to_le_bytes());
        (sol[10], sol[11]) = (kind, u8::from(kind > 0));
        let all = parts(tow_ms, 3, false);
        // NAV-POSLLH and NAV-VELNED, without the NAV-STATUS in between.
        let (place, rest) = all.split_at(8 + 28);
        [&message(1, 6, &sol)[..], place, &rest[8 + 16..]].concat()
    };
    let bytes: Vec<u8> = (0..20)
        .flat_map(|k| epoch(k, if k < 10 { 3 } else { 0 }))
        .collect();
    let (all, d) = decode(&bytes, 7);
    assert_eq!((all.len(), d.decoded().corrupted), (9, 0), "{:?}", d.decoded());
    assert!(all.iter().skip(1).all(|m| matches!(m.measurement,
        Measurement::Gnss(g) if (g.velocity[1] + 1.5).abs() < 1e-9)));
    assert!(
        d.remarks().iter().any(|r| r.text.contains("10 NAV-SOL (no fix)")),
        "{:?}",
        d.remarks()
    );
}

/// NAV-POSLLH, NAV-STATUS with this kind of fix, NAV-VELNED and, if `fine`, NAV-HPPOSLLH, in a receiver's order.
fn parts(tow_ms: u32, fix: u8, fine: bool) -> Vec<u8> {
    let mut place = [0; 28];
    put(&mut place, 0, &tow_ms.to_le_bytes());
    put(&mut place, 4, &145_000_000_i32.to_le_bytes());
    put(&mut place, 8, &500_000_000_i32.to_le_bytes());
    put(&mut place, 12, &255_000_i32.to_le_bytes());
    put(&mut place, 20, &1000_u32.to_le_bytes());
    put(&mut place, 24, &2000_u32.to_le_bytes());
    let mut status = [0; 16];
    put(&mut status, 0, &tow_ms.to_le_bytes());
    (status[4], status[5]) = (fix, u8::from(fix > 0));
    let mut velocity = [0; 36];
    put(&mut velocity, 0, &tow_ms.to_le_bytes());
    put(&mut velocity, 8, &(-150_i32).to_le_bytes());
    put(&mut velocity, 28, &10_u32.to_le_bytes());
    let mut precise = [0; 36];
    put(&mut precise, 4, &tow_ms.to_le_bytes());
    put(&mut precise, 8, &145_000_000_i32.to_le_bytes());
    put(&mut precise, 12, &500_000_000_i32.to_le_bytes());
    put(&mut precise, 16, &255_000_i32.to_le_bytes());
    (precise[25], precise[26]) = (50, 9);
    put(&mut precise, 28, &1000_u32.to_le_bytes());
    put(&mut precise, 32, &2000_u32.to_le_bytes());
    let precise = if fine {
        message(1, 0x14, &precise)
    } else {
        Vec::new()
    };
    [
        message(1, 2, &place),
        message(1, 3, &status),
        message(1, 0x12, &velocity),
        precise,
    ]
    .concat()
}

#[test]
fn ubx_receiver_without_whole_fixes() {
    for fine in [false, true] {
        let bytes: Vec<u8> = (0..20).flat_map(|k| parts(200 * k, 3, fine)).collect();
        let (all, d) = decode(&bytes, 7);
        assert_eq!(all.len(), 19, "{fine}: {:?}", d.decoded());
        for (k, m) in (1..).zip(&all) {
            assert_eq!(m.at_ns, 200_000_000 * k);
        }
        for m in all.iter().skip(1) {
            let g = m.measurement.gnss().unwrap();
            let (height, across) = if fine { (255.0009, 0.03) } else { (255.0, 0.3) };
            let latitude = if fine { 50.000_000_05 } else { 50.0 };
            assert!(
                (g.datum.latitude_deg - latitude).abs() < 1e-10
                    && (g.datum.longitude_deg - 14.5).abs() < 1e-10
            );
            assert!((g.datum.height_m - height).abs() < 1e-6, "{g:?}");
            assert!(
                (g.position_sd[0] - across).abs() < 1e-9 && (g.velocity[1] + 1.5).abs() < 1e-9,
                "{g:?}"
            );
            assert!((g.velocity_sd[0] - 0.1).abs() < 1e-9);
        }
    }
}

#[test]
fn ubx_parts_without_a_fix_and_with_a_whole_one() {
    let bytes: Vec<u8> = (0..20).flat_map(|k| parts(200 * k, 0, false)).collect();
    let (all, d) = decode(&bytes, 7);
    assert!(all.is_empty());
    let reports = |d: &UbxDecoder, part: &str| d.remarks().iter().any(|r| r.text.contains(part));
    assert!(reports(&d, "20 NAV-STATUS (no fix)"), "{:?}", d.remarks());
    // NAV-PVT is complete. When it is silent for 2 s, the parts are used from their second epoch on.
    let part = |k: u32| {
        [
            parts(200 * k, 3, false),
            if k < 20 { pvt(200 * k) } else { Vec::new() },
        ]
        .concat()
    };
    let bytes: Vec<u8> = (0..40).flat_map(part).collect();
    let (all, d) = decode(&bytes, 7);
    let times: Vec<i64> = all.iter().map(|m| m.at_ns / 200_000_000).collect();
    let expected: Vec<i64> = (0..20).chain(31..40).collect();
    assert_eq!(times, expected, "{:?}", d.remarks());
    assert!(reports(&d, "NAV-POSLLH") && reports(&d, "a better one is used"));
}

#[test]
fn ubx_messages_that_are_not_read() {
    let mut sol = [0; 52];
    (sol[10], sol[11]) = (3, 1);
    let messages = [
        message(1, 0x35, &[0; 8]),
        message(1, 0x04, &[0; 18]),
        message(1, 0x04, &[0; 18]),
        message(0x0a, 0x77, &[0; 4]),
        message(1, 0x06, &sol),
        message(1, 7, &[0; 84]),
    ];
    let (_, d) = decode(&messages.concat(), 7);
    let text: Vec<String> = d.remarks().into_iter().map(|r| r.text).collect();
    let text = text.join("; ");
    for part in [
        "2 NAV-DOP",
        "1 NAV-SAT",
        "1 UBX-0A-77",
        "but no position",
        "of an unexpected length",
    ] {
        assert!(text.contains(part), "{part}: {text}");
    }
    let n = d.decoded();
    assert_eq!((n.good, n.ignored, n.corrupted), (1, 4, 1));
}

#[test]
fn ubx_pulse_of_another_time_base() {
    let before_any_fix = pulse(77_000);
    // Pulses announced for the next second, the last one, the next in UTC (18 s behind), and a new week.
    let bytes = [
        before_any_fix,
        pvt(20_200),
        pulse(21_000),
        pulse(19_000),
        pulse(3_000),
        pvt(604_799_800),
        pulse(0),
        message(0x0d, 1, &u32::MAX.to_le_bytes().repeat(4)),
    ]
    .concat();
    let (_, d) = decode(&bytes, 9);
    let n = d.decoded();
    assert_eq!((n.pulses, n.mismatched_pulses, n.corrupted), (5, 1, 1));
}

#[test]
fn ubx_messages_after_damage() {
    let mut bad = pvt(1000);
    bad[40] ^= 1;
    let cut = &pvt(2000)[..60];
    let bytes = [&bad[..], &pvt(3000), cut, &pvt(4000), b"$GPGGA,noise", &pvt(5000)].concat();
    let (all, d) = decode(&bytes, 64);
    assert!(d.decoded().corrupted >= 2, "{:?}", d.decoded());
    assert!(
        all.len() >= 2 && all.iter().any(|h| h.at_ns == 5_000_000_000),
        "{all:?}"
    );
}

proptest! {
    #[test]
    fn ubx_arbitrary_damage(
        damage in damage(60), noise in prop::collection::vec(any::<u8>(), 0..600), cut in 1_usize..700,
    ) {
        let whole = (0..10).flat_map(|k| [pvt(200 * k), relative(200 * k, true)].concat()).collect();
        let bytes = [damaged(whole, damage), noise].concat();
        let (all, _) = decode(&bytes, cut);
        prop_assert!(all.len() <= 40);
    }
}

#[test]
fn ubx_attitude_with_and_without_a_heading() {
    let att = |k: u32, accuracy: i32| {
        let mut p = [0; 32];
        let values = [150_000, -200_000, 9_000_000, 10_000, 20_000, accuracy];
        put(&mut p, 0, &(200 * k).to_le_bytes());
        for (k, v) in values.into_iter().enumerate() {
            put(&mut p, 8 + 4 * k, &i32::to_le_bytes(v));
        }
        message(1, 5, &p)
    };
    for (accuracy, headings) in [(100_000, 10), (18_000_000, 0)] {
        let bytes: Vec<u8> = (0..10).flat_map(|k| att(k, accuracy)).collect();
        let (all, _) = decode(&bytes, 7);
        let attitudes = crate::fixtures::attitudes(&all);
        let heading = crate::fixtures::headings(&all);
        assert_eq!((attitudes.len(), heading.len()), (10, headings));
        let of = attitudes[0].1;
        let shown = [of.tilt[0], of.tilt[1], of.tilt_sd].map(f64::to_degrees);
        assert!(
            shown
                .iter()
                .zip([1.5, -2.0, 0.2])
                .all(|(a, b)| (a - b).abs() < 1e-6),
            "{shown:?}"
        );
        assert!(heading.iter().all(|h| (h.to_degrees() - 90.0).abs() < 1e-6));
    }
}

#[test]
fn ubx_place_in_earth_centred_coordinates() {
    // Position in Earth-centred coordinates: 50 N, 14.5 E, 255 m.
    let sol = |k: u32| {
        let mut p = [0; 52];
        put(&mut p, 0, &(200 * k).to_le_bytes());
        (p[10], p[11]) = (3, 1);
        for (k, v) in [397_717_762, 102_856_807, 486_298_438, 300]
            .into_iter()
            .enumerate()
        {
            put(&mut p, 12 + 4 * k, &i32::to_le_bytes(v));
        }
        message(1, 6, &p)
    };
    let bytes: Vec<u8> = (0..10).flat_map(sol).collect();
    let (all, d) = decode(&bytes, 7);
    let fixes = crate::fixtures::fixes(&all);
    assert!(fixes.len() >= 8, "{} {:?}", fixes.len(), d.remarks());
    for g in &fixes {
        let apart_m = g.datum.distance_m(&Datum::new(50.0, 14.5, 255.0));
        assert!(apart_m < 0.02 && (g.position_sd[0] - 0.9).abs() < 1e-9, "{g:?}");
    }
    // A message in degrees with the same time takes precedence.
    let bytes: Vec<u8> = (0..20)
        .flat_map(|k| [sol(k), parts(200 * k, 3, false)].concat())
        .collect();
    let places = crate::fixtures::fixes(&decode(&bytes, 7).0);
    assert!(
        places
            .iter()
            .skip(2)
            .all(|g| g.position_sd[0] != fixes[0].position_sd[0]),
        "{places:?}"
    );
}
