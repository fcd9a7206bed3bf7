use alight_shared::msg::{AutopilotMode, CommandKind, Message, Motors, Phase};
use proptest::prelude::*;

use super::{
    node_tests::{fresh_input, node},
    tests::at,
    *,
};
use crate::fixtures::{command, header};

fn wild() -> impl Strategy<Value = f64> {
    prop_oneof![
        4 => -20.0..20.0_f64,
        2 => 0.0..1.0_f64,
        1 => Just(f64::NAN),
        1 => Just(f64::INFINITY),
        1 => Just(-1e300),
    ]
}

#[derive(Clone, Debug)]
struct Blow {
    mask: u8,
    age_ms: i64,
    position: [f64; 3],
    drone: [f64; 3],
    ages: [f64; 2],
    sd: f64,
    armed: bool,
    mode: AutopilotMode,
    stop: bool,
    command: Option<CommandKind>,
    battery: f64,
    repeat: u8,
}

fn blow() -> impl Strategy<Value = Blow> {
    let mode = prop_oneof![
        6 => Just(AutopilotMode::Offboard),
        1 => Just(AutopilotMode::Other),
        1 => Just(AutopilotMode::Hold),
    ];
    let command = prop_oneof![
        20 => Just(None),
        4 => Just(Some(CommandKind::Land)),
        1 => Just(Some(CommandKind::Abort)),
        1 => Just(Some(CommandKind::Hold)),
    ];
    let deck = prop_oneof![4 => Just([0.0, 0.0, -1.3]), 1 => prop::array::uniform3(wild())];
    let drone = prop_oneof![
        2 => Just([0.0, 0.0, -16.3]),
        3 => Just([0.1, 0.0, -8.3]),
        3 => (0.0..3.0_f64).prop_map(|h| [0.1, 0.1, -1.6 - h]),
        1 => prop::array::uniform3(wild()),
    ];
    let age = prop_oneof![3 => 0.0..0.4_f64, 1 => wild()];
    (
        (any::<u8>(), -200..800_i64, deck, drone),
        (age.clone(), age, wild(), prop::bool::weighted(0.95), mode),
        (prop::bool::weighted(0.02), command, wild(), 1..80_u8),
    )
        .prop_map(
            |((mask, age_ms, position, drone), (a, b, sd, armed, mode), (stop, command, battery, repeat))| {
                Blow {
                    mask: mask | mask.rotate_left(3) | mask.rotate_left(5),
                    age_ms: if age_ms < 600 { 0 } else { age_ms - 500 },
                    position,
                    drone,
                    ages: [a, b],
                    sd: if sd > 1.0 { 0.05 } else { sd },
                    armed,
                    mode,
                    stop,
                    command,
                    battery,
                    repeat,
                }
            },
        )
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 96, ..ProptestConfig::default() })]
    #[test]
    fn mission_random_input(blows in prop::collection::vec(blow(), 1..60)) {
        let mut m = node();
        let mut now = at(1.0);
        let mut n = 0_u32;
        let (mut followed, mut stop_at) = (false, None);
        for b in &blows {
            for r in 0..b.repeat {
                n += 1;
                now += Span::from_millis(10);
                let then = now - Span::from_millis(b.age_ms);
                let mut input = fresh_input(n, then, b.drone);
                let f = input.forecast.as_mut().unwrap();
                [f.radio_age_s, f.vision_age_s] = b.ages;
                f.mean_z = Some(b.position[2]);
                for s in f.stages.iter_mut() {
                    s.position = b.position;
                    s.position_sd = [b.sd.abs(); 3];
                }
                let a = input.autopilot.as_mut().unwrap();
                (a.armed, a.mode, a.battery) = (b.armed, b.mode, Some(b.battery.abs().min(1.0)));
                if b.mask & 1 == 0 { input.forecast = None }
                if b.mask & 2 == 0 { input.drone = None }
                if b.mask & 4 == 0 { input.autopilot = None }
                if b.mask & 8 == 0 { input.plan = None }
                if b.stop && b.mask & 16 != 0 {
                    input.set_point = Some(SetPoint { header: header(n, then), motors: Motors::Stop, ..SetPoint::default() });
                    stop_at = stop_at.max(Some(then));
                }
                if r == 0 {
                    input.commands.extend(b.command.map(|kind| command(header(n, then), kind)));
                }
                let out = m.step(now, &input);
                let state = m.phase.state();
                // A drone on the deck with motors running completes its landing after a set-point loss.
                let begins = |code| matches!(code, ReasonCode::Restarted | ReasonCode::GivenBack);
                let stands = |s: &MissionState| begins(s.entered.code) && s.entered.value.abs() < 0.15;
                followed |= state.phase() == Phase::Follow || out.state.as_ref().is_some_and(stands);
                if state == State::Idle { followed = false }
                prop_assert!(state.phase() != Phase::Landing || followed, "landing without following");
                if let Some(s) = out.state {
                    prop_assert!(s.check().is_ok(), "{s:?}");
                    if s.descent_mps > 0.0 {
                        prop_assert!(m.forecast.fresh(now, topics::FORECAST.stale_after).is_some());
                        prop_assert!(m.drone.fresh(now, topics::DRONE_STATE.stale_after).is_some());
                        prop_assert!(m.autopilot.get().is_some_and(|a| a.armed));
                        let detected = m.forecast.get().map_or(f64::INFINITY, |f| f.vision_age_s);
                        prop_assert!(detected <= 13.0, "deck not detected: {detected}");
                    }
                    if s.state == State::Landed && s.previous != State::Landed && s.since == now {
                        prop_assert!(stop_at.is_some_and(|t| now - t <= Span::from_millis(110)));
                    }
                }
            }
        }
    }
}
