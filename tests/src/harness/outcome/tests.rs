use super::*;

const HALF: [f64; 2] = [1.25, 0.85];
const DOWN: [[f64; 3]; 4] = [
    [0.2, 0.2, 0.0],
    [0.2, -0.2, 0.0],
    [-0.2, 0.2, 0.0],
    [-0.2, -0.2, 0.0],
];

fn at(t_s: f64) -> TrialObservation<'static> {
    TrialObservation {
        t_s,
        contacts: &[],
        feet: DOWN,
        relative_euler: [0.0; 3],
        tilt_error: 0.0,
        horizontal_m: 0.1,
        motors_on: true,
        descending: true,
        attempts: 1,
        gave_up: false,
        waiting: Reason::default(),
        in_water: false,
        capsized: false,
        keep_out_gap_m: None,
        collisions: 0,
    }
}
fn touch(normal_mps: f64, tangential_mps: f64) -> ContactEvent {
    ContactEvent {
        foot: true,
        on_deck: true,
        normal_mps,
        tangential_mps,
    }
}
fn run(first: ContactEvent, tilt: f64, stop_s: f64, feet_after: [[f64; 3]; 4]) -> Outcome {
    let mut judge = Judge::default();
    let contacts = [first];
    judge.observe(
        &TrialObservation {
            contacts: &contacts,
            tilt_error: tilt,
            ..at(10.0)
        },
        HALF,
    );
    for k in 1..1000 {
        let t = 10.0 + 0.01 * f64::from(k);
        let o = TrialObservation {
            motors_on: t < 10.0 + stop_s,
            feet: feet_after,
            ..at(t)
        };
        if judge.observe(&o, HALF) {
            break;
        }
    }
    judge.outcome(1, "0.5,5", "mpc-faa", 100.0)
}

#[test]
fn judge_of_a_soft_landing() {
    let o = run(touch(0.4, 0.2), 0.05, 0.5, DOWN);
    assert_eq!(o.outcome, Ending::Success, "{}", o.reason);
    assert_eq!(o.unsafe_contacts, 0);
}

#[test]
fn judge_of_each_exceeded_limit() {
    assert_eq!(run(touch(1.1, 0.0), 0.0, 0.5, DOWN).outcome, Ending::Hard);
    assert_eq!(run(touch(0.4, 1.1), 0.0, 0.5, DOWN).outcome, Ending::Fast);
    assert_eq!(run(touch(0.4, 0.0), 0.2, 0.5, DOWN).outcome, Ending::Tilted);
    assert_eq!(run(touch(0.4, 0.0), 0.0, 2.5, DOWN).outcome, Ending::Timeout);
    let mut off = DOWN;
    off[0] = [1.3, 0.0, 0.0];
    assert_eq!(run(touch(0.4, 0.0), 0.0, 0.5, off).outcome, Ending::Slid);
    let mut up = DOWN;
    up[0][2] = 0.1;
    assert_eq!(run(touch(0.4, 0.0), 0.0, 0.5, up).outcome, Ending::Tipped);
    // An unsafe trial whose metrics are all within limits also has a ratio of at least 1.
    let ratio = |o: Outcome| o.limit_ratio;
    assert!((ratio(run(touch(0.4, 0.2), 0.05, 0.5, DOWN)) - 0.4).abs() < 1e-9);
    assert!((ratio(run(touch(1.1, 0.0), 0.0, 0.5, DOWN)) - 1.1).abs() < 1e-9);
    for unsafe_ in [
        run(touch(0.4, 0.0), 0.0, 2.5, DOWN),
        run(touch(0.4, 0.0), 0.0, 0.5, off),
        run(touch(0.4, 0.0), 0.0, 0.5, up),
    ] {
        assert!(unsafe_.is_unsafe() && ratio(unsafe_) >= 1.0);
    }
    let other = ContactEvent {
        foot: false,
        ..touch(0.1, 0.0)
    };
    assert_eq!(run(other, 0.0, 0.5, DOWN).outcome, Ending::Tipped);
}

#[test]
fn judge_of_water_and_fast_contacts() {
    let o = run(touch(1.5, 1.5), 0.0, 0.5, DOWN);
    assert_eq!(
        (o.unsafe_contacts, o.contacts_above_2_mps, o.water_contacts),
        (1, 1, 0)
    );
    let o = run(touch(1.5, 1.0), 0.0, 0.5, DOWN);
    assert_eq!((o.unsafe_contacts, o.contacts_above_2_mps), (1, 0));
    let mut judge = Judge::default();
    judge.observe(
        &TrialObservation {
            in_water: true,
            ..at(5.0)
        },
        HALF,
    );
    let o = judge.outcome(1, "", "", 0.0);
    assert_eq!((o.outcome, o.water_contacts), (Ending::Water, 1));
}

#[test]
fn judge_of_a_rejected_landing() {
    let landing = |first_s: f64, motors_on: bool, normal_mps: f64| {
        let mut judge = Judge::default();
        for k in 0..2000 {
            let t_s = 0.1 * f64::from(k);
            let touches = (t_s - first_s).abs() < 0.05;
            let touch = ContactEvent {
                foot: true,
                on_deck: true,
                normal_mps,
                tangential_mps: 0.0,
            };
            let contacts = if touches {
                core::slice::from_ref(&touch)
            } else {
                &[]
            };
            let flies = t_s < first_s + 0.2;
            let motors_on = flies || motors_on;
            let over = judge.observe(
                &TrialObservation {
                    contacts,
                    motors_on,
                    ..at(t_s)
                },
                HALF,
            );
            if over {
                break;
            }
        }
        judge.outcome(1, "calm", "alight", TIME_LIMIT_S).is_rejected()
    };
    assert!(landing(1e9, true, 0.3), "never came down");
    assert!(landing(178.0, false, 0.3), "came down too late");
    assert!(!landing(178.0, false, 1.3), "too hard");
    assert!(!landing(100.0, true, 0.3), "motors on");
    assert!(!landing(100.0, false, 0.3), "landed");
}

#[test]
fn judge_of_keep_out_volumes() {
    let mut judge = Judge::default();
    for (k, gap) in [2.0, 0.3, -0.1, -0.2, 0.1, -0.05].into_iter().enumerate() {
        let keep_out_gap_m = Some(gap);
        judge.observe(
            &TrialObservation {
                keep_out_gap_m,
                ..at(5.0 + k as f64)
            },
            HALF,
        );
    }
    let o = judge.outcome(1, "", "", 0.0);
    assert_eq!((o.outcome, o.keep_out_collisions), (Ending::Collision, Some(2)));
    assert_eq!(o.keep_out_gap_m, Some(-0.2));
    assert_eq!(run(touch(0.4, 0.2), 0.05, 0.5, DOWN).keep_out_collisions, None);
}

#[test]
fn judge_of_a_false_stop() {
    let mut judge = Judge::default();
    judge.observe(
        &TrialObservation {
            motors_on: false,
            ..at(5.0)
        },
        HALF,
    );
    assert_eq!(judge.outcome(1, "", "", 0.0).outcome, Ending::FalseStop);
}
