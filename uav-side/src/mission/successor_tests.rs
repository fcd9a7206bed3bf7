use alight_shared::msg::{CommandKind, Motors};

use super::{
    node_tests::fresh_input,
    tests::{at, config},
    *,
};
use crate::fixtures::{command, header};

fn checkpoint(state: State, t: f64) -> MissionCheckpoint {
    let header = Header::new(1, 1, 5, 9, at(t));
    MissionCheckpoint {
        header,
        state: MissionState {
            header,
            state,
            attempts: 1,
            since: at(t - 1.0),
            hold_position: [1.0, 2.0, -16.0],
            ..MissionState::default()
        },
        landing: true,
        started: at(t - 30.0),
        mean_deck_z: Some(-1.3),
        ..MissionCheckpoint::default()
    }
}

fn successor() -> MissionNode {
    MissionNode::new(
        &config(),
        &DroneGeometry::default(),
        &DeckGeometry::default(),
        1,
        2,
    )
    .as_successor()
}

/// First state of a successor with this checkpoint, `height` above the deck, and why the checkpoint was rejected.
fn begun(checkpoint: Option<MissionCheckpoint>, height: f64) -> (MissionState, Option<CheckpointRejection>) {
    let mut m = successor();
    for k in 0..100_u32 {
        let t = at(10.0 + 0.01 * f64::from(k));
        let z = -1.3 - DroneGeometry::default().feet_below_m - height;
        let input = MissionIn {
            checkpoint,
            ..fresh_input(k, t, [0.1, 0.0, z])
        };
        let out = m.step(t, &input);
        if let Some(state) = out.state {
            assert_eq!(out.checkpoint.map(|m| m.state), Some(state));
            return (state, out.rejected);
        }
    }
    panic!("no state for a second")
}

#[test]
fn successor_with_a_checkpoint() {
    for state in [
        State::Idle,
        State::GetAltitude,
        State::Approach,
        State::Tracking,
        State::Descent,
        State::Landed,
        State::Hold,
        State::GaveUp,
    ] {
        let (s, rejected) = begun(Some(checkpoint(state, 9.8)), 3.0);
        let wanted = if state == State::Idle {
            State::GetAltitude
        } else {
            state
        };
        assert_eq!((s.state, rejected), (wanted, None));
        if matches!(state, State::Hold | State::GaveUp) {
            assert_eq!((s.hold_position, s.with_deck), ([0.1, 0.0, -16.0], true));
        }
    }
    for (at_s, height, state) in [
        (9.8, 0.5, State::Flare),
        // The pilot has left the plan, so the landing starts again unless the drone is on the deck.
        (9.0, 0.5, State::Tracking),
        (9.0, 0.05, State::Flare),
    ] {
        assert_eq!(begun(Some(checkpoint(State::Flare, at_s)), height).0.state, state);
    }
    assert_eq!(begun(Some(checkpoint(State::Descent, 9.8)), 3.0).0.attempts, 1);
}

/// The successor reads the set-point that stops the motors one step late.
#[test]
fn successor_after_the_pilot_stopped_the_motors() {
    let mut m = successor();
    for k in 0..10_u32 {
        let t = at(10.0 + 0.01 * f64::from(k));
        let mut input = fresh_input(k, t, [0.1, 0.0, -1.3 - DroneGeometry::default().feet_below_m]);
        input.checkpoint = Some(checkpoint(State::Flare, 9.9));
        input.autopilot = input.autopilot.map(|a| AutopilotState { armed: false, ..a });
        input.set_point = Some(SetPoint {
            header: header(k, t),
            motors: Motors::Stop,
            ..SetPoint::default()
        })
        .filter(|_| k > 2);
        m.step(t, &input);
    }
    assert_eq!(m.phase.state(), State::Landed);
}

#[test]
fn successor_without_a_sound_checkpoint() {
    let change = |f: fn(&mut MissionCheckpoint)| {
        let mut m = checkpoint(State::Descent, 9.8);
        f(&mut m);
        Some(m)
    };
    use CheckpointRejection::{Age, Damaged, OtherDrone, Version};
    for (bad, why) in [
        (None, None),
        (Some(MissionCheckpoint::default()), None),
        (change(|m| m.header.version ^= 1), Some(Version)),
        (change(|m| m.state.header.version -= 1), Some(Damaged)),
        (change(|m| m.header.drone = 2), Some(OtherDrone)),
        (change(|m| m.header.at = at(4.0)), Some(Age)),
        (change(|m| m.header.at = at(11.0)), Some(Age)),
        (change(|m| m.state.hold_position[0] = f64::NAN), Some(Damaged)),
        (change(|m| m.mean_deck_z = Some(f64::NAN)), Some(Damaged)),
    ] {
        let (s, rejected) = begun(bad, 1.0);
        assert_eq!((s.state, rejected), (State::GaveUp, why), "{bad:?}");
        assert_eq!(s.entered.code, ReasonCode::Restarted);
        assert!((s.hold_position[2] + 16.3).abs() < 0.1, "{s:?}");
    }
    // On the deck the pilot's detector decides; away from it the mission stays idle.
    assert_eq!(begun(None, 0.05).0.state, State::Flare);
    assert_eq!(begun(None, 12.0).0.state, State::Idle);
}

#[test]
fn abort_among_many_commands_to_a_successor() {
    for abort_at in [0, 15, 16, 29] {
        let mut m = successor();
        let mut entered = None;
        for k in 0..100_u32 {
            let t = at(10.0 + 0.01 * f64::from(k));
            let kind = if k == abort_at {
                CommandKind::Abort
            } else {
                CommandKind::Land
            };
            let input = MissionIn {
                commands: (k < 30)
                    .then(|| command(header(k + 1, t), kind))
                    .into_iter()
                    .collect(),
                checkpoint: (k == 29).then(|| checkpoint(State::Tracking, 10.2)),
                ..fresh_input(k, t, [0.1, 0.0, -8.3])
            };
            if let Some(state) = m.step(t, &input).state {
                entered.get_or_insert(state.state);
            }
        }
        assert_eq!(entered, Some(State::GaveUp), "abort as command {abort_at}");
    }
}

/// For each combination of state, charge, and control after a reboot, the drone continues the purpose of the
/// flight, returns, or waits for an order. A landing that the pilot has ended stays ended.
#[test]
fn purpose_that_outlives_a_reboot() {
    use alight_shared::msg::{AutopilotMode, KeptStation, Station};
    // The clock had reached 500 s and restarts with the reboot.
    let written = |change: fn(&mut MissionCheckpoint)| {
        let mut m = MissionCheckpoint {
            armed: true,
            landing: false,
            ..checkpoint(State::Tracking, 500.0)
        };
        change(&mut m);
        m.lasting()
    };
    let flown = |checkpoint, modes: &[AutopilotMode], battery| {
        let mut m = successor();
        let mut last = MissionState::default();
        for k in 0..120_u32 {
            let t = at(3.0 + 0.1 * f64::from(k));
            let mut input = fresh_input(k, t, [20.0, 0.0, -16.3]);
            if let Some(a) = &mut input.autopilot {
                let mode = modes.get(k as usize / 20).or(modes.last());
                (a.mode, a.battery) = (mode.copied().unwrap_or(AutopilotMode::Offboard), Some(battery));
                a.set_points_lost = a.mode == AutopilotMode::Hold;
            }
            last = m
                .step(t, &MissionIn { checkpoint, ..input })
                .state
                .unwrap_or(last);
        }
        last
    };
    let landing = written(|m| m.landing = true);
    let station = written(|m| {
        m.state.station = Some(KeptStation {
            station: Station {
                height_m: 15,
                ..Station::USUAL
            },
            until: at(590.0),
        });
    });
    let stopped = written(|m| m.stopped = true);
    let declined = written(|m| (m.stopped, m.deck_declined) = (true, true));
    let nothing = written(|_| ());
    use AutopilotMode::{Hold, Offboard, Other};
    let (ours, holds, taken): (&[_], &[_], &[_]) = (&[Offboard], &[Hold, Offboard], &[Other, Offboard]);
    for (k, (kept, modes, battery, state)) in [
        (landing, ours, 0.9, State::Tracking),
        (landing, holds, 0.9, State::Tracking),
        (landing, taken, 0.9, State::Idle),
        (station, ours, 0.9, State::Hold),
        (station, taken, 0.9, State::Idle),
        (stopped, ours, 0.9, State::Idle),
        (stopped, ours, 0.18, State::Idle),
        (stopped, ours, 0.14, State::Tracking),
        (declined, ours, 0.14, State::GaveUp),
        (nothing, ours, 0.9, State::Idle),
        (nothing, ours, 0.15, State::Tracking),
        (nothing, &[Other], 0.15, State::Idle),
    ]
    .into_iter()
    .enumerate()
    {
        let m = flown(kept, modes, battery);
        assert_eq!(m.state, state, "row {k}: {m:?}");
        assert_ne!(m.waiting.to_string() + &m.entered.to_string(), "", "row {k}");
    }
    let kept = flown(station, ours, 0.9).station.unwrap();
    assert!((at(60.0)..at(130.0)).contains(&kept.until), "{kept:?}");
    assert!(written(|m| (m.landing, m.armed) = (true, false)).is_none());
}
