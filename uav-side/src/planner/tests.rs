use alight_shared::{
    geometry::{DeckGeometry, DroneGeometry},
    msg::{DeckStage, Header, State as Mode},
    surroundings::{KeepOut, Surroundings},
};
use nalgebra::Vector3;
use proptest::prelude::*;

use super::{qp::NO_CEILING, *};
use crate::{fixtures::with_number, planner};

#[path = "../../benches/approach/mod.rs"]
pub(super) mod approach;
#[path = "../../benches/naive/mod.rs"]
pub(super) mod naive;

use approach::{ABOVE, Approach, BenchSea, MODERATE, PlanFollower};

#[derive(Debug)]
struct Plain;
impl Law for Plain {}

fn config(kind: PlannerKind) -> PlannerConfig {
    PlannerConfig {
        kind,
        ..PlannerConfig::default()
    }
}

#[test]
fn touchdown_attitude_with_and_without_faa() {
    for phase in [0.0, 2.0, 4.0] {
        let sea = BenchSea { phase, ..MODERATE };
        let mut worst = Solve::Optimal;
        let mut min = f64::MAX;
        let with = Approach::new(sea, ABOVE, 4.0)
            .land(&config(PlannerKind::MpcFaa), |_, p| {
                min = min.min(-p.stages[0].position[2]);
                if p.solve != Solve::Optimal {
                    worst = p.solve;
                }
            })
            .expect("touches");
        let plain = Planner::with_law(
            Box::new(Plain),
            &config(PlannerKind::MpcFaa),
            &DroneGeometry::default(),
            &DeckGeometry::default(),
            1,
        );
        let without = Approach::new(sea, ABOVE, 4.0)
            .land_with(plain, |_, _| {})
            .expect("touches");
        assert!(
            with.time_s < 15.0 && without.time_s < 15.0,
            "{with:?} {without:?}"
        );
        assert!(with.tilt.to_degrees() < 2.0, "{with:?}");
        assert!(
            without.tilt > 2.0 * with.tilt && without.tilt.to_degrees() > 2.0,
            "{without:?}"
        );
        assert!((0.3..0.7).contains(&with.speed_mps), "{with:?}");
        assert!(with.off_m < 0.4, "{with:?}");
        assert!(with.announced_s.is_some_and(|t| t.abs() < 0.03), "{with:?}");
        assert_eq!(worst, Solve::Optimal);
    }
}

#[test]
fn mpc_faa_with_both_published_horizons() {
    for (stages, step_s) in [(20, 0.05), (40, 0.05)] {
        let c = PlannerConfig {
            stages,
            step_s,
            ..PlannerConfig::default()
        };
        let contact = Approach::new(MODERATE, ABOVE, 4.0)
            .land(&c, |_, p| {
                assert!(p.stages.len() == 41 && p.stages.len() > stages)
            })
            .expect("touches");
        assert!(
            contact.tilt.to_degrees() < 2.0 && contact.off_m < 0.8,
            "{contact:?}"
        );
    }
    let per_stage = PlannerConfig {
        faa: weights::Faa {
            distance: weights::FaaDistance::PerStage,
            ..weights::Faa::default()
        },
        ..PlannerConfig::default()
    };
    let contact = Approach::new(MODERATE, ABOVE, 4.0)
        .land(&per_stage, |_, _| {})
        .expect("touches");
    assert!(contact.tilt.to_degrees() < 2.0, "{contact:?}");
}

struct Bench {
    planner: Planner,
    follower: PlanFollower,
    around: Surroundings,
}

impl Bench {
    fn new(position: [f64; 3]) -> Self {
        Bench::of(PlannerKind::MpcFaa, position)
    }
    fn of(kind: PlannerKind, position: [f64; 3]) -> Self {
        let (drone, deck) = (DroneGeometry::default(), DeckGeometry::default());
        Bench {
            planner: Planner::new(&config(kind), &drone, &deck, 7),
            follower: PlanFollower::new(position),
            around: Surroundings::default(),
        }
    }
    fn tick(&mut self, mission: MissionState, sea: Option<&BenchSea>) -> Option<Plan> {
        self.follower.follow();
        let (now, header) = (self.follower.now(), self.follower.header());
        let input = PlannerIn {
            forecast: sea.map(|s| DeckForecast {
                surroundings: self.around,
                ..s.forecast(now, header.sequence)
            }),
            mission: Some(MissionState { header, ..mission }),
            drone: Some(self.follower.drone),
        };
        let plan = self.planner.step(now, &input).plan;
        self.follower.end_tick(plan);
        plan
    }
    fn ticks(&mut self, count: usize, mission: MissionState, sea: Option<&BenchSea>) -> Option<Plan> {
        (0..count).filter_map(|_| self.tick(mission, sea)).last()
    }
}

fn landing(state: Mode) -> MissionState {
    MissionState {
        state,
        height_m: 7.0,
        descent_mps: 1.0,
        minimum_altitude_m: 2.0,
        ..MissionState::default()
    }
}

fn hold(position: [f64; 3]) -> MissionState {
    MissionState {
        state: Mode::Hold,
        hold_position: position,
        hold_yaw: 3.0,
        minimum_altitude_m: 2.0,
        ..MissionState::default()
    }
}

#[test]
fn planner_to_a_far_target() {
    let mut b = Bench::new([0.0, 0.0, -5.0]);
    let (mut speed, mut tilt, mut rate) = (0.0_f64, 0.0_f64, 0.0_f64);
    let mut arrived = None;
    for _ in 0..2000 {
        if let Some(plan) = b.tick(hold([40.0, -20.0, -15.0]), None) {
            assert_eq!(plan.solve, Solve::Optimal);
            for s in plan.stages.iter() {
                speed = speed.max(s.velocity[0].hypot(s.velocity[1]));
                tilt = tilt.max(s.euler[0].hypot(s.euler[1]));
                rate = rate.max(s.euler_rates[2].abs());
            }
        }
        let p = b.follower.drone.position();
        if arrived.is_none() && (p - Vector3::new(40.0, -20.0, -15.0)).norm() < 0.5 {
            arrived = Some(b.follower.now().secs());
        }
    }
    let overshoot = b.follower.drone.position[0] - 40.0;
    assert!(arrived.is_some_and(|t| t < 13.0), "{arrived:?}");
    assert!((5.0..8.3).contains(&speed), "{speed}");
    assert!(tilt.to_degrees() < 30.0 && rate < 1.0, "{tilt} {rate}");
    assert!(overshoot.abs() < 0.05 && b.follower.drone.velocity().norm() < 0.05);
    // The short rotation from 0 to 3 rad is through 1.5, and it completes.
    assert!((wrap_angle(b.follower.drone.euler().z - 3.0)).abs() < 0.02);
    assert_eq!(b.planner.resets, 1);
}

#[test]
fn planner_rates() {
    let mut b = Bench::new(ABOVE);
    for (state, rate_hz) in [
        (Mode::Hold, 10),
        (Mode::Tracking, 50),
        (Mode::Landed, 0),
        (Mode::Idle, 0),
    ] {
        let mission = MissionState {
            state,
            height_m: 7.0,
            ..hold(ABOVE)
        };
        let plans = (0..100).filter(|_| b.tick(mission, Some(&MODERATE)).is_some());
        assert_eq!(plans.count(), rate_hz, "{state:?}");
    }
}

#[test]
fn planner_tracking_without_heave() {
    let mut b = Bench::new(ABOVE);
    let (mut low, mut high, mut off) = (f64::MAX, f64::MIN, 0.0_f64);
    for tick in 0..3000 {
        b.tick(landing(Mode::Tracking), Some(&MODERATE));
        if tick > 2000 {
            low = low.min(b.follower.drone.position[2]);
            high = high.max(b.follower.drone.position[2]);
            let deck = MODERATE.deck(b.follower.now().secs());
            off = off.max(
                (b.follower.drone.position() - Vector3::from(deck.position))
                    .xy()
                    .norm(),
            );
        }
    }
    assert!(
        high - low < 0.2 && (0.5 * (high + low) + 8.3).abs() < 0.1,
        "{low} {high}"
    );
    assert!(off < 0.05, "{off}");
}

#[test]
fn planner_leaving_a_deck_under_way() {
    // A deck under way at 7 m/s that has begun to rise at 2 m/s; the drone is half a metre above it and sinks.
    let deck = |t: f64| DeckStage {
        position: [7.0 * t, 0.0, -1.3 - 2.0 * t],
        velocity: [7.0, 0.0, -2.0],
        ..DeckStage::default()
    };
    let drone = DroneGeometry::default();
    let at_deck = MissionState {
        with_deck: true,
        ..hold([0.0, 0.0, -16.3])
    };
    let break_off = landing(Mode::Tracking);
    for (kind, mission) in [
        (PlannerKind::Alight, at_deck),
        (PlannerKind::Alight, break_off),
        (PlannerKind::MpcFaa, at_deck),
    ] {
        let mut planner = Planner::new(&config(kind), &drone, &DeckGeometry::default(), 7);
        let now = Time::from_secs(10.0);
        let header = crate::fixtures::header(1, now);
        let input = PlannerIn {
            forecast: Some(crate::fixtures::forecast(header, deck)),
            mission: Some(MissionState { header, ..mission }),
            drone: Some(DroneState {
                velocity: [7.0, 0.0, -1.5],
                ..crate::fixtures::drone(header, [0.3, 0.0, -2.1])
            }),
        };
        let plan = planner.step(now, &input).plan.expect("plans");
        let step_s = plan.step.secs();
        for (k, s) in plan.stages.iter().enumerate() {
            let d = deck(step_s * k as f64).position;
            let clearance = d[2] - s.position[2] - drone.feet_below_m;
            assert!(clearance > 0.35, "{kind:?} stage {k}: {clearance}");
            assert!((s.position[0] - d[0]).abs() < 0.5, "{kind:?} stage {k}: {s:?}");
        }
        let last = plan.stages.last().expect("stages");
        assert!(last.velocity[2] < -3.0, "{kind:?}: {last:?}");
    }
}

#[test]
fn planner_escape_direction_and_sector() {
    let mut b = Bench::of(PlannerKind::Alight, [ABOVE[0], ABOVE[1], ABOVE[2]]);
    b.around.escape = Some(core::f32::consts::PI);
    let leave = MissionState {
        with_deck: true,
        ..hold([ABOVE[0], ABOVE[1], -16.3])
    };
    b.ticks(300, leave, Some(&MODERATE));
    let aside = |b: &Bench| {
        let deck = MODERATE.deck(b.follower.now().secs());
        let r = b.follower.drone.position() - Vector3::from(deck.position);
        nalgebra::Rotation3::from_axis_angle(&Vector3::z_axis(), -deck.euler[2]) * r
    };
    let r = aside(&b);
    assert!(r.x < -4.0 && r.y.abs() < 0.5, "astern: {r:?}");
    // The path back above the deck leads round the bow.
    b.around.sector = [-0.5, 1.0];
    let mut came = None;
    for _ in 0..3000 {
        b.tick(landing(Mode::Tracking), Some(&MODERATE));
        let r = aside(&b);
        let low = (3.5..8.5).contains(&r.xy().norm());
        if low && came.is_some() {
            assert!(b.around.outside_sector(r.y.atan2(r.x), 0.0).abs() < 0.1, "{r:?}");
        }
        came = came.or((r.xy().norm() > 9.5).then_some(()));
    }
    assert!(came.is_some() && aside(&b).xy().norm() < 0.5, "{:?}", aside(&b));
}

#[test]
fn planner_minimum_altitude() {
    // A drone ordered to land while 6 m off the deck descends only to the minimum altitude.
    let mut b = Bench::new([14.0, -8.0, -4.0]);
    let mut lowest = f64::MAX;
    let mission = MissionState {
        descent_mps: 2.0,
        minimum_altitude_m: 2.5,
        ..landing(Mode::Flare)
    };
    let sea = BenchSea {
        heave: 0.0,
        ..MODERATE
    };
    for _ in 0..100 {
        if let Some(plan) = b.tick(mission, Some(&sea)) {
            for (i, s) in plan.stages.iter().enumerate() {
                let t = plan.header.at + plan.step * i as i64;
                let d = MODERATE.deck(t.secs()).position;
                // This place is outside the outline widened by half a metre.
                if (s.position[0] - d[0]).hypot(s.position[1] - d[1]) > 2.3 {
                    lowest = lowest.min(-s.position[2]);
                }
            }
        }
    }
    assert!(lowest > 2.45 && lowest < 3.0, "{lowest}");
}

#[test]
fn planner_far_from_its_plan_or_at_an_origin_reset() {
    let mut b = Bench::new([0.0, 0.0, -10.0]);
    b.ticks(50, hold([0.0, 0.0, -10.0]), None);
    assert_eq!(b.planner.resets, 1);
    // The drone is displaced by 2 m.
    b.follower.plan = None;
    b.follower.drone.position = [2.0, 0.0, -10.0];
    let plan = (0..10)
        .find_map(|_| b.tick(hold([0.0, 0.0, -10.0]), None))
        .expect("plans");
    assert!((plan.stages[0].position[0] - 2.0).abs() < 1e-9);
    assert_eq!(b.planner.resets, 2);
    // The tracker must close a gap of half a metre.
    b.follower.plan = None;
    b.follower.drone.position[0] = plan.stages[1].position[0] + 0.5;
    b.tick(hold([0.0, 0.0, -10.0]), None);
    for frames in [0, 1] {
        b.follower.drone.frames = frames;
        let input = PlannerIn {
            drone: Some(DroneState {
                header: b.follower.header(),
                ..b.follower.drone
            }),
            ..PlannerIn::default()
        };
        b.planner.step(b.follower.now(), &input);
        b.follower.tick += 1;
    }
    let before = b.planner.resets;
    b.ticks(10, hold([0.0, 0.0, -10.0]), None);
    assert_eq!(b.planner.resets, before + 1);
}

#[test]
fn planner_without_a_forecast() {
    // Alight sinks at 2.5 m/s when the forecast ends, so it needs longer to return.
    [(PlannerKind::MpcFaa, 400), (PlannerKind::Alight, 600)]
        .into_iter()
        .for_each(stays_without_forecast);
}

fn stays_without_forecast((kind, ticks): (PlannerKind, usize)) {
    let mut b = Bench::of(kind, ABOVE);
    b.ticks(300, landing(Mode::Tracking), Some(&MODERATE));
    b.ticks(100, landing(Mode::Descent), Some(&MODERATE));
    b.ticks(61, landing(Mode::Descent), None);
    let mut stays = |ticks| {
        for _ in 0..ticks {
            let plan = b.tick(landing(Mode::Descent), None);
            assert_eq!(plan.and_then(|p| p.touchdown_at), None);
        }
        b.follower.drone.position()
    };
    let stopped = stays(ticks - 60);
    let moved = (stays(399) - stopped).norm();
    let still = b.follower.drone.velocity().norm() < 0.02;
    assert!(moved < 0.1 && still, "{moved} {kind:?}");
}

#[test]
fn planner_messages_out_of_order() {
    let mut b = Bench::new([0.0, 0.0, -10.0]);
    b.ticks(20, hold([0.0, 0.0, -10.0]), None);
    let now = b.follower.now();
    let mut foreign = Header::new(1, 1, 1, 901, now);
    foreign.version += 1;
    let wrong = [
        (500.0, Header::new(1, 1, 1, 3, now - Span::from_secs(1.0))),
        (500.0, Header::new(1, 1, 1, 900, now + Span::from_secs(1.0))),
        (500.0, foreign),
        (f64::NAN, Header::new(1, 1, 1, 902, now)),
    ];
    for (k, (north, header)) in wrong.into_iter().enumerate() {
        let mission = hold([north, 0.0, -10.0]);
        let input = PlannerIn {
            mission: Some(MissionState { header, ..mission }),
            ..PlannerIn::default()
        };
        b.planner.step(now, &input);
        assert_eq!(b.planner.mission.rejected(), k as u32 + 1);
    }
    b.ticks(100, hold([0.0, 0.0, -10.0]), None);
    assert!(b.follower.drone.position().xy().norm() < 0.01);
}

fn number() -> impl Strategy<Value = f64> {
    prop_oneof![
        4 => -30.0..30.0_f64,
        1 => prop::sample::select(vec![0.0, f64::NAN, f64::INFINITY, -1e12, 1e-300, 9e4, -90.0]),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 48, ..ProptestConfig::default() })]

    #[test]
    fn rotor_limits_with_any_problem(
        state in prop::array::uniform12(-3.0..3.0_f64),
        target in prop::array::uniform12(-20.0..20.0_f64),
        clearance_m in 0.0..1.0_f64,
        previous in prop::array::uniform4(-0.2..0.2_f64),
    ) {
        let c = PlannerConfig::default();
        let drone = DroneGeometry::default();
        let mut mpc = Mpc::new(&c, &drone);
        let weight = c.faa.apply(&c.landing.diagonal(), clearance_m);
        let mut problem = Problem {
            state,
            input: previous,
            reference: vec![target; 20],
            weight: vec![weight; 20],
            ceiling: Vec::new(),
            sides: Vec::new(),
        };
        let mut solution = Solution::default();
        mpc.solve(&mut problem, |_, x, _| if x > 0.0 { -1.0 } else { NO_CEILING }, &mut solution);
        prop_assert!(solution.solve != Solve::Infeasible);
        let highest = drone.max_thrust_n / (drone.mass_kg * GRAVITY);
        let rotor = |nu: &[f64; 4], r: usize| 1.0 + (0..4).map(|i| model::MIXER[i][r] * nu[i]).sum::<f64>();
        let mut before = previous;
        for nu in &solution.inputs {
            for r in 0..4 {
                let u = rotor(nu, r);
                prop_assert!(u >= c.rotors.lowest - 1e-9 && u <= highest + 1e-9, "{u}");
                let change = (u - rotor(&before, r)).abs();
                prop_assert!(change <= c.rotors.slew_per_s * c.step_s + 1e-9, "{change}");
            }
            before = *nu;
        }
    }

    /// Any number anywhere in the inputs, in any state.
    #[test]
    fn planner_arbitrary_input(
        steps in prop::collection::vec((0..10_usize, any::<usize>(), number(), any::<bool>()), 1..80),
    ) {
        const MODES: [Mode; 10] = [
            Mode::Idle, Mode::GetAltitude, Mode::Approach, Mode::Tracking, Mode::TrackingStable,
            Mode::Descent, Mode::Flare, Mode::Landed, Mode::Hold, Mode::GaveUp,
        ];
        let drone = DroneGeometry::default();
        let mut planner = Planner::new(&PlannerConfig::default(), &drone, &DeckGeometry::default(), 1);
        let mut follower = PlanFollower::new(ABOVE);
        for (mode, at, number, damaged) in steps {
            follower.follow();
            let (now, header) = (follower.now(), follower.header());
            let mut input = PlannerIn {
                forecast: Some(MODERATE.forecast(now, header.sequence)),
                mission: Some(MissionState { header, ..landing(MODES[mode]) }),
                drone: Some(follower.drone),
            };
            if damaged {
                input = with_number(input, at, number);
            }
            let plan = planner.step(now, &input).plan;
            if let Some(plan) = &plan {
                prop_assert!(plan.check().is_ok());
                prop_assert_eq!(plan.header.at, now);
                prop_assert!(plan.stages.len() >= 20);
                // The thrust stays within the rotors' limits.
                let up = drone.max_thrust_n / drone.mass_kg - GRAVITY;
                for s in plan.stages.iter() {
                    prop_assert!(s.acceleration[2] <= GRAVITY + 1e-6 && s.acceleration[2] >= -up - 1e-6);
                }
            }
            follower.end_tick(plan);
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 60, ..ProptestConfig::default() })]

    /// A drone that starts outside a volume next to a rocking deck must follow the deck, land, leave, or hold a
    /// position anywhere, even inside the volume.
    #[test]
    fn planner_clear_of_volumes(
        low in prop::array::uniform2(-5.0..4.0_f64), size in prop::array::uniform3(0.2..3.0_f64),
        top in 0.5..9.0_f64, from in prop::array::uniform3(-7.0..7.0_f64), to in prop::array::uniform3(-7.0..7.0_f64),
        mode in 0_usize..5, escape in prop::option::of(-3.0..3.0_f32),
    ) {
        let margin = crate::surroundings::margin_m(&DroneGeometry::default());
        let volume = KeepOut {
            low: [low[0], low[1], -top].map(|v| v as f32),
            high: [low[0] + size[0], low[1] + size[1], size[2]].map(|v| v as f32),
        };
        let q = |deck: &DeckStage, p: [f64; 3]| {
            let r = Vector3::from(p) - Vector3::from(deck.position);
            volume.beyond(&(deck.rotation().transpose() * r)).max() - margin
        };
        let near = |p: [f64; 3]| [ABOVE[0] + p[0], ABOVE[1] + p[1], ABOVE[2] + p[2]];
        let (from, to) = (near(from), near(to));
        let here = MODERATE.deck(0.0);
        prop_assume!(q(&here, from) > 0.5 && q(&here, near([0.0, 0.0, 5.0])) > 0.6);
        let mission = match mode {
            0 => landing(Mode::Tracking),
            1 => landing(Mode::Descent),
            2 => landing(Mode::Flare),
            3 => hold(to),
            _ => MissionState { with_deck: true, ..hold([from[0], from[1], -16.0]) },
        };
        let mut b = Bench::of(PlannerKind::Alight, from);
        b.around.escape = escape;
        let _ = b.around.keep_out.push(volume);
        for _ in 0..500 {
            let Some(plan) = b.tick(mission, Some(&MODERATE)) else { continue };
            let deck = MODERATE.deck(plan.header.at.secs());
            let Some(s) = plan.stages.first() else { continue };
            // Bounds are soft: the volume includes a margin of 0.5 m for the errors of drone and forecast.
            let gap = q(&deck, s.position);
            prop_assert!(gap > -0.5, "{gap:.2} {s:?}, from {from:?}");
        }
    }
}
