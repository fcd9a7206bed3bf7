//! The simulated boat's own autopilot, at the other end of the link that the vessel's computer steers by.

use std::net::UdpSocket;

use alight_shared::time::{Time, TrueTime};
use alight_sim::autopilots::boat::BoatAutopilot;
use alight_sim::harness::physics::Physics;
use alight_usv::helm::{HelmConfig, HelmOutput};

use alight_computer::exit::{CliError, Doing};

use crate::live::config::free_port;
use crate::live::plant::{datagrams, dial};

/// The helm of a simulated vessel, and where its link listens. A boat that is really there is not steered by it: neither
/// its autopilot's link nor its switch is opened, and sentences of NMEA 0183 no simulated boat takes.
pub fn simulated(helm: &HelmConfig) -> Result<(HelmConfig, Option<String>), CliError> {
    if helm.output != HelmOutput::Mavlink {
        return Ok((
            HelmConfig {
                output: HelmOutput::None,
                ..helm.clone()
            },
            None,
        ));
    }
    let at = format!("127.0.0.1:{}", free_port()?);
    let own = HelmConfig {
        connect: format!("udpin://{at}"),
        signing_key: String::new(),
        consent_switch: String::new(),
        ..helm.clone()
    };
    Ok((own, Some(at)))
}

/// The link, MAVLink over UDP.
pub struct BoatLink {
    socket: UdpSocket,
    autopilot: BoatAutopilot,
}

impl BoatLink {
    /// It sends to where the vessel's helm listens, which may not have started yet.
    pub fn open(helm: &str) -> Result<BoatLink, CliError> {
        Ok(BoatLink {
            socket: dial(helm).doing(format_args!("sending the boat's MAVLink to {helm}"))?,
            autopilot: BoatAutopilot::default(),
        })
    }
    /// Takes what came until `t`, steers the vessel by it, and sends what is due.
    pub fn step(&mut self, physics: &mut Physics) {
        let t: Time<TrueTime> = physics.now();
        for bytes in datagrams(&self.socket) {
            self.autopilot.receive(t, &bytes);
        }
        physics.steer_to(self.autopilot.steers_to(t));
        let sent = self.autopilot.sent(t);
        if !sent.is_empty() {
            let _undelivered = self.socket.send(&sent);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::node::Node;
    use alight_shared::time::VesselClock;
    use alight_sim::harness::scenario::Scenario;
    use alight_usv::helm::{HelmIn, HelmNode};

    #[test]
    fn no_real_boat_is_steered_by_a_simulation() {
        let real = |output| HelmConfig {
            output,
            connect: "serial:///dev/ttyUSB1:57600".into(),
            signing_key: "/etc/alight/key".into(),
            consent_switch: "/dev/gpiochip0:22".into(),
            ..HelmConfig::default()
        };
        let (own, at) = simulated(&real(HelmOutput::Mavlink)).unwrap();
        assert_eq!(own.connect, format!("udpin://{}", at.unwrap()));
        assert_eq!(
            (own.signing_key, own.consent_switch),
            (String::new(), String::new())
        );
        let (own, at) = simulated(&real(HelmOutput::Nmea0183)).unwrap();
        assert_eq!((own.output, at), (HelmOutput::None, None));
    }

    /// The vessel's helm receives the boat's autopilot over the loopback, and no vessel is steered by it before a consent.
    #[test]
    fn boats_autopilot_on_the_link_of_the_helm() {
        let vessel = UdpSocket::bind("127.0.0.1:0").unwrap();
        vessel
            .set_read_timeout(Some(std::time::Duration::from_secs(10)))
            .unwrap();
        let mut boat = BoatLink::open(&vessel.local_addr().unwrap().to_string()).unwrap();
        let mut physics = Physics::new(&Scenario::default(), 1).unwrap();
        boat.step(&mut physics);
        let mut bytes = [0; 300];
        let n = vessel.recv(&mut bytes).unwrap();
        let mut helm = HelmNode::new(&HelmConfig {
            output: HelmOutput::Mavlink,
            connect: "udpin://127.0.0.1:14560".into(),
            ..HelmConfig::default()
        });
        let now = Time::<VesselClock>::from_secs(1.0);
        assert!(helm.is_silent(now));
        let bytes = Some(bytes[..n].to_vec());
        helm.step(
            now,
            &HelmIn {
                bytes,
                ..HelmIn::default()
            },
        );
        assert!(!helm.is_silent(now) && !helm.is_steered(now));
    }
}
