use super::*;
use crate::fixtures::{self, damage, damaged};
use crate::sensors::{Measurement, Mount};
use proptest::prelude::*;

fn frame(sequence: u8, message: &m::MavMessage) -> Vec<u8> {
    let from = Sender {
        system: 7,
        component: 1,
        sequence,
    };
    mavlink::encode(from, message)
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
/// A second of a boat's Pixhawk.
fn second(from_ms: u32) -> Vec<u8> {
    let mut out = Vec::new();
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
    let count = |kind| all.iter().filter(|h| h.measurement.kind() == kind).count();
    assert_eq!([count(0), count(1), count(2), count(3)], [50, 5, 5, 25]);
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
    // Its forward is the vessel's starboard.
    assert!(
        (i.gyro[1] - 0.1).abs() < 1e-6 && (i.accelerometer[2] + 9.8).abs() < 1e-6,
        "{i:?}"
    );
    assert!((a.tilt[1] - 0.1).abs() < 1e-6 && a.tilt[0].abs() < 1e-6, "{a:?}");
    assert!((a.rates.unwrap()[1] - 0.25).abs() < 1e-6);
    assert!((h.heading + core::f64::consts::FRAC_PI_2).abs() < 1e-6, "{h:?}");
    assert!((g.velocity[1] - 2.0).abs() < 1e-6 && g.velocity_sd[2] == NOT_MEASURED_SD);
    assert_eq!((g.lever_arm, g.datum.height_m), (Some([0.0, 0.0, -2.0]), 210.0));
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
    });
    let odometry = frame(1, &m::MavMessage::ODOMETRY(data));
    let (all, _) = decode(
        &[&odometry[..], &frame(2, &origin), &odometry].concat(),
        50,
        Mount::default(),
    );
    let fixes: Vec<_> = all.iter().filter(|h| h.measurement.kind() == 1).collect();
    let [fix] = fixes[..] else { panic!("{all:?}") };
    let Measurement::Gnss(g) = fix.measurement else {
        panic!("{fix:?}")
    };
    assert_eq!(
        (g.position[0], g.velocity[0], g.datum.latitude_deg),
        (3.0, 1.5, 50.0)
    );
    assert_eq!(all.iter().filter(|h| h.measurement.kind() == 3).count(), 2);
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
    let messages = |bytes: &[u8]| decode(bytes, 500, Mount::default()).1.decoded().ignored;
    assert_eq!(
        (messages(&first), messages(&second)),
        (1 + WANTED.len() as u64, 1)
    );
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
