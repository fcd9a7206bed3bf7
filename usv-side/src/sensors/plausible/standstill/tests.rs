use super::*;
use alight_shared::msg::{AttitudeFix, GnssFix, Header, HeadingFix, ImuSample, NOT_MEASURED_SD};
use core::f64::consts::TAU;
use proptest::prelude::*;

/// Boat that follows a wave (m, s), measured with these resolutions.
#[derive(Clone, Copy, Debug)]
struct Boat {
    amplitude_m: f64,
    period_s: f64,
    /// Resolution of angles (rad), and of heave and height (m).
    steps: [f64; 2],
    /// Channel that stands still from this time on, s.
    frozen: Option<(Channel, f64)>,
}

fn header(t: f64) -> Header<VesselClock> {
    Header::new(1, 0, 1, 0, Time::from_secs(t))
}
fn rounded(x: f64, step: f64) -> f64 {
    (x / step).round() * step
}

impl Boat {
    const RTK: Boat = Boat {
        amplitude_m: 0.4,
        period_s: 4.2,
        steps: [0.0017, 0.01],
        frozen: None,
    };
    /// Attitude with heave and rates, heading with its rate, and RTK fix at `t`.
    fn at(&self, t: f64) -> [Measurement; 3] {
        let of = |channel: Channel| match self.frozen {
            Some((frozen, from)) if frozen == channel => t.min(from),
            Some(_) | None => t,
        };
        let w = TAU / self.period_s;
        let slope = self.amplitude_m * w * w / G;
        let wave = |a: f64, phase: f64, t: f64| a * (w * t + phase).sin();
        let [angle, length] = self.steps;
        let tilt = [(0.0, Channel::Roll), (0.9, Channel::Pitch)].map(|(phase, axis)| {
            let t = of(Channel::Tilt).min(of(axis));
            rounded(wave(slope, phase, t), angle)
        });
        let rate = wave(slope * w, 1.57, of(Channel::Rates));
        let heave = rounded(wave(self.amplitude_m, 1.0, of(Channel::Heave)), length);
        let attitude = AttitudeFix {
            header: header(t),
            tilt,
            rates: Some([rounded(rate, angle), 0.0, 0.0]),
            heave: Some(heave),
            ..AttitudeFix::default()
        };
        let yaw = 0.7 + wave(0.4 * slope, 0.3, of(Channel::Heading));
        let turn = wave(0.4 * slope * w, 1.87, of(Channel::RateOfTurn));
        let heading = HeadingFix {
            header: header(t),
            heading: rounded(yaw, angle),
            // A coarse rate of turn has a resolution of 0.2 deg/s.
            rate: Some(rounded(turn, angle.min(0.0035))),
            ..HeadingFix::default()
        };
        let height_m = 25.0 + rounded(wave(self.amplitude_m, 1.0, of(Channel::Height)), length);
        let fix = GnssFix {
            header: header(t),
            datum: Datum::new(59.5, 10.6, height_m),
            position: [2.0 * of(Channel::Place), 0.0, 0.0],
            velocity: [2.0, 0.0, 0.0],
            position_sd: [0.01, 0.01, 0.02],
            velocity_sd: [0.1, 0.1, NOT_MEASURED_SD],
            ..GnssFix::default()
        };
        [attitude.into(), heading.into(), fix.into()]
    }
    /// Channels that stand still after this many seconds at 10 Hz, with the time of their first standstill.
    fn stills(&self, seconds: u32) -> Vec<(usize, f64, Standstill)> {
        let mut boat = Movement::default();
        let mut all: Vec<(usize, f64, Standstill)> = Vec::new();
        for k in 0..10 * seconds {
            let t = 0.1 * f64::from(k);
            for m in self.at(t) {
                let still = boat.take(m.kind() as u8, &m);
                for (k, s) in still.still.iter().enumerate() {
                    all.extend(s.filter(|s| s.is_new).map(|s| (k, t, s)));
                }
            }
        }
        all
    }
}

const EACH: [Channel; CHANNELS] = [
    Channel::Tilt,
    Channel::Roll,
    Channel::Pitch,
    Channel::Heading,
    Channel::Heave,
    Channel::Height,
    Channel::Place,
    Channel::Rates,
    Channel::RateOfTurn,
];

#[test]
fn each_channel_that_stands_still_among_moving_ones() {
    for channel in EACH {
        let boat = Boat {
            frozen: Some((channel, 20.0)),
            ..Boat::RTK
        };
        let all = boat.stills(60);
        let [(k, at, s)] = all[..] else {
            panic!("{channel:?}: {all:?}");
        };
        let within = (19.9..20.2).contains(&s.since.secs()) && (STILL_S..14.0).contains(&(at - 20.0));
        assert!(k == channel as usize && within, "{channel:?} {at}: {s:?}");
    }
}

#[test]
fn placeholders_of_an_unconfigured_instrument() {
    // Zero in waves; 90 deg while the rate of turn swings, turns the boat, or is only biased.
    type Rate = fn(f64) -> f64;
    let cases: [(f64, f64, Option<Rate>, &[&str]); 4] = [
        (0.0, 0.4, None, &["roll"]),
        (90.0, 0.0, Some(|t| 0.08 * (1.2 * t).cos()), &["rate of turn"]),
        (90.0, 0.0, Some(|_| 0.05), &["rate of turn"]),
        (90.0, 0.0, Some(|_| -0.015), &[]),
    ];
    for (shown_deg, amplitude_m, rate, by) in cases {
        let mut boat = Movement::default();
        let mut found = Vec::new();
        for k in 0..300 {
            let t = 0.1 * f64::from(k);
            let [attitude, ..] = Boat {
                amplitude_m,
                ..Boat::RTK
            }
            .at(t);
            let heading = HeadingFix {
                header: header(t),
                heading: f64::to_radians(shown_deg),
                rate: rate.map(|rate| rate(t)),
                ..HeadingFix::default()
            };
            boat.take(0, &attitude);
            let still = boat.take(1, &heading.into()).still(Channel::Heading);
            found.extend(still.filter(|s| s.is_new).map(|s| s.by));
        }
        assert_eq!(found, by, "{shown_deg}");
    }
}

#[test]
fn numbers_that_never_changed_since_the_start() {
    // Roll next to a moving pitch, a heading and a height with decimals, the same in whole units, and a repeated fix.
    for (roll, heading_deg, height_m, place_m, found) in [
        (0.0, 40.0, 25.0, 2.0, vec![Channel::Roll]),
        (0.021, 359.9, 25.0, 2.0, vec![Channel::Roll, Channel::Heading]),
        (0.0, 40.0, 25.4, 2.0, vec![Channel::Roll, Channel::Height]),
        (
            0.0,
            40.0,
            25.4,
            0.0,
            vec![Channel::Roll, Channel::Height, Channel::Place],
        ),
    ] {
        let (mut boat, mut all) = (Movement::default(), Vec::new());
        for k in 0..300 {
            let t = 0.1 * f64::from(k);
            let [attitude, ..] = Boat::RTK.at(t);
            let a = attitude.attitude().unwrap();
            let attitude = AttitudeFix {
                tilt: [roll, a.tilt[1]],
                ..*a
            };
            let heading = HeadingFix {
                header: header(t),
                heading: f64::from(heading_deg as f32).to_radians(),
                ..HeadingFix::default()
            };
            let fix = GnssFix {
                header: header(t),
                // The geoid's slope moves the height.
                datum: Datum::new(59.5, 10.6, height_m + 1e-5 * t),
                position: [place_m * t, 0.0, 0.0],
                velocity_sd: [NOT_MEASURED_SD; 3],
                ..GnssFix::default()
            };
            let all_kinds: [Measurement; 3] = [attitude.into(), heading.into(), fix.into()];
            for m in all_kinds {
                let still = boat.take(m.kind() as u8, &m);
                let new = EACH.iter().filter(|c| still.still(**c).is_some_and(|s| s.is_new));
                all.extend(new.copied());
            }
        }
        all.sort_by_key(|c| *c as usize);
        assert_eq!(all, found, "{heading_deg} {height_m}");
    }
}

#[test]
fn standstill_ends_with_the_next_other_number() {
    let frozen = Boat {
        frozen: Some((Channel::Tilt, 20.0)),
        ..Boat::RTK
    };
    let mut boat = Movement::default();
    for k in 0..500 {
        let t = 0.1 * f64::from(k);
        let [attitude, _, fix] = if t < 40.0 { frozen.at(t) } else { Boat::RTK.at(t) };
        boat.take(2, &fix);
        let is_still = boat.take(0, &attitude).still(Channel::Tilt).is_some();
        assert_eq!(is_still, is_still && (24.0..40.0).contains(&t), "{t}");
        assert!(is_still || !(32.0..39.9).contains(&t), "{t}");
    }
}

#[test]
fn marina_with_a_coarse_compass_and_a_noisy_antenna() {
    // Attitude and heading constant for ten minutes, in whole degrees and tenths; RTK height with 1 cm noise;
    // gyroscope with vibration.
    let mut boat = Movement::default();
    let mut noise = 1_u64;
    let mut random = || {
        noise = noise.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        (noise >> 40) as f64 / f64::from(1 << 24) - 0.5
    };
    for k in 0..6000 {
        let t = 0.1 * f64::from(k);
        let attitude = AttitudeFix {
            header: header(t),
            // The rotation adds rounding errors.
            tilt: [0.0175 + 1e-17 * f64::from(k % 3), -0.0175],
            heave: Some(0.0),
            ..AttitudeFix::default()
        };
        let heading = HeadingFix {
            header: header(t),
            heading: 0.0,
            rate: Some(0.0),
            ..HeadingFix::default()
        };
        let fix = GnssFix {
            header: header(t),
            datum: Datum::new(59.5, 10.6, 25.0 + 0.04 * random()),
            position_sd: [0.01, 0.01, 0.02],
            velocity_sd: [0.1, 0.1, NOT_MEASURED_SD],
            ..GnssFix::default()
        };
        let imu = ImuSample {
            header: header(t),
            gyro: [0.01 * random(), 0.01 * random(), 0.0],
            ..ImuSample::default()
        };
        for (k, m) in [attitude.into(), heading.into(), fix.into(), imu.into()]
            .into_iter()
            .enumerate()
        {
            let still = boat.take(k as u8, &m);
            assert!(still.still.iter().all(Option::is_none), "{t}: {still:?}");
        }
    }
}

#[test]
fn calm_water_turn_with_a_coarse_attitude() {
    // In a circle on flat water, heading and position change, but not an attitude in whole degrees.
    let mut boat = Movement::default();
    for k in 0..3000 {
        let t = 0.1 * f64::from(k);
        let [_, _, fix] = Boat {
            amplitude_m: 0.0,
            ..Boat::RTK
        }
        .at(t);
        let heading = HeadingFix {
            header: header(t),
            heading: wrap_angle(0.1 * t),
            ..HeadingFix::default()
        };
        let attitude = AttitudeFix {
            header: header(t),
            tilt: [0.0175, 0.0],
            ..AttitudeFix::default()
        };
        for (k, m) in [fix, heading.into(), attitude.into()].into_iter().enumerate() {
            let still = boat.take(k as u8, &m);
            assert!(still.still.iter().all(Option::is_none), "{t}: {still:?}");
        }
    }
}

proptest! {
    /// Sensors with steps of up to 2 deg and 0.3 m never stand still, in any sea.
    #[test]
    fn coarse_sensors_in_any_sea(
        slope in 0.0_f64..0.35,
        period_s in 2.0_f64..14.0,
        angle in 1e-4_f64..0.035,
        length in 1e-3_f64..0.3,
    ) {
        let w = TAU / period_s;
        let boat = Boat {
            amplitude_m: (slope * G / (w * w)).min(5.0),
            period_s,
            steps: [angle, length],
            frozen: None,
        };
        prop_assert_eq!(boat.stills(120), Vec::new());
    }

    /// A standstill of any fine channel is found if the sea rolls the boat by at least 8 deg.
    #[test]
    fn standstill_in_any_sea(slope in 0.15_f64..0.3, period_s in 2.5_f64..8.0, k in 0_usize..CHANNELS, from in 15.0_f64..25.0) {
        let w = TAU / period_s;
        let boat = Boat {
            amplitude_m: slope * G / (w * w),
            period_s,
            frozen: Some((EACH[k], from)),
            ..Boat::RTK
        };
        let found: Vec<usize> = boat.stills(60).into_iter().map(|(k, ..)| k).collect();
        prop_assert_eq!(found, vec![k]);
    }
}
