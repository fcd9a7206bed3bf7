//! `wait-calm`: a landing-period indicator in the manner of Abujoub et al. 2020: follow the deck low
//! over it and descend only when the predicted deck stays within limits of tilt and heave rate for
//! the whole descent. The descent itself is that of `mpc`.
//!
//! In a sea that never is as calm as the limits ask for, the limits grow with the time waited: an
//! indicator without that would wait for ever in half of the seas of the paper's Table II.

use alight_shared::config;
use alight_shared::msg::{DeckForecast, Phase, State as Mode};
use alight_shared::time::{DroneClock, Span, Time};

use super::View;

config! {
    /// What calm is.
    ///
    /// Chosen: Tilt and heave rate: the order of published limits for helicopters on small decks
    /// (pitch 2 to 3 deg, roll 5 deg, heave rate 1 to 1.5 m/s). The descent: from 2 m at the
    /// mission's 1 m/s, the last 0.9 m at 0.5 m/s.
    #[derive(Copy)]
    pub struct WaitCalmConfig {
        /// Waits with the feet at this height over the deck, m.
        pub wait_m: f64 = 2.0, in 0.2..=20.0;
        /// The descent from there takes this long, s: calm has to last for it.
        pub descent_s: f64 = 2.9, in 0.1..=4.0;
        /// Largest tilt of the deck, deg.
        pub tilt_deg: f64 = 4.0, in 0.1..=45.0;
        /// Largest vertical speed of the deck's centre, m/s.
        pub heave_mps: f64 = 0.6, in 0.01..=10.0;
        /// After this long the limits have doubled, s.
        pub patience_s: f64 = 15.0, in 0.1..=1e4;
        /// Below this clearance it goes on whatever comes, m.
        pub commit_m: f64 = 1.2;
    }
    check |this, at| {
        at.range("commit_m", this.commit_m, 0.0, this.wait_m)?;
    }
}

/// Since when it waits, and whether it has seen a calm.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct WaitCalm {
    since: Option<Time<DroneClock>>,
    calm: bool,
}

impl WaitCalm {
    /// Takes the permission to descend away until calm is predicted. `clearance_m`: feet over the
    /// deck.
    pub fn judge(
        &mut self,
        now: Time<DroneClock>,
        clearance_m: f64,
        view: &mut View,
        config: &WaitCalmConfig,
    ) {
        if view.mission.state.phase() != Phase::Landing {
            *self = WaitCalm::default();
            return;
        }
        if view.mission.state == Mode::Flare {
            return;
        }
        if clearance_m > config.wait_m || clearance_m < config.commit_m {
            return;
        }
        let since = *self.since.get_or_insert(now);
        let limit = 1.0 + (now - since).secs().max(0.0) / config.patience_s;
        // Once begun, half as much again has to be wrong to wait anew.
        let limit = if self.calm { 1.5 * limit } else { limit };
        self.calm = view
            .forecast
            .as_ref()
            .is_some_and(|f| worst(now, f, config.descent_s).within(config, limit));
        if !self.calm {
            view.mission.descent_mps = 0.0;
        }
    }
}

/// The greatest tilt (rad) and vertical speed (m/s) of a stretch of the forecast.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Worst {
    tilt: f64,
    heave: f64,
    covered: bool,
}

impl Worst {
    fn within(&self, config: &WaitCalmConfig, factor: f64) -> bool {
        self.covered
            && self.tilt <= config.tilt_deg.to_radians() * factor
            && self.heave <= config.heave_mps * factor
    }
}

fn worst(now: Time<DroneClock>, forecast: &DeckForecast, lasts_s: f64) -> Worst {
    let (begin, end) = (now, now + Span::from_secs(lasts_s));
    let mut worst = Worst::default();
    for (k, s) in forecast.stages.iter().enumerate() {
        let t = forecast.header.at + forecast.step * k as i64;
        if t + forecast.step < begin {
            continue;
        }
        if t > end {
            worst.covered = true;
            break;
        }
        let tilt = (s.euler[0].cos() * s.euler[1].cos()).clamp(-1.0, 1.0).acos();
        worst.tilt = worst.tilt.max(tilt);
        worst.heave = worst.heave.max(s.velocity[2].abs());
    }
    worst
}
