//! Listens to the vessel's real sensors as `alight sensors` would, for a moment.

use alight_shared::node::Node;
use alight_shared::transport::clock::steady_ns;
use alight_usv::sensors::{MAX_STEP_BYTES, SensorNode, SensorsIn, SourceStatus};

use crate::config::VesselComputer;
use crate::io::byte_link::ByteLink;
use crate::process::supervisor::pause;
use crate::tools::check::facts::SourceCheck;

/// All sources are listened to for so long, s: two periods of the slowest receivers and the pause of a link that is opened
/// late.
pub const LISTEN_S: f64 = 2.5;
/// They are read this often.
const READ_ROUNDS: u32 = (LISTEN_S * 1e3) as u32 / 10;
/// With this pause.
const READ_PERIOD: std::time::Duration = std::time::Duration::from_millis(10);

/// What each source sends. The ports must be free: a serial port gives each byte to one reader.
pub fn listen(computer: &VesselComputer) -> Vec<SourceCheck> {
    let sources = &computer.sensor.sources;
    let mut links: Vec<Result<ByteLink, String>> = sources
        .iter()
        .map(|s| ByteLink::new(s.connect.parse()?, steady_ns()).map_err(|e| e.to_string()))
        .collect();
    let mut node = SensorNode::new(&computer.placed_sensors(), computer.vessel_id, 0);
    let mut why: Vec<Option<String>> = vec![None; sources.len()];
    let mut bytes_in = vec![0_usize; sources.len()];
    for _ in 0..if sources.is_empty() { 0 } else { READ_ROUNDS } {
        let mut input = SensorsIn {
            bytes: vec![Vec::new(); links.len()],
        };
        for (k, link) in links.iter_mut().enumerate() {
            if let (Ok(link), Some(bytes)) = (link, input.bytes.get_mut(k)) {
                link.read(steady_ns(), |b| {
                    if bytes.len() < MAX_STEP_BYTES {
                        bytes.extend_from_slice(b);
                    }
                });
                let error = link.last_error().filter(|_| bytes.is_empty());
                if let (Some(slot), Some(error)) = (why.get_mut(k), error) {
                    *slot = Some(error);
                }
                if let Some(n) = bytes_in.get_mut(k) {
                    *n += bytes.len();
                }
            }
        }
        let out = node.step(computer.clock.read(steady_ns()), &input);
        for (k, bytes) in &out.requests {
            if let Some(Ok(link)) = links.get_mut(*k) {
                link.write(steady_ns(), bytes);
            }
        }
        pause(READ_PERIOD);
    }
    let status = node.status();
    sources
        .iter()
        .zip(links)
        .enumerate()
        .map(|(k, (source, link))| {
            let bytes = bytes_in.get(k).copied().unwrap_or_default();
            let silent = why.get_mut(k).and_then(Option::take).filter(|_| bytes == 0);
            SourceCheck {
                name: source.name.clone(),
                connect: source.connect.clone(),
                received: match (link, silent) {
                    (Err(why), _) | (Ok(_), Some(why)) => Err(why),
                    (Ok(_), None) => Ok((
                        bytes,
                        status.get(k).copied().unwrap_or_else(SourceStatus::default),
                    )),
                },
            }
        })
        .collect()
}
