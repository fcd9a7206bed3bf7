//! End of a helm: the mode and the course that are given back, and by whom.

use super::*;

#[test]
fn mode_of_a_person_before_the_helm_is_taken() {
    // Within the lead: nothing is commanded.
    let mut b = Bench::new();
    b.agreed(0.8);
    b.mode = MANUAL;
    assert_eq!(b.run(0.2).why, HelmEnd::ModeChanged);
    b.run(20.0);
    assert_eq!((b.mode, b.set_point, b.modes_set.len()), (MANUAL, None, 0));
    // A request is on its way, and is taken after his: his mode is given back, not that of before.
    let mut b = Bench::new();
    b.takes_after_s = 0.6;
    b.agreed(1.7);
    b.mode = MANUAL;
    assert_eq!(b.run(0.2).why, HelmEnd::ModeChanged);
    b.run(6.0);
    assert_eq!((b.mode, b.modes_set.as_slice()), (MANUAL, &[GUIDED, MANUAL][..]));
    assert_eq!(b.node.checkpoint(), None);
}

#[test]
fn boat_that_does_not_settle_on_the_course() {
    let mut b = Bench::new();
    // So small a turn that one which is never begun is within what a boat is off on a straight course.
    (b.advice.heading_rad, b.advice.speed_mps) = (0.21, 5.0);
    b.follows = false;
    assert_eq!(b.agreed(55.0).state, HelmState::Agreed);
    assert_eq!(b.run(6.0).why, HelmEnd::NotSettled);
    b.run(5.0);
    assert_eq!(b.mode, AUTO);
    assert!(!b.visited.contains(&Steady));
}

#[test]
fn no_before_the_heartbeat_that_shows_the_mode() {
    // Wherever the heartbeats fall, and whether it takes the mode at once or later.
    for (phase, takes_after_s) in (0..10).flat_map(|k| [(k, 0.0), (k, 0.3), (k, 0.9)]) {
        let mut b = Bench::new();
        (b.beat_s, b.takes_after_s) = ([1.0, 0.1 * f64::from(phase)], takes_after_s);
        assert_eq!(b.run(2.0).state, Asked);
        b.step_with(vec![true]);
        while b.set_point.is_none() {
            b.step_with(Vec::new());
        }
        b.run(0.1);
        assert_eq!(b.step_with(vec![false]).why, HelmEnd::Refused);
        b.run(5.0);
        assert_eq!(
            (b.mode, b.modes_set.first()),
            (AUTO, Some(&GUIDED)),
            "{phase} {takes_after_s}"
        );
        assert_eq!(b.node.checkpoint(), None);
    }
}

#[test]
fn former_mode_that_is_not_taken_back() {
    let mut b = Bench::new();
    assert_eq!(b.agreed(25.0).state, Steady);
    b.denies = true;
    b.demand = Demand::Nothing;
    b.run(12.0);
    assert_eq!(b.run(60.0).why, HelmEnd::NotGivenBack);
    // The skipper is not asked for a boat in that mode, whoever steers it.
    b.demand = Demand::Comes;
    assert_eq!(b.run(20.0).why, HelmEnd::NotGivenBack);
    b.demand = Demand::Nothing;
    b.run(15.0);
    b.mode = MANUAL;
    assert_eq!(b.run(1.0).state, Idle);
    b.mode = GUIDED;
    b.demand = Demand::Comes;
    assert_eq!(b.run(5.0).state, Idle);
    b.mode = AUTO;
    assert_eq!(b.run(1.0).state, Asked);
    // After a no, too.
    let mut b = Bench::new();
    b.agreed(8.0);
    b.denies = true;
    assert_eq!(b.step_with(vec![false]).why, HelmEnd::Refused);
    assert_eq!(b.run(11.0).why, HelmEnd::NotGivenBack);
}

#[test]
fn way_back_from_a_course() {
    // Slower before than the boat is steered, and faster than the limits: as fast as it may, or not at all.
    for (former_mps, back_mps) in [(1.0, None), (3.0, Some(3.0)), (6.0, Some(5.0))] {
        let mut b = Bench::new();
        b.own[1] = former_mps;
        b.motion[1] = former_mps;
        assert_eq!(b.agreed(25.0).state, Steady, "{former_mps}");
        b.demand = Demand::Nothing;
        while b.node.status().state != Done {
            b.set_point = None;
            b.step_with(Vec::new());
        }
        // Long enough for a set-point.
        b.run(0.5);
        let speed = b.set_point.map(|[_, speed]| (10.0 * speed).round() / 10.0);
        assert_eq!(speed, back_mps, "{former_mps}");
        b.run(60.0);
        assert_eq!((b.mode, b.node.status().state), (AUTO, Idle));
    }
}

#[test]
fn way_back_into_a_keep_out_sector() {
    let mut b = Bench::with(&HelmConfig {
        output: HelmOutput::Mavlink,
        connect: "udpin://127.0.0.1:14560".into(),
        keep_out_deg: vec![[350.0, 10.0]],
        ..HelmConfig::default()
    });
    assert_eq!(b.agreed(25.0).state, Steady, "out of it");
    b.demand = Demand::Nothing;
    while b.node.status().state != Done {
        b.set_point = None;
        b.step_with(Vec::new());
    }
    b.run(0.5);
    assert_eq!(
        (b.mode, b.set_point),
        (AUTO, None),
        "its autopilot is given back at once"
    );
}

#[test]
fn turn_back_to_the_autopilots_own_course() {
    for rate_radps in [0.0, 0.1] {
        let mut b = Bench::new();
        b.rate_radps = rate_radps;
        b.agreed(25.0);
        assert!(!b.node.turns_back());
        b.step_with(vec![false]);
        assert!(b.node.turns_back(), "the drones are informed at once");
        b.run(5.0);
        assert!(b.node.turns_back());
        b.run(15.0);
        assert_eq!(b.node.turns_back(), rate_radps > 0.0, "until it turns no more");
        b.run(60.0);
        assert!(!b.node.turns_back());
    }
    // One that was never steered turns back to nothing.
    let mut b = Bench::new();
    b.run(1.0);
    b.step_with(vec![false]);
    assert!(!b.node.turns_back());
}

#[test]
fn descent_on_the_way_back() {
    let mut b = Bench::new();
    assert_eq!(b.agreed(25.0).state, Steady);
    b.demand = Demand::Nothing;
    assert_eq!(b.run(12.0).state, Done);
    let turned = b.heading_deg();
    b.demand = Demand::Descends;
    assert_eq!(b.run(10.0).state, Steady);
    assert!(
        (b.heading_deg() - turned).abs() < 3.0,
        "{turned} {}",
        b.heading_deg()
    );
    b.demand = Demand::Nothing;
    b.run(60.0);
    assert_eq!((b.mode, b.node.status().state), (AUTO, Idle));
}

#[test]
fn helm_of_a_process_that_ends() {
    let mut b = Bench::new();
    b.agreed(10.0);
    b.ends = true;
    assert_eq!(b.run(0.1).why, HelmEnd::Restarted);
    b.run(3.0);
    assert_eq!((b.mode, b.node.checkpoint()), (AUTO, None));
    // A question ends, and none begins.
    let mut b = Bench::new();
    b.run(1.0);
    b.ends = true;
    assert_eq!(b.run(5.0).state, Idle);
}

#[test]
fn old_checkpoint_of_a_helm() {
    let mut b = Bench::new();
    b.agreed(30.0);
    let former = b.node.checkpoint();
    assert!(former.is_some_and(|f| b.t_s - 11.0 < f.at.secs() && f.at.secs() <= b.t_s));
    b.node = HelmNode::new(&b.node.config.clone());
    b.t_s += 61.0;
    let input = HelmIn {
        checkpoint: former,
        ..HelmIn::default()
    };
    assert_eq!(b.node.step(b.now(), &input).status.why, HelmEnd::NotGivenBack);
    b.demand = Demand::Nothing;
    assert_eq!(
        b.run(20.0).why,
        HelmEnd::NotGivenBack,
        "the skipper sets the mode"
    );
    assert_eq!((b.mode, b.node.checkpoint()), (GUIDED, None));
    b.mode = AUTO;
    assert_eq!(b.run(1.0).state, Idle);
}

#[test]
fn helm_of_a_process_that_was_restarted() {
    let mut b = Bench::new();
    b.agreed(10.0);
    let former = b.node.checkpoint();
    assert_eq!(former.and_then(|f| f.mode), Some(AUTO));
    let config = b.node.config.clone();
    b.node = HelmNode::new(&config);
    let bytes = b.boat(&[]);
    let input = HelmIn {
        bytes: Some(bytes),
        checkpoint: former,
        ..HelmIn::default()
    };
    b.t_s += 0.1;
    let out = b.node.step(b.now(), &input);
    assert_eq!(out.status.why, HelmEnd::Restarted);
    b.run(3.0);
    assert_eq!(b.mode, AUTO);
    assert_eq!(b.node.checkpoint(), None);
}

/// The skipper has looked at so much room: 500 m at 2 m/s.
#[test]
fn helm_as_far_as_one_yes_allows() {
    let mut b = Bench::with(&HelmConfig {
        max_way_m: 500.0,
        ..Bench::new().node.config
    });
    b.agreed(200.0);
    assert_eq!(b.node.status().state, Steady);
    assert_eq!(b.run(60.0).why, HelmEnd::TooFar);
    assert_eq!(b.mode, AUTO);
    // A descent is not turned under.
    let mut b = Bench::with(&HelmConfig {
        max_way_m: 500.0,
        ..Bench::new().node.config
    });
    b.agreed(100.0);
    b.demand = Demand::Descends;
    assert_eq!(b.run(300.0).state, Steady);
    b.demand = Demand::Comes;
    assert_eq!(b.run(1.0).why, HelmEnd::TooFar);
}

/// A yes is for one landing of one drone: another that comes, or the same for its take-off, is asked for again.
#[test]
fn yes_for_one_flight() {
    let mut b = Bench::new();
    b.agreed(60.0);
    b.demand = Demand::Descends;
    b.run(10.0);
    // It has landed, and prepares its next take-off before it counts as secured.
    b.demand = Demand::Stands;
    assert_eq!(b.run(20.0).state, Steady);
    b.demand = Demand::Comes;
    assert_eq!(b.run(1.0).state, Done);
    let mut b = Bench::new();
    b.agreed(60.0);
    assert_eq!(b.node.status().state, Steady);
    b.drone = Some(2);
    assert_eq!(b.run(1.0).state, Done);
}
