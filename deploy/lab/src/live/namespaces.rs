//! Two network namespaces of Linux, one for the vessel's computer and one for the drone's, each
//! with a TUN device; what lies between the devices is the link emulator's. Made and removed with
//! iproute2's `ip`, which needs the right to administer the network (root).

use std::process::{Command, Stdio};

use alight_computer::exit::{CliError, Doing};
use tun_rs::{DeviceBuilder, SyncDevice};

/// The vessel's address, and the drone's.
pub const ADDRESSES: [&str; 2] = ["10.77.0.1", "10.77.0.2"];
/// Largest packet; the usual one, so that fragments fall as they do at sea.
const MTU: u16 = 1500;

/// The namespaces of one set of processes.
#[derive(Clone, Debug)]
pub struct Namespaces {
    name: String,
}

fn ip(arguments: &[&str]) -> Result<(), CliError> {
    let doing = format_args!("running ip {}", arguments.join(" "));
    let out = Command::new("ip")
        .args(arguments)
        .stdin(Stdio::null())
        .output()
        .doing(doing)?;
    if out.status.success() {
        return Ok(());
    }
    let error = String::from_utf8_lossy(&out.stderr);
    Err(CliError::because(doing, error.trim()))
}

impl Namespaces {
    /// The namespaces called after `name`; nothing is made yet.
    pub fn named(name: &str) -> Namespaces {
        Namespaces { name: name.into() }
    }
    /// The vessel's (0) or the drone's (1).
    pub fn space(&self, side: usize) -> String {
        let side = if side == 0 { "vessel" } else { "drone" };
        format!("alight-{}-{side}", self.name)
    }
    /// Makes those that are not there.
    pub fn make(&self) -> Result<(), CliError> {
        for side in 0..2 {
            let space = self.space(side);
            if ip(&["-n", &space, "link", "show", "lo"]).is_err() {
                ip(&["netns", "add", &space])?;
            }
            ip(&["-n", &space, "link", "set", "lo", "up"])?;
        }
        Ok(())
    }
    /// Removes both, also those of a run that was killed. Processes in them keep what they have.
    pub fn remove(&self) {
        for side in 0..2 {
            // One that is not there needs no removing.
            let _none = ip(&["netns", "del", &self.space(side)]);
        }
    }
    /// A device in each namespace, up and with its address; gone when the program is.
    pub fn devices(&self) -> Result<[SyncDevice; 2], CliError> {
        Ok([self.device(0)?, self.device(1)?])
    }
    fn device(&self, side: usize) -> Result<SyncDevice, CliError> {
        // Born in our namespace under a name that no other process uses, then moved: the file that we
        // hold stays attached to it.
        let (space, born) = (self.space(side), format!("al{}{side}", std::process::id()));
        let device = DeviceBuilder::new()
            .name(&born)
            .mtu(MTU)
            .build_sync()
            .doing(format_args!("making the TUN device {born}"))?;
        ip(&["link", "set", &born, "netns", &space, "name", "radio"])?;
        let address = format!("{}/24", ADDRESSES[side.min(1)]);
        ip(&["-n", &space, "addr", "add", &address, "dev", "radio"])?;
        ip(&["-n", &space, "link", "set", "radio", "up"])?;
        Ok(device)
    }
    /// Command prefix that runs a command in the namespace.
    pub fn enter(&self, side: usize) -> Vec<String> {
        ["ip", "netns", "exec", &self.space(side)]
            .map(String::from)
            .to_vec()
    }
}

/// Namespaces that are removed with this.
pub struct OwnSpaces(Namespaces);

impl OwnSpaces {
    /// New ones; those of a run that was killed are removed before.
    pub fn make(name: &str) -> Result<OwnSpaces, CliError> {
        let own = OwnSpaces(Namespaces::named(name));
        own.0.remove();
        own.0.make()?;
        Ok(own)
    }
    /// Command prefix that runs a command on a side.
    pub fn enter(&self, side: usize) -> Vec<String> {
        self.0.enter(side)
    }
}

impl Drop for OwnSpaces {
    fn drop(&mut self) {
        self.0.remove();
    }
}
