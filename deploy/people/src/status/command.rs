use alight_shared::msg::ComputerReport;
use std::time::Duration;

use alight_computer::{
    exit::{CliError, Exit},
    process::{instance::is_running, observer::InstanceFollower, supervisor::pause},
    situation::{OBSERVATION_S, configured},
    subject::{Computer, Subject},
    terminal,
};
use alight_transport::{memory::Instance, wake::end_requested};
use clap::Args;

use super::{Status, watch};

/// Status of the running processes.
#[derive(Args, Debug)]
#[command(
    after_help = "Run it as the user that runs Alight: sudo -u alight alight status\n\
Exit codes: 0 fine, 1 warnings or no process, 2 broken; with --watch that of the last status."
)]
pub struct StatusArgs {
    #[command(flatten)]
    subject: Subject,
    /// Show everything: each finding, each process, each topic as each process reads it, the radio; --json always
    /// does
    #[arg(long, conflicts_with = "watch")]
    all: bool,
    /// Repeat until stopped (q); without a terminal, print a line for each change
    #[arg(long)]
    watch: bool,
    /// Print one JSON object, the same that the page of alight view draws
    #[arg(long)]
    json: bool,
}

const JSON_PERIOD: Duration = Duration::from_secs(1);
/// Period at which messages are read, which limits the resolution of their ages.
const POLL_PERIOD: Duration = Duration::from_millis(50);

struct ComputerObserver {
    configured: ComputerReport,
    instance: Instance,
    follower: InstanceFollower,
    /// The observer has waited for the first report of every process.
    has_waited: bool,
}

impl ComputerObserver {
    fn at(computer: &Computer) -> Result<ComputerObserver, CliError> {
        let name = computer.instance();
        Ok(ComputerObserver {
            configured: configured(computer),
            instance: Instance::new(name)?,
            follower: InstanceFollower::of(name, "status")?,
            has_waited: false,
        })
    }
    /// Reads messages for `span`; the first call waits until every process can have reported. None if no process runs
    /// or the user has ended the command.
    fn read(&mut self, span: Duration) -> Option<Status> {
        let first = Duration::from_secs_f64(OBSERVATION_S) + 2 * POLL_PERIOD;
        let mut left = if self.has_waited { span } else { first };
        while !left.is_zero() {
            pause(left.min(POLL_PERIOD));
            left = left.saturating_sub(POLL_PERIOD);
            if end_requested() || !is_running(&self.instance) {
                return None;
            }
            self.follower.poll();
        }
        self.has_waited = true;
        let (_, snapshot) = self.follower.poll()?;
        Some(Status::look(Some(snapshot), &self.configured))
    }
}

pub fn run(args: &StatusArgs) -> Result<Exit, CliError> {
    let mut observer = ComputerObserver::at(&args.subject.computer()?)?;
    let Some(first) = observer.read(Duration::ZERO) else {
        if end_requested() {
            return Ok(Exit::Success);
        }
        let absent = Status::absent(&observer.configured);
        show(args, &absent)?;
        return Ok(absent.worst.exit());
    };
    let mut worst = first.worst;
    let mut next = Some(first);
    if args.watch && !args.json {
        watch::run(|span| {
            let status = next.take().or_else(|| observer.read(span));
            worst = status.as_ref().map_or(worst, |s| s.worst);
            Ok(status)
        })?;
    } else {
        while let Some(status) = next.take() {
            worst = status.worst;
            show(args, &status)?;
            next = args.watch.then(|| observer.read(JSON_PERIOD)).flatten();
        }
    }
    Ok(worst.exit())
}

fn show(args: &StatusArgs, status: &Status) -> Result<(), CliError> {
    if args.json {
        terminal::json(status)?;
    } else if args.all {
        terminal::line(status.all());
    } else {
        terminal::line(status.text());
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[derive(Parser)]
    struct Command {
        #[command(flatten)]
        args: StatusArgs,
    }

    #[test]
    fn everything_as_json() {
        let parsed =
            |flags: &[&str]| Command::try_parse_from([&["status"][..], flags].concat()).map(|c| c.args);
        assert!(parsed(&["--all", "--json"]).is_ok_and(|a| a.all && a.json));
        assert!(parsed(&["--all", "--watch"]).is_err());
    }
}
