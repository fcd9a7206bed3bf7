//! `alight replay --plot`: draws the last landing of a flight from the drone's own estimate, because its truth is not
//! recorded.

use std::path::{Path, PathBuf};

use alight_computer::{
    config::DroneComputerConfig,
    exit::CliError,
    playback::Plot,
    record::{
        log::{Log, ProcessStart},
        observer::StepObserver,
    },
};
use alight_shared::{
    msg::{DeckForecast, DroneState},
    step::Step,
    time::{DroneTime, Time, WorldTime},
};
use alight_sim::harness::trace::{Trace, TracePoint};
use alight_uav::{
    pilot::PilotOut,
    predictor::{PredictorIn, PredictorOut},
};
use nalgebra::{UnitQuaternion, Vector3};

use super::chart;

/// Time between points, s: 10 MB for an hour.
const STEP_S: f64 = 0.05;

pub struct BeliefPlot {
    path: PathBuf,
    flight: PathBuf,
    feet_below_m: f64,
    drone: Option<DroneState>,
    trace: Trace,
}

pub fn begin(path: &Path, log: &Log) -> Result<Box<dyn Plot>, CliError> {
    chart::can_write(path)?;
    let drone = log
        .find("predictor")
        .map(ProcessStart::config::<DroneComputerConfig>);
    let drone = drone.transpose()?.ok_or_else(|| {
        CliError(format!(
            "--plot: {} has no step of a predictor; name a flight of the drone's computer, or a recording of a trial",
            log.path().display()
        ))
    })?;
    Ok(Box::new(BeliefPlot {
        path: path.into(),
        flight: log.path().into(),
        feet_below_m: drone.drone.airframe.feet_below_m,
        drone: None,
        trace: Trace {
            step_s: STEP_S,
            ..Trace::default()
        },
    }))
}

impl BeliefPlot {
    fn predicted(&mut self, t_s: f64, now: DroneTime, i: &PredictorIn, o: &PredictorOut) {
        self.drone = i.drone.or(self.drone);
        let next_s = self
            .trace
            .points
            .last()
            .map_or(f64::NEG_INFINITY, |p| p.t_s + STEP_S);
        let (Some(drone), Some(forecast)) = (&self.drone, &o.forecast) else {
            return;
        };
        // The tolerance covers the rounding of times in floating point.
        if t_s >= next_s - 1e-6 {
            let point = point(t_s, now, drone, forecast, self.feet_below_m);
            self.trace.points.extend(point);
        }
    }
}

/// Estimated drone and deck at `now`; None while the forecast is empty.
fn point(
    t_s: f64,
    now: DroneTime,
    drone: &DroneState,
    forecast: &DeckForecast,
    feet_below_m: f64,
) -> Option<TracePoint> {
    let deck = forecast.at(now).or_else(|| forecast.stages.first().copied())?;
    // The odometry is some milliseconds old.
    let at = drone.position() + drone.velocity() * (now - drone.header.at).secs();
    let [roll, pitch, deck_yaw] = deck.euler;
    let to_deck = UnitQuaternion::from_euler_angles(roll, pitch, deck_yaw).inverse();
    let relative = to_deck * drone.attitude();
    let feet =
        to_deck * (at - Vector3::from(deck.position)) + relative * Vector3::new(0.0, 0.0, feet_below_m);
    let (roll, pitch, yaw) = relative.euler_angles();
    Some(TracePoint {
        t_s,
        drone: at.into(),
        deck: deck.position,
        drone_velocity: drone.velocity,
        deck_velocity: deck.velocity,
        deck_yaw,
        displacement: [feet.x, feet.y, -feet.z],
        relative_euler: [roll, pitch, yaw],
    })
}

impl StepObserver for BeliefPlot {
    fn step(&mut self, t: WorldTime, step: &Step<'_>) {
        let now = Time::from_nanos(step.now_ns);
        if let (Some(i), Some(o)) = (step.input(), step.output()) {
            self.predicted(t.secs(), now, i, o);
        }
        if let Some(o) = step.output::<PilotOut>() {
            let contact = |touchdown_at: DroneTime| (t - (now - touchdown_at)).secs();
            let touchdown = o.touchdown.as_ref().map(|c| contact(c.suspected_at));
            self.trace.touchdown_s = touchdown.or(self.trace.touchdown_s);
        }
    }
}

impl Plot for BeliefPlot {
    fn write(&self) -> Result<(), CliError> {
        let title = format!("Landing: {}, by the drone's own estimate", self.flight.display());
        chart::landing(&self.trace, &title, &self.path)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::msg::{DeckStage, Seq};

    #[test]
    fn drone_above_a_rolled_deck() {
        let now = DroneTime::from_nanos(5_000_000_000);
        let mut drone = DroneState {
            position: [1.0, 2.0, -3.0],
            ..DroneState::default()
        };
        drone.header.at = now;
        let stage = DeckStage {
            position: [1.0, 2.0, -1.0],
            euler: [0.2, 0.0, 0.0],
            ..DeckStage::default()
        };
        let forecast = DeckForecast {
            stages: Seq::filled([stage]),
            ..DeckForecast::default()
        };
        let p = point(1.0, now, &drone, &forecast, 0.25).unwrap();
        // 1.75 m above the centre; on a deck that is rolled to starboard, starboard points down.
        assert!((p.displacement[1] + 1.75 * 0.2_f64.sin()).abs() < 1e-9, "{p:?}");
        assert!((p.displacement[2] - 1.75 * 0.2_f64.cos()).abs() < 1e-9, "{p:?}");
        assert!((p.relative_euler[0] + 0.2).abs() < 1e-9, "{p:?}");
    }
}
