//! The command line of recordings.

use std::path::PathBuf;

use clap::Args;

/// A recording to compute again.
#[derive(Args, Debug)]
pub struct ReplayArgs {
    /// Recording (`alight trial --record FILE.mcap`), or logs of live processes (`--log DIR`)
    #[arg(value_name = "FILE.mcap|DIR")]
    pub path: PathBuf,
    /// Print the result as one JSON object, the last line
    #[arg(long)]
    pub json: bool,
}
