use super::*;
use crate::{
    fixtures::{rtcm_frame, sentence},
    sensors::{Mount, UNWITNESSED},
};
use alight_shared::vessel_model::{PITCH, ROLL, SURGE, SWAY, YAW};
use proptest::prelude::*;

fn node(sources: usize) -> SensorNode {
    let config = SourcesConfig {
        sources: vec![SourceConfig::default(); sources],
    };
    SensorNode::new(&config, 1, 9)
}
/// Sentences of a motion sensor and a receiver at step `k` (100 ms).
fn messages(k: i64) -> String {
    let (s, tenth) = (k / 10, k % 10);
    let t = format!("12{:02}{:02}.{tenth}0", s / 60, s % 60);
    sentence(&format!(
        "PASHR,{t},90.0,T,{:.2},1.00,0.10,0.1,0.1,0.2,1,1",
        (0.1 * k as f64).sin()
    )) + &sentence(&format!(
        "GPGGA,{t},5000.0000,N,01430.0000,E,4,12,0.8,210.0,M,45.0,M,,"
    ))
}
fn step(n: &mut SensorNode, now: Time<VesselClock>, bytes: &[&[u8]]) -> Readings {
    let input = SensorsIn {
        bytes: bytes.iter().map(|b| b.to_vec()).collect(),
        ..SensorsIn::default()
    };
    Readings::of(&n.step(now, &input).readings)
}
fn at(k: i64) -> Time<VesselClock> {
    Time::from_nanos(7_000_000_000 + k * 100_000_000)
}

#[test]
fn sensor_node_with_two_sources() {
    let mut n = node(2);
    let (mut imu, mut times) = (0, Vec::new());
    for k in 0..50 {
        // The second sentence is 30 ms late or more.
        let late = Span::from_millis(30 + 20 * (k % 3));
        let first = step(&mut n, at(k), &[messages(k).as_bytes(), &[]]);
        let second = step(&mut n, at(k) + late, &[&[], messages(k).as_bytes()]);
        imu += first.imu.len();
        assert!(first.attitude.iter().all(|a| a.source == 0));
        assert!(second.gnss.iter().all(|g| g.source == 2));
        times.extend(second.attitude.iter().map(|a| a.header.at));
    }
    assert_eq!(imu, 0);
    let steps: Vec<f64> = times.windows(2).skip(5).map(|w| (w[1] - w[0]).secs()).collect();
    assert!(steps.iter().all(|s| (s - 0.1).abs() < 1e-3), "jitter: {steps:?}");
    let is_unwitnessed = |r: &Remark| r.text.contains(UNWITNESSED);
    assert!(!n.remarks().iter().flatten().any(is_unwitnessed), "two of each");
    let status = n.status();
    assert_eq!((status[0].given, status[0].duplicated), ([0, 50, 50, 50], 0));
}

#[test]
fn sensor_node_repeated_and_reordered_messages() {
    let mut n = node(1);
    let mut given = 0;
    for k in 0..40 {
        let mut text = messages(k);
        if k % 10 == 5 {
            text = text.clone() + &text;
        }
        if k % 10 == 9 {
            text += &messages(k - 3);
        }
        given += step(&mut n, at(k), &[text.as_bytes()]).attitude.len();
    }
    let s = n.status()[0];
    let last = n.remarks()[0].last().map(|r| r.text.clone()).unwrap_or_default();
    assert!(
        last.starts_with("position, roll and pitch, heading unwitnessed: "),
        "{last}"
    );
    assert_eq!(given, 40);
    assert!(s.duplicated >= 4 && s.out_of_order >= 8, "{s:?}");
    assert_eq!(s.decoded.corrupted, 0);
}

#[test]
fn sensor_node_byte_limit() {
    let mut n = node(1);
    assert!(step(&mut n, at(0), &[&[b'x'; 3 * MAX_STEP_BYTES]]).is_empty());
    assert_eq!(n.status()[0].lost_bytes, 2 * MAX_STEP_BYTES as u64);
}

#[test]
fn sensor_node_across_a_leap_second() {
    // The receiver's UTC steps back by 1 s at 60 s; the new offset is found within a second and reported.
    let mut n = node(1);
    let mut late = Vec::new();
    for k in 0..900 {
        let text = messages(if k < 600 { k } else { k - 10 });
        let now = at(k) + Span::from_millis(30 + 20 * (k % 3));
        for a in step(&mut n, now, &[text.as_bytes()]).attitude {
            late.push((k, (now - a.header.at).secs()));
        }
    }
    let old = late.iter().filter(|(_, age)| *age > 0.2).count();
    assert_eq!(old, 0, "of {}", late.len());
    assert!(
        late.iter().filter(|(k, _)| *k >= 610).count() == 290,
        "{}",
        late.len()
    );
    let remark = &n.remarks()[0][1];
    assert!(
        remark
            .text
            .starts_with("its clock changed 1 times, most recently by -1.0"),
        "{remark:?}"
    );
}

#[test]
fn heading_that_stands_still_while_the_boat_turns() {
    // A rate of turn at 10 Hz is dated by its arrival, the heading at 2 Hz by the receiver's time.
    for swing in [3.0, 0.0] {
        let (mut n, mut used) = (node(1), 0);
        for k in 0..600 {
            let phase = core::f64::consts::TAU * k as f64 / 90.0;
            let mut text = sentence(&format!("TIROT,{:.1},A", 126.0 * phase.cos()));
            if k % 5 == 0 {
                text += messages(k).split_inclusive('\n').next_back().unwrap_or_default();
                text += &sentence(&format!("HEHDT,{:.1},T", 90.0 + swing * phase.sin()));
            }
            let given = step(&mut n, at(k), &[text.as_bytes()]).heading.len();
            used += if k > 300 { given } else { 0 };
        }
        let is_found = |r: &Remark| r.text.starts_with("heading stands still");
        assert_eq!(n.remarks()[0].iter().any(is_found), swing == 0.0);
        assert_eq!(used == 0, swing == 0.0, "{used}");
    }
}

#[test]
fn sensor_node_of_a_line_that_is_full() {
    // The line carries 8 ms less than it is sent in each second.
    let mut n = node(1);
    for k in 0..900 {
        let delay = Span::from_nanos(800_000 * k);
        for a in step(&mut n, at(k) + delay, &[messages(k).as_bytes()]).attitude {
            assert!((a.header.at - at(k)).secs().abs() < 0.02, "{k}: {a:?}");
        }
    }
    let (remark, delay_s) = (&n.remarks()[0][0], n.status()[0].delay_s);
    assert!(
        remark
            .text
            .starts_with("its line is full: 8 ms later each second; 0.6 s old"),
        "{remark:?}"
    );
    assert!(
        (0.6..0.73).contains(&delay_s) && n.status()[0].restarts == 0,
        "{delay_s}"
    );
}

#[test]
fn sensor_node_with_fixes_that_come_late() {
    // Every second fix arrives one second after its time; the first is dated by its arrival.
    let mut n = node(1);
    for k in 0..60_i64 {
        let gga = |k: i64| {
            sentence(&format!(
                "GPGGA,1200{:02}.00,5000.0000,N,01430.0000,E,4,12,0.8,210.0,M,45.0,M,,",
                k
            ))
        };
        let both = if k % 2 == 0 {
            String::new()
        } else {
            gga(k - 1) + &gga(k)
        };
        step(&mut n, at(10 * k), &[both.as_bytes()]);
    }
    let remark = &n.remarks()[0][0];
    assert!(
        remark.text.starts_with("gnss: 29 of 60 arrived more than 0.6 s") && remark.remedy.is_some(),
        "{remark:?}"
    );
}

#[test]
fn sensor_node_with_a_sensor_without_a_time() {
    let mut n = node(1);
    let mut ages = Vec::new();
    for k in 0..200 {
        let text = sentence(&format!("PSXN,23,{:.2},1.00,210.00,0.00", 0.1 * k as f64));
        for a in step(&mut n, at(k), &[text.as_bytes()]).attitude {
            assert_eq!(a.header.at, at(k));
            ages.push((a.tilt[0].to_degrees() - 0.1 * k as f64).abs());
        }
    }
    assert!(
        ages.len() >= 175 && ages.iter().all(|a| *a < 1e-3),
        "{}",
        ages.len()
    );
}

#[test]
fn sensor_node_of_a_server_with_two_clocks() {
    let source = SourceConfig {
        format: Format::SignalK,
        ..SourceConfig::default()
    };
    let mut n = SensorNode::new(
        &SourcesConfig {
            sources: vec![source],
        },
        1,
        9,
    );
    let delta = |stamp: String, path: &str, value: &str| {
        format!(
            r#"{{"updates":[{{"$source":"a","timestamp":"{stamp}","values":[{{"path":"{path}","value":{value}}}]}}]}}"#
        ) + "\n"
    };
    for k in 0..100_i64 {
        // The receiver's time differs from the server's by an hour.
        let of_day = |hour: i64| format!("2026-05-20T{hour:02}:00:{:02}.{}Z", k / 10, k % 10);
        let place = delta(
            of_day(11),
            "navigation.position",
            r#"{"latitude":50,"longitude":14.5}"#,
        );
        let heading = delta(of_day(12), "navigation.headingTrue", "1.0");
        let now = Time::from_secs(1000.0 + 0.1 * k as f64);
        let out = step(&mut n, now, &[(place + &heading).as_bytes()]);
        assert_eq!((out.gnss.len(), out.heading.len()), (1, 1), "{k}");
        for at in [out.gnss[0].header.at, out.heading[0].header.at] {
            assert!((at - now).secs().abs() < 1e-6, "{k}: {at:?}");
        }
    }
    assert_eq!((n.status()[0].restarts, n.status()[0].implausible_time), (0, 0));
}

#[test]
fn sensor_node_with_a_heave_that_stands_too_high() {
    let mut n = node(1);
    let mut attitudes = 0;
    for k in 0..100 {
        let t = format!("12{:02}{:02}.{}0", k / 600, k / 10 % 60, k % 10);
        let text = sentence(&format!(
            "PASHR,{t},90.0,T,{}.00,1.00,30.00,0.1,0.1,0.2,1,1",
            k % 5
        ));
        for a in step(&mut n, at(k), &[text.as_bytes()]).attitude {
            assert_eq!(
                (a.heave, (a.tilt[0].to_degrees() - (k % 5) as f64).abs() < 1e-6),
                (None, true)
            );
            attitudes += 1;
        }
    }
    let remark = &n.remarks()[0][0];
    assert!(
        attitudes == 100 && remark.remedy.is_some(),
        "{attitudes} {remark:?}"
    );
    assert!(
        remark
            .text
            .starts_with("heave is beyond what is possible (30.0 m): left out 100 times of 100"),
        "{remark:?}"
    );
}

fn base_node(format: Format) -> SensorNode {
    let mount = Mount {
        antenna_m: Some([1.0, 2.0, -3.0]),
        ..Mount::default()
    };
    let source = SourceConfig {
        format,
        rtcm: true,
        mount,
        ..SourceConfig::default()
    };
    let sources = vec![source];
    SensorNode::new(&SourcesConfig { sources }, 1, 9).with_deck([-4.0, 0.0, -1.0])
}
fn pushed(n: &mut SensorNode, now: Time<VesselClock>, bytes: &[u8]) -> SensorsOut {
    let input = SensorsIn {
        bytes: vec![bytes.to_vec()],
        ..SensorsIn::default()
    };
    n.step(now, &input)
}
/// RTCM frames of step `k`, every tenth step with a damaged one.
fn epoch(k: i64) -> Vec<Vec<u8>> {
    let mut damaged = rtcm_frame(1087, 90);
    damaged[40] ^= 1;
    let mut all = vec![rtcm_frame(1005, 19), rtcm_frame(1077, 305), rtcm_frame(1230, 8)];
    all.extend((k % 10 == 0).then_some(damaged));
    all
}

#[test]
fn frames_of_a_base_among_sentences() {
    let mut n = base_node(Format::Nmea);
    let (mut attitudes, mut frames, mut before) = (0, Vec::new(), Vec::new());
    for k in 0..100_i64 {
        // Without a line end between frame and sentence; a step's last bytes arrive in the next step.
        let mut bytes = [before, epoch(k).concat(), messages(k).into_bytes()].concat();
        before = bytes.split_off(bytes.len() - (k % 7) as usize);
        let out = pushed(&mut n, at(k), &bytes);
        attitudes += Readings::of(&out.readings).attitude.len();
        frames.extend(out.rtcm);
    }
    let whole: Vec<Vec<u8>> = (0..100).flat_map(|k| epoch(k).into_iter().take(3)).collect();
    assert!(
        frames
            .iter()
            .map(|f| &*f.bytes)
            .eq(whole.iter().map(Vec::as_slice))
    );
    assert_eq!(attitudes, 100);
    let (first, last) = (frames[0].header, frames[299].header);
    assert_eq!(
        (first.at, first.boot, first.sequence, last.sequence),
        (at(0), 9, 1, 300)
    );
    assert!(frames.iter().all(|f| f.antenna_m == [5.0, 2.0, -2.0]));
    let remarks = &n.remarks()[0];
    assert!(
        remarks[0]
            .text
            .starts_with("RTCM of 3.5 kB/s, of which 3.0 kB/s go by radio")
            && remarks[0].remedy.is_some(),
        "{remarks:?}"
    );
    let rates = Remark::fine("RTCM: 1005 10.0 Hz, 1077 10.0 Hz, 1230 10.0 Hz; 10 damaged".into());
    assert_eq!(remarks[1], rates);
}

#[test]
fn frames_of_a_base_that_lacks_its_place() {
    let mut n = base_node(Format::Rtcm);
    for k in 0..5 {
        let out = pushed(
            &mut n,
            at(10 * k),
            &[rtcm_frame(1087, 90), messages(k).into_bytes()].concat(),
        );
        assert!(out.readings.is_empty() && out.rtcm.len() == 1);
    }
    let status = n.status()[0];
    assert_eq!((status.decoded.good, status.newest_s), (5, Some(at(40).secs())));
    let texts: Vec<String> = n.remarks()[0].iter().map(|r| r.text.clone()).collect();
    assert!(
        texts[0].starts_with("RTCM lacks the base position (4072.0, 1005 or 1006)"),
        "{texts:?}"
    );
    assert!(
        texts[1].contains("GLONASS without its biases (1230)"),
        "{texts:?}"
    );
    assert_eq!(texts[2..], ["RTCM: 1087 1.0 Hz"]);
    pushed(&mut n, at(50), &rtcm_frame(4072, 40));
    assert_eq!(n.remarks()[0][1].text, "RTCM: 1087 1.0 Hz, 4072.0 once");
    for k in 6..40 {
        pushed(&mut n, at(10 * k), &rtcm_frame(1087, 90));
    }
    assert!(n.remarks()[0][0].remedy.is_some(), "{:?}", n.remarks());
}

#[test]
fn frames_of_one_step_are_bounded() {
    let mut n = base_node(Format::Ubx);
    let out = pushed(&mut n, at(0), &rtcm_frame(1077, 94).repeat(50));
    assert_eq!((out.rtcm.len(), n.status()[0].lost_bytes), (32, 1800));
    assert!(pushed(&mut node(1), at(0), &rtcm_frame(1077, 94)).rtcm.is_empty());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn sensor_node_future_measurements(parts in prop::collection::vec(
        (0_usize..5, prop::collection::vec(any::<u8>(), 0..300), any::<bool>()), 1..60
    )) {
        let formats = [Format::Nmea, Format::Ubx, Format::Mavlink, Format::N2k, Format::SignalK];
        let sources = formats.map(|format| SourceConfig { format, ..SourceConfig::default() });
        let mut n = SensorNode::new(&SourcesConfig { sources: sources.into() }, 1, 9);
        for (k, (which, bytes, good)) in parts.into_iter().enumerate() {
            let mut all = vec![Vec::new(); 5];
            all[which] = if good { messages(k as i64).into_bytes() } else { bytes };
            let now = at(k as i64);
            let bytes: Vec<&[u8]> = all.iter().map(Vec::as_slice).collect();
            for a in &step(&mut n, now, &bytes).attitude {
                prop_assert!(a.header.at <= now && usize::from(a.source) < 10);
            }
        }
    }
}

#[derive(Clone, Copy, Debug)]
enum Fate {
    Repeated,
    Lost,
    Late(i64),
    Cut(usize),
    Flipped(usize),
}

fn fate() -> impl Strategy<Value = Fate> {
    prop_oneof![
        Just(Fate::Repeated),
        Just(Fate::Lost),
        (1_i64..4).prop_map(Fate::Late),
        (0_usize..120).prop_map(Fate::Cut),
        (0_usize..960).prop_map(Fate::Flipped),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]
    #[test]
    fn estimate_with_lost_late_and_damaged_messages(
        fates in prop::collection::vec((50_i64..580, fate()), 0..120)
    ) {
        let mut sensors = node(1);
        let mut vessel = crate::VesselNode::new(&crate::VesselNodeConfig::default(), 1, 9);
        let mut late: Vec<(i64, Vec<u8>)> = Vec::new();
        let mut last = None;
        for k in 0..620_i64 {
            let mut bytes = messages(k).into_bytes();
            for (_, fate) in fates.iter().filter(|(at, _)| *at == k) {
                match fate {
                    Fate::Repeated => bytes = [&bytes[..], &bytes].concat(),
                    Fate::Lost => bytes.clear(),
                    Fate::Late(by) => late.push((k + by, core::mem::take(&mut bytes))),
                    Fate::Cut(at) => {
                        bytes.drain(..(*at).min(bytes.len()));
                    }
                    Fate::Flipped(bit) => {
                        if let Some(b) = bytes.get_mut(bit / 8) {
                            *b ^= 1 << (bit % 8);
                        }
                    }
                }
            }
            late.retain(|(due, b)| {
                if *due == k {
                    bytes.extend_from_slice(b);
                }
                *due > k
            });
            let now = at(k) + Span::from_millis(20);
            let readings = step(&mut sensors, now, &[&bytes]);
            last = vessel.step(now, &readings.into()).estimate.map(|e| (k, e)).or(last);
        }
        let (k, e) = last.unwrap();
        prop_assert!(k >= 610, "silent since {k}");
        let roll = (0.1 * k as f64).sin().to_radians();
        prop_assert!((e.eta[ROLL] - roll).abs() < 0.01, "roll {} {roll}", e.eta[ROLL]);
        prop_assert!((e.eta[PITCH] - 1_f64.to_radians()).abs() < 0.01, "pitch {}", e.eta[PITCH]);
        prop_assert!((e.eta[YAW] - core::f64::consts::FRAC_PI_2).abs() < 0.02, "heading {}", e.eta[YAW]);
        prop_assert!(e.eta[SURGE].abs() < 0.3 && e.eta[SWAY].abs() < 0.3, "{:?}", e.eta);
        prop_assert_eq!(vessel.outliers().restarts, 0);
    }
}

/// Packs values with these widths in bits into bytes.
fn bits(values: &[(i64, u32)]) -> Vec<u8> {
    let each = values
        .iter()
        .flat_map(|(v, width)| (0..*width).rev().map(move |k| (v >> k & 1) as u8));
    let all: Vec<u8> = each.collect();
    all.chunks(8)
        .map(|b| {
            b.iter()
                .enumerate()
                .fold(0, |byte, (k, bit)| byte | bit << (7 - k))
        })
        .collect()
}
/// Message 1005 of a station at a position.
fn base_at(station: i64, [x, y, z]: [f64; 3]) -> Vec<u8> {
    let [x, y, z] = [x, y, z].map(|v| (v * 1e4).round() as i64);
    let head = [(1005, 12), (station, 12), (0, 6), (0b1110, 4)];
    let values = [&head[..], &[(x, 38), (0, 2), (y, 38), (0, 2), (z, 38)]].concat();
    alight_shared::rtcm::frame(&bits(&values))
}

#[test]
fn bases_that_are_not_on_the_vessel() {
    // ECEF position of 50 N 14.5 E, 255 m, as in the vessel's sentences, moving north at 2 m/s.
    let here = [3_977_177.6, 1_028_568.1, 4_862_984.4];
    let observations =
        |station: i64| alight_shared::rtcm::frame(&bits(&[(1077, 12), (station, 12), (0, 600)]));
    let moved = |k: i64| {
        let minutes = 0.2 * k as f64 / 1852.0;
        let (s, tenth) = (k / 10, k % 10);
        sentence(&format!(
            "GPGGA,12{:02}{:02}.{tenth}0,50{minutes:08.5},N,01430.0000,E,4,12,0.8,210.0,M,45.0,M,,",
            s / 60,
            s % 60
        ))
    };
    let texts = |frames: &dyn Fn(i64) -> Vec<Vec<u8>>| {
        let mut n = base_node(Format::Nmea);
        for k in 0..150 {
            pushed(
                &mut n,
                at(k),
                &[frames(k).concat(), moved(k).into_bytes()].concat(),
            );
        }
        let found = n.remarks().concat().into_iter().filter(|r| r.remedy.is_some());
        found
            .map(|r| r.text)
            .filter(|t| t.starts_with("RTCM"))
            .collect::<Vec<_>>()
    };
    let caster = texts(&|_| {
        vec![
            base_at(1042, [here[0] + 12e3, here[1], here[2]]),
            observations(1042),
        ]
    });
    assert!(
        caster.len() == 1 && caster[0].starts_with("RTCM's base (station 1042) is 12."),
        "{caster:?}"
    );
    let survey = texts(&|_| vec![base_at(7, here), observations(7)]);
    assert!(
        survey.len() == 1 && survey[0].contains("has not moved for 15 s, and the boat by 30 m"),
        "{survey:?}"
    );
    let moving = |k: i64| {
        let [x, y, z] = here;
        let north = 0.2 * k as f64;
        base_at(7, [x - 0.742 * north, y - 0.192 * north, z + 0.643 * north])
    };
    assert_eq!(texts(&|k| vec![moving(k), observations(7)]), [""; 0]);
    let two = texts(&|k| vec![moving(k), observations(7), observations(1042)]);
    assert_eq!(two, ["RTCM of 2 stations: 7 and 1042"]);
    let mixed = texts(&|k| vec![moving(k), observations(7), rtcm_frame(4072, 40)]);
    assert!(
        mixed.len() == 1 && mixed[0].contains("next to 4072.0"),
        "{mixed:?}"
    );
    let rare = texts(&|k| {
        [
            vec![observations(7)],
            if k % 50 == 0 { vec![moving(k)] } else { Vec::new() },
        ]
        .concat()
    });
    assert_eq!(
        rare,
        ["RTCM has the base position at 0.2 Hz, and observations at 10.0 Hz"]
    );
}

#[test]
fn frozen_attitude_next_to_another_sources_heights() {
    // From 20 s on, the first source's driver repeats its last attitude; the second one's RTK height changes.
    let mut n = node(2);
    let mut newest = 0;
    for k in 0..600 {
        let t = 0.1 * k as f64;
        let wave = |a: f64, from: f64| a * (1.5 * t.min(from)).sin();
        let pitch = 2.0 * (1.9 * t.min(20.0)).sin();
        let roll = wave(6.0, 20.0);
        let xdr = sentence(&format!("IIXDR,A,{pitch:.1},D,PTCH,A,{roll:.1},D,ROLL"));
        let (s, tenth) = (k / 10, k % 10);
        let gga = sentence(&format!(
            "GPGGA,1200{s:02}.{tenth}0,5000.0000,N,01430.0000,E,4,12,0.8,{:.2},M,45.0,M,,",
            210.0 + wave(0.4, 60.0)
        ));
        if !step(&mut n, at(k), &[xdr.as_bytes(), gga.as_bytes()])
            .attitude
            .is_empty()
        {
            newest = k;
        }
    }
    assert!((200..330).contains(&newest), "{newest}");
    let text = &n.remarks()[0][0].text;
    assert!(
        text.starts_with("attitude stands still for ") && text.contains("while the height moves"),
        "{text}"
    );
}
