//! The radio's keys, and impairments of the radio for trials: named profiles and files.

use alight_shared::config::{self, Check, Keys};
use alight_shared::time::{Time, TrueTime};
use alight_shared::topics;
use alight_sim::radio::{Direction, Radio, RadioConfig};
use alight_sim::streams::Streams;

use super::config::LinkImpairment;
use crate::Refused;

/// The key of `topic` as vessel `id` publishes it.
pub fn vessel_key(id: u32, topic: &str) -> String {
    format!("alight/vessel-{id}/{topic}")
}
/// The key of `topic` as drone `id` publishes it.
pub fn drone_key(id: &str, topic: &str) -> String {
    format!("alight/drone-{id}/{topic}")
}
/// What processes say about themselves.
pub const STATUS: &str = "status";
/// What drones say about themselves, from any drone. One chunk of a key is `drone-N`.
pub fn any_drone_status() -> String {
    format!("alight/drone-$*/{}", topics::DRONE_STATUS.name)
}
/// The drones' questions for the time, from any drone.
pub fn any_time_request() -> String {
    format!("alight/*/{}", topics::TIME_REQUEST.name)
}

/// The profile `name`, or the one in the TOML file of that name; `scenario` is the scene's own.
pub fn profile(name: &str, scenario: &RadioConfig) -> Result<Option<RadioConfig>, Refused> {
    let quiet = RadioConfig {
        duplicate: 0.0,
        loss: 0.0,
        ..RadioConfig::default()
    };
    Ok(match name {
        "clean" => None,
        "scenario" => Some(scenario.clone()),
        // Ours: an access point on the mast, the drone within a few ten metres.
        "wifi-near" => Some(RadioConfig {
            delay_s: 0.004,
            delay_sd_s: 0.003,
            delay_min_s: 0.001,
            loss: 0.005,
            ..quiet
        }),
        // Ours: the edge of its range.
        "wifi-far" => Some(RadioConfig {
            delay_s: 0.03,
            delay_sd_s: 0.025,
            delay_min_s: 0.002,
            loss: 0.1,
            ..quiet
        }),
        // Ours: a mesh of narrow-band radios, several hops.
        "radio-mesh" => Some(RadioConfig {
            delay_s: 0.12,
            delay_sd_s: 0.04,
            delay_min_s: 0.04,
            loss: 0.05,
            ..quiet
        }),
        // 30 % loss, 100 ms latency, 30 ms jitter: what the project promises to land with.
        "storm" => Some(RadioConfig {
            delay_s: 0.1,
            delay_sd_s: 0.03,
            delay_min_s: 0.005,
            loss: 0.3,
            ..quiet
        }),
        // Ours: 5 s of silence every 25 s from a minute on.
        "blackout-5s" => {
            let outages_s = (0..10)
                .map(|k| 65.0 + 25.0 * f64::from(k))
                .map(|t| [t, t + 5.0])
                .collect();
            Some(RadioConfig {
                outages_s,
                ..RadioConfig::default()
            })
        }
        file => {
            let path = std::path::Path::new(file);
            let known = "scenario, clean, wifi-near, wifi-far, radio-mesh, storm, blackout-5s";
            if !path.exists() {
                return Err(Refused(format!(
                    "--link {file}: neither a profile ({known}) nor a file; choose one of them"
                )));
            }
            let text = std::fs::read_to_string(path)
                .map_err(|e| Refused::because(format!("reading the profile {file}"), e))?;
            let profile: RadioConfig = toml::from_str(&text)
                .map_err(|e| Refused::because(format!("reading the profile {file}"), e))?;
            profile
                .check(&Keys::ROOT)
                .map_err(|e: config::ConfigError| Refused::because(format!("the profile {file}"), e))?;
            Some(profile)
        }
    })
}

/// Delays and loses what a process receives, as its profile says. Without a profile everything goes
/// straight through.
pub struct Impaired<T> {
    radio: Option<Radio<T>>,
    epoch_ns: i64,
    through: Vec<(i64, T)>,
}

impl<T: Clone> Impaired<T> {
    /// The impairment of one direction; `epoch_ns` is the steady clock at the profile's time zero.
    pub fn new(link: Option<&LinkImpairment>, direction: Direction, epoch_ns: i64) -> Impaired<T> {
        let radio = link.map(|l| Radio::new(&l.profile, direction, &Streams::new(l.seed)));
        Impaired {
            radio,
            epoch_ns,
            through: Vec::new(),
        }
    }
    fn true_time(&self, steady_ns: i64) -> Time<TrueTime> {
        Time::from_nanos(steady_ns.saturating_sub(self.epoch_ns))
    }
    /// Something came at `at_ns` of the steady clock.
    pub fn take(&mut self, at_ns: i64, value: T) {
        let at = self.true_time(at_ns);
        match &mut self.radio {
            Some(radio) => radio.send(at, value),
            None => self.through.push((at_ns, value)),
        }
    }
    /// What has arrived by `now_ns`, with its time of arrival on the steady clock, ns.
    pub fn arrived(&mut self, now_ns: i64) -> Vec<(i64, T)> {
        let now = self.true_time(now_ns);
        let epoch_ns = self.epoch_ns;
        match &mut self.radio {
            Some(radio) => radio
                .receive(now)
                .into_iter()
                .map(|(at, v)| (at.nanos().saturating_add(epoch_ns), v))
                .collect(),
            None => std::mem::take(&mut self.through),
        }
    }
    /// From now on nothing arrives any more.
    pub fn cut(&mut self, now_ns: i64) {
        let now = self.true_time(now_ns);
        if let Some(radio) = &mut self.radio {
            radio.cut_after(now);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_named_profile_passes_its_check() {
        let scenario = RadioConfig::default();
        for name in [
            "scenario",
            "wifi-near",
            "wifi-far",
            "radio-mesh",
            "storm",
            "blackout-5s",
        ] {
            profile(name, &scenario)
                .unwrap()
                .unwrap()
                .check(&Keys::ROOT)
                .unwrap();
        }
        assert_eq!(profile("clean", &scenario).unwrap(), None);
        assert!(
            profile("no-such-thing", &scenario)
                .unwrap_err()
                .0
                .contains("radio-mesh")
        );
    }

    #[test]
    fn an_impaired_link_delays_and_cuts_and_a_clean_one_does_not() {
        let link = LinkImpairment {
            seed: 3,
            cut_at_tracking: false,
            profile: RadioConfig {
                loss: 0.0,
                duplicate: 0.0,
                ..RadioConfig::default()
            },
        };
        let mut impaired = Impaired::new(Some(&link), Direction::ToDrone, 1_000);
        let mut clean = Impaired::new(None, Direction::ToDrone, 1_000);
        impaired.take(2_000, 'a');
        clean.take(2_000, 'a');
        assert_eq!(clean.arrived(2_000), vec![(2_000, 'a')]);
        assert_eq!(impaired.arrived(2_000), vec![]);
        let late = impaired.arrived(1_000_000_000);
        assert!(late.len() == 1 && late[0].0 > 5_000_000, "{late:?}");
        impaired.cut(2_000_000_000);
        impaired.take(2_000_000_001, 'b');
        assert_eq!(impaired.arrived(9_000_000_000), vec![]);
    }
}
