use super::*;
use alight_shared::{
    frames::wrap_angle,
    msg::{Header, HeadingFix, ImuSample},
};
use core::f64::consts::TAU;

/// Wave of amplitude 1 and this period, s.
fn wave(t: f64, period_s: f64) -> f64 {
    (TAU * t / period_s).sin()
}
fn header(t: f64) -> Header<VesselClock> {
    Header::new(1, 0, 1, 0, Time::from_secs(t))
}
/// Attitude with rates of a rocking boat at `t`, at 10 Hz.
fn rocking(t: f64) -> AttitudeFix {
    let (roll, pitch) = (0.105 * wave(t, 4.0), 0.044 * wave(t, 3.3));
    let rates = [
        0.105 * TAU / 4.0 * wave(t + 1.0, 4.0),
        0.044 * TAU / 3.3 * wave(t + 3.3 / 4.0, 3.3),
    ];
    AttitudeFix {
        header: header(t),
        tilt: [roll, pitch],
        tilt_sd: 0.0035,
        rates: Some([rates[0], rates[1] * roll.cos(), -rates[1] * roll.sin()]),
        heave: Some(0.4 * wave(t, 4.2)),
        heave_sd: 0.05,
        ..AttitudeFix::default()
    }
}
fn series<M: Into<Measurement>>(seconds: u32, of: impl Fn(f64) -> M) -> Vec<Measurement> {
    let at = (0..10 * seconds).map(|k| 0.1 * f64::from(k));
    at.map(|t| of(t).into()).collect()
}
fn attitudes(all: &[Measurement]) -> Vec<AttitudeFix> {
    all.iter().filter_map(Measurement::attitude).copied().collect()
}
fn fixes(all: &[Measurement]) -> Vec<GnssFix> {
    all.iter().filter_map(Measurement::gnss).copied().collect()
}
/// Checks that valid measurements pass unchanged and without a remark.
fn is_inert(all: &[Measurement], what: &str) {
    let (kept, remarks) = sift(all.to_vec());
    assert!(remarks.is_empty(), "{what}: {remarks:?}");
    assert!(kept == all, "{what}");
}

#[test]
fn good_attitudes_with_heave_and_rates() {
    is_inert(&series(200, rocking), "short waves");
    let swell = |t: f64| AttitudeFix {
        heave: Some(3.0 * wave(t, 20.0) + 0.3 * wave(t, 70.0)),
        ..rocking(t)
    };
    is_inert(
        &series(400, swell),
        "swell with a slow error of a twentieth of its height",
    );
    let still = |t: f64| AttitudeFix {
        tilt: [0.01, -0.02],
        rates: Some([0.0; 3]),
        heave: Some(0.0),
        ..rocking(t)
    };
    is_inert(&series(200, still), "a sensor without heave in still water");
}

#[test]
fn single_impossible_heave() {
    let spike = |t: f64| AttitudeFix {
        heave: Some(if (t - 50.0).abs() < 0.01 {
            300.0
        } else {
            0.4 * wave(t, 4.2)
        }),
        ..rocking(t)
    };
    let (kept, remarks) = sift(series(100, spike));
    let without = attitudes(&kept).iter().filter(|a| a.heave.is_none()).count();
    assert_eq!((kept.len(), without, remarks.len()), (1000, 1, 1));
    assert!(
        remarks[0].remedy.is_none() && remarks[0].text.contains("left out 1 times of 1000"),
        "{remarks:?}"
    );
}

#[test]
fn heave_that_drifts_and_returns() {
    let drifting = |t: f64| AttitudeFix {
        heave: Some(0.4 * wave(t, 4.2) + if t < 200.0 { 0.05 * t } else { 0.0 }),
        ..rocking(t)
    };
    let mut live = Plausibility::default();
    let mut heaves = Vec::new();
    for m in series(400, drifting) {
        let t = m.at().secs();
        let Some(Measurement::Attitude(a)) = live.take(m, &Contradicted::default()).measurement else {
            panic!("an attitude at {t} s is left out");
        };
        let apart = [0, 1].map(|i| (a.tilt[i] - rocking(t).tilt[i]).abs());
        assert!(apart.iter().all(|d| *d < 1e-9), "{t}: {apart:?}");
        heaves.push((t, a.heave.is_some()));
        if (t - 100.0).abs() < 0.01 {
            let remark = &live.remarks("")[0];
            assert!(
                remark.remedy.is_some() && remark.text.starts_with("heave drifts by "),
                "{remark:?}"
            );
        }
    }
    let used = |from: f64, to: f64| heaves.iter().filter(|(t, u)| *u && *t >= from && *t < to).count();
    assert_eq!((used(55.0, 199.95), used(289.95, 400.0)), (0, 1100));
    assert!(live.remarks("").iter().all(|r| r.remedy.is_none()), "it is over");
}

#[test]
fn rates_of_a_wrong_unit_and_sign() {
    let wrong = |of: fn([f64; 3]) -> [f64; 3]| {
        let spoilt = move |t: f64| {
            let good = rocking(t);
            AttitudeFix {
                rates: good.rates.map(of),
                ..good
            }
        };
        sift(series(90, spoilt))
    };
    type Spoil = fn([f64; 3]) -> [f64; 3];
    let cases: [(&str, Spoil); 4] = [
        ("sign", |r| r.map(|x| -x)),
        ("degrees", |r| r.map(f64::to_degrees)),
        ("radians of radians", |r| r.map(f64::to_radians)),
        ("constant", |_| [0.3; 3]),
    ];
    for (what, of) in cases {
        let (kept, remarks) = wrong(of);
        let all = attitudes(&kept);
        assert_eq!(all.len(), 900, "{what}");
        let late = all.iter().filter(|a| a.header.at.secs() > 35.0);
        assert!(
            late.clone().all(|a| a.rates.is_none() && a.heave.is_some()),
            "{what}"
        );
        assert!(
            remarks.len() == 1 && remarks[0].text.starts_with("angular rate"),
            "{what}: {remarks:?}"
        );
    }
}

#[test]
fn rate_of_turn_of_a_wrong_sign() {
    let turning = |sign: f64| {
        move |t: f64| HeadingFix {
            header: header(t),
            heading: wrap_angle(0.1 * t),
            heading_sd: 0.01,
            rate: Some(0.1 * sign),
            ..HeadingFix::default()
        }
    };
    is_inert(&series(200, turning(1.0)), "rate of turn");
    let (kept, remarks) = sift(series(200, turning(-1.0)));
    let rated = kept
        .iter()
        .filter(|m| matches!(m, Measurement::Heading(h) if h.rate.is_some()));
    assert_eq!((kept.len(), rated.count()), (2000, 0));
    assert!(
        remarks[0].text.starts_with("rate of turn differs by"),
        "{remarks:?}"
    );
}

#[test]
fn yaw_rate_against_the_heading() {
    let turning = |yaw_rate: f64| {
        let of = |k: u32| {
            let t = 0.1 * f64::from(k);
            let attitude = AttitudeFix {
                header: header(t),
                tilt_sd: 0.0035,
                rates: Some([0.0, 0.0, yaw_rate]),
                ..AttitudeFix::default()
            };
            let heading = HeadingFix {
                header: header(t),
                heading: wrap_angle(0.1 * t),
                heading_sd: 0.01,
                ..HeadingFix::default()
            };
            [Measurement::Attitude(attitude), Measurement::Heading(heading)]
        };
        (0..2000).flat_map(of).collect::<Vec<Measurement>>()
    };
    is_inert(&turning(0.1), "yaw rate");
    let (kept, remarks) = sift(turning(0.5));
    let rated = attitudes(&kept).iter().filter(|a| a.rates.is_some()).count();
    assert!(kept.len() == 4000 && rated <= 1, "{} {rated}", kept.len());
    assert!(
        remarks.len() == 1 && remarks[0].text.starts_with("yaw rate differs by 22.9 deg/s"),
        "{remarks:?}"
    );
}

#[test]
fn vertical_velocity_against_the_height() {
    let heaving = |climb: f64| {
        move |t: f64| GnssFix {
            header: header(t),
            position: [0.0, 0.0, 0.5 * wave(t, 4.0)],
            position_sd: [NOT_MEASURED_SD, NOT_MEASURED_SD, 0.02],
            velocity: [0.0, 0.0, climb * 0.5 * TAU / 4.0 * wave(t + 1.0, 4.0)],
            velocity_sd: [NOT_MEASURED_SD, NOT_MEASURED_SD, 0.05],
            ..GnssFix::default()
        }
    };
    is_inert(&series(200, heaving(1.0)), "vertical velocity");
    for climb in [-1.0, 0.0] {
        let (kept, remarks) = sift(series(200, heaving(climb)));
        let climbing = fixes(&kept).iter().filter(|fix| has_climb(fix)).count();
        assert!(kept.len() == 2000 && climbing <= 1, "{climb}: {climbing}");
        assert!(
            remarks[0].text.starts_with("vertical velocity differs by"),
            "{remarks:?}"
        );
    }
}

/// Fix of a boat moving north at 3 m/s, with this measured velocity and height.
fn sailing(t: f64, velocity: [f64; 3], up: f64) -> GnssFix {
    GnssFix {
        header: header(t),
        position: [3.0 * t, 0.0, -up],
        velocity,
        position_sd: [0.5, 0.5, 1.0],
        velocity_sd: [0.1; 3],
        ..GnssFix::default()
    }
}

#[test]
fn velocity_that_is_not_that_of_the_position() {
    let north = [3.0, 0.0, 0.0];
    is_inert(&series(200, |t| sailing(t, north, 2.0)), "velocity");
    // A repeated position is removed, and does not test the velocity.
    let stuck = |t: f64| GnssFix {
        position: [0.0; 3],
        ..sailing(t, north, 2.0)
    };
    let (kept, remarks) = sift(series(200, stuck));
    let all = fixes(&kept);
    assert!(all.len() == 2000 && all.iter().all(has_velocity) && !all.iter().any(has_place));
    assert!(
        all.iter().skip(100).all(|g| !has_height(g)),
        "it repeats the whole fix"
    );
    assert!(
        remarks.len() == 2 && remarks[0].text.starts_with("place stands still for"),
        "{remarks:?}"
    );
    // Its height may move.
    let (kept, remarks) = sift(series(200, |t| GnssFix {
        position: [0.0, 0.0, 0.3 * wave(t, 4.0)],
        ..sailing(t, north, 2.0)
    }));
    assert!(
        fixes(&kept).iter().all(has_velocity) && remarks.len() == 1,
        "{remarks:?}"
    );
    let jumps = |t: f64| GnssFix {
        position: [3.0 * t + if t > 90.0 { 40.0 } else { 0.0 }, 0.0, -2.0],
        ..sailing(t, north, 2.0)
    };
    is_inert(&series(200, jumps), "a position that jumps");
    for velocity in [[12.0, -5.0, 0.0], [0.0; 3], [-3.0, 0.0, 0.0]] {
        let (kept, remarks) = sift(series(120, |t| sailing(t, velocity, 2.0)));
        let all = fixes(&kept);
        let moving = all.iter().filter(|g| has_velocity(g)).count();
        let placed = all.iter().filter(|g| has_place(g) && has_height(g)).count();
        assert_eq!((placed, moving), (1200, 0), "{velocity:?}");
        assert!(remarks[0].text.starts_with("velocity differs by"), "{remarks:?}");
    }
}

#[test]
fn heading_that_repeats_the_course() {
    let boat = |leeway: fn(f64) -> f64| {
        let of = move |k: u32| {
            let t = 0.5 * f64::from(k);
            let course = 0.02 * (0.7 * t).sin() + 0.01 * (1.9 * t).sin();
            let heading = HeadingFix {
                header: header(t),
                heading: course + leeway(t),
                heading_sd: 0.01,
                ..HeadingFix::default()
            };
            let velocity = [3.0 * course.cos(), 3.0 * course.sin(), 0.0];
            [sailing(t, velocity, 2.0).into(), heading.into()]
        };
        (0..200).flat_map(of).collect::<Vec<Measurement>>()
    };
    is_inert(&boat(|t| 0.03 * (0.5 * t).cos()), "a compass");
    let (kept, remarks) = sift(boat(|_| 0.0));
    assert_eq!(kept.len(), 200);
    assert!(
        remarks.len() == 1
            && remarks[0]
                .text
                .starts_with("heading repeats the course over ground"),
        "{remarks:?}"
    );
}

#[test]
fn height_that_jumps_to_and_fro() {
    let north = [3.0, 0.0, 0.0];
    let moved = |t: f64| sailing(t, north, if t > 50.0 { 12.0 } else { 2.0 });
    is_inert(&series(100, moved), "a receiver that changes its solution");
    let garbage = |t: f64| {
        sailing(
            t,
            north,
            if (10.0 * t).round() % 3.0 == 0.0 {
                300.0
            } else {
                2.0
            },
        )
    };
    let (kept, remarks) = sift(series(100, garbage));
    let all = fixes(&kept);
    assert!(all.iter().all(|g| has_place(g) && has_velocity(g)));
    assert!(all.iter().filter(|g| has_height(g)).count() < 20);
    assert!(remarks[0].text.starts_with("height jumps by"), "{remarks:?}");
}

#[test]
fn attitude_beyond_its_bound_and_at_a_standstill() {
    let capsized = |t: f64| AttitudeFix {
        tilt: [
            if (19.95..29.95).contains(&t) {
                1.5
            } else {
                0.1 * wave(t, 4.0)
            },
            0.03 * wave(t, 3.3),
        ],
        rates: None,
        ..rocking(t)
    };
    let (kept, remarks) = sift(series(100, capsized));
    assert_eq!((kept.len(), remarks.len()), (871, 1), "{remarks:?}");
    assert!(
        remarks[0]
            .text
            .starts_with("attitude is beyond what is possible (85.9 deg)"),
        "{remarks:?}"
    );
    // Degrees taken for radians pass through possible values.
    let degrees = |t: f64| AttitudeFix {
        tilt: rocking(t).tilt.map(f64::to_degrees),
        rates: None,
        ..rocking(t)
    };
    let kept = sift(series(100, degrees)).0;
    assert!(kept.iter().all(|m| m.at().secs() < 10.0), "{}", kept.len());
    let standing = |t: f64| AttitudeFix {
        tilt: [0.02, 0.01],
        rates: None,
        heave: Some(wave(t, 6.0)),
        ..rocking(t)
    };
    let (kept, remarks) = sift(series(120, standing));
    assert_eq!(kept.len(), 0, "also what came before it was found");
    assert!(
        remarks[0].text.starts_with("attitude stands still for"),
        "{remarks:?}"
    );
}

#[test]
fn inertial_sensor_in_other_axes() {
    let lying = |force: [f64; 3]| {
        series(60, |t| ImuSample {
            header: header(t),
            accelerometer: [force[0] + wave(t, 4.0), force[1], force[2]],
            ..ImuSample::default()
        })
    };
    is_inert(&lying([0.0, 3.0, -9.3]), "a boat that lies over");
    for force in [[0.0, 0.0, 9.81], [9.81, 0.0, 0.0], [0.0, -9.81, 0.0]] {
        let (kept, remarks) = sift(lying(force));
        assert!(
            kept.len() < 210 && remarks[0].text.starts_with("specific force shows gravity"),
            "{remarks:?}"
        );
    }
}

#[test]
fn roll_against_the_antenna_s_motion() {
    for sign in [1.0, -1.0] {
        let mut all = Vec::new();
        for m in series(120, rocking) {
            let (at, t) = (m.at(), m.at().secs());
            let [roll, pitch] = rocking(t).tilt;
            let attitude = AttitudeFix {
                tilt: [sign * roll, pitch],
                rates: None,
                ..rocking(t)
            };
            let heading = HeadingFix {
                header: header(t),
                heading: 0.02 * wave(t, 9.0),
                ..HeadingFix::default()
            };
            let fix = GnssFix {
                header: header(t),
                position: [2.0 * t - 4.0 * pitch, 4.0 * roll, 0.0],
                velocity_sd: [NOT_MEASURED_SD; 3],
                lever_arm: Some([0.0, 0.0, -4.0]),
                ..GnssFix::default()
            };
            all.extend([attitude.into(), heading.into(), Measurement::from(fix).of(0, at)]);
        }
        if sign > 0.0 {
            is_inert(&all, "right sign");
            continue;
        }
        let (kept, remarks) = sift(all);
        let last = attitudes(&kept).last().map(|a| a.header.at.secs());
        assert!(last.is_some_and(|t| t < 40.0), "{last:?}");
        assert!(
            remarks[0].text.contains("has the wrong sign of roll"),
            "{remarks:?}"
        );
    }
}

/// Attitude, heading and RTK fix of a boat at 2 m/s, with a heave `factor` times the height's and an antenna ahead.
fn heaving(factor: f64, heading: f64, sd_m: f64) -> Vec<Measurement> {
    let at = |t: f64| {
        let attitude = AttitudeFix {
            rates: None,
            heave: Some(-factor * 0.4 * wave(t, 4.2)),
            ..rocking(t)
        };
        let compass = HeadingFix {
            header: header(t),
            heading: heading + 0.02 * wave(t, 9.0),
            ..HeadingFix::default()
        };
        let [roll, pitch] = attitude.tilt;
        let noise = sd_m * wave(t, 0.37);
        let fix = GnssFix {
            header: header(t),
            position: [
                2.0 * t - 4.0 * pitch,
                4.0 * roll,
                -0.4 * wave(t, 4.2) - 5.0 * pitch + noise,
            ],
            position_sd: [0.02, 0.02, sd_m],
            velocity: [2.0, 0.0, 0.0],
            velocity_sd: [0.1, 0.1, NOT_MEASURED_SD],
            lever_arm: Some([5.0, 0.0, -4.0]),
            ..GnssFix::default()
        };
        [Measurement::Attitude(attitude), compass.into(), fix.into()]
    };
    (0..1800).flat_map(|k| at(0.1 * f64::from(k))).collect()
}

#[test]
fn heave_against_the_height_of_the_fixes() {
    for (factor, sd_m) in [(1.0, 0.02), (0.8, 0.02), (1.0, 0.3), (3.3, 0.3)] {
        is_inert(&heaving(factor, 0.0, sd_m), "heave of the right sign");
    }
    for (factor, sd_m, text) in [
        (
            -1.0,
            0.02,
            "heave has the opposite sign of the fixes' height (-1.0 m",
        ),
        (-1.0, 0.3, "heave has the opposite sign of the fixes' height"),
        (
            3.3,
            0.02,
            "heave is 3.3 times the fixes' change of height: check its unit",
        ),
    ] {
        let (kept, remarks) = sift(heaving(factor, 0.0, sd_m));
        let last = attitudes(&kept).into_iter().rfind(|a| a.heave.is_some());
        assert!(
            last.is_none_or(|a| a.header.at.secs() < 60.0),
            "{factor}: {last:?}"
        );
        assert!(
            remarks.len() == 1 && remarks[0].text.starts_with(text),
            "{remarks:?}"
        );
    }
}

#[test]
fn heading_across_or_against_the_course() {
    for (heading, angle) in [(1.4, "80 deg"), (core::f64::consts::PI, "180 deg")] {
        let all: Vec<Measurement> = heaving(1.0, heading, 0.02);
        let is_heading = |m: &&Measurement| m.kind() != ATTITUDE;
        let all: Vec<Measurement> = all.iter().filter(is_heading).copied().collect();
        let (kept, remarks) = sift(all.clone());
        assert!(kept == all && remarks.len() == 1, "{remarks:?}");
        let text = format!("heading differs from the course over ground by a steady {angle} at 2.0 m/s");
        assert_eq!(remarks[0].text, text);
    }
}

#[test]
fn times_that_jump_and_numbers_that_are_not_finite() {
    let mut all = series(100, rocking);
    for (k, at) in [(200, 1e9), (400, -1e9), (600, 1e-3)] {
        all[k] = all[k].of(0, Time::from_secs(at));
    }
    is_inert(&all, "times");
    let broken = |t: f64| AttitudeFix {
        heave: Some(f64::NAN),
        rates: Some([f64::INFINITY, 0.0, f64::NAN]),
        ..rocking(t)
    };
    let kept = attitudes(&sift(series(10, broken)).0);
    assert!(kept.len() == 100 && kept.iter().all(|a| a.heave.is_none() && a.rates.is_none()));
}
