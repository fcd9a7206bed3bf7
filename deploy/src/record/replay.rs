//! Replay of a recording: recorded inputs through new nodes, outputs compared bit for bit.

use std::path::Path;

use alight_bridge::Bridge;
use alight_shared::node::Node;
use alight_shared::time::{Time, TrueTime};
use alight_shared::wire::{self, WireError};
use alight_uav::mission::Mission;
use alight_uav::pilot::Pilot;
use alight_uav::planner::Planner;
use alight_uav::planner::law::Law;
use alight_uav::predictor::{Predictor, PredictorIn};
use alight_uav::settings::DroneSettings;
use alight_usv::VesselComputer;
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::config::DroneFile;
use crate::exit::CliError;
use crate::record::entry::{Computed, Entry, Missing, MissionEntry, PilotEntry, PlannerEntry};
use crate::record::onlooker::Onlooker;
use crate::record::reading::Recording;
use crate::record::{DECK_FILE, DRONE_FILE, LIVE, NODES, VESSEL_FILE};

/// How one node's replay went.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct NodeReplay {
    /// The node.
    pub node: String,
    /// Steps replayed.
    pub steps: u64,
    /// The recording's time of the first step whose output differs, s.
    pub differs_at_s: Option<f64>,
    /// The number of that step, from 0 on.
    pub differs_at_step: Option<u64>,
}

/// The law of a recorded planner that is none of the drone's.
pub type ForeignLaw = fn(&Recording, &DroneSettings) -> Result<Option<Box<dyn Law>>, CliError>;

/// Replays the recording at `path`, in the order of [`NODES`], before the eyes of who looks on.
pub fn replay(
    path: &Path,
    law: ForeignLaw,
    onlooker: &mut dyn Onlooker,
) -> Result<Vec<NodeReplay>, CliError> {
    let recording = Recording::open(path)?;
    let mut nodes = Nodes::of(&recording, law)?;
    let mut replayed = NODES.map(|node| NodeReplay {
        node: node.into(),
        steps: 0,
        differs_at_s: None,
        differs_at_step: None,
    });
    recording.steps(|k, t_s, bytes| {
        let same = nodes.step(k, Time::from_secs(t_s), bytes, onlooker)?;
        let node = &mut replayed[k];
        if !same && node.differs_at_s.is_none() {
            (node.differs_at_s, node.differs_at_step) = (Some(t_s), Some(node.steps));
        }
        node.steps += 1;
        Ok(())
    })?;
    if replayed.iter().all(|v| v.steps == 0) {
        return Err(CliError(format!(
            "{}: holds no step of any node",
            recording.origin()
        )));
    }
    Ok(replayed.into())
}

/// The nodes as they began.
struct Nodes {
    vessel: VesselComputer,
    bridge: Bridge,
    predictor: Predictor,
    mission: Mission,
    planner: Planner,
    pilot: Pilot,
    computed: Computed,
}

impl Nodes {
    /// From the recorded configurations.
    fn of(recording: &Recording, law: ForeignLaw) -> Result<Nodes, CliError> {
        let number = |name: &str| recording.number(name);
        let (vessel_id, id) = (number("vessel_id")?, number("drone_id")?);
        let mut boots = [0; NODES.len()];
        for (boot, node) in boots.iter_mut().zip(NODES) {
            *boot = number(&crate::record::boot(node))?;
        }
        let [v, b, p, m, l, t] = boots;
        let (vessel, arbiter) = (
            recording.configuration(VESSEL_FILE)?,
            recording.configuration(DECK_FILE)?,
        );
        let DroneFile { bridge, drone } = recording.configuration(DRONE_FILE)?;
        let (planner, airframe, deck) = (&drone.planner, &drone.airframe, &drone.deck);
        let planner = match law(recording, &drone)? {
            None => Planner::new(planner, airframe, deck, l),
            Some(law) => Planner::with_law(law, planner, airframe, deck, l),
        };
        let mission = Mission::new(&drone.mission(), &drone.airframe, &drone.deck, id, m);
        let mission = match number(LIVE)? {
            0 => mission,
            _ => mission.as_successor(),
        };
        Ok(Nodes {
            vessel: VesselComputer::new(&vessel, &arbiter, vessel_id, v),
            bridge: Bridge::new(&bridge, b),
            predictor: Predictor::new(&drone.predictor(), p),
            mission,
            planner,
            pilot: Pilot::new(&drone.pilot, &drone.airframe, id, t),
            computed: Computed::default(),
        })
    }

    /// One recorded step of node `k` of [`NODES`]; is its output the same?
    fn step(
        &mut self,
        k: usize,
        t: Time<TrueTime>,
        bytes: &[u8],
        onlooker: &mut dyn Onlooker,
    ) -> Result<bool, WireError> {
        let computed = &mut self.computed;
        match k {
            0 => same(&mut self.vessel, bytes, Ok, |_, i, o| onlooker.vessel(t, i, o)),
            1 => same(&mut self.bridge, bytes, Ok, |_, _, o| onlooker.bridge(t, o)),
            2 => {
                let mut forecast = None;
                let input = |i: PredictorIn| {
                    computed.drone(i.drone);
                    Ok(i)
                };
                let same = same(&mut self.predictor, bytes, input, |_, i, o| {
                    forecast = o.forecast;
                    onlooker.predictor(t, i, o);
                })?;
                computed.forecast(forecast);
                Ok(same)
            }
            3 => {
                let input = |i: MissionEntry| i.input(computed);
                same(&mut self.mission, bytes, input, |_, i, o| {
                    onlooker.mission(t, i, o);
                })
            }
            4 => {
                let mut plan = None;
                let input = |i: PlannerEntry| i.input(computed);
                let same = same(&mut self.planner, bytes, input, |now, _, o| {
                    plan = o.plan;
                    onlooker.planner(t, now, o);
                })?;
                computed.plan(plan);
                Ok(same)
            }
            _ => {
                let input = |i: PilotEntry<Vec<_>>| i.input(computed);
                same(&mut self.pilot, bytes, input, |now, i, o| {
                    onlooker.pilot(t, now, i, o);
                })
            }
        }
    }
}

/// Feeds one entry to a node, and shows the step. An input that names a forecast or plan that the replay has not
/// computed is a difference.
fn same<N, I>(
    node: &mut N,
    bytes: &[u8],
    input: impl FnOnce(I) -> Result<N::In, Missing>,
    look: impl FnOnce(Time<N::Clock>, &N::In, &N::Out),
) -> Result<bool, WireError>
where
    N: Node<Out: Serialize>,
    I: DeserializeOwned,
{
    let entry: Entry<I> = wire::decode_record(bytes)?;
    let Ok(input) = input(entry.input) else {
        return Ok(false);
    };
    let now = Time::from_nanos(entry.now_ns);
    let output = node.step(now, &input);
    look(now, &input, &output);
    Ok(wire::hash_record(&output)? == entry.output)
}
