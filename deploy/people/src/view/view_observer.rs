//! Observer of steps, which puts messages of the nodes on the board and shows the board to the viewers.

use alight_shared::{
    msg::{ComputerReport, DeckForecast, DroneState},
    process::ProcessKind,
    step::Step,
};
use std::time::Duration;

use alight_computer::{
    exit::{CliError, Doing},
    playback::{Bodies, Viewer},
    process::supervisor::pause,
    record::{
        messages::{Message, each_message},
        observer::StepObserver,
        scenery::Scenery,
        views::Views,
    },
    terminal::{note, open_browser},
};
use alight_shared::time::{Span, Time, TrueTime};
use alight_transport::clock::steady_ns;

use crate::{
    status::{Status, go::Go},
    view::{
        board::Board,
        live_sink::LiveSink,
        picture::Picture,
        server::{Served, Server},
    },
};

const PICTURE_PERIOD_NS: i64 = 200_000_000;
/// Maximum pause while a simulated flight is slowed to real time.
const MAX_PAUSE: Duration = Duration::from_millis(50);
/// Time for which a simulated flight waits for a viewer before it begins.
const ARRIVAL_NS: i64 = 600_000_000_000;
/// Time for which the last picture of a simulation remains available to viewers.
const LINGER_NS: i64 = 10_000_000_000;

const SCENE_MS: i64 = 1_000;

struct Live {
    sink: LiveSink,
    views: Views,
    scenery: Option<Scenery>,
    /// Newest forecast and state that have not been drawn yet.
    forecast: Option<DeckForecast>,
    drone: Option<DroneState>,
}

pub struct ViewObserver {
    pub server: Server,
    pub board: Board,
    live: Option<Live>,
    next_ns: i64,
    newest: Time<TrueTime>,
    /// Clock of the steps minus the clock of the processes' reports.
    offset: Span,
    pace: Pace,
}

impl ViewObserver {
    /// Starts the server; `paced` slows simulated steps to real time.
    pub fn start(
        served: Served,
        known: ComputerReport,
        bodies: &Bodies,
        paced: bool,
    ) -> Result<ViewObserver, CliError> {
        let server = Server::start(served)?;
        let mut live = None;
        if let Some(context) = server.context() {
            let mut sink = LiveSink::new(context);
            let opened = Views::new(&mut sink).doing("opening Foxglove's channels")?;
            let scenery = bodies
                .as_ref()
                .map(|(d, a)| Scenery::new(&mut sink, d, a, SCENE_MS));
            live = Some(Live {
                views: opened,
                scenery: scenery.transpose().doing("opening Foxglove's channels")?,
                sink,
                forecast: None,
                drone: None,
            });
        }
        let mut board = Board::new(known);
        board.heights_m = bodies.as_ref().map(|(d, a)| [a.feet_below_m, -d.centre_m[2]]);
        Ok(ViewObserver {
            server,
            board,
            live,
            next_ns: i64::MIN,
            newest: Time::EPOCH,
            offset: Span::ZERO,
            pace: if paced { Pace::Waiting } else { Pace::Free },
        })
    }
    /// Clears the board except for the ended flights, when another set of processes runs. `offset` is the clock of
    /// its steps minus the clock of its reports.
    pub fn reset(&mut self, offset: Span) {
        self.offset = offset;
        self.board.reset(Time::from_nanos(steady_ns()));
        self.next_ns = i64::MIN;
    }
    pub fn board_time(&self, t: Time<TrueTime>) -> Time<TrueTime> {
        t - self.offset
    }
    /// Shows `status` at `t`, with the flights that ended and no other data.
    pub fn show_nothing(&self, t: Time<TrueTime>, status: Status) {
        let Picture { flights, result, .. } = self.board.picture(t - self.offset);
        self.server.show(Picture {
            status,
            flights,
            result,
            ..Picture::default()
        });
    }
    fn is_watched(&self) -> bool {
        self.server.is_watched() || self.live.as_ref().is_some_and(|live| live.sink.is_watched())
    }
    /// Shows the last picture, with `over` as the reason for the end.
    pub fn end(&self, over: &'static str) {
        let mut picture = self.board.picture(self.newest - self.offset);
        picture.over = Some(over);
        if let Some(why) = self.board.too_slow() {
            picture.status.go = Go::unknown(why);
        }
        self.server.show(picture);
    }
    pub fn message(&mut self, t: Time<TrueTime>, message: &Message<'_>) {
        self.board.message(t - self.offset, message);
        if let Message::Drone(_) = message {
            self.pace.begin(t);
        }
        if let Some(live) = &mut self.live {
            live.message(t, message);
        }
    }
    /// Shows a picture if one is due; all messages of `t` have arrived.
    pub fn show(&mut self, t: Time<TrueTime>) {
        self.newest = t;
        self.board.sample(t - self.offset);
        if let Some(live) = &mut self.live {
            live.draw(t);
        }
        if t.nanos() >= self.next_ns {
            self.next_ns = t.nanos() + PICTURE_PERIOD_NS;
            self.server.show(self.board.picture(t - self.offset));
        }
    }
}

impl Viewer for ViewObserver {
    fn begin(&self, alone: bool) {
        let lines = self.server.lines();
        lines.iter().for_each(|line| note(alone, line));
        open_browser(&self.server.page_url());
        note(alone, "waiting for a viewer, at most 10 min; Ctrl-C ends it");
        let until = steady_ns() + ARRIVAL_NS;
        while !self.is_watched() && steady_ns() < until {
            pause(MAX_PAUSE);
        }
    }
    fn linger(&self) {
        let until = steady_ns() + LINGER_NS;
        while self.server.is_watched() && steady_ns() < until {
            self.end("the flight has ended");
            pause(4 * MAX_PAUSE);
        }
    }
}

impl StepObserver for ViewObserver {
    fn step(&mut self, t: Time<TrueTime>, step: &Step<'_>) {
        each_message(step, &mut |message| self.message(t, &message));
        self.show(t);
        if step.process == ProcessKind::Mission {
            self.pace.hold(t);
        }
    }
}

impl Live {
    fn message(&mut self, t: Time<TrueTime>, message: &Message<'_>) {
        if let Message::Forecast(forecast) = *message {
            self.forecast = Some(*forecast);
        }
        if let Message::Drone(drone) = *message {
            // The drone's reported NED frame is that of the scene, except for the water level.
            let at = drone.position;
            let at = self.scenery.as_ref().map_or(at, |s| s.in_scene(at));
            (self.views.true_drone, self.drone) = (Some(at), Some(*drone));
        }
        self.views.message(&mut self.sink, t, message);
    }
    /// Draws vessel and drone if a new forecast or state has arrived.
    fn draw(&mut self, t: Time<TrueTime>) {
        let (forecast, drone) = (self.forecast.take(), self.drone.take());
        if let Some(scenery) = &mut self.scenery
            && (forecast.is_some() || drone.is_some())
        {
            scenery.show(&mut self.sink, &self.views, t, forecast.as_ref(), drone.as_ref());
        }
    }
}

enum Pace {
    Free,
    /// The drone has not appeared: there is nothing to show yet.
    Waiting,
    /// Steady clock minus the world's time at which the drone appeared, ns.
    From(i64),
}

impl Pace {
    fn begin(&mut self, t: Time<TrueTime>) {
        if matches!(self, Pace::Waiting) {
            *self = Pace::From(steady_ns() - t.nanos());
        }
    }
    fn hold(&mut self, t: Time<TrueTime>) {
        let Pace::From(offset) = *self else { return };
        let ahead = || t.nanos() - (steady_ns() - offset);
        while ahead() > 1_000_000 {
            pause(Duration::from_nanos(ahead().unsigned_abs()).min(MAX_PAUSE));
        }
        if ahead() < -1_000_000_000 {
            // A computer slower than real time does not catch up.
            *self = Pace::From(steady_ns() - t.nanos());
        }
    }
}
