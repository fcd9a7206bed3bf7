//! An operator's command to the mission of this computer: repeated until the mission shows that it has taken it.

use alight_shared::admission::Retransmission;
use alight_shared::msg::{Command, CommandKind, Header, MissionState};
use alight_shared::time::{DroneClock, Span, SteadyClock, Time};

use crate::config::DroneComputerConfig;
use crate::process::life::draw_boot;

/// The mission has this long to show that it took the command: its state comes at 50 Hz.
const TIMEOUT: Span = Span::from_millis(2000);
/// A command that shows no effect is repeated after this long.
const REPEAT: Span = Span::from_millis(500);

/// A command under way; without a kind nothing is commanded, and the mission is only asked.
pub struct LocalCommand {
    header: Header<DroneClock>,
    kind: Option<CommandKind>,
    sending: Retransmission<SteadyClock>,
}

impl LocalCommand {
    /// Given now, at `steady_ns` of the steady clock.
    pub fn new(computer: &DroneComputerConfig, kind: Option<CommandKind>, steady_ns: i64) -> LocalCommand {
        let now = computer.clock.read::<DroneClock>(steady_ns);
        let (vessel, drone) = (computer.bridge.vessel_id, computer.bridge.drone_id);
        LocalCommand {
            header: Header::new(vessel, drone, draw_boot(), 0, now),
            kind,
            sending: Retransmission::new(Time::from_nanos(steady_ns), REPEAT, TIMEOUT),
        }
    }
    /// The message to send now.
    pub fn due(&mut self, steady_ns: i64) -> Option<Command> {
        let kind = self.kind?;
        self.sending.is_due(Time::from_nanos(steady_ns)).then(|| {
            // The time at which it was given stays: what the mission receives meanwhile is newer.
            self.header.sequence += 1;
            Command {
                header: self.header,
                kind,
            }
        })
    }
    /// Whether this state shows that the mission has taken it, or that it rejects it, by the echo of one of its repetitions; None:
    /// it shows neither.
    pub fn taken(&self, m: &MissionState) -> Option<bool> {
        let sent = 1..=self.header.sequence;
        match self.kind {
            None => Some(true),
            Some(kind) => m
                .echo()
                .answers(kind, |[boot, k]| boot == self.header.boot && sent.contains(&k)),
        }
    }
    /// Whether nothing more is waited for.
    pub fn is_over(&self, steady_ns: i64) -> bool {
        self.sending.is_over(Time::from_nanos(steady_ns))
    }
}

/// The answer of drone `drone`'s mission, for the operator.
pub fn answer(drone: u32, mission: &MissionState, taken: bool) -> Vec<String> {
    let mut lines = vec![
        format!("drone {drone}: {}", mission.state.because(&mission.entered)),
        format!("waiting: {}", mission.waits()),
    ];
    if !taken {
        let why = mission.rejected.map(|why| format!(": {why}"));
        lines.push(format!(
            "the mission of drone {drone} did not take the command{}",
            why.unwrap_or_default()
        ));
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::msg::{Reason, ReasonCode, State, Station};

    #[test]
    fn local_abort_repetition_and_receipt() {
        let mut abort = LocalCommand::new(
            &DroneComputerConfig::default(),
            Some(CommandKind::Abort),
            10_000_000_000,
        );
        let sent: Vec<Command> = (0..40)
            .filter_map(|k| abort.due(10_000_000_000 + k * 50_000_000))
            .collect();
        assert_eq!(sent.len(), 4);
        assert!(sent.iter().all(|c| c.header.at.nanos() == 10_000_000_000));
        assert!(
            sent.windows(2)
                .all(|w| w[0].header.sequence < w[1].header.sequence)
        );
        let published = |state, echo: Option<[u32; 2]>| MissionState {
            header: Header::new(1, 1, 7, 1, Time::from_nanos(10_020_000_000)),
            state,
            abort: echo,
            ..MissionState::default()
        };
        // It gave up, or climbs out, by itself or for another's abort.
        let boot = sent[0].header.boot;
        for echo in [
            None,
            Some([boot, 0]),
            Some([boot, 5]),
            Some([boot.wrapping_add(1), 1]),
        ] {
            assert!(abort.taken(&published(State::GaveUp, echo)).is_none(), "{echo:?}");
        }
        assert_eq!(
            abort.taken(&published(State::ClimbOut, Some([boot, 4]))),
            Some(true)
        );
        assert!(!abort.is_over(12_000_000_000) && abort.is_over(12_000_000_001));
    }

    #[test]
    fn local_order_that_the_mission_rejects() {
        let mut station = LocalCommand::new(
            &DroneComputerConfig::default(),
            Some(CommandKind::Station(Station::USUAL)),
            10_000_000_000,
        );
        let sent = station.due(10_000_000_000).unwrap();
        let shows = |rejected| MissionState {
            order: Some([sent.header.boot, sent.header.sequence]),
            rejected,
            ..MissionState::default()
        };
        assert_eq!(station.taken(&MissionState::default()), None);
        assert_eq!(station.taken(&shows(None)), Some(true));
        let why: Reason = ReasonCode::StationNotNow.into();
        assert_eq!(station.taken(&shows(Some(why))), Some(false));
        assert_eq!(answer(1, &shows(Some(why)), false)[1], format!("waiting: {why}"));
    }
}
