//! The drone's mission as a process: wakes with odometry, with a forecast and with a command. Its checkpoint
//! goes to the supervisor, which republishes it to a mission that begins.

use alight_shared::msg::{
    AutopilotState, CameraLight, Command, DeckForecast, DeckGrant, DroneState, MissionCheckpoint,
    MissionState, Plan, RangeSample, SetPoint, SettingsOrder,
};
use alight_shared::process::ProcessKind;
use alight_shared::time::DroneClock;
use alight_transport::TransportError;
use alight_transport::memory::{Listener, Memory, Publisher};
use alight_uav::mission::{Mission, MissionIn, MissionOut};
use tracing::warn;

use crate::config::DroneComputer;
use crate::process::keeper::OwnCheckpoint;
use crate::process::shell::{Shell, reads};

reads! {
    /// What the mission reads.
    Inputs => MissionIn {
        newest forecast: DeckForecast,
        newest drone: DroneState,
        newest autopilot: AutopilotState,
        newest plan: Plan,
        newest set_point: SetPoint,
        all commands: Command,
        newest settings: SettingsOrder,
        newest deck: DeckGrant<DroneClock>,
        all ranges: RangeSample,
        newest light: CameraLight,
        ; checkpoint
    }
}

/// Publishers of the mission, its checkpoint's too.
pub struct MissionShell {
    state: Publisher<MissionState>,
    checkpoint: OwnCheckpoint<MissionCheckpoint>,
}

impl Shell for MissionShell {
    type Node = Mission;
    type Reads = Inputs;
    const KIND: ProcessKind = ProcessKind::Mission;

    fn node(computer: &DroneComputer, boot: u32) -> Mission {
        let (drone, id) = (&computer.drone, computer.bridge.drone_id);
        Mission::new(&drone.mission(), &drone.airframe, &drone.deck, id, boot).as_successor()
    }
    fn join(memory: &Memory) -> Result<Self, TransportError> {
        Ok(MissionShell {
            state: memory.publisher()?,
            checkpoint: OwnCheckpoint::join(memory)?,
        })
    }
    fn wakes(memory: &Memory) -> Result<Vec<Listener>, TransportError> {
        Ok(vec![
            memory.listener::<DroneState>()?,
            memory.listener::<DeckForecast>()?,
            memory.listener::<Command>()?,
        ])
    }
    fn complete(&mut self, t: i64, input: &mut MissionIn) {
        input.checkpoint = self.checkpoint.predecessor(t);
    }
    fn send(&mut self, out: &MissionOut) -> bool {
        // First what must not be lost.
        self.checkpoint.publish(out.checkpoint.as_ref());
        self.state.send_any(out.state.as_ref());
        if let Some(why) = out.rejected {
            warn!(
                "the checkpoint of the mission before this one does not count: it is {why}; what a ground station set is \
                 the file's again: set it again before the next landing"
            );
        }
        out.state.is_some()
    }
    fn unsent(&self) -> u64 {
        self.state.unsent() + self.checkpoint.unsent()
    }
}
