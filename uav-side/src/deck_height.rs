//! The deck's mean height, from forecasts.

use alight_shared::estimation::low_pass_gain;
use alight_shared::msg::DeckForecast;
use alight_shared::time::{DroneClock, Time};

/// Mean of the predicted heights, which span about one wave, NED z, m; None without a stage.
pub(crate) fn forecast_mean(forecast: &DeckForecast) -> Option<f64> {
    let n = forecast.stages.len();
    (n > 0).then(|| forecast.stages.iter().map(|s| s.position[2]).sum::<f64>() / n as f64)
}

/// First-order low-pass of the deck's height, NED z.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct MeanDeckHeight(Option<(Time<DroneClock>, f64)>);

impl MeanDeckHeight {
    /// The mean, m; None before the first height.
    pub(crate) fn value(&self) -> Option<f64> {
        self.0.map(|(_, z)| z)
    }
    /// Forgets it: the frame itself has moved.
    pub(crate) fn forget(&mut self) {
        self.0 = None;
    }
    /// Restarts at `z` (m).
    pub(crate) fn begin(&mut self, at: Time<DroneClock>, z: f64) -> f64 {
        self.0 = Some((at, z));
        z
    }
    /// Follows `z` (m) with the time constant `time_s` by at most `limit_m` of difference; begins there.
    pub(crate) fn follow(&mut self, at: Time<DroneClock>, z: f64, time_s: f64, limit_m: f64) -> f64 {
        let next = self.0.map_or(z, |(last, mean)| {
            let dt = (at - last).secs().max(0.0);
            mean + (z - mean).clamp(-limit_m, limit_m) * low_pass_gain(dt, time_s)
        });
        self.begin(at, next)
    }
}
