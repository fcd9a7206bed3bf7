use super::*;
use crate::sensors::{Mount, config::BusDevices};

#[test]
fn devices_of_a_group_that_fall_silent_and_return() {
    let mut bus = SensorBus::default();
    let mut takes = |device: u32, at_s: f64| {
        let heading = Content::Heading {
            heading: 1.0,
            variation: None,
            deviation: None,
            magnetic: false,
        };
        bus.take(device, (at_s * 1e9) as i64, heading).is_ok()
    };
    assert!(takes(1, 0.0) && !takes(2, 0.1) && takes(1, 1.0));
    // The second device replaces the first until the first returns.
    assert!(!takes(2, 2.9) && takes(2, 3.1) && !takes(3, 3.2));
    assert!(takes(1, 3.3) && !takes(2, 3.4) && takes(1, 4.0));
    // A third device replaces both while they are silent.
    assert!(takes(2, 6.1) && takes(3, 8.2) && !takes(2, 8.3) && takes(1, 8.4));
}

/// Fixes of two receivers at 10 Hz, with a whole fix each second. `first` sends first, perhaps after a
/// velocity from `other`. The latitude is the receiver's number.
fn fixes_of_two([first, other]: [u32; 2], velocity_before: bool) -> Vec<GnssFix> {
    let mut bus = SensorBus::default();
    let place = |of: u32| [f64::from(of), 14.5];
    let velocity = |of: u32| Content::velocity(f64::from(of), Some((0.0, false))).unwrap();
    let whole = |of: u32| {
        Content::Gnss(GnssReport {
            place: place(of),
            altitude_m: Some(100.0 + f64::from(of)),
            separation_m: None,
            quality: 2,
            hdop: None,
            caution: false,
        })
    };
    let mut sent = Vec::new();
    if velocity_before {
        sent.push((other, 0, velocity(other)));
    }
    for k in 0..50_i64 {
        let at_ns = k * 100_000_000 + 1_000_000;
        if k % 10 == 3 {
            sent.extend([other, first].map(|of| (of, at_ns, whole(of))));
        }
        sent.extend([first, other].map(|of| (of, at_ns, Content::Position(place(of)))));
        sent.extend([other, first].map(|of| (of, at_ns, velocity(of))));
    }
    let taken = sent
        .into_iter()
        .filter_map(|(of, at_ns, c)| bus.take(of, at_ns, c).ok()?);
    taken
        .map(|m| match m {
            Measurement::Gnss(fix) => fix,
            m => panic!("{m:?}"),
        })
        .collect()
}

#[test]
fn receivers_that_both_send_everything() {
    for (devices, velocity_before) in [([1, 2], false), ([1, 2], true), ([2, 1], false), ([2, 1], true)] {
        let fixes = fixes_of_two(devices, velocity_before);
        let of = f64::from(devices[0]);
        assert_eq!(fixes.len(), 50, "{devices:?}");
        assert!(
            fixes.iter().all(|f| (f.datum.latitude_deg - of).abs() < 1e-9),
            "{devices:?}"
        );
        let is_measured = |sd: f64| sd < NOT_MEASURED_SD;
        let heights = fixes.iter().filter(|f| is_measured(f.position_sd[2]));
        assert_eq!(heights.count(), 5, "{devices:?}");
        let with_velocity = |f: &&GnssFix| is_measured(f.velocity_sd[0]) && (f.velocity[0] - of).abs() < 1e-9;
        assert_eq!(fixes.iter().filter(with_velocity).count(), 49, "{devices:?}");
        let better = fixes
            .iter()
            .filter(|f| f.position_sd[0] < fixes[0].position_sd[0]);
        assert_eq!(better.count(), 47, "of whole fixes");
    }
}

#[test]
fn receiver_that_stands_in_with_its_velocity() {
    let mut bus = SensorBus::default();
    let velocity = |of: u32| Content::velocity(f64::from(of), Some((0.0, false))).unwrap();
    let place = Content::Position([50.0, 14.5]);
    let mut takes = |of, at_s: f64, c| bus.take(of, (at_s * 1e9) as i64, c).is_ok();
    assert!(takes(1, 0.0, place) && !takes(2, 0.1, velocity(2)) && takes(1, 0.1, velocity(1)));
    // The first device has lost its position, but still sends a velocity.
    assert!(takes(2, 2.5, place) && takes(2, 2.5, velocity(2)) && !takes(1, 2.6, velocity(1)));
    assert!(takes(1, 3.0, place) && takes(1, 3.0, velocity(1)) && !takes(2, 3.1, velocity(2)));
}

#[test]
fn separation_of_a_receiver() {
    // The sea is 45 m above the ellipsoid here.
    let mut bus = SensorBus::default();
    let place = Datum::new(50.0, 14.5, 0.0);
    assert_eq!(bus.height(&place, 2.5, Some(44.0)), (46.5, 0.0));
    for stated in [None, Some(0.0), Some(-30.0)] {
        let (height, spread) = bus.height(&place, 2.5, stated);
        assert!(
            (height - 47.6).abs() < 1.0 && spread > 0.0,
            "{stated:?}: {height}"
        );
    }
    assert_eq!(bus.height(&place, 48.0, Some(44.0)), (48.0, 0.0));
}

fn heading(rad: f64) -> Content {
    Content::Heading {
        heading: rad,
        variation: None,
        deviation: None,
        magnetic: false,
    }
}
fn whole(quality: u8, altitude_m: Option<f64>, hdop: f64) -> Content {
    Content::Gnss(GnssReport {
        place: [50.0, 14.5],
        altitude_m,
        separation_m: None,
        quality,
        hdop: Some(hdop),
        caution: false,
    })
}
fn bus_with(devices: BusDevices) -> SensorBus {
    SensorBus::new(&Mounting::new(&Mount {
        devices,
        ..Mount::default()
    }))
}
fn texts(bus: &SensorBus) -> String {
    let all = bus.remarks(&Account::default());
    let of = |r: Remark| format!("{} [{}]\n", r.text, r.remedy.unwrap_or_default());
    all.into_iter().map(of).collect()
}
/// Device in use each tenth of a second; `sent` gives the messages of both.
fn used_of_two(
    bus: &mut SensorBus,
    tenths: i64,
    sent: impl Fn(u32, i64) -> Option<Content>,
) -> Vec<(i64, u32)> {
    let mut used = Vec::new();
    for k in 0..tenths {
        for device in [1, 2] {
            let taken = sent(device, k).map(|c| bus.take(device, k * 100_000_000, c));
            used.extend(taken.is_some_and(|t| t.is_ok()).then_some((k, device)));
        }
    }
    used
}

#[test]
fn quicker_device_after_some_seconds_of_evidence() {
    let mut bus = SensorBus::default();
    let used = used_of_two(&mut bus, 1200, |device, k| {
        let tilt = Content::Attitude([0.01 * (k as f64 * 0.1).sin(), 0.0]);
        (device == 2 || k % 10 == 0).then_some(tilt)
    });
    let expected = |k: i64| if k < 150 { 1 } else { 2 };
    assert!(used.iter().all(|(k, device)| *device == expected(*k)), "{used:?}");
    assert_eq!(used.len(), 15 + 1050);
    let texts = texts(&bus);
    assert!(
        texts.contains("attitude: device 2 is used in place of 1"),
        "{texts}"
    );
}

#[test]
fn devices_that_are_about_as_good_are_not_changed() {
    let mut bus = SensorBus::default();
    // The dilutions change; one device sends at half the rate of the other.
    let used = used_of_two(&mut bus, 3000, |device, k| {
        let hdop = if (k / 300 + i64::from(device)) % 2 == 0 {
            0.9
        } else {
            1.0
        };
        (device == 2 || k % 2 == 0).then(|| whole(1, Some(48.0), hdop))
    });
    assert!(used.iter().all(|(_, device)| *device == 1), "{used:?}");
    assert!(!texts(&bus).contains("device"), "{}", texts(&bus));
}

#[test]
fn receiver_of_centimetres_unless_it_lacks_the_height() {
    for (altitude, last) in [(Some(48.0), 2), (None, 1)] {
        let mut bus = SensorBus::default();
        let used = used_of_two(&mut bus, 400, |device, k| {
            let fix = match device {
                1 => whole(1, Some(48.0), 1.0),
                _ => whole(4, altitude, 1.0),
            };
            (k % 10 == 0).then_some(fix)
        });
        assert_eq!(used.len(), 40, "one at a time");
        assert_eq!((used[0].1, used[39].1), (1, last));
    }
}

#[test]
fn device_that_stands_still_while_another_turns() {
    let mut bus = SensorBus::default();
    let used = used_of_two(&mut bus, 300, |device, k| {
        let turned = if device == 2 { 0.002 * k as f64 } else { 0.0 };
        Some(heading(1.0 + turned))
    });
    assert_eq!((used[149], used[150]), ((149, 1), (150, 2)));
    let texts = texts(&bus);
    assert!(texts.contains("heading of device 1 has not changed"), "{texts}");
}

#[test]
fn headings_of_two_devices_that_contradict_each_other() {
    for (apart, tenths, is_finding, is_told) in [
        (0.25, 590, false, false),
        (0.25, 620, true, true),
        (0.075, 620, false, true),
        (0.05, 900, false, false),
    ] {
        let mut bus = SensorBus::default();
        used_of_two(&mut bus, tenths, |device, k| {
            let turned = if device == 2 { apart } else { 0.0 };
            Some(heading(1.0 + turned + 0.1 * (0.05 * k as f64).sin()))
        });
        let texts = texts(&bus);
        let text = "deg over the last 60 s: more than their accuracies allow";
        assert_eq!(texts.contains(text), is_finding, "{apart} {tenths}: {texts}");
        let differ = format!(
            "heading of devices 1 and 2 differ by {:.1} deg",
            f64::to_degrees(apart)
        );
        assert_eq!(texts.contains(&differ), is_told, "{apart} {tenths}: {texts}");
        assert_eq!(texts.contains("heading = \"DEVICE\""), is_finding, "{texts}");
    }
}

#[test]
fn heading_in_degrees_for_radians() {
    let mut bus = SensorBus::default();
    let given = [0.7, 6.25, -3.1, 40.1].map(|rad| bus.take(1, 0, heading(rad)));
    assert!(matches!(given, [Ok(_), Ok(_), Ok(_), Err(Why::Range)]));
}

#[test]
fn receivers_that_contradict_each_other() {
    // 0.001 degrees of latitude are 111 m; 0.0001 degrees are within antenna distance and slow error.
    for (apart, is_finding) in [(1e-3, true), (1e-4, false)] {
        let mut bus = SensorBus::default();
        used_of_two(&mut bus, 700, |device, _| {
            let north = if device == 2 { apart } else { 0.0 };
            Some(Content::Position([50.0 + north, 14.5]))
        });
        let texts = texts(&bus);
        assert_eq!(
            texts.contains("position of devices 1 and 2 differ by 111.1 m"),
            is_finding,
            "{texts}"
        );
    }
}

#[test]
fn chosen_device_that_comes_later_and_falls_silent() {
    let mut bus = bus_with(BusDevices {
        heading: "2".into(),
        ..BusDevices::default()
    });
    let takes =
        |bus: &mut SensorBus, device, at_s: f64| bus.take(device, (at_s * 1e9) as i64, heading(1.0)).is_ok();
    assert!(takes(&mut bus, 1, 0.0) && takes(&mut bus, 2, 0.1) && !takes(&mut bus, 1, 0.2));
    assert!(takes(&mut bus, 1, 2.5) && takes(&mut bus, 1, 6.0));
    let silent = texts(&bus);
    assert!(
        silent.contains("heading: the chosen device 2 has sent nothing valid for 6 s; sent by 1"),
        "{silent}"
    );
    assert!(takes(&mut bus, 2, 6.1) && !takes(&mut bus, 1, 6.2));
    assert_eq!(texts(&bus), "");
}

#[test]
fn chosen_device_that_never_came_and_its_name() {
    let mut bus = bus_with(BusDevices {
        heading: "0xABC".into(),
        ..BusDevices::default()
    });
    for k in 0..7 {
        assert!(bus.take(35, k * 1_000_000_000, heading(1.0)).is_ok());
    }
    let missing = texts(&bus);
    assert!(
        missing.contains("0x0000000000000abc has sent nothing valid yet; sent by 35")
            && missing.contains("correct heading in [sensor.sources.mount.devices]"),
        "{missing}"
    );
    bus.name(35, ["35", &name_text(0xabc)]);
    assert!(bus.take(35, 7_000_000_000, heading(1.0)).is_ok());
    assert_eq!(texts(&bus), "");
}

#[test]
fn velocity_of_a_chosen_device() {
    let mut bus = bus_with(BusDevices {
        velocity: "7".into(),
        ..BusDevices::default()
    });
    let velocity = |speed: f64| Content::velocity(speed, Some((0.0, false))).unwrap();
    assert!(bus.take(7, 0, velocity(3.0)).is_ok());
    assert!(bus.take(1, 10_000_000, velocity(2.0)).is_err());
    match bus.take(1, 20_000_000, Content::Position([50.0, 14.5])) {
        Ok(Some(Measurement::Gnss(fix))) => assert!((fix.velocity[0] - 3.0).abs() < 1e-9, "{fix:?}"),
        other => panic!("{other:?}"),
    }
}

#[test]
fn devices_without_number_are_bounded() {
    let mut bus = SensorBus::default();
    for k in 0..10_000_u32 {
        let _ = bus.take(k, i64::from(k) * 1_000_000, heading(1.0));
    }
    assert!(texts(&bus).len() < 4000);
}
