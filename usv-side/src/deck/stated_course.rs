//! Course and speed as stated by the helm's switch, and by orders from a terminal on board.

use alight_shared::{
    msg::{Course, MAX_STEADY_S},
    time::{Span, VesselTime},
};

use super::{config::DeckConfig, inputs::Reading};

#[derive(Clone, Copy, Debug, Default, PartialEq)]
enum Ordered {
    #[default]
    Nothing,
    SteadyUntil(VesselTime),
    Turning,
}

/// Newest statements, lost in a restart: a promise must then be given again.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct StatedCourse {
    /// The helm's switch shows that the vessel turns or may turn.
    pub(super) switch: Option<Reading>,
    ordered: Ordered,
}

impl StatedCourse {
    /// States that course and speed are kept for `for_s` seconds; 0 withdraws the statement.
    pub(super) fn order_steady(&mut self, now: VesselTime, for_s: u32) {
        let for_s = f64::from(for_s).min(f64::from(MAX_STEADY_S));
        self.ordered = Ordered::SteadyUntil(now + Span::from_secs(for_s));
    }
    pub(super) fn order_turning(&mut self) {
        self.ordered = Ordered::Turning;
    }
    /// Course at `now`: a turn stated by either source, otherwise the longest promise.
    pub(super) fn at(&self, now: VesselTime, config: &DeckConfig) -> Course {
        let has_switch = !config.helm_switch.is_empty();
        if self.ordered == Ordered::Turning || Reading::active(self.switch, has_switch, now) {
            return Course::Turning;
        }
        let ordered_s = match self.ordered {
            Ordered::SteadyUntil(end) => (end - now).secs(),
            Ordered::Nothing | Ordered::Turning => 0.0,
        };
        let switch_s = if has_switch { config.helm_steady_s } else { 0.0 };
        Course::Steady(switch_s.max(ordered_s) as f32).after(0.0)
    }
}
