use std::{net::SocketAddr, path::PathBuf};

use clap::Args;
use tracing::warn;

use crate::{
    config::view::{FOXGLOVE, ViewConfig},
    process::scheduling,
};

/// Flags of every process.
#[derive(Args, Clone, Debug)]
pub struct ProcessArgs {
    /// The computer's configuration (TOML)
    #[arg(long, value_name = "FILE")]
    pub config: PathBuf,
    /// Record into this flight's directory, instead of a new one below recorder.directory
    #[arg(long, alias = "log", hide = true, value_name = "DIR")]
    pub flight: Option<PathBuf>,
    /// End when standard input closes, so that processes end with their supervisor
    #[arg(long, hide = true)]
    pub supervised: bool,
    /// Scheduling of the process.
    #[command(flatten)]
    pub scheduling: Scheduling,
}

/// Path of a recording to write; the name must end in .mcap.
pub fn mcap_file(text: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("mcap")) {
        return Ok(path);
    }
    Err("recordings are MCAP: choose a name that ends in .mcap".into())
}

pub fn page_address(text: &str) -> Result<SocketAddr, String> {
    let why = "an address and a port, such as 127.0.0.1:7450; a file comes before the flag";
    text.parse().map_err(|_| why.into())
}

/// Addresses at which viewers are served, if any.
#[derive(Args, Clone, Debug, Default)]
pub struct ViewArgs {
    /// Serve a page for a browser [at 127.0.0.1:7450]
    ///
    /// The configuration may name another address; ADDR:PORT comes before both.
    #[arg(long, value_name = "ADDR:PORT", num_args = 0..=1, value_parser = page_address)]
    pub view: Option<Option<SocketAddr>>,
    /// Serve Foxglove, too [at 127.0.0.1:8765]
    ///
    /// It receives the topics of a recording.
    #[arg(long, value_name = "ADDR:PORT", num_args = 0..=1, value_parser = page_address, requires = "view")]
    pub foxglove: Option<Option<SocketAddr>>,
}

impl ViewArgs {
    /// These flags take precedence over the configuration's addresses; None without a viewer.
    pub fn over(&self, configured: &ViewConfig) -> Option<ViewConfig> {
        if self.view.is_none() && !configured.on {
            return None;
        }
        let mut view = configured.clone();
        if let Some(Some(address)) = self.view {
            view.listen = address.to_string();
        }
        if let Some(address) = self.foxglove {
            view.foxglove = address.map_or_else(|| FOXGLOVE.into(), |a| a.to_string());
        }
        Some(view)
    }
}

/// Flags of a computer's service.
#[derive(Args, Debug)]
pub struct ServiceArgs {
    #[command(flatten)]
    pub process: ProcessArgs,
    #[command(flatten)]
    pub view: ViewArgs,
}

/// Scheduling that a supervisor requests for its process.
#[derive(Args, Clone, Debug, Default, PartialEq, Eq)]
pub struct Scheduling {
    /// Real-time priority (SCHED_FIFO)
    #[arg(long, hide = true, value_name = "PRIORITY")]
    pub realtime: Option<u8>,
    /// Processors on which the process may run
    #[arg(long, hide = true, value_delimiter = ',', value_name = "NUMBERS")]
    pub processors: Vec<u16>,
}

impl Scheduling {
    pub fn where_permitted(&self, permitted: bool) -> Scheduling {
        Scheduling {
            realtime: self.realtime.filter(|_| permitted),
            processors: self.processors.clone(),
        }
    }
    pub fn flags(&self) -> Vec<String> {
        let mut flags = Vec::new();
        if let Some(priority) = self.realtime {
            flags.extend(["--realtime".into(), priority.to_string()]);
        }
        if !self.processors.is_empty() {
            let numbers: Vec<String> = self.processors.iter().map(u16::to_string).collect();
            flags.extend(["--processors".into(), numbers.join(",")]);
        }
        flags
    }
    pub fn apply(&self) {
        if !self.processors.is_empty() && !scheduling::keep_to(&self.processors) {
            warn!("processors {:?}: not permitted or absent", self.processors);
        }
        if self.realtime.is_some_and(|p| !scheduling::set_real_time(p)) {
            warn!("real-time priority {:?} is not permitted", self.realtime);
        }
    }
    /// Locks the memory of a real-time process. Call it once the process has joined shared memory.
    pub fn lock_memory(&self) {
        if self.realtime.is_some() && !scheduling::lock_memory() {
            warn!(
                "not permitted to lock memory, so a page fault may delay a step: LimitMEMLOCK, or ulimit -l unlimited"
            );
        }
    }
}

/// One of the drone's cameras.
#[derive(Args, Debug)]
pub struct CameraArgs {
    #[command(flatten)]
    pub process: ProcessArgs,
    /// Source of images, instead of camera.source or uvdar.source
    #[arg(long, value_name = "SOURCE")]
    pub source: Option<String>,
    /// Examine the images without the drone's other processes, and print each detection (JSON)
    #[arg(long)]
    pub print: bool,
}

/// The link to a real autopilot.
#[derive(Args, Debug)]
pub struct AutopilotArgs {
    /// Flags of every process
    #[command(flatten)]
    pub process: ProcessArgs,
    /// The autopilot's address: udpin://127.0.0.1:14540, udpin://0.0.0.0:14540?from=IP, udpout://HOST:PORT,
    /// tcpout://HOST:PORT, serial:///dev/ttyACM0:921600 [default: the configuration's]
    #[arg(long, value_name = "URL")]
    pub connect: Option<String>,
}
