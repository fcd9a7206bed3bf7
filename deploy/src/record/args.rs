//! The command line of recordings.

use std::path::PathBuf;

use clap::Args;

/// A recording to compute again.
#[derive(Args, Debug)]
pub struct ReplayArgs {
    /// Recording (`alight trial --record FILE.mcap`)
    #[arg(value_name = "FILE.mcap")]
    pub path: PathBuf,
    /// Print the result as one JSON object, the last line
    #[arg(long)]
    pub json: bool,
}
