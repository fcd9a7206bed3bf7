//! State of the autopilot's own mission (PX4 Mission, ArduCopter AUTO): in progress or complete.
//!
//! It is complete when the firmware reports it (`MISSION_STATE_COMPLETE` of `MISSION_CURRENT`), or, for
//! firmware without a state, when the last item is reached (`MISSION_ITEM_REACHED`). PX4 then enters Hold;
//! ArduCopter stays in AUTO. A Hold during the mission does not complete it; any other mode is a takeover.
//!
//! PX4 reports the previous flight's mission as complete until the mission starts again, so it must be active
//! first.
//!
//! When a sortie must end (low battery, mission complete or an order), Alight takes over with the mode
//! command that a take-off uses, but never from a pilot. It does so once per flight for each reason, and takes back a
//! drone that it has sent away on low battery once the deck is free. A
//! mission that is selected again afterwards continues until the drone is disarmed.
//!
//! In unattended cycles `MAV_CMD_MISSION_START` starts the sortie's mission from its beginning.
//!
//! Sources: PX4 `MavlinkMissionManager::send_mission_current`, its `Commander` (Mission to Loiter when finished);
//! ArduPilot `GCS_MAVLINK::send_mission_current`, `ModeAuto::exit_mission`.

use alight_shared::{
    admission::Periodic,
    mavlink::{MessageData as _, dialect as m},
    msg::{AutopilotMode, LinkCheckpoint, MissionState, OwnMission, ReasonCode, State},
    time::{DroneClock, Span},
};

use super::{
    AutopilotOut, ControlAuthority, DroneTime,
    message::{CommandLong, MavCmd, severity},
    modes::Firmware,
    peer::MavlinkPeer,
};

/// Request period of the mission's state while ArduCopter flies it.
const ASK: Span = Span::from_millis(1000);
const PAUSE: Span = Span::from_millis(1000);
const TRIES: u32 = 3;

/// End of a return or landing that Alight has commanded.
const TAKEN_BACK: usize = 3;

/// `total` of an empty mission.
const NO_ITEMS: u16 = u16::MAX;

#[derive(Clone, Copy, Debug, Default)]
pub(super) struct OwnMissionMonitor {
    state: m::MissionState,
    last: Option<u16>,
    /// Whether the last item has been reached since the mission began.
    reached_last: bool,
    began: bool,
    /// Whether the mode has since always been the mission's mode or the Hold that follows it.
    own: bool,
    now: OwnMission,
}

/// End of the autopilot's mission for one reason, commanded once per flight even after a restart.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct MissionEnd {
    sent: u32,
    /// Whether our mode has been reached since the first command.
    done: bool,
}

impl MissionEnd {
    /// Whether no further command follows in this flight.
    pub(super) fn is_over(&self) -> bool {
        self.done || self.sent >= TRIES
    }
}

impl OwnMissionMonitor {
    /// Processes `MISSION_CURRENT`. PX4 counts items from 0; ArduPilot's `total` excludes its first item,
    /// home.
    pub(super) fn current(&mut self, firmware: Firmware, d: &m::MISSION_CURRENT_DATA) {
        self.state = d.mission_state;
        let total = d.total;
        let known = !matches!(total, 0 | NO_ITEMS);
        self.last = known.then_some(match firmware {
            Firmware::Px4 => total.saturating_sub(1),
            Firmware::ArduCopter => total,
        });
    }
    /// Processes `MISSION_ITEM_REACHED`.
    pub(super) fn reached(&mut self, item: u16) {
        self.reached_last = self.began && self.last.is_some_and(|last| item >= last);
    }
    fn is_complete(&self) -> bool {
        match self.state {
            m::MissionState::MISSION_STATE_UNKNOWN => self.reached_last,
            state => state == m::MissionState::MISSION_STATE_COMPLETE,
        }
    }
    pub(super) fn is_under_way(&self) -> bool {
        self.began && self.own
    }
    pub(super) fn step(&mut self, armed: bool, flies: bool, mode: AutopilotMode) -> OwnMission {
        if !armed {
            self.began = false;
            self.own = false;
            self.reached_last = false;
        }
        if armed && flies && !self.is_complete() {
            self.began = true;
        }
        self.own = armed && (flies || self.own && mode == AutopilotMode::Hold);
        self.now = match (self.own, self.began && self.is_complete()) {
            (true, true) => OwnMission::Done,
            (true, false) if flies => OwnMission::Flies,
            (true | false, _) => OwnMission::None,
        };
        self.now
    }
    pub(super) fn now(&self) -> OwnMission {
        self.now
    }
}

#[derive(Clone, Copy, Debug, Default)]
pub(super) struct OwnMissionSequence {
    pub(super) monitor: OwnMissionMonitor,
    /// Ends of the mission in this flight: on battery, on completion, on an order; and [`TAKEN_BACK`].
    pub(super) ends: [MissionEnd; 4],
    starts: u32,
    timer: Periodic<DroneClock>,
}

impl OwnMissionSequence {
    pub(super) fn recall(&mut self, m: &LinkCheckpoint) {
        for (end, is_over) in self.ends.iter_mut().zip(m.ended_missions) {
            end.done |= is_over;
        }
        // No other mode has followed the active mission, so Hold means that the mission is complete.
        if m.own_mission {
            self.monitor.began = true;
            self.monitor.own = true;
        }
    }

    /// Requests the mission's state from ArduCopter. PX4 sends it unrequested and rejects the request.
    pub(super) fn ask(&mut self, now: DroneTime, peer: &MavlinkPeer, out: &mut AutopilotOut) {
        let asks = peer.flies_mission && peer.firmware == Firmware::ArduCopter;
        if asks && self.timer.is_due_spaced(now, ASK) {
            out.send(CommandLong::request(peer.address, m::MISSION_CURRENT_DATA::ID));
        }
    }

    /// Sends the command for the mission node's state, `pause` after the previous one.
    pub(super) fn command(
        &mut self,
        now: DroneTime,
        (peer, authority): (&MavlinkPeer, ControlAuthority),
        own: OwnMission,
        mission: Option<&MissionState>,
        pause: &mut Periodic<DroneClock>,
        out: &mut AutopilotOut,
    ) {
        let code = |state: State| mission.filter(|m| m.state == state).map(|m| m.waiting.code);
        let ready = pause.is_ready(now);
        let ends = self.ends(peer, own, code(State::Idle), ready && authority.may_offer());
        let starts = self.starts(code(State::Hold), ready && authority.commands());
        let (command, severity, text) = if starts {
            let text = "hands over to the autopilot's own mission";
            let start = CommandLong::new(peer.address, MavCmd::MAV_CMD_MISSION_START, [0.0, 0.0]);
            (start, severity::NOTICE, text)
        } else if let Some(text) = ends {
            let end = CommandLong::mode(peer.address, peer.firmware.offboard());
            (end, severity::WARNING, text)
        } else {
            return;
        };
        out.send(command);
        out.alarm(severity, text.into());
        pause.restart(now, PAUSE);
    }
    /// Decides whether to end the autopilot's mission, and returns the reason as a text.
    fn ends(
        &mut self,
        peer: &MavlinkPeer,
        own: OwnMission,
        idle: Option<ReasonCode>,
        may: bool,
    ) -> Option<&'static str> {
        let (which, text) = match idle {
            Some(ReasonCode::TurnsBack) => (0, "ends the autopilot's mission: turns back to the vessel"),
            Some(ReasonCode::OrderedBack) => (2, "ends the autopilot's mission: ordered back"),
            Some(ReasonCode::BatteryDeck) => (
                TAKEN_BACK,
                "the deck is free: takes the drone back that it has sent away",
            ),
            Some(ReasonCode::MissionDone) => (1, "the autopilot's mission is done: returns to the vessel"),
            Some(_) | None => (usize::MAX, ""),
        };
        if !peer.armed {
            self.ends = Default::default();
            return None;
        }
        let ours = peer.mode == AutopilotMode::Offboard;
        for end in &mut self.ends {
            end.done |= end.sent > 0 && ours;
        }
        let sent_away = own == OwnMission::SentAway;
        let may = may && own != OwnMission::None && sent_away == (which == TAKEN_BACK);
        let end = self.ends.get_mut(which).filter(|end| may && !end.is_over())?;
        end.sent += 1;
        Some(text)
    }
    fn starts(&mut self, hold: Option<ReasonCode>, may: bool) -> bool {
        if hold != Some(ReasonCode::HandsOver) {
            self.starts = 0;
            return false;
        }
        let starts = may && self.starts < TRIES;
        self.starts += u32::from(starts);
        starts
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    use m::MissionState::{
        MISSION_STATE_ACTIVE as ACTIVE, MISSION_STATE_COMPLETE as COMPLETE, MISSION_STATE_PAUSED as PAUSED,
        MISSION_STATE_UNKNOWN as UNKNOWN,
    };

    fn current(total: u16, mission_state: m::MissionState) -> m::MISSION_CURRENT_DATA {
        m::MISSION_CURRENT_DATA {
            total,
            mission_state,
            ..m::MISSION_CURRENT_DATA::DEFAULT
        }
    }

    fn armed(m: &mut OwnMissionMonitor, mode: Option<AutopilotMode>) -> OwnMission {
        m.step(true, mode.is_none(), mode.unwrap_or(AutopilotMode::Other))
    }

    #[test]
    fn mission_done_and_held_by_px4_or_by_a_pilot() {
        use OwnMission::{Done, Flies, None as No};
        let hold = Some(AutopilotMode::Hold);
        let mut m = OwnMissionMonitor::default();
        for (reported, mode, expected) in [
            (ACTIVE, None, Flies),
            (PAUSED, hold, No),
            (ACTIVE, None, Flies),
            (COMPLETE, hold, Done),
            // The pilot's Hold does not complete the mission.
            (COMPLETE, Some(AutopilotMode::Other), No),
            (COMPLETE, hold, No),
        ] {
            m.current(Firmware::Px4, &current(4, reported));
            assert_eq!(armed(&mut m, mode), expected);
        }
        assert_eq!(m.step(false, false, AutopilotMode::Hold), No);
        // In the next flight a mission still reported as complete has not started yet.
        for (reported, expected) in [(COMPLETE, Flies), (ACTIVE, Flies), (COMPLETE, Done)] {
            m.current(Firmware::Px4, &current(4, reported));
            assert_eq!(armed(&mut m, None), expected);
        }
    }

    #[test]
    fn last_item_of_a_firmware_without_a_state() {
        for (firmware, last) in [(Firmware::Px4, 3), (Firmware::ArduCopter, 4)] {
            let mut m = OwnMissionMonitor::default();
            m.current(firmware, &current(4, UNKNOWN));
            assert_eq!(armed(&mut m, None), OwnMission::Flies);
            m.reached(last - 1);
            assert_eq!(armed(&mut m, None), OwnMission::Flies, "{firmware:?}");
            m.reached(last);
            assert_eq!(armed(&mut m, None), OwnMission::Done, "{firmware:?}");
        }
        let mut m = OwnMissionMonitor::default();
        m.current(Firmware::ArduCopter, &current(0, UNKNOWN));
        armed(&mut m, None);
        m.reached(9);
        assert_eq!(armed(&mut m, None), OwnMission::Flies);
    }
}
