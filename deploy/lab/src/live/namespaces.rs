//! Two Linux network namespaces, one per computer, each with a TUN device for the link emulator. iproute2's `ip`
//! creates and removes them, which requires network administration rights (root).

use std::process::{Command, Stdio};

use alight_computer::exit::{CliError, Doing};
use tun_rs::{DeviceBuilder, SyncDevice};

pub const ADDRESSES: [&str; 2] = ["10.77.0.1", "10.77.0.2"];
/// Maximum packet size, bytes; the usual value, so that packets are fragmented as at sea.
const MTU: u16 = 1500;

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
    /// Namespaces with names derived from `name`; does not create them.
    pub fn named(name: &str) -> Namespaces {
        Namespaces { name: name.into() }
    }
    pub fn space(&self, side: usize) -> String {
        let side = if side == 0 { "vessel" } else { "drone" };
        format!("alight-{}-{side}", self.name)
    }
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
    /// Removes both namespaces, including those of a killed run. Processes in them keep their sockets.
    pub fn remove(&self) {
        for side in 0..2 {
            let _none = ip(&["netns", "del", &self.space(side)]);
        }
    }
    /// Device in each namespace, up and with its address; removed when the program ends.
    pub fn devices(&self) -> Result<[SyncDevice; 2], CliError> {
        Ok([self.device(0)?, self.device(1)?])
    }
    fn device(&self, side: usize) -> Result<SyncDevice, CliError> {
        // Created in this namespace under a unique name, then moved; the open file stays attached.
        let space = self.space(side);
        let born = format!("al{}{side}", std::process::id());
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
    pub fn enter(&self, side: usize) -> Vec<String> {
        ["ip", "netns", "exec", &self.space(side)]
            .map(String::from)
            .to_vec()
    }
}

pub struct OwnSpaces(Namespaces);

impl OwnSpaces {
    /// Creates new namespaces, after removing those of a killed run.
    pub fn make(name: &str) -> Result<OwnSpaces, CliError> {
        let own = OwnSpaces(Namespaces::named(name));
        own.0.remove();
        own.0.make()?;
        Ok(own)
    }
    pub fn enter(&self, side: usize) -> Vec<String> {
        self.0.enter(side)
    }
}

impl Drop for OwnSpaces {
    fn drop(&mut self) {
        self.0.remove();
    }
}
