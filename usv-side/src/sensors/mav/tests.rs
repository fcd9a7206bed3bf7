use super::*;
use crate::{
    fixtures::{self, damage, damaged},
    sensors::{Measurement, Mount},
};
use proptest::prelude::*;

fn frame(sequence: u8, message: &m::MavMessage) -> Vec<u8> {
    frame_of(7, 1, sequence, message)
}
fn frame_of(system: u8, component: u8, sequence: u8, message: &m::MavMessage) -> Vec<u8> {
    let from = MavlinkSender {
        system,
        component,
        sequence,
    };
    mavlink::encode(from, message, None)
}
fn heartbeat(mavtype: m::MavType) -> m::MavMessage {
    m::MavMessage::HEARTBEAT(m::HEARTBEAT_DATA {
        mavtype,
        autopilot: m::MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA,
        ..m::HEARTBEAT_DATA::DEFAULT
    })
}
fn boat() -> m::MavMessage {
    heartbeat(m::MavType::MAV_TYPE_SURFACE_BOAT)
}
fn half(angle: f64) -> (f32, f32) {
    ((0.5 * angle).cos() as f32, (0.5 * angle).sin() as f32)
}
fn attitude(ms: u32, roll: f64) -> m::MavMessage {
    let (q1, q2) = half(roll);
    m::MavMessage::ATTITUDE_QUATERNION(m::ATTITUDE_QUATERNION_DATA {
        time_boot_ms: ms,
        q1,
        q2,
        rollspeed: 0.25,
        ..m::ATTITUDE_QUATERNION_DATA::DEFAULT
    })
}
fn imu(us: u64) -> m::MavMessage {
    m::MavMessage::HIGHRES_IMU(m::HIGHRES_IMU_DATA {
        time_usec: us,
        zacc: -9.8,
        xgyro: 0.1,
        fields_updated: m::HighresImuUpdatedFlags::from_bits_retain(0x3f),
        ..m::HIGHRES_IMU_DATA::DEFAULT
    })
}
fn gps(us: u64) -> m::MavMessage {
    m::MavMessage::GPS_RAW_INT(m::GPS_RAW_INT_DATA {
        time_usec: us,
        fix_type: m::GpsFixType::GPS_FIX_TYPE_3D_FIX,
        lat: 500_000_000,
        lon: 145_000_000,
        alt: 210_000,
        vel: 200,
        cog: 9000,
        ..m::GPS_RAW_INT_DATA::DEFAULT
    })
}
/// One second of data from a boat's Pixhawk.
fn second(from_ms: u32) -> Vec<u8> {
    let mut out = frame(255, &boat());
    for k in 0..50_u32 {
        let ms = from_ms + 20 * k;
        out.extend(frame(k as u8, &imu(u64::from(ms) * 1000)));
        if k % 2 == 0 {
            out.extend(frame(k as u8, &attitude(ms, 0.1)));
        }
        if k % 10 == 0 {
            out.extend(frame(k as u8, &gps(u64::from(ms) * 1000)));
        }
    }
    out
}
fn decode(bytes: &[u8], cut: usize, mount: Mount) -> (Vec<SourceMeasurement>, MavlinkDecoder) {
    fixtures::decode(MavlinkDecoder::new(&Mounting::new(&mount)), bytes, cut)
}

#[test]
fn mavlink_kinds_of_measurement() {
    let mount = Mount {
        antenna_m: Some([0.0, 0.0, -2.0]),
        mounting_deg: [0.0, 0.0, 90.0],
        ..Mount::default()
    };
    let (all, d) = decode(&second(5000), 37, mount);
    assert_eq!((d.decoded().good, d.decoded().corrupted), (50 + 25 + 5, 0));
    assert_eq!(
        [0, 1, 2, 3].map(|kind| fixtures::count(&all, kind)),
        [50, 5, 5, 25]
    );
    let first = |kind| all.iter().find(|h| h.measurement.kind() == kind).unwrap();
    assert_eq!((first(0).at_ns, first(3).at_ns), (5_000_000_000, 5_000_000_000));
    let (Measurement::Imu(i), Measurement::Gnss(g), Measurement::Attitude(a), Measurement::Heading(h)) = (
        first(0).measurement,
        first(1).measurement,
        first(3).measurement,
        first(2).measurement,
    ) else {
        panic!("kinds");
    };
    // The sensor's forward axis is the vessel's starboard.
    assert!(
        (i.gyro[1] - 0.1).abs() < 1e-6 && (i.accelerometer[2] + 9.8).abs() < 1e-6,
        "{i:?}"
    );
    assert!((a.tilt[1] - 0.1).abs() < 1e-6 && a.tilt[0].abs() < 1e-6, "{a:?}");
    assert!((a.rates.unwrap()[1] - 0.25).abs() < 1e-6);
    assert!((h.heading + core::f64::consts::FRAC_PI_2).abs() < 1e-6, "{h:?}");
    assert!((g.velocity[1] - 2.0).abs() < 1e-6 && g.velocity_sd[2] == NOT_MEASURED_SD);
    assert_eq!(g.lever_arm, Some([0.0, 0.0, -2.0]));
    // The receiver sends 210 m above the sea, which is 45.25 m above the ellipsoid there.
    assert!((g.datum.height_m - 255.25).abs() < 0.01, "{g:?}");
    assert!((1.0..4.0).contains(&g.height_spread), "{g:?}");
    assert!(d.remarks()[0].text.contains("EGM96 45.2 m"), "{:?}", d.remarks());
}

#[test]
fn mavlink_odometry_with_and_without_origin() {
    let (q1, q2) = half(0.1);
    let mut data = m::ODOMETRY_DATA {
        time_usec: 1_000_000,
        frame_id: m::MavFrame::MAV_FRAME_LOCAL_NED,
        child_frame_id: m::MavFrame::MAV_FRAME_BODY_FRD,
        x: 3.0,
        q: [q1, q2, 0.0, 0.0],
        vx: 1.5,
        ..m::ODOMETRY_DATA::DEFAULT
    };
    data.pose_covariance[0] = f32::NAN;
    let origin = m::MavMessage::GPS_GLOBAL_ORIGIN(m::GPS_GLOBAL_ORIGIN_DATA {
        latitude: 500_000_000,
        longitude: 145_000_000,
        altitude: 210_000,
        time_usec: 0,
    });
    let odometry = frame(1, &m::MavMessage::ODOMETRY(data));
    let (all, _) = decode(
        &[&frame(0, &boat()), &odometry[..], &frame(2, &origin), &odometry].concat(),
        50,
        Mount::default(),
    );
    let [g] = fixtures::fixes(&all)[..] else {
        panic!("{all:?}")
    };
    assert_eq!(
        (g.position[0], g.velocity[0], g.datum.latitude_deg),
        (3.0, 1.5, 50.0)
    );
    assert_eq!(fixtures::count(&all, 3), 2);
}

#[test]
fn mavlink_attitudes_of_a_doubtful_estimator() {
    let status = |flags: u16| {
        frame(
            1,
            &m::MavMessage::ESTIMATOR_STATUS(m::ESTIMATOR_STATUS_DATA {
                flags: m::EstimatorStatusFlags::from_bits_retain(flags),
                ..m::ESTIMATOR_STATUS_DATA::DEFAULT
            }),
        )
    };
    let tilts = |first_ms: u32, count: u32| -> Vec<u8> {
        (0..count)
            .flat_map(|k| frame(2, &attitude(first_ms + 40 * k, 0.1)))
            .collect()
    };
    let of = |bytes: &[u8]| {
        let (all, d) = decode(&[&frame(0, &boat())[..], bytes].concat(), 91, Mount::default());
        (fixtures::count(&all, 3), d.decoded().left_out, d)
    };
    // Status and attitudes before alignment, and afterwards.
    let (used, left_out, d) = of(&[status(2), tilts(0, 10), status(0x3f), tilts(400, 5)].concat());
    assert_eq!((used, left_out), (5, 10));
    let text = "left out: 10 ATTITUDE_QUATERNION (marked as invalid)";
    assert!(
        d.remarks().iter().any(|r| r.text == text && r.remedy.is_some()),
        "{:?}",
        d.remarks()
    );
    // A bad report that is not followed by another, and a good one.
    assert_eq!(
        of(&[status(0), tilts(0, 260)].concat()).0,
        260 - usize::from(UNFIT)
    );
    assert_eq!(of(&[status(1), tilts(0, 10)].concat()).0, 10);
    // The yaw is aligned with a horizontal position, and not in the mode of a constant position.
    for (flags, headings) in [(0x01, 0), (0x91, 0), (0x11, 2)] {
        let bytes = [frame(0, &boat()), status(flags), tilts(1000, 10)].concat();
        let (all, _) = decode(&bytes, 91, Mount::default());
        assert_eq!(fixtures::count(&all, 2), headings, "{flags}");
    }
}

#[test]
fn mavlink_fixes_and_headings_that_are_none() {
    let m::MavMessage::GPS_RAW_INT(own) = gps(1_000_000) else {
        panic!("GPS_RAW_INT");
    };
    let of = |fix_type| {
        let data = m::GPS_RAW_INT_DATA {
            fix_type,
            lat: i32::MAX,
            ..own
        };
        let bytes = [frame(0, &boat()), frame(1, &m::MavMessage::GPS_RAW_INT(data))].concat();
        let (all, d) = decode(&bytes, 91, Mount::default());
        (all.len(), d.decoded().left_out, d.decoded().corrupted)
    };
    assert_eq!(of(m::GpsFixType::GPS_FIX_TYPE_NO_FIX), (0, 1, 0));
    assert_eq!(of(m::GpsFixType::GPS_FIX_TYPE_NO_GPS), (0, 0, 0));
    assert_eq!(of(m::GpsFixType::GPS_FIX_TYPE_3D_FIX), (0, 0, 1));
}

#[test]
fn mavlink_frames_after_damage() {
    let mut bytes = second(5000);
    let k = bytes.len() / 2;
    bytes[k] ^= 0xff;
    bytes.drain(k + 300..k + 310);
    let (all, d) = decode(&bytes, 100, Mount::default());
    assert!((1..=6).contains(&d.decoded().corrupted), "{:?}", d.decoded());
    assert!(all.len() >= 70, "{}", all.len());
}

#[test]
fn mavlink_stream_requests() {
    let (_, mut d) = decode(&second(0), 500, Mount::default());
    let (first, second) = (d.request().unwrap(), d.request().unwrap());
    let messages = |bytes: &[u8]| decode(bytes, 500, Mount::default()).1.decoded().left_out;
    assert_eq!(
        (messages(&first), messages(&second)),
        (1 + WANTED.len() as u64, 1)
    );
}

/// Half a second of a drone's autopilot, system 1: rolled by 20 deg, one kilometre north.
fn drone(with_heartbeat: bool) -> Vec<u8> {
    let m::MavMessage::GPS_RAW_INT(own) = gps(600_000_000) else {
        panic!("GPS_RAW_INT");
    };
    let away = m::MavMessage::GPS_RAW_INT(m::GPS_RAW_INT_DATA {
        lat: own.lat + 100_000,
        ..own
    });
    let mut out = Vec::new();
    if with_heartbeat {
        out.extend(frame_of(1, 1, 0, &heartbeat(m::MavType::MAV_TYPE_QUADROTOR)));
    }
    for k in 0..20_u32 {
        out.extend(frame_of(
            1,
            1,
            k as u8,
            &attitude(600_000 + 20 * k, 20_f64.to_radians()),
        ));
        out.extend(frame_of(1, 1, k as u8, &away));
    }
    out
}

#[test]
fn mavlink_of_two_systems() {
    let gcs = frame_of(255, 190, 0, &heartbeat(m::MavType::MAV_TYPE_GCS));
    let companion = frame_of(7, 191, 0, &attitude(77, 1.0));
    let bytes = [
        drone(false),
        drone(true),
        gcs,
        second(5000),
        companion,
        drone(true),
    ]
    .concat();
    let (all, d) = decode(&bytes, 91, Mount::default());
    assert_eq!(all.len(), 50 + 5 + 25 + 5, "the boat's alone");
    for m in &all {
        match m.measurement {
            Measurement::Attitude(a) => assert!((a.tilt[0] - 0.1).abs() < 1e-6, "{a:?}"),
            Measurement::Gnss(g) => assert!((g.datum.latitude_deg - 50.0).abs() < 1e-6, "{g:?}"),
            Measurement::Imu(_) | Measurement::Heading(_) => {}
        }
    }
    let n = d.decoded();
    assert_eq!(
        (n.good, n.undated, n.corrupted, n.left_out),
        (80, 0, 0, 3 * 40 + 2 + 1 + 1)
    );
    let text = &d.remarks()[1].text;
    for part in [
        "system 7 component 1 is the vessel's",
        "system 1 component 1, a multirotor (122 messages)",
    ] {
        assert!(text.contains(part), "{text}");
    }
    let mut d = d;
    let asked = d.request().unwrap();
    assert!(asked.len() > 100);
}

#[test]
fn mavlink_without_a_boat() {
    let (all, mut d) = decode(&[drone(true), drone(true)].concat(), 91, Mount::default());
    assert!(all.is_empty(), "{all:?}");
    let remark = &d.remarks()[0];
    assert!(
        remark.text.contains("no system") && remark.text.contains("a multirotor"),
        "{remark:?}"
    );
    assert!(remark.remedy.as_ref().is_some_and(|r| r.contains("system = N")));
    assert!(
        d.request().unwrap().len() < 30,
        "a foreign sender is asked for nothing"
    );
    // If it is selected by number, the drone's system counts as the vessel.
    let named = MavlinkDecoder::new(&Mounting::default()).of_system(1);
    assert_eq!(fixtures::decode(named, &drone(true), 91).0.len(), 20 + 20 + 2);
    let silent: Vec<u8> = (0..150)
        .flat_map(|k| frame(k, &imu(u64::from(k) * 1000)))
        .collect();
    assert_eq!(decode(&silent, 91, Mount::default()).0.len(), 50);
}

#[test]
fn mavlink_heights_above_the_ellipsoid() {
    let m::MavMessage::GPS_RAW_INT(own) = gps(1_000_000) else {
        panic!("GPS_RAW_INT");
    };
    let with = |time_usec: u64, alt_ellipsoid: i32| {
        let data = m::GPS_RAW_INT_DATA {
            time_usec,
            alt_ellipsoid,
            ..own
        };
        frame(1, &m::MavMessage::GPS_RAW_INT(data))
    };
    // Once the receiver has provided a height, zero is also valid.
    let bytes = [frame(0, &boat()), with(1, 254_000), with(2, 0)].concat();
    let fixes = fixtures::fixes(&decode(&bytes, 91, Mount::default()).0);
    assert_eq!(fixes.len(), 2);
    let is_given = |g: &GnssFix| (g.datum.height_m - 254.0).abs() < 1e-6 && g.height_spread == 0.0;
    assert!(fixes.iter().all(is_given), "{fixes:?}");
}

proptest! {
    #[test]
    fn mavlink_arbitrary_damage(
        damage in damage(80), noise in prop::collection::vec(any::<u8>(), 0..600), cut in 1_usize..700,
    ) {
        let bytes = [damaged(second(1000), damage), noise].concat();
        let (all, d) = decode(&bytes, cut, Mount::default());
        prop_assert!(d.frames.waiting() <= MAX_WAITING);
        for m in all {
            if let Measurement::Attitude(a) = m.measurement {
                prop_assert!(a.tilt.iter().all(|t| t.is_finite()));
            }
        }
    }
}
