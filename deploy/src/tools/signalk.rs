//! `alight signalk`: what this computer knows, for the boat's Signal K server.

use std::time::Duration;

use alight_shared::transport::clock::steady_ns;
use alight_shared::transport::wake::end_requested;
use clap::Args;
use tokio::time::{MissedTickBehavior, interval, sleep};

use crate::config::link_url::LinkUrl;
use crate::exit::{CliError, Exit};
use crate::io::runtime;
use crate::io::web_socket::{SignalKSocket, Subscribe};
use crate::process::observer::Follower;
use crate::signalk::Deltas;
use crate::status::Status;
use crate::status::situation::{Known, Situation};
use crate::status::subject::{Computer, Subject};
use crate::terminal;

/// Whose, and where the server is.
#[derive(Args, Debug)]
#[command(after_help = "Run it as the user that runs Alight, beside its service:\n  \
sudo -u alight alight signalk --connect 'ws://venus.local:3000?token=/etc/alight/signalk.token'\n\
It sends alight.* and notifications.alight.*; nothing that comes back is an order.\n\
It ends by Ctrl-C, and nothing in a flight waits for it. docs/signalk.md")]
pub struct SignalKArgs {
    #[command(flatten)]
    subject: Subject,
    /// The server, with the file of a token where it asks for one
    #[arg(long, value_name = "URL", default_value = "ws://127.0.0.1:3000")]
    connect: String,
}

/// What is new is sent this often.
const PERIOD: Duration = Duration::from_millis(500);
/// A server that is not there is tried again after this long.
const RETRY: Duration = Duration::from_secs(2);

/// Publishes until it is asked to end.
pub fn run(args: &SignalKArgs) -> Result<Exit, CliError> {
    if end_requested() {
        return Ok(Exit::Success);
    }
    let url: LinkUrl = args.connect.parse().map_err(CliError)?;
    let LinkUrl::SignalK(host, token) = &url else {
        return Err(CliError(format!(
            "--connect {url}: write ws://HOST:3000, or ws://HOST:3000?token=FILE"
        )));
    };
    let mut look = Look::at(args.subject.fixed()?)?;
    runtime::block_on(async {
        let (mut deltas, mut before) = (Deltas::default(), None);
        while !end_requested() {
            let connected = SignalKSocket::connect(host, Subscribe::None, token.as_deref()).await;
            let why = match connected {
                Ok(socket) => {
                    terminal::line(format_args!("connected to {url}"));
                    before = None;
                    deltas.forget();
                    publish(socket, &mut deltas, &mut look).await
                }
                Err(e) => Err(e),
            };
            let Err(why) = why.map_err(|e| e.to_string()) else {
                break;
            };
            if before.as_ref() != Some(&why) {
                terminal::line(format_args!("{url}: {why}; trying again"));
            }
            before = Some(why);
            sleep(RETRY).await;
        }
        Ok(Exit::Success)
    })
}

/// Sends what is new until the connection ends, or this is asked to.
async fn publish(mut socket: SignalKSocket, deltas: &mut Deltas, look: &mut Look) -> std::io::Result<()> {
    let mut due = interval(PERIOD);
    due.set_missed_tick_behavior(MissedTickBehavior::Delay);
    while !end_requested() {
        tokio::select! {
            // A greeting, and answers to what others ask of these paths: nothing of it counts.
            received = socket.receive() => drop(received?),
            _ = due.tick() => {
                if let Some(delta) = deltas.delta(&look.status(), steady_ns()) {
                    socket.send(delta).await?;
                }
            }
        }
    }
    Ok(())
}

/// Looks at the computer's processes whenever they run.
struct Look {
    computer: Computer,
    known: Known,
    follower: Follower,
}

impl Look {
    fn at(subject: Subject) -> Result<Look, CliError> {
        let computer = subject.computer()?;
        let (instance, known) = match &computer {
            Computer::Vessel(v) => (&v.instance, Known::vessel(v)),
            Computer::Drone(d) => (&d.instance, Known::drone(d)),
        };
        let follower = Follower::of(instance, "signalk")?;
        Ok(Look {
            follower,
            known,
            computer,
        })
    }
    fn status(&mut self) -> Status {
        let now_ns = steady_ns();
        if let Computer::Vessel(vessel) = &self.computer {
            self.known.refresh(vessel, now_ns);
        }
        match self.follower.poll() {
            Some((_, seen)) if !seen.processes.is_empty() => {
                Status::of(Situation::of(self.known.clone(), seen, now_ns))
            }
            Some(_) | None => Status::absent(&self.known),
        }
    }
}
