//! The newest message of each topic of an instance.

use core::ops::Deref;
use std::collections::BTreeMap;

use alight_shared::{
    geodesy::Datum,
    msg::{
        AttitudeResponse, AutopilotState, ComputerReport, DeckForecast, DeckGrant, DroneState, LinkState,
        MissionState, Plan, SourceReport, TwoDigits, VesselStatus, WaveModel,
    },
    plain::Plain,
    process::{ProcessKind, ProcessState},
    time::DroneClock,
};
use nalgebra::Vector3;

/// Time with three digits, from microseconds to seconds.
pub fn time(s: f64) -> String {
    if !s.is_finite() {
        "-".into()
    } else if s.abs() < 1e-3 {
        format!("{:.0} us", s * 1e6)
    } else if s.abs() < 0.0995 {
        format!("{} ms", TwoDigits(s * 1e3))
    } else {
        format!("{} s", TwoDigits(s))
    }
}

/// Time in whole numbers, from seconds to hours.
pub fn minutes(s: f64) -> String {
    if !s.is_finite() {
        "-".into()
    } else if s < 90.0 {
        format!("{s:.0} s")
    } else if s < 5400.0 {
        format!("{:.0} min", s / 60.0)
    } else {
        format!("{:.0} h", s / 3600.0)
    }
}

/// Minimum age of a stale message, s: viewers poll a few times a second.
const MIN_STALE_S: f64 = 1.0;

#[derive(Clone, Copy, Debug)]
pub struct Newest<T> {
    value: Option<T>,
    at_ns: i64,
}

impl<T> Default for Newest<T> {
    fn default() -> Self {
        Newest {
            value: None,
            at_ns: 0,
        }
    }
}

impl<T> From<T> for Newest<T> {
    fn from(value: T) -> Self {
        Newest {
            value: Some(value),
            at_ns: 0,
        }
    }
}

impl<T> Deref for Newest<T> {
    type Target = Option<T>;
    fn deref(&self) -> &Option<T> {
        &self.value
    }
}

impl<T: Plain> Newest<T> {
    pub fn set(&mut self, now_ns: i64, value: Option<T>) {
        if value.is_some() {
            *self = Newest { value, at_ns: now_ns };
        }
    }
    /// Time since the arrival, s; infinite before the first message.
    pub fn age_s(&self, now_ns: i64) -> f64 {
        let age_s = now_ns.saturating_sub(self.at_ns).max(0) as f64 * 1e-9;
        if self.value.is_some() {
            age_s
        } else {
            f64::INFINITY
        }
    }
    /// Whether the age exceeds the topic's staleness limit.
    pub fn is_old(&self, now_ns: i64) -> bool {
        self.age_s(now_ns) > T::TOPIC.stale_after.secs().max(MIN_STALE_S)
    }
    pub fn fresh(&self, now_ns: i64) -> Option<&T> {
        self.value.as_ref().filter(|_| !self.is_old(now_ns))
    }
}

#[derive(Clone, Debug, Default)]
pub struct Snapshot {
    /// Time at which the observer began to receive, on its clock, ns.
    pub since_ns: i64,
    pub processes: BTreeMap<ProcessKind, ProcessState>,
    pub mission: Newest<MissionState>,
    pub autopilot: Newest<AutopilotState>,
    pub drone: Newest<DroneState>,
    pub forecast: Newest<DeckForecast>,
    pub link: Newest<LinkState>,
    pub plan: Newest<Plan>,
    pub grant: Newest<DeckGrant<DroneClock>>,
    pub wave: Newest<WaveModel<DroneClock>>,
    /// Response of the drone's attitude to set-points, as the pilot estimates it.
    pub response: Option<AttitudeResponse>,
    pub vessel: Newest<VesselStatus>,
    /// Reports on the vessel's real sensors, by their index in its configuration.
    pub sources: BTreeMap<u32, SourceReport>,
    pub computer: Newest<ComputerReport>,
}

impl Snapshot {
    /// Origin of the drone's frame, and distance to the deck by the newest forecast, m.
    pub fn frame(&self) -> Option<(Datum, Option<f64>)> {
        let drone = (*self.drone)?;
        let deck = self.forecast.and_then(|f| f.stages.first().copied());
        let apart = deck.map(|d| (drone.position() - Vector3::from(d.position)).norm());
        Some((drone.datum, apart))
    }
    /// Age of the newest plan relative to the mission's newest time stamp (same clock), s; infinite before the first
    /// plan.
    pub fn plan_age_s(&self, now_ns: i64) -> f64 {
        let since_s = self.plan.age_s(now_ns);
        match (*self.plan, *self.mission) {
            (Some(plan), Some(mission)) => {
                let made_s = (mission.header.at - plan.header.at).secs() + self.mission.age_s(now_ns);
                since_s.max(made_s)
            }
            _ => since_s,
        }
    }
    /// One line of at most 100 columns; `now_ns` is on the observer's clock.
    pub fn line(&self, now_ns: i64) -> String {
        if let (Some(vessel), None) = (&*self.vessel, &*self.mission) {
            let estimate = vessel.estimator.estimate_age_s.map_or("no estimate".into(), time);
            return format!("estimate {estimate} old, {} drones received", vessel.drones.len());
        }
        let state = self.mission.map_or("-", |m| m.state.name());
        let waiting = self.mission.map(|m| m.waiting.to_string()).unwrap_or_default();
        let link = self.link.map_or_else(
            || "link -".into(),
            |l| format!("link {} old, {:.0} % lost", time(l.age_s), 100.0 * l.loss),
        );
        let plan = match *self.plan {
            None => "no plan".into(),
            Some(_) => format!("plan {} old", time(self.plan_age_s(now_ns))),
        };
        let solve = self
            .processes
            .get(&ProcessKind::Planner)
            .map_or_else(String::new, |p| {
                format!(", solved in {}/{}", time(p.step_p50_s), time(p.step_p99_s))
            });
        let mut line = format!("{state}: {link}; {plan}{solve}; {waiting}");
        if let Some((cut, _)) = line.char_indices().nth(100) {
            line.truncate(cut);
        }
        line
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn status_line_width() {
        assert_eq!(time(0.000_042), "42 us");
        assert_eq!(time(0.0217), "22 ms");
        assert_eq!(time(0.1742), "0.17 s");
        assert_eq!(time(12.34), "12 s");
        assert_eq!(time(f64::INFINITY), "-");
        let snapshot = Snapshot {
            mission: MissionState::default().into(),
            link: LinkState {
                age_s: 0.062,
                loss: 0.02,
                ..LinkState::default()
            }
            .into(),
            ..Snapshot::default()
        };
        let line = snapshot.line(0);
        assert!(
            line.contains("62 ms") && line.contains("2 % lost") && line.chars().count() <= 100,
            "{line}"
        );
    }
}
