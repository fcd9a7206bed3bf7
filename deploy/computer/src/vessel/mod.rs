//! `alight vessel`: the processes of the vessel's computer, as its service runs them.

pub mod crew;
pub mod deck_file;
pub mod deck_inputs;
pub mod estimator;
pub mod helm_lamp;
pub mod radio;
pub mod sensors;
pub mod status;

use crate::{
    config::{VesselComputerConfig, link_url::LinkUrl},
    exit::{CliError, Exit},
    process::{
        args::{Scheduling, ServiceArgs},
        facts::Facts,
        sealed::SealedConfig,
        service::{self, ComputerService},
    },
};

/// Silence after which a process is killed and restarted, s: six reporting periods.
const SILENCE_TIMEOUT_S: f64 = 3.0;

pub fn run(args: &ServiceArgs) -> Result<Exit, CliError> {
    let (computer, sealed) = SealedConfig::begin::<VesselComputerConfig>(&args.process.config)?;
    // An invalid address is rejected here; the process would restart again and again.
    for source in &computer.sensor.sources {
        let of = |e| CliError(format!("sensor {}: {e}", source.name));
        source.connect.parse::<LinkUrl>().map_err(of)?;
    }
    computer.radio.check_zenoh()?;
    sensors::node(&computer, 0)?;
    let nodes = computer.processes().into_iter();
    let service = ComputerService {
        instance: &computer.instance,
        facts: Facts::vessel(&computer),
        computer: format!("vessel-{}", computer.vessel_id),
        recorder: &computer.recorder,
        silence_timeout_s: SILENCE_TIMEOUT_S,
        nodes: nodes.map(|kind| (kind, Scheduling::default())).collect(),
        view: args.view.over(&computer.view),
        checkpoints: None,
    };
    service::run(&args.process, service, sealed)
}
