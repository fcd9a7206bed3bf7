//! Rate, age and noise of the vessel's sensors by kind, measured during a reception. The vessel's class follows from
//! them, not from the configuration.

use std::collections::BTreeMap;

use alight_shared::{
    estimation::median,
    msg::SensorReadings,
    time::{Time, VesselClock},
};

/// Silence at the end after which a sensor counts as stopped, s; longer than the period of a 1 Hz sensor.
const SILENT_S: f64 = 1.5;

/// Measurements of one kind, from the sensor with the largest number.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct KindStatistics {
    pub rate_hz: f64,
    /// Median age at reception, s.
    pub age_s: f64,
    /// Median standard deviation: position m, heading and tilt rad; zero for inertial samples.
    pub sd: f64,
    /// More than half of the measurements include the body's three angular rates.
    pub with_rates: bool,
    /// More than half of the measurements include heave.
    pub with_heave: bool,
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SensorStatistics {
    pub inertial: Option<KindStatistics>,
    pub gnss: Option<KindStatistics>,
    pub heading: Option<KindStatistics>,
    pub attitude: Option<KindStatistics>,
}

#[derive(Clone, Copy, Debug, Default)]
struct Sample {
    at_s: f64,
    age_s: f64,
    sd: f64,
    has_rates: bool,
    has_heave: bool,
}

type Series = BTreeMap<u8, Vec<Sample>>;

#[derive(Debug, Default)]
pub struct MeasurementSeries {
    inertial: Series,
    gnss: Series,
    heading: Series,
    attitude: Series,
}

impl MeasurementSeries {
    pub fn add(&mut self, now: Time<VesselClock>, readings: &[SensorReadings]) {
        let sample = |at: Time<VesselClock>, sd: f64| Sample {
            at_s: at.secs(),
            age_s: (now - at).secs(),
            sd,
            ..Sample::default()
        };
        for r in readings {
            for m in r.imu.iter() {
                let samples = self.inertial.entry(m.source).or_default();
                samples.push(sample(m.header.at, 0.0));
            }
            for m in r.gnss.iter() {
                let [across, _, _] = m.position_sd;
                self.gnss
                    .entry(m.source)
                    .or_default()
                    .push(sample(m.header.at, across));
            }
            for m in r.heading.iter() {
                let samples = self.heading.entry(m.source).or_default();
                samples.push(sample(m.header.at, m.heading_sd));
            }
            for m in r.attitude.iter() {
                self.attitude.entry(m.source).or_default().push(Sample {
                    has_rates: m.rates.is_some(),
                    has_heave: m.heave.is_some(),
                    ..sample(m.header.at, m.tilt_sd)
                });
            }
        }
    }
    pub fn measured(&self, now: Time<VesselClock>) -> SensorStatistics {
        let best = |series: &Series| {
            let statistics = series
                .values()
                .filter_map(|all| KindStatistics::of(all, now.secs()));
            statistics.max_by(|a, b| a.rate_hz.total_cmp(&b.rate_hz))
        };
        SensorStatistics {
            inertial: best(&self.inertial),
            gnss: best(&self.gnss),
            heading: best(&self.heading),
            attitude: best(&self.attitude),
        }
    }
}

impl KindStatistics {
    /// Statistics of a sensor's measurements until `until_s`, in order of reception; None without measurements.
    fn of(all: &[Sample], until_s: f64) -> Option<KindStatistics> {
        let (first, last) = (all.first()?, all.last()?);
        let silent_s = until_s - (last.at_s + last.age_s);
        let steps = all.len().saturating_sub(1) as f64;
        let span_s = last.at_s - first.at_s + if silent_s > SILENT_S { silent_s } else { 0.0 };
        let most = |has: fn(&Sample) -> bool| 2 * all.iter().filter(|s| has(s)).count() > all.len();
        Some(KindStatistics {
            // A single measurement only bounds the rate from above.
            rate_hz: if steps > 0.0 {
                steps / span_s.max(1e-3)
            } else {
                1.0 / silent_s.max(1.0)
            },
            age_s: median(all.iter().map(|s| s.age_s))?,
            sd: median(all.iter().map(|s| s.sd))?,
            with_rates: most(|s| s.has_rates),
            with_heave: most(|s| s.has_heave),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::msg::{AttitudeFix, Header, Seq};

    /// Statistics of a sensor of this rate that sends from 0 s to `end_s`, each attitude 0.1 s late, received for 2.5
    /// s.
    fn received(rate_hz: f64, end_s: f64, fix: AttitudeFix) -> KindStatistics {
        let mut received = MeasurementSeries::default();
        for k in 0..(rate_hz * end_s) as u32 {
            let at_s = f64::from(k) / rate_hz;
            let at = Time::from_secs(at_s);
            let fix = AttitudeFix {
                header: Header::new(1, 0, 0, k, at),
                ..fix
            };
            let readings = SensorReadings {
                attitude: Seq::filled([fix]),
                ..SensorReadings::default()
            };
            received.add(Time::from_secs(at_s + 0.1), &[readings]);
        }
        let measured = received.measured(Time::from_secs(2.5));
        assert_eq!((measured.inertial, measured.gnss), (None, None));
        measured.attitude.unwrap()
    }

    #[test]
    fn rate_and_age_of_what_was_received() {
        let fix = AttitudeFix {
            tilt_sd: 0.01,
            rates: Some([0.0; 3]),
            ..AttitudeFix::default()
        };
        for rate_hz in [1.0, 10.0, 20.0] {
            let found = received(rate_hz, 2.4, fix);
            assert!((found.rate_hz - rate_hz).abs() < 1e-6, "{found:?}");
            assert!((found.age_s - 0.1).abs() < 1e-6 && (found.sd - 0.01).abs() < 1e-12);
            assert!(found.with_rates && !found.with_heave);
        }
        assert!(received(20.0, 0.5, fix).rate_hz < 5.0);
        assert!(received(1.0, 1.0, AttitudeFix::default()).rate_hz < 0.5);
    }
}
