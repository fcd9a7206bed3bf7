use super::*;
use crate::fixtures::rtcm_frame;
use alight_shared::{
    msg::{CommandKind, DeckOrder, Header, Reason, ReasonCode, State, TimeRequest},
    time::Time,
};

fn computer() -> VesselComputer {
    VesselComputer::new(&VesselNodeConfig::default(), &DeckConfig::default(), 1, 9)
}
fn status(boot: u32, sequence: u32, state: State) -> Arrival<VesselClock, DroneStatus> {
    let message = DroneStatus {
        header: Header::new(1, 3, boot, sequence, Time::EPOCH),
        state,
        entered: Reason::plain(ReasonCode::Operator),
        battery: Some(0.5),
        ..DroneStatus::default()
    };
    Arrival {
        at: Time::EPOCH,
        sender: Sender::Drone(3),
        message,
    }
}

fn events(computer: &mut VesselComputer, t_s: f64, input: ComputerIn) -> Vec<String> {
    let out = computer.step(Time::from_secs(t_s), &input);
    out.events.iter().map(ToString::to_string).collect()
}

#[test]
fn vessel_computer_changes() {
    let mut computer = computer();
    let mut received = |t_s, statuses| {
        let input = ComputerIn {
            statuses,
            ..ComputerIn::default()
        };
        events(&mut computer, t_s, input)
    };
    let descends = received(5.0, vec![status(7, 1, State::Descent)]);
    assert_eq!(descends.len(), 2, "{descends:?}");
    assert!(descends[0].starts_with("drone 3: Descent") && descends[0].ends_with("(battery 50 %)"));
    assert_eq!(descends[1], "the deck is reserved for drone 3");
    assert!(received(5.5, vec![status(7, 2, State::Descent)]).is_empty());
    let double = (1..4).flat_map(|k| {
        let both = vec![status(8, k, State::Descent), status(7, 2 + k, State::Descent)];
        received(5.5 + 0.5 * f64::from(k), both)
    });
    let double: Vec<_> = double.filter(|e| e.starts_with("two drones")).collect();
    assert_eq!(double.len(), 1, "{double:?}");
    assert!(double[0].contains("00000007 and 00000008"), "{double:?}");
    let order = ComputerIn {
        crew: vec![CrewOrder {
            header: Header::new(1, 0, 77, 0, Time::from_secs(8.0)),
            order: DeckOrder::Closed,
        }],
        ..ComputerIn::default()
    };
    assert_eq!(events(&mut computer, 8.0, order), ["crew order: deck closed"]);
}

#[test]
fn status_with_an_old_mission_state() {
    let mut computer = computer();
    let mut received = |t_s: f64, status: Arrival<VesselClock, DroneStatus>| {
        let input = ComputerIn {
            statuses: vec![status],
            ..ComputerIn::default()
        };
        computer.step(Time::from_secs(t_s), &input);
        let now = Time::from_secs(t_s);
        (
            computer.arbiter().owner(),
            computer.arbiter().silent_drones(now).count(),
            computer.drones().received(),
        )
    };
    assert_eq!(received(5.0, status(7, 1, State::Descent)), (Some(3), 0, 1));
    // The mission's process hangs while the bridge still sends: the drone's state is unknown.
    let mut last = None;
    for k in 2..30 {
        let mut old = status(7, k, State::Descent);
        old.message.mission_age_s = 0.5 * k as f32;
        last = Some(received(5.0 + 0.5 * f64::from(k), old));
    }
    assert_eq!(
        last,
        Some((Some(3), 1, 29)),
        "displayed, but silent for the arbiter"
    );
}

/// Drones follow the boot of the vessel's main process, not that of its sensor process.
#[test]
fn frames_of_a_base_with_the_computers_boot() {
    let mut computer = computer();
    let now = Time::from_secs(2.0);
    let frame = RtcmFrames {
        header: Header::new(1, 0, 77, 5, now),
        bytes: Seq::filled(rtcm_frame(1005, 19)),
        ..RtcmFrames::default()
    };
    let input = ComputerIn {
        rtcm: vec![frame],
        ..ComputerIn::default()
    };
    let header = Header::new(1, 0, 9, 1, now);
    assert_eq!(computer.step(now, &input).rtcm, [RtcmFrames { header, ..frame }]);
    assert!(computer.step(now, &ComputerIn::default()).rtcm.is_empty());
}

/// A drone with a valid certificate publishes under the number of another drone, which is landing.
#[test]
fn message_for_another_drone() {
    let config = VesselNodeConfig::default();
    let mut computer = VesselComputer::new(&config, &DeckConfig::default(), 1, 9);
    computer.admit([3]);
    let abort = OperatorCommand {
        header: Header::new(1, 3, 5, 1, Time::EPOCH),
        kind: CommandKind::Abort,
    };
    let command = |sender, message| Arrival {
        at: Time::EPOCH,
        sender,
        message,
    };
    let landing = ComputerIn {
        statuses: vec![status(7, 1, State::Descent)],
        commands: vec![command(Sender::Operator(2), abort)],
        ..ComputerIn::default()
    };
    let out = computer.step(Time::from_secs(5.0), &landing);
    let [relayed] = out.commands[..] else {
        panic!("{out:?}")
    };

    let mut acknowledged = status(7, 2, State::GaveUp);
    acknowledged.message.abort = Some([relayed.header.boot, relayed.header.sequence]);
    let mut left = status(8, 1, State::Idle);
    left.message.deck_distance_m = Some(900.0);
    let land = OperatorCommand {
        kind: CommandKind::Land,
        ..abort
    };
    let mut request = TimeRequest {
        header: Header::new(1, 3, 7, 1, Time::EPOCH),
        newest_at: Time::from_secs(1.0),
        newest_boot: 9,
    };
    let mut requests = Vec::new();
    for k in 0..20_u32 {
        request.header.sequence = k;
        requests.push(Arrival {
            at: Time::from_secs(7.0),
            sender: Sender::Drone(4),
            message: request,
        });
    }
    let forged = ComputerIn {
        time_requests: requests,
        statuses: [acknowledged, left]
            .map(|s| Arrival {
                sender: Sender::Drone(4),
                ..s
            })
            .into(),
        commands: vec![command(Sender::Drone(4), land)],
        ..ComputerIn::default()
    };
    let out = computer.step(Time::from_secs(7.0), &forged);
    assert!(
        out.events.is_empty() && out.vessel.time_replies.is_empty(),
        "{out:?}"
    );
    assert_eq!(computer.arbiter().owner(), Some(3));
    assert_eq!(computer.relay().unacknowledged().collect::<Vec<_>>(), [3]);
    assert_eq!(computer.node().rate_fraction(), 1.0);
    assert_eq!(computer.on_other_keys(), 23);
    let own = ComputerIn {
        statuses: vec![acknowledged],
        ..ComputerIn::default()
    };
    computer.step(Time::from_secs(7.1), &own);
    assert_eq!(computer.relay().unacknowledged().count(), 0);
}
