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
            error: None,
        })
    }
    /// What has come.
    pub fn received(&mut self) -> Vec<u8> {
        let mut bytes = Vec::new();
        while bytes.len() < MAX_STEP_BYTES {
            let Some(arrival) = self.links.arrived() else {
                break;
            };
            if !arrival.bytes.is_empty() {
                self.error = None;
            }
            bytes.extend(arrival.bytes);
            self.error = arrival.error.or(self.error.take());
        }
        bytes
    }
    /// Sends what the step has for it.
    pub fn send(&self, bytes: &[u8]) {
        if !bytes.is_empty() {
            self.links.write(0, bytes);
        }
    }
    /// Why it cannot be steered: its link, or that nothing of a boat's autopilot comes.
    pub fn error(&self, silent: bool) -> Option<String> {
        let silence = || format!("{}: no heartbeat of a boat's autopilot comes", self.address);
        self.error
            .clone()
            .filter(|_| silent)
            .or_else(|| silent.then(silence))
    }
}
