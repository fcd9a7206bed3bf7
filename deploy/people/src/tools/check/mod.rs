//! `alight check`: faults that prevent this computer from flying, with remedies. [`gather`] collects facts, [`rules`]
//! judges them. The only change that it makes is a camera's exposure, to the setting that the service would use.

mod autopilot;
mod camera;
pub mod equipment;
pub mod facts;
pub mod gather;
mod received;
mod receiver;
pub mod rules;
mod sources;
#[cfg(test)]
mod tests;
mod view;

use std::path::{Path, PathBuf};

use alight_computer::{
    exit::{CliError, Exit},
    subject::{Computer, SHIPPED},
    terminal::{self, Form},
};
use clap::Args;
use serde_json::json;

use crate::status::finding::FindingLevel;

/// Check of this computer.
#[derive(Args, Debug)]
#[command(
    after_help = "Run it as the user that runs Alight: sudo -u alight alight check\n\
Exit codes: 0 fine, 1 warnings, 2 broken."
)]
pub struct CheckArgs {
    /// Configuration of the vessel's or the drone's computer (TOML) [default: /etc/alight/vessel.toml or
    /// /etc/alight/drone.toml, whichever exists]
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Name of the set of processes, such as `sim` [default: the configuration's]
    #[arg(long)]
    pub instance: Option<String>,
    /// Output format.
    #[command(flatten)]
    pub form: Form,
}

pub fn run(args: &CheckArgs) -> Result<Exit, CliError> {
    let path = match &args.config {
        Some(path) => path.clone(),
        None => Computer::shipped().ok_or_else(|| {
            CliError(format!(
                "neither {} nor {} can be read: name --config FILE, or write both with alight init",
                SHIPPED[0], SHIPPED[1]
            ))
        })?,
    };
    if !args.form.alone() {
        return Ok(print(&path, args.instance.as_deref()).exit());
    }
    let findings = rules::judge(&gather::gather(&path, args.instance.as_deref()));
    let worst = FindingLevel::worst(&findings);
    let value = json!({ "config": path, "worst": worst, "findings": findings });
    args.form.print(&value, &findings)?;
    Ok(worst.exit())
}

pub fn print(path: &Path, instance: Option<&str>) -> FindingLevel {
    let findings = rules::judge(&gather::gather(path, instance));
    findings
        .iter()
        .for_each(|f| terminal::line(f.level.coloured(&f.lines())));
    FindingLevel::worst(&findings)
}
