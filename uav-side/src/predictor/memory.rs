//! What outlives the predictor's process: the offset between the camera's view of the deck and the radio's. In the last
//! half of a metre the deck is too near to be seen, and a predictor that began there would know the deck to the error of
//! two GNSS receivers.

use alight_shared::msg::{DroneState, Header, PredictorMemory};
use alight_shared::time::{DroneClock, Span, Time};
use alight_shared::topics;
use nalgebra::Vector3;

use super::axis::{AxisNoise, MeasurementRow};
use super::node::Predictor;
use super::track::JUMP_M;
use super::waves::AXES;
use crate::memory;

/// An older memory does not count: the odometry has drifted meanwhile, and so has the drone.
const MAX_AGE: Span = topics::PREDICTOR_MEMORY.stale_after;

/// A predictor that does not know yet what the one before it left.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Beginning {
    since: Option<Time<DroneClock>>,
    /// Who keeps the memory has answered, with this.
    answer: Option<PredictorMemory>,
}

impl Predictor {
    /// A predictor before this one may have flown: it asks for that one's memory first, and publishes nothing until it is
    /// answered: a forecast by the radio alone may lie metres beside the deck, and would end a landing.
    #[must_use]
    pub fn as_successor(mut self) -> Self {
        self.beginning = Some(Beginning::default());
        self
    }

    /// Takes the memory of the predictor before this one as soon as the radio's view of the deck is there to be offset,
    /// unless this one has seen the deck itself.
    pub(super) fn begin(&mut self, now: Time<DroneClock>, given: Option<&PredictorMemory>) {
        let Some(beginning) = &mut self.beginning else {
            return;
        };
        let given = given.filter(|m| m.header.boot != self.boot);
        beginning.answer = given.copied().or(beginning.answer);
        let waited = now - *beginning.since.get_or_insert(now);
        // Boot 0: who keeps it has nothing.
        match beginning.answer {
            None if waited < memory::WAIT => {}
            Some(m) if m.header.boot != 0 && self.vision_at.is_none() => {
                if self.resume(now, &m) {
                    self.beginning = None;
                }
            }
            Some(_) | None => self.beginning = None,
        }
    }

    /// Whether `m` was judged: it waits for odometry and radio.
    fn resume(&mut self, now: Time<DroneClock>, m: &PredictorMemory) -> bool {
        let (Some(drone), Some(filter), Some((boot, _))) =
            (self.track.newest(), self.filter.as_mut(), self.radio_sequence)
        else {
            return false;
        };
        let judged = memory::judge(now, drone.header.drone, MAX_AGE, m);
        if judged.is_err() || m.vessel_boot != boot || !same_frame(drone, m) {
            return true;
        }
        let age = (now - m.header.at).secs().max(0.0);
        let noise = AxisNoise::all(&self.config);
        let variance = core::array::from_fn(|i| aged(m.offset_sd[i].powi(2), &noise[i], age));
        filter.know_offset(&m.offset, &variance);
        self.vision_at = Some(m.vision_at);
        self.tag_at = m.tag_at;
        true
    }

    /// What a successor has to know, by the newest observation, beside a forecast with this header.
    pub(super) fn memory(&self, forecast: &Header<DroneClock>) -> Option<PredictorMemory> {
        let (drone, filter) = (self.track.newest()?, self.filter.as_ref()?);
        let axes = filter.last()?;
        let offset: [(f64, f64); AXES] = core::array::from_fn(|i| axes[i].project(MeasurementRow::Offset));
        Some(PredictorMemory {
            header: Header {
                vessel: drone.header.vessel,
                drone: drone.header.drone,
                at: filter.newest()?,
                ..*forecast
            },
            vessel_boot: self.radio_sequence?.0,
            vision_at: self.vision_at?,
            tag_at: self.tag_at,
            offset: offset.map(|(value, _)| value),
            offset_sd: offset.map(|(_, variance)| variance.sqrt()),
            position: drone.position,
            velocity: drone.velocity,
            odometry_at: drone.header.at,
        })
    }
}

/// The odometry's origin is where it was: the drone has moved as its velocities say.
fn same_frame(drone: &DroneState, given: &PredictorMemory) -> bool {
    let dt = (drone.header.at - given.odometry_at).secs();
    let moved = drone.position() - Vector3::from(given.position);
    let mean = 0.5 * (drone.velocity() + Vector3::from(given.velocity));
    (moved - mean * dt).norm() <= JUMP_M
}

/// The variance of an offset after `age` (s): both slow errors walk on, the odometry's drift at worst steadily.
fn aged(variance: f64, noise: &AxisNoise, age: f64) -> f64 {
    let walk = |(sd, time): (f64, f64)| 2.0 * sd * sd * age / time;
    variance + walk(noise.radio) + walk(noise.vision) + (noise.drift.0 * age).powi(2)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn memory_of_an_origin_that_has_moved_is_of_another_frame() {
        let given = PredictorMemory {
            position: [1.0, 2.0, -3.0],
            velocity: [4.0, 0.0, 0.0],
            odometry_at: Time::from_secs(10.0),
            ..PredictorMemory::default()
        };
        let later = |x: f64| DroneState {
            header: Header::new(1, 1, 1, 1, Time::from_secs(11.0)),
            position: [x, 2.0, -3.0],
            velocity: [4.0, 0.0, 0.0],
            ..DroneState::default()
        };
        assert!(same_frame(&later(5.0), &given));
        assert!(same_frame(&later(5.6), &given));
        assert!(!same_frame(&later(1.0), &given));
        assert!(!same_frame(&later(6.0), &given));
    }

    #[test]
    fn memory_grows_less_certain_with_its_age() {
        let noise = AxisNoise::all(&super::super::PredictorConfig::default())[0];
        let sd = |age: f64| aged(0.05_f64.powi(2), &noise, age).sqrt();
        assert_eq!(sd(0.0), 0.05);
        assert!(
            sd(1.0) > 0.08 && sd(2.0) > sd(1.0) && sd(2.0) < 0.5,
            "{} {}",
            sd(1.0),
            sd(2.0)
        );
    }
}
