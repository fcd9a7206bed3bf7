//! Advice in seas of one wave system on a hull that follows it.

use alight_shared::{time::Time, vessel_model::DOFS};

use super::*;

/// Advisor after samples of a hull in these waves (height m, angular frequency rad/s, direction rad). It
/// heaves with the water and rolls by `roll` times the slope.
fn sampled(waves: &[[f64; 3]], heading: f64, speed_mps: f64, roll: f64, seconds: f64) -> Advisor {
    let mut advisor = Advisor::new(
        &VesselModelConfig::default(),
        &DeckGeometry::default(),
        &AdviceConfig::default(),
    );
    let way = Rotation2::new(heading) * Vector2::new(speed_mps, 0.0);
    for n in 0..(seconds * 10.0) as i64 {
        let t = 0.1 * n as f64;
        let mut value = [0.0; DOFS];
        for (phase, [height, omega, to]) in waves.iter().enumerate() {
            let k = omega * omega / GRAVITY;
            let toward = Vector2::new(to.cos(), to.sin());
            let (s, c) = ((omega - k * way.dot(&toward)) * t + phase as f64).sin_cos();
            let slope = Rotation2::new(-heading) * (toward * (k * height * s));
            let tilt = Rotation2::new(heading) * Vector2::new(-roll * slope.y, slope.x);
            value[0] += omega * height * c * toward.x;
            value[1] += omega * height * c * toward.y;
            value[HEAVE] -= height * c;
            value[ROLL] += tilt.x;
            value[PITCH] += tilt.y;
        }
        let sample = MotionSample {
            at: Time::from_secs(100.0 + t),
            mean_heading: heading,
            value,
            rate: [0.0; 5],
            level_variance: 0.0,
        };
        advisor.observe(&sample, way);
    }
    advisor
}

/// Advice after a round with this steepest slope in each of the last windows.
fn round(advisor: &mut Advisor, heading: f64, speed_mps: f64, steepest: f64) -> Advice {
    let now = Conditions {
        heading_rad: heading,
        speed_mps,
        heel: [0.0; 2],
        unforeseen: [0.2; 2],
        wind: NO_WIND,
        steepest: vec![steepest; SLOPE_WINDOWS],
    };
    advisor.round = Some(Round {
        courses: courses(heading, speed_mps),
        outlooks: Vec::new(),
        now,
    });
    while advisor.round.is_some() {
        advisor.evaluate();
    }
    advisor.advice().unwrap()
}

#[test]
fn sea_by_the_motion_of_a_hull_under_way() {
    for (heading, speed) in [(0.0, 0.0), (2.0, 3.0), (-1.0, 3.0), (2.5, 4.0)] {
        let advisor = sampled(
            &[[0.4, 1.2, 0.5], [0.2, 1.5, 0.8], [0.2, 1.0, 0.3]],
            heading,
            speed,
            1.0,
            150.0,
        );
        let (_, sea) = advisor.sea.as_ref().unwrap();
        assert!(
            wrap_angle(sea.towards - 0.5).abs() < 0.15,
            "{heading}: {}",
            sea.towards
        );
        let all: f64 = sea.waves.iter().map(|w| w.variance).sum();
        let truth = 0.5 * (0.16 + 0.04 + 0.04);
        let mean = |w: f64| (w - 1.2).abs();
        assert!(
            (all / truth - 1.0).abs() < 0.3,
            "{heading} {speed}: {all} of {truth}"
        );
        let omega = sea.waves.iter().map(|w| w.variance * w.omega).sum::<f64>() / all;
        assert!(mean(omega) < 0.15, "{heading} {speed}: {omega}");
    }
}

#[test]
fn advice_for_a_hull_that_rolls() {
    // Beam sea on a hull that rolls three times as much as the water.
    let waves = [[0.5, 1.4, 0.0], [0.3, 1.7, 0.3], [0.3, 1.2, -0.3]];
    let heading = core::f64::consts::FRAC_PI_2;
    let mut advisor = sampled(&waves, heading, 3.0, 3.0, 150.0);
    let advice = round(&mut advisor, heading, 3.0, 0.25);
    assert!(advice.is_change(), "{advice:?}");
    let off = advice.best.heading_rad.sin().abs();
    assert!(off < 0.9, "out of the beam sea: {advice:?}");
    assert!(
        advice.best.likelihood > advice.here.likelihood + 0.02,
        "{advice:?}"
    );
    assert!(advice.turn_s() <= MAX_TURN_S && advice.way_lost_m() > 0.0);
    // A skipper who limits turns to 20 deg, and one whose permitted speeds exclude the present one.
    let limited = |limits: AdviceConfig| {
        let mut advisor = advisor.clone();
        advisor.limits = limits;
        advisor.advice().unwrap()
    };
    let near = limited(AdviceConfig {
        heading_change_deg: 20.0,
        ..AdviceConfig::default()
    });
    assert!(wrap_angle(near.best.heading_rad - heading).abs() < 0.36);
    assert!(near.best.worth(&advice.here) < advice.best.worth(&advice.here));
    let fast = limited(AdviceConfig {
        speed_mps: [5.0, 8.0],
        ..AdviceConfig::default()
    });
    assert!(!fast.is_change(), "{fast:?}");
}

#[test]
fn advice_from_before_a_gap_in_the_estimate() {
    let waves = [[0.5, 1.4, 0.0], [0.3, 1.7, 0.3], [0.3, 1.2, -0.3]];
    let heading = core::f64::consts::FRAC_PI_2;
    let mut advisor = sampled(&waves, heading, 3.0, 3.0, 150.0);
    round(&mut advisor, heading, 3.0, 0.25);
    let mut advises = |t_s: f64| {
        advisor.resume(Time::from_secs(t_s));
        advisor.advice().is_some()
    };
    assert!(advises(300.0) && advises(304.0));
    assert!(!advises(310.0), "the sea may have changed");
}

#[test]
fn no_advice_where_every_course_is_as_good() {
    let heading = core::f64::consts::FRAC_PI_2;
    let mut advisor = sampled(&[[0.05, 1.2, 0.0], [0.02, 1.0, 0.2]], heading, 2.0, 1.0, 150.0);
    let advice = round(&mut advisor, heading, 2.0, 0.02);
    assert!(!advice.is_change() && advice.here.likelihood > 0.95, "{advice:?}");
    assert_eq!((advice.turn_s(), advice.way_lost_m()), (0.0, 0.0));
}

#[test]
fn no_sea_before_enough_motion_or_in_calm_water() {
    assert!(sampled(&[[0.4, 1.2, 0.5]], 0.0, 2.0, 1.0, 30.0).sea.is_none());
    let calm = sampled(&[], 0.0, 2.0, 1.0, 150.0);
    assert!(calm.sea.is_none() && calm.advice().is_none());
}

#[test]
fn courses_that_are_compared() {
    let all = courses(0.3, 5.0);
    assert!((all[0][0] - 0.3).abs() < 1e-12 && all[0][1] == 5.0);
    assert_eq!(all.len(), 3 * 24);
    assert_eq!(courses(0.0, 0.4).len(), 24);
    assert!(courses(0.0, 100.0).len() <= MAX_SPEEDS * 24);
}
