//! The vessel's real sensors: those of a running process as it reports them, the others by a short reception.

use std::{path::Path, sync::Arc, time::Duration};

use alight_computer::{
    config::VesselComputerConfig,
    io::{byte_link::ByteLink, byte_links::ByteLinks, peer::Speaks, runtime},
    process::{sealed, snapshot::Snapshot},
    situation::{ObservedSituation, SourceHealth},
    vessel::sensors::{self, foreign_remark},
};
use alight_shared::{config, msg::SourceStatus, node::Node};
use alight_transport::clock::steady_ns;
use alight_usv::sensors::{SensorNode, SensorsIn, SourceConfig};
use tokio::time::{Instant, timeout_at};

use crate::tools::check::{
    facts::SourceCheck,
    received::{MeasurementSeries, SensorStatistics},
};

/// Time for which all sources are received, s: two periods of the slowest receivers, with a margin for a link that
/// opens late.
pub const LISTEN_S: f64 = 2.5;
const STEP_PERIOD: Duration = Duration::from_millis(20);

#[derive(Clone, Debug, Default)]
pub struct ListenedSources {
    pub sources: Vec<SourceCheck>,
    pub measured: SensorStatistics,
}

/// Sources that the process with this file owns, as reported in `snapshot`, and the other sources, received here. If
/// the running vessel uses another configuration, all sources are received here; those that it owns cannot be opened,
/// which is a finding.
pub fn of(
    path: &Path,
    v: &VesselComputerConfig,
    snapshot: Option<&Snapshot>,
) -> (Vec<SourceHealth>, ListenedSources) {
    let flown: Option<VesselComputerConfig> = snapshot
        .and_then(|_| sealed::running(path))
        .and_then(|text| config::parse(&text, &path.display().to_string()).ok());
    let is_flown = |source: &SourceConfig| {
        let flown = flown.as_ref().map(|f| &f.sensor.sources);
        flown.is_some_and(|sources| sources.contains(source))
    };
    let (held, open): (Vec<_>, Vec<_>) = v.sensor.sources.iter().cloned().partition(is_flown);
    let mut reported = snapshot.map_or_else(Vec::new, |snapshot| {
        ObservedSituation::of(snapshot, steady_ns()).sources()
    });
    reported.retain(|r| held.iter().any(|s| s.name == r.name));
    let mut others = v.clone();
    others.sensor.sources = open;
    (reported, listen(&others))
}

/// Receives each source's data. The ports must be free, because a serial port gives each byte to one reader only.
pub fn listen(computer: &VesselComputerConfig) -> ListenedSources {
    runtime::block_on(async { Ok(received(computer).await) }).unwrap_or_default()
}

async fn received(computer: &VesselComputerConfig) -> ListenedSources {
    let sources = &computer.sensor.sources;
    let (mut links, mut why) = (Vec::new(), vec![None; sources.len()]);
    for (k, source) in sources.iter().enumerate() {
        match open(source).await {
            Ok(link) => links.push((k, link)),
            Err(e) => why[k] = Some(e),
        }
    }
    let mut links = ByteLinks::start(links);
    let mut node = match sensors::node(computer, 0) {
        Ok(node) => node,
        Err(e) => {
            why.fill(Some(e.to_string()));
            SensorNode::new(&computer.placed_sensors(), computer.vessel_id, 0)
        }
    };
    let mut bytes_in = vec![0_usize; sources.len()];
    let mut foreign = vec![None; sources.len()];
    let mut all = MeasurementSeries::default();
    let end = Instant::now() + Duration::from_secs_f64(if sources.is_empty() { 0.0 } else { LISTEN_S });
    while Instant::now() < end {
        let mut input = SensorsIn {
            samples: Vec::new(),
            bytes: vec![Vec::new(); sources.len()],
        };
        let step = Instant::now() + STEP_PERIOD;
        if let Ok(arrival) = timeout_at(step, links.next()).await {
            let k = arrival.link;
            bytes_in[k] += arrival.bytes.len();
            foreign[k] = arrival.foreign;
            input.bytes[k] = arrival.bytes;
            why[k] = arrival.error.or(why[k].take());
        }
        let now = computer.clock.read(steady_ns());
        let out = node.step(now, &input);
        all.add(now, &out.readings);
        for (k, bytes) in &out.requests {
            links.write(*k, bytes);
        }
    }
    let (status, remarks) = (node.status(), node.remarks());
    let measured = all.measured(computer.clock.read(steady_ns()));
    let sources = sources
        .iter()
        .zip(why)
        .zip(bytes_in)
        .enumerate()
        .map(|(k, ((source, why), bytes))| SourceCheck {
            name: source.name.clone(),
            connect: source.connect.clone(),
            remarks: foreign_remark(foreign.get(k).copied().flatten())
                .into_iter()
                .chain(remarks.get(k).cloned().unwrap_or_default())
                .collect(),
            received: match why.filter(|_| bytes == 0) {
                Some(why) => Err(why),
                None => Ok((
                    bytes,
                    status.get(k).copied().unwrap_or_else(SourceStatus::default),
                )),
            },
        })
        .collect();
    ListenedSources { sources, measured }
}

async fn open(source: &SourceConfig) -> Result<ByteLink, String> {
    let speaks: Speaks = Arc::new(source.format.speaks());
    let link = ByteLink::with_peer(source.connect.parse()?, Some(speaks)).await;
    link.map_err(|e| e.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_computer::process::{facts::Facts, sealed::SealedConfig};
    use alight_shared::msg::{SourceReport, VesselStatus};

    /// Configuration file of a vessel with sources of these names, each at a port without data.
    fn file(names: &[&str]) -> String {
        let source = |name: &&str| {
            format!(
                "[[sensor.sources]]\nname = \"{name}\"\nconnect = \"udpin://127.0.0.1:0\"\nformat = \"nmea\"\n"
            )
        };
        format!("vessel_id = 1\n{}", names.iter().map(source).collect::<String>())
    }

    #[test]
    fn sources_next_to_a_running_vessel() {
        let name = format!("alight-check-sources-{}.toml", std::process::id());
        let path = std::env::temp_dir().join(name);
        std::fs::write(&path, file(&["imu", "compass"])).unwrap();
        let computer: VesselComputerConfig = config::load(&path).unwrap();
        let mut snapshot = Snapshot {
            computer: Facts::vessel(&computer).report.into(),
            ..Snapshot::default()
        };
        let names = |checked: &[SourceCheck]| checked.iter().map(|s| s.name.clone()).collect::<Vec<_>>();
        let (held, listened) = of(&path, &computer, Some(&snapshot));
        assert!(held.is_empty());
        assert_eq!(names(&listened.sources), ["imu", "compass"]);

        let (_, sealed) = SealedConfig::begin::<VesselComputerConfig>(&path).unwrap();
        let now = steady_ns();
        snapshot.vessel.set(now, Some(VesselStatus::default()));
        snapshot.sources = (0..2)
            .map(|number| {
                let report = SourceReport {
                    number,
                    ..SourceReport::default()
                };
                (number, report)
            })
            .collect();
        std::fs::write(&path, file(&["imu", "compass", "receiver"])).unwrap();
        let edited: VesselComputerConfig = config::load(&path).unwrap();
        let (held, listened) = of(&path, &edited, Some(&snapshot));
        assert_eq!(
            held.iter().map(|h| &*h.name).collect::<Vec<_>>(),
            ["imu", "compass"]
        );
        assert_eq!(names(&listened.sources), ["receiver"]);
        drop(sealed);
        std::fs::remove_file(path).unwrap();
    }
}
