//! Flags of the processes.

use std::path::PathBuf;

use clap::Args;

/// A process.
#[derive(Args, Debug)]
pub struct ProcessArgs {
    /// Its computer's configuration (TOML)
    #[arg(long, value_name = "FILE")]
    pub config: PathBuf,
    /// Log what it consumed into this directory
    #[arg(long, value_name = "DIR")]
    pub log: Option<PathBuf>,
    /// End when standard input closes: a supervisor that dies takes its processes with it
    #[arg(long, hide = true)]
    pub supervised: bool,
}

/// One of the drone's cameras.
#[derive(Args, Debug)]
pub struct CameraArgs {
    /// The process.
    #[command(flatten)]
    pub process: ProcessArgs,
    /// Where images come from, in the place of camera.source or uvdar.source
    #[arg(long, value_name = "SOURCE")]
    pub source: Option<String>,
    /// Look at what the source has without the drone's other processes, and print each sighting (JSON)
    #[arg(long)]
    pub print: bool,
}

/// The vessel's real sensors.
#[derive(Args, Debug)]
pub struct SensorsArgs {
    /// The vessel's configuration (TOML), with a table [[sensor.sources]] for each sensor
    #[arg(long, value_name = "FILE")]
    pub config: PathBuf,
    /// Say what became of each source's bytes as JSON objects, one a line
    #[arg(long)]
    pub json: bool,
    /// End when standard input closes
    #[arg(long, hide = true)]
    pub supervised: bool,
}

/// The link to a real autopilot.
#[derive(Args, Debug)]
pub struct AutopilotArgs {
    /// What every process has
    #[command(flatten)]
    pub process: ProcessArgs,
    /// Where the autopilot is: udpin://0.0.0.0:14540, udpout://HOST:PORT, tcpout://HOST:PORT,
    /// tcpin://0.0.0.0:PORT, serial:///dev/ttyACM0:921600 [default: the configuration's]
    #[arg(long, value_name = "URL")]
    pub connect: Option<String>,
}
