//! Operator's command to the mission on this computer, repeated until the mission accepts it.

use alight_shared::{
    admission::Retransmission,
    msg::{Command, CommandKind, Header, MissionState},
    time::{SteadyClock, Time},
    topics,
};

use crate::{config::DroneComputerConfig, process::life::draw_boot};

pub fn give(
    computer: &DroneComputerConfig,
    kind: CommandKind,
    now: Time<SteadyClock>,
) -> Retransmission<SteadyClock, Command> {
    let vessel = computer.bridge.vessel_id;
    let drone = computer.bridge.drone_id;
    let at = computer.clock.read(now.nanos());
    let header = Header::new(vessel, drone, draw_boot(), 1, at);
    Retransmission::new(Command { header, kind }, now, topics::LOCAL_RETRIES)
}

pub fn answer(drone: u32, mission: &MissionState, taken: bool) -> Vec<String> {
    let mut lines = vec![
        format!("drone {drone}: {}", mission.state.because(&mission.entered)),
        format!("waiting: {}", mission.waiting),
    ];
    if !taken {
        let why = mission.rejected.map(|why| format!(": {why}"));
        lines.push(format!(
            "the mission of drone {drone} did not accept the command{}",
            why.unwrap_or_default()
        ));
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::msg::{Reason, ReasonCode, State, Station};

    fn at(ms: i64) -> Time<SteadyClock> {
        Time::from_nanos(10_000_000_000 + ms * 1_000_000)
    }

    #[test]
    fn local_abort_repetition_and_receipt() {
        let mut abort = give(&DroneComputerConfig::default(), CommandKind::Abort, at(0));
        let sent: Vec<Command> = (0..40).filter_map(|k| abort.due(at(50 * k))).collect();
        assert_eq!(sent, [abort.message; 4]);
        assert_eq!(sent[0].header.at.nanos(), 10_000_000_000);
        let published = |state, echo: Option<[u32; 2]>| MissionState {
            header: Header::new(1, 1, 7, 1, Time::from_nanos(10_020_000_000)),
            state,
            abort: echo,
            ..MissionState::default()
        };
        // The mission has already given up or climbs out, by itself or after another operator's abort.
        let boot = sent[0].header.boot;
        for echo in [
            None,
            Some([boot, 0]),
            Some([boot, 2]),
            Some([boot.wrapping_add(1), 1]),
        ] {
            assert!(
                abort.answered(&published(State::GaveUp, echo)).is_none(),
                "{echo:?}"
            );
        }
        assert_eq!(
            abort.answered(&published(State::ClimbOut, Some([boot, 1]))),
            Some(true)
        );
        assert!(!abort.is_over(at(2000)) && abort.is_over(at(2001)));
    }

    #[test]
    fn local_order_that_the_mission_rejects() {
        let kind = CommandKind::Station(Station::USUAL);
        let station = give(&DroneComputerConfig::default(), kind, at(0));
        let own = &station.message.header;
        let shows = |rejected| MissionState {
            order: Some([own.boot, own.sequence]),
            rejected,
            ..MissionState::default()
        };
        assert_eq!(station.answered(&MissionState::default()), None);
        assert_eq!(station.answered(&shows(None)), Some(true));
        let why: Reason = ReasonCode::StationNotNow.into();
        assert_eq!(station.answered(&shows(Some(why))), Some(false));
        assert!(answer(1, &shows(Some(why)), false)[2].ends_with(&format!("command: {why}")));
    }
}
