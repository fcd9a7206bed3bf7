//! The link to the boat's autopilot, which the vessel's process steers by ([`alight_usv::helm`]).

use alight_shared::mavlink::Signing;
use alight_usv::helm::HelmOutput;

use crate::config::VesselComputer;
use crate::config::link_url::LinkUrl;
use crate::exit::CliError;
use crate::io::byte_link::ByteLink;
use crate::io::byte_links::ByteLinks;
use crate::io::mavlink_key;

/// Most bytes that a step is given; what comes beyond waits.
const MAX_STEP_BYTES: usize = 1 << 16;
/// What to do about a boat's autopilot that cannot be steered.
pub const REMEDY: &str = "the skipper is not asked, and drones land as on a boat that is not steered: see to its cable and \
                          vessel.helm.connect (docs/helm.md)";

/// The key of its MAVLink signing, where one is configured.
pub fn signing_key(computer: &VesselComputer) -> Result<Option<Signing>, CliError> {
    mavlink_key::read("vessel.helm.signing_key", &computer.vessel.helm.signing_key)
}

/// The link; none where no helm is configured.
pub struct HelmLink {
    links: ByteLinks,
    address: String,
    open: bool,
    error: Option<String>,
}

impl HelmLink {
    /// Begins to read it, inside a tokio runtime.
    pub async fn open(computer: &VesselComputer) -> Result<HelmLink, CliError> {
        let helm = &computer.vessel.helm;
        let link = match helm.output {
            HelmOutput::None => None,
            HelmOutput::Mavlink | HelmOutput::Nmea0183 => {
                let url = LinkUrl::of_autopilot(&helm.connect);
                let url = url.map_err(|e| CliError(format!("vessel.helm.connect: {e}")))?;
                Some(ByteLink::of_several(url, None).await?)
            }
        };
        Ok(HelmLink {
            links: ByteLinks::start(link.map(|link| (0, link))),
            address: helm.connect.clone(),
            open: false,
            error: None,
        })
    }
    /// What has come; None: the link is not open.
    pub fn received(&mut self) -> Option<Vec<u8>> {
        let mut bytes = Vec::new();
        while bytes.len() < MAX_STEP_BYTES {
            let Some(arrival) = self.links.arrived() else {
                break;
            };
            bytes.extend(arrival.bytes);
            self.open = arrival.open;
            // An open link has no error but a new one.
            self.error = arrival.error.or(self.error.take().filter(|_| !arrival.open));
        }
        self.open.then_some(bytes)
    }
    /// Sends what the step has for it.
    pub fn send(&self, bytes: &[u8]) {
        if !bytes.is_empty() {
            self.links.write(0, bytes);
        }
    }
    /// Why it cannot be steered: its link, or that nothing of a boat's autopilot comes.
    pub fn error(&self, silent: bool) -> Option<String> {
        let why = match self.open {
            true => "no heartbeat of a boat's autopilot comes",
            false => "the link to the boat's autopilot is not open",
        };
        let silence = || format!("{}: {why}", self.address);
        self.error.clone().or_else(|| silent.then(silence))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[tokio::test]
    async fn dead_link_of_an_autopilot_that_reports_nothing() {
        let mut computer = VesselComputer::default();
        computer.vessel.helm.output = HelmOutput::Nmea0183;
        let mut open = async |connect: &str| {
            computer.vessel.helm.connect = connect.into();
            let mut link = HelmLink::open(&computer).await.unwrap();
            for _ in 0..1000 {
                if link.received().is_some() || link.error(false).is_some() {
                    break;
                }
                tokio::time::sleep(Duration::from_millis(10)).await;
            }
            link
        };
        let mut dead = open("serial:///nowhere/ttyUSB1:4800").await;
        assert_eq!(dead.received(), None);
        let why = dead.error(false).unwrap();
        assert!(why.contains("/nowhere/ttyUSB1"), "{why}");
        // A port that is free now.
        let free = std::net::UdpSocket::bind("127.0.0.1:0").and_then(|s| s.local_addr());
        let mut bound = open(&format!("udpin://{}", free.unwrap())).await;
        assert_eq!((bound.received(), bound.error(false)), (Some(Vec::new()), None));
    }
}
