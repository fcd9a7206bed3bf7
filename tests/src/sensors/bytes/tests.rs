use alight_shared::{
    geodesy::Datum,
    msg::Header,
    time::{Time, VesselClock},
};
use alight_usv::sensors::{Measurement, Mounting, SourceMeasurement};
use proptest::prelude::*;

use super::*;

const NS: i64 = 1_000_000_000;
const STATED: StatedErrors = StatedErrors {
    position_m: 1.04,
    velocity_mps: 0.1,
};

fn text(bytes: Vec<u8>) -> String {
    String::from_utf8(bytes).unwrap()
}
fn clock(h: i64, m: i64, s: i64) -> i64 {
    ((h * 60 + m) * 60 + s) * NS
}

#[test]
fn nmea_sentences_of_the_maker_byte_by_byte() {
    // Example from u-blox's protocol specification.
    let gga = nmea::Gga {
        utc_ns: clock(9, 27, 25),
        place: Datum::new(47.0 + 17.113_99 / 60.0, 8.0 + 33.915_90 / 60.0, 499.6 + 48.0),
        geoid_m: 48.0,
        hdop: 1.01,
        satellites: 8,
    };
    assert_eq!(
        text(gga.sentence(nmea::USUAL)),
        "$GPGGA,092725.00,4717.11399,N,00833.91590,E,1,08,1.01,499.6,M,48.0,M,,*5B\r\n"
    );
    assert_eq!(
        text(nmea::zda(clock(8, 27, 10), Some([16, 9, 2002]))),
        "$GPZDA,082710.00,16,09,2002,00,00*64\r\n"
    );
    let (east, north) = 77.52_f64.to_radians().sin_cos();
    assert_eq!(
        text(nmea::vtg([0.0022 * north, 0.0022 * east])),
        "$GPVTG,77.52,T,,M,0.004,N,0.008,K,A*06\r\n"
    );
    // Sentences recorded from a compass and from a NEO-6 receiver.
    assert_eq!(text(nmea::hdt(274.07_f64.to_radians())), "$GPHDT,274.07,T*03\r\n");
    assert_eq!(
        text(nmea::sentence("GPTXT,01,01,02,u-blox ag - www.u-blox.com")),
        "$GPTXT,01,01,02,u-blox ag - www.u-blox.com*50\r\n"
    );
}

#[test]
fn ubx_frames_of_the_maker_byte_by_byte() {
    // As shown by u-center: version poll, 5 solutions per second, port poll.
    let hex = |bytes: Vec<u8>| bytes.iter().map(|b| format!("{b:02X}")).collect::<String>();
    assert_eq!(hex(ubx::message(0x0a, 0x04, &[])), "B5620A0400000E34");
    assert_eq!(
        hex(ubx::message(0x06, 0x08, &[0xc8, 0, 1, 0, 1, 0])),
        "B56206080600C80001000100DE6A"
    );
    assert_eq!(hex(ubx::message(0x06, 0x00, &[])), "B562060000000618");
}

#[test]
fn mavlink_frame_of_a_known_heartbeat() {
    // Test frame used by MAVLink implementations.
    let payload = mavlink::heartbeat(5, [2, 3, 0x59, 3]);
    assert_eq!(
        mavlink::frame(0xef, mavlink::HEARTBEAT, &payload),
        [
            0xfd, 9, 0, 0, 0xef, 1, 1, 0, 0, 0, 5, 0, 0, 0, 2, 3, 0x59, 3, 3, 0x10, 0xf0
        ]
    );
}

#[test]
fn kinds_of_measurements_of_each_source() {
    use Format::{Mavlink, Nmea, Ubx};
    let who = |formats: &[Format]| {
        let source = |format: &Format| SourceConfig {
            format: *format,
            ..SourceConfig::default()
        };
        let all = Carries::assign(&formats.iter().map(source).collect::<Vec<_>>())?;
        let which = |of: fn(&Carries) -> bool| all.iter().position(of);
        Some([which(|c| c.imu), which(|c| c.gnss), which(|c| c.heading)])
    };
    assert_eq!(who(&[Ubx, Nmea, Mavlink]), Some([Some(2), Some(0), Some(1)]));
    assert_eq!(who(&[Mavlink, Nmea]), Some([Some(0), Some(1), Some(1)]));
    assert_eq!(who(&[Mavlink]), Some([Some(0), Some(0), Some(0)]));
    assert_eq!(who(&[Nmea, Ubx]), None);
}

fn header(at_ns: i64) -> Header<VesselClock> {
    Header::new(1, 0, 1, 0, Time::from_nanos(at_ns))
}
fn read(format: Format, mount: &Mount, bytes: &[u8]) -> Vec<SourceMeasurement> {
    let (mut decoder, mut out) = (format.decoder(&Mounting::new(mount), 0), Vec::new());
    decoder.push(bytes, &mut out);
    let counts = decoder.decoded();
    assert_eq!((counts.corrupted, counts.undated), (0, 0), "{counts:?}");
    out
}

proptest! {
    #[test]
    fn sensor_bytes_through_the_vessels_decoders(
        place in (-80.0..80.0_f64, -179.9..179.9_f64, -100.0..200.0_f64),
        velocity in (-8.0..8.0_f64, -8.0..8.0_f64, -2.0..2.0_f64),
        force in prop::array::uniform3(-20.0..20.0_f64), gyro in prop::array::uniform3(-3.0..3.0_f64),
        heading in -3.1..3.1_f64, mounting in prop::array::uniform3(-90.0..90.0_f64), offset in -180.0..180.0_f64,
        ticks in 1_000_i64..8_000_000,
    ) {
        let at_ns = ticks * 10_000_000;
        let mount = Mount { mounting_deg: mounting, heading_offset_deg: offset, ..Mount::default() };
        let datum = Datum::new(place.0, place.1, place.2);
        // A decoder needs two epochs to determine which messages belong together.
        let readings = |at_ns: i64| Readings {
            imu: vec![ImuSample { header: header(at_ns), gyro, accelerometer: force, ..ImuSample::default() }],
            gnss: vec![GnssFix {
                header: header(at_ns), datum, velocity: velocity.into(), position_sd: [0.3; 3], ..GnssFix::default()
            }],
            heading: vec![HeadingFix {
                header: header(at_ns), heading, heading_sd: 0.02, ..HeadingFix::default()
            }],
            ..Readings::default()
        };
        for format in [Format::Nmea, Format::Ubx, Format::N2k, Format::SignalK, Format::Mavlink] {
            let kinds = Carries { imu: format == Format::Mavlink, gnss: true, heading: true };
            let mut sensor = BoatSensor::new(format, &mount, kinds, STATED);
            let epochs = [at_ns - NS / 5, at_ns].map(|at_ns| sensor.bytes(&readings(at_ns)));
            let mut all = read(format, &mount, &epochs.concat());
            prop_assert_eq!(all.len(), 2 * (2 + usize::from(kinds.imu)), "{:?} {:?}", format, all);
            let day = |ns: i64| ns.rem_euclid(86_400 * NS);
            all.retain(|m| day(m.at_ns) == day(at_ns));
            prop_assert_eq!(all.len(), 2 + usize::from(kinds.imu), "{:?} {:?}", format, all);
            for m in all {
                match m.measurement {
                    Measurement::Gnss(g) => {
                        // 1e-7 deg is 1.1 cm.
                        prop_assert!((g.datum.latitude_deg - datum.latitude_deg).abs() < 1e-7, "{:?} {:?}", format, g);
                        prop_assert!((g.datum.longitude_deg - datum.longitude_deg).abs() < 1e-7, "{:?}", g);
                        // The height reference is not given here; the tests of heights cover both references.
                        let apart_m = (g.datum.height_m - datum.height_m).abs();
                        prop_assert!(apart_m < 2e-3 || matches!(format, Format::N2k | Format::SignalK), "{:?}", g);
                        for (k, v) in [velocity.0, velocity.1].into_iter().enumerate() {
                            prop_assert!((g.velocity[k] - v).abs() < 0.01, "{:?} {:?}", format, g);
                        }
                        prop_assert!((g.position_sd[0] - 0.3).abs() < 0.02, "{:?} {:?}", format, g);
                    }
                    Measurement::Heading(h) => {
                        let apart = alight_shared::frames::wrap_angle(h.heading - heading);
                        prop_assert!(apart.abs() < 1.1e-4, "{:?} {:?}", format, h);
                    }
                    Measurement::Imu(i) => {
                        for k in 0..3 {
                            prop_assert!((i.accelerometer[k] - force[k]).abs() < 1e-4, "{:?}", i);
                            prop_assert!((i.gyro[k] - gyro[k]).abs() < 1e-5, "{:?}", i);
                        }
                    }
                    Measurement::Attitude(_) => prop_assert!(false, "no attitude was sent"),
                }
            }
        }
    }
}
