use alight_shared::msg::ComputerReport;
use std::time::Duration;

use alight_computer::{
    config::link_url::LinkUrl,
    exit::{CliError, Exit},
    io::{
        runtime,
        web_socket::{SignalKSocket, Subscribe},
    },
    process::observer::InstanceFollower,
    situation::configured,
    subject::Subject,
    terminal,
};
use alight_transport::{clock::steady_ns, wake::end_requested};
use clap::Args;
use tokio::time::{Instant, MissedTickBehavior, interval, sleep};

use crate::signalk::Deltas;
use alight_people::status::Status;

/// Computer, and address of the server.
#[derive(Args, Debug)]
#[command(after_help = "Run it as the user that runs Alight, next to its service:\n  \
sudo -u alight alight signalk --connect ws://venus.local:3000\n\
If the server asks for a token: 'ws://HOST:3000?token=FILE'.\n\
It sends alight.* and notifications.alight.*; it takes no orders.\n\
Ctrl-C ends it; no flight waits for it. alight help view")]
pub struct SignalKArgs {
    #[command(flatten)]
    subject: Subject,
    /// Server, with the file of a token if the server asks for one
    #[arg(long, value_name = "URL", default_value = "ws://127.0.0.1:3000")]
    connect: String,
}

const PERIOD: Duration = Duration::from_millis(500);
/// Pause before an absent server is tried again; it doubles with each attempt up to a maximum.
const RETRY: Duration = Duration::from_secs(2);
const MAX_RETRY: Duration = Duration::from_secs(32);

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
    let mut look = ComputerObserver::at(&args.subject.fixed()?)?;
    runtime::block_on(async {
        let mut deltas = Deltas::default();
        let mut retry = Retry::default();
        while !end_requested() {
            let connected = SignalKSocket::connect(host, Subscribe::None, token.as_deref()).await;
            let why = match connected {
                Ok(socket) => {
                    deltas.forget();
                    let taken = || {
                        if retry.taken() {
                            terminal::line(format_args!("connected to {url}"));
                        }
                    };
                    publish(socket, &mut deltas, &mut look, taken).await
                }
                Err(e) => Err(e),
            };
            let Err(why) = why.map_err(|e| e.to_string()) else {
                break;
            };
            let (is_news, pause) = retry.failed(&why);
            if is_news {
                terminal::line(format_args!("{url}: {why}; trying again"));
            }
            wait(pause).await;
        }
        Ok(Exit::Success)
    })
}

async fn wait(pause: Duration) {
    let until = Instant::now() + pause;
    while !end_requested() && Instant::now() < until {
        sleep(PERIOD.min(pause)).await;
    }
}

#[derive(Debug)]
struct Retry {
    /// Newest reported fault; None while the server accepts messages.
    reported: Option<String>,
    pause: Duration,
    connected: bool,
}

impl Default for Retry {
    fn default() -> Self {
        Retry {
            reported: None,
            pause: RETRY,
            connected: false,
        }
    }
}

impl Retry {
    /// Records that a delta was sent and the connection is still open; returns whether this is new.
    fn taken(&mut self) -> bool {
        self.reported = None;
        self.pause = RETRY;
        !core::mem::replace(&mut self.connected, true)
    }
    /// Records that the connection is missing or lost; returns whether this is new, and the time to wait.
    fn failed(&mut self, why: &str) -> (bool, Duration) {
        let pause = self.pause;
        self.pause = (2 * pause).min(MAX_RETRY);
        self.connected = false;
        let is_news = self.reported.as_deref() != Some(why);
        self.reported = Some(why.into());
        (is_news, pause)
    }
}

/// Sends new values until the connection ends or the command is stopped. A delta counts as `taken` if the connection
/// is still open at the next period.
async fn publish(
    mut socket: SignalKSocket,
    deltas: &mut Deltas,
    look: &mut ComputerObserver,
    mut taken: impl FnMut(),
) -> std::io::Result<()> {
    let mut due = interval(PERIOD);
    due.set_missed_tick_behavior(MissedTickBehavior::Delay);
    let mut is_sent = false;
    while !end_requested() {
        tokio::select! {
            // Ignores greetings, and replies to other clients' requests for these paths.
            received = socket.receive() => drop(received?),
            _ = due.tick() => {
                if is_sent {
                    taken();
                }
                if let Some(delta) = deltas.delta(&look.status(), steady_ns()) {
                    socket.send(delta).await?;
                    is_sent = true;
                }
            }
        }
    }
    Ok(())
}

struct ComputerObserver {
    configured: ComputerReport,
    follower: InstanceFollower,
}

impl ComputerObserver {
    fn at(subject: &Subject) -> Result<ComputerObserver, CliError> {
        let computer = subject.computer()?;
        Ok(ComputerObserver {
            follower: InstanceFollower::of(computer.instance(), "signalk")?,
            configured: configured(&computer),
        })
    }
    fn status(&mut self) -> Status {
        let snapshot = self.follower.poll().map(|(_, snapshot)| snapshot);
        Status::look(snapshot.filter(|s| !s.processes.is_empty()), &self.configured)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_computer::{
        certificates,
        config::VesselComputerConfig,
        process::{
            facts::{Facts, Reporter},
            instance::OwnedInstance,
            supervisor::pause,
        },
    };
    use alight_shared::{
        msg::VesselStatus,
        process::{ProcessKind, ProcessState},
    };
    use alight_transport::memory::{Memory, Publisher, Services};

    #[test]
    fn signalk_server_that_takes_nothing() {
        let mut retry = Retry::default();
        let pauses: Vec<u64> = (0..6).map(|_| retry.failed("rejected").1.as_secs()).collect();
        assert_eq!(pauses, [2, 4, 8, 16, 32, 32]);
        assert!(!retry.failed("rejected").0, "reported once");
        assert!(retry.failed("closed").0 && !retry.failed("closed").0);
        assert!(retry.taken() && !retry.taken());
        assert_eq!(retry.failed("closed"), (true, RETRY));
    }

    /// The configuration file, since removed, has another number than the running process and its certificate.
    #[test]
    fn restarted_processes_by_their_topics_alone() {
        let name = format!("test-signalk-{}", std::process::id());
        let path = std::env::temp_dir().join(format!("alight-{name}.toml"));
        std::fs::write(&path, format!("vessel_id = 7\ninstance = \"{name}\"\n")).unwrap();
        let subject = Subject {
            config: Some(path.clone()),
            ..Subject::default()
        };
        let mut look = ComputerObserver::at(&subject).unwrap();
        std::fs::remove_file(path).unwrap();
        let mut status = look.status();
        assert!(!status.running && status.title == "vessel 7");

        let owned = OwnedInstance::take(&name).unwrap();
        let memory = Memory::join(owned.instance(), "test").unwrap();
        let services = Services::create(&memory).unwrap();
        owned.ready().unwrap();
        let keys = owned.file("keys");
        certificates::init(&keys, 400).unwrap();
        let own = certificates::issue(&keys, "vessel", 8, &[], 400).unwrap();
        let mut computer = VesselComputerConfig {
            vessel_id: 8,
            ..VesselComputerConfig::default()
        };
        let file = own.join(certificates::CERTIFICATE_FILE);
        computer.radio.tls.certificate = file.display().to_string();
        let mut reporter = Reporter::join(&memory, Facts::vessel(&computer)).unwrap();
        let mut states: Publisher<ProcessState> = memory.publisher().unwrap();
        let mut vessels: Publisher<VesselStatus> = memory.publisher().unwrap();
        for _ in 0..2000 {
            if status.situation.vessel().is_none() {
                reporter.poll(steady_ns(), || Some("vessel.toml was edited".into()));
                states.send(&ProcessState {
                    kind: ProcessKind::Vessel,
                    at_ns: steady_ns(),
                    ..ProcessState::default()
                });
                vessels.send(&VesselStatus::default());
                pause(Duration::from_millis(5));
                status = look.status();
            }
        }
        let found = |topic: &str| status.findings.iter().find(|f| f.topic == topic);
        assert_eq!((status.running, status.title.as_str()), (true, "vessel 8"));
        let certificate = found("certificate").unwrap();
        assert!(
            certificate.found.contains("vessel-8, 399 days left"),
            "{certificate:?}"
        );
        assert_eq!(found("configuration").unwrap().found, "vessel.toml was edited");
        look.follower.leave();
        drop((reporter, states, vessels, services, memory));
    }
}
