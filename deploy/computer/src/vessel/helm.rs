//! The link to the boat's autopilot, which the vessel's process steers by ([`alight_usv::helm`]).

use alight_shared::mavlink::Signing;
use alight_usv::helm::HelmOutput;

use crate::config::VesselComputerConfig;
use crate::config::link_url::LinkUrl;
use crate::exit::CliError;
use crate::io::byte_link::ByteLink;
use crate::io::byte_links::ByteLinks;
use crate::io::mavlink_key;
use crate::io::signalk_autopilot::SignalKAutopilot;

/// Most bytes that a step is given; what comes beyond waits.
const MAX_STEP_BYTES: usize = 1 << 16;
/// Remedy for a boat's autopilot that cannot be steered.
pub const REMEDY: &str = "the skipper is not asked, and drones land as on a boat that is not steered: see to its cable and \
                          vessel.helm.connect (docs/helm.md)";

/// The key of its MAVLink signing, where one is configured.
pub fn signing_key(computer: &VesselComputerConfig) -> Result<Option<Signing>, CliError> {
    mavlink_key::read("vessel.helm.signing_key", &computer.vessel.helm.signing_key)
}

/// The link; none where no helm is configured.
pub struct HelmLink {
    links: ByteLinks,
    /// The server of an autopilot behind Signal K.
    server: Option<SignalKAutopilot>,
    address: String,
    open: bool,
    error: Option<String>,
}

impl HelmLink {
    /// Begins to read it, inside a tokio runtime.
    pub async fn open(computer: &VesselComputerConfig) -> Result<HelmLink, CliError> {
        let helm = &computer.vessel.helm;
        let wrong = |e| CliError(format!("vessel.helm.connect: {e}"));
        let (mut link, mut server) = (None, None);
        match helm.output {
            HelmOutput::None => {}
            HelmOutput::Mavlink | HelmOutput::Nmea0183 => {
                let url = LinkUrl::of_autopilot(&helm.connect).map_err(wrong)?;
                link = Some(ByteLink::of_several(url, None).await?);
            }
            HelmOutput::SignalK => {
                if let LinkUrl::SignalK(host, token) = LinkUrl::of_signalk(&helm.connect).map_err(wrong)? {
                    server = Some(SignalKAutopilot::of(host, token));
                }
            }
        }
        Ok(HelmLink {
            server,
            links: ByteLinks::start(link.map(|link| (0, link))),
            address: helm.connect.clone(),
            open: false,
            error: None,
        })
    }
    /// Received data; None: the link is not open.
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
        while let Some(answer) = self.server.as_mut().and_then(SignalKAutopilot::answered) {
            self.open = answer.is_ok();
            match answer {
                Ok(line) => {
                    self.error = unserved(&self.address, &line);
                    bytes.extend(line.into_bytes());
                }
                Err(why) => self.error = Some(why.to_string()),
            }
        }
        self.open.then_some(bytes)
    }
    /// Sends what the step has for it.
    pub fn send(&mut self, bytes: &[u8]) {
        match &mut self.server {
            Some(server) => server.send(bytes),
            None if bytes.is_empty() => {}
            None => self.links.write(0, bytes),
        }
    }
    /// Why it cannot be steered: its link, or that nothing of a boat's autopilot comes.
    pub fn error(&self, silent: bool) -> Option<String> {
        let why = match self.open {
            true if self.server.is_some() => {
                "the server reports no autopilot with the states standby and auto (its plugin signalk-autopilot)"
            }
            true => "no heartbeat of a boat's autopilot comes",
            false => "the link to the boat's autopilot is not open",
        };
        let silence = || format!("{}: {why}", self.address);
        self.error.clone().or_else(|| silent.then(silence))
    }
}

/// Why a look at the autopilot was not served, by its answer.
fn unserved(address: &str, line: &str) -> Option<String> {
    let status = line.strip_prefix("GET / {} ")?.split(' ').next()?;
    let why = match status {
        "200" => return None,
        "401" | "403" => {
            "the server asks for a token: let its administrator make one, and add ?token=FILE to the address"
        }
        _ => "the server has no autopilot by version 2 of its API: see to its plugin (signalk-autopilot)",
    };
    Some(format!("{address}: it answers {status}: {why}"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn answers_of_a_server_without_an_autopilot() {
        let why = |line: &str| unserved("ws://venus.local", line);
        assert_eq!(why("GET / {} 200 {\"state\":\"auto\"}\n"), None);
        assert_eq!(why("PUT /target {\"value\":0.1} 400 {}\n"), None);
        let token = why("GET / {} 401 \n").unwrap();
        assert!(
            token.contains("ws://venus.local") && token.contains("?token=FILE"),
            "{token}"
        );
        assert!(why("GET / {} 404 {}\n").unwrap().contains("signalk-autopilot"));
    }

    #[tokio::test]
    async fn dead_link_of_an_autopilot_that_reports_nothing() {
        let mut computer = VesselComputerConfig::default();
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
