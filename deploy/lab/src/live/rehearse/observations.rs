//! Rows of the check list from the state of vessel, drone and simulated world.

use alight_computer::situation::{ObservedSituation, SourceHealth};
use alight_shared::{
    metrics::{MetricName, MetricValue},
    process::ProcessKind,
    topics,
};

use super::{
    Rehearsal, flights,
    list::{self, CheckList},
};

impl Rehearsal<'_> {
    /// Shows each sensor with the rate at which the estimator used it since `before`.
    pub(super) fn show_sources(
        &self,
        list: &mut CheckList,
        before: Option<ObservedSituation>,
        now: Option<ObservedSituation>,
    ) {
        let Some(now) = now else {
            list.add(
                list::VESSEL,
                "sensors",
                false,
                "the vessel's process does not report",
            );
            return;
        };
        let process = now.process(ProcessKind::Vessel).copied().unwrap_or_default();
        let before = before.map(|b| (b.process(ProcessKind::Vessel).map_or(0, |p| p.at_ns), b.sources()));
        for (k, (source, config)) in now
            .sources()
            .iter()
            .zip(&self.plan.vessel.sensor.sources)
            .enumerate()
        {
            let earlier = before
                .as_ref()
                .and_then(|(at_ns, sources)| Some((*at_ns, sources.get(k)?.uses.used)));
            let (since_ns, used) = earlier.unwrap_or((process.began_ns, 0));
            let span_s = ((process.at_ns - since_ns) as f64 * 1e-9).max(1e-3);
            let rate_hz = (source.uses.used - used.min(source.uses.used)) as f64 / span_s;
            let mut figure = format!("{rate_hz:.1} Hz used");
            for (count, name) in [
                (source.report.status.decoded.corrupted, "damaged"),
                (source.report.status.decoded.undated, "undated"),
                (source.uses.outliers, "outliers"),
                (source.uses.rejected, "rejected"),
            ] {
                if count > 0 {
                    figure += &format!(", {count} {name}");
                }
            }
            if let Some(why) = &source.report.why {
                figure += &format!("; {why}");
            }
            let format = format!("{:?}", config.format).to_lowercase();
            let ok = rate_hz > 0.0 && source.report.why.is_none();
            list.add(
                list::VESSEL,
                format!("sensor {} ({format})", source.name),
                ok,
                figure,
            );
        }
        let e = now.vessel().map(|(_, v)| v.estimator).unwrap_or_default();
        let age_s = e.estimate_age_s.unwrap_or(f64::INFINITY);
        let waves = e.waves.map_or("waves unknown".into(), |[height_m, _]| {
            format!("waves of {height_m:.1} m")
        });
        let figure = if age_s.is_finite() {
            format!("{:.0} ms old, {waves}, {} restarts", 1e3 * age_s, e.restarts)
        } else {
            "none yet".into()
        };
        list.add(list::VESSEL, "vessel's estimate", age_s < 1.0, figure);
    }
    pub(super) fn show_fault(&mut self, list: &mut CheckList) {
        let Some((process, fault)) = self.fault.as_ref().and_then(|f| Some((f.process()?, f))) else {
            return;
        };
        let report = fault.report.clone();
        let happened = if fault.freezes() { "frozen" } else { "killed" };
        let recovered = report.recovery_s.is_some();
        if process != ProcessKind::Vessel {
            let what = format!("{}, {happened}", process.name());
            list.add(list::DRONE, what, recovered, report.to_string());
            return;
        }
        let sources = self.vessel_status().map(|s| s.sources()).unwrap_or_default();
        let is_fresh = |s: &SourceHealth| s.age_s.is_some_and(|age| age < 1.0);
        let back = sources.iter().filter(|s| is_fresh(s)).count();
        let all = sources.len();
        let figure = format!("{report}, {back} of {all} sensors back");
        let what = format!("alight-vessel, {happened}");
        list.add(list::VESSEL, what, recovered && back == all, figure);
    }
    pub(super) fn show_contact(&mut self, list: &mut CheckList) {
        let number = self.plan.drone.bridge.drone_id;
        let status = self.vessel_status();
        let vessel = status.as_ref().and_then(ObservedSituation::vessel);
        let drones = vessel.map(|(_, v)| &v.drones[..]).unwrap_or_default();
        let received = drones.iter().find(|d| d.status.header.drone == number);
        let figure = match (received, vessel.and_then(|(known, _)| known.certificate.read())) {
            (None, _) => format!("it does not receive drone {number}"),
            (Some(d), Some(certificate)) => {
                format!(
                    "{} received it {:.1} s ago: {}",
                    certificate.name,
                    d.age_s,
                    d.status.state.name()
                )
            }
            (Some(d), None) => format!("received {:.1} s ago: {}", d.age_s, d.status.state.name()),
        };
        list.add(
            list::DRONE,
            "drone's status on vessel",
            received.is_some(),
            figure,
        );
    }
    pub(super) fn show_vision(&self, list: &mut CheckList) {
        let camera = self
            .observer
            .as_ref()
            .and_then(|(_, o)| o.snapshot.processes.get(&ProcessKind::Camera));
        let value = |name: MetricName| {
            let metric = camera.and_then(|c| c.metrics.iter().find(|m| m.name == name));
            metric.map(|m| m.value)
        };
        let count = |name| match value(name) {
            Some(MetricValue::Count(n)) => n,
            Some(_) | None => 0,
        };
        let seconds = |name| match value(name) {
            Some(MetricValue::Seconds(s)) => s,
            Some(_) | None => f64::NAN,
        };
        let images = count(MetricName::Images);
        let tags = count(MetricName::TagDetections);
        let figure = format!(
            "{tags} of {images} images, {:.0} ms old (99 %: {:.0})",
            1e3 * seconds(MetricName::ExposureToFixP50),
            1e3 * seconds(MetricName::ExposureToFixP99)
        );
        list.add(list::DRONE, "vision measurement", tags > 0, figure);
    }
    pub(super) fn show_verdict(&self, list: &mut CheckList) {
        let Some(landed) = &self.landed else {
            list.add(
                list::LADDER,
                "landed",
                false,
                format!("not within {} s", self.args.time_limit),
            );
            return;
        };
        let o = &landed.outcome;
        let figure = match (
            o.success,
            o.position_error_m,
            o.touchdown_speed_mps,
            o.tilt_error_deg,
        ) {
            (true, Some(off_m), Some(speed), Some(tilt)) => {
                format!("{off_m:.2} m off centre, {speed:.2} m/s, {tilt:.1} deg")
            }
            _ => format!("{}: {}", o.outcome.name(), o.reason),
        };
        list.add(list::LADDER, "landed", o.success, figure);
        let late_s = landed.latest_tick_s;
        if !o.success && late_s > topics::DRONE_STATE.stale_after.secs() {
            list.print(format_args!(
                "the simulated world was up to {late_s:.2} s late: this computer was too busy; rehearse again without \
                 other work on it"
            ));
        }
        let disarmed = o.stop_time_s.is_some() && self.armed != Some(true);
        let figure = match o.stop_time_s {
            Some(s) => format!("{s:.2} s after the first contact"),
            None => "motors on".into(),
        };
        list.add(list::LADDER, "disarmed", disarmed, figure);
        flights::show(&self.plan, list);
    }
}
