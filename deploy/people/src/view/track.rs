//! Track over ground of drone and deck in the last five minutes.

use std::collections::VecDeque;

use alight_shared::time::{Span, Time, TrueTime};

use crate::view::picture::TrackView;

const STEP_S: f64 = 2.0;
const SAMPLES: usize = 150;

/// North and east in the drone's frame, m; None if unknown.
type Ground = Option<[f64; 2]>;

#[derive(Debug, Default)]
pub struct GroundTrack {
    samples: VecDeque<[Ground; 2]>,
    newest: Option<Time<TrueTime>>,
    frame: u8,
}

impl GroundTrack {
    /// Adds the positions of drone and deck at `t` when a sample is due. `frame` identifies their frame; a new one
    /// starts a new track.
    pub fn add(&mut self, t: Time<TrueTime>, frame: u8, drone: Ground, deck: Ground) {
        if self.newest.is_some_and(|at| t < at) || frame != self.frame {
            *self = GroundTrack {
                frame,
                ..GroundTrack::default()
            };
        }
        let due = self.newest.is_none_or(|at| t - at >= Span::from_secs(STEP_S));
        if !due || drone.is_none() && deck.is_none() {
            return;
        }
        // The path between positions further apart in time is unknown.
        let gap = self
            .newest
            .is_some_and(|at| t - at > Span::from_secs(2.0 * STEP_S));
        self.newest = Some(t);
        self.samples.extend(gap.then_some([None, None]));
        self.samples.push_back([drone, deck]);
        while self.samples.len() > SAMPLES {
            self.samples.pop_front();
        }
    }
    /// Track for the page, relative to the newest position of the deck, otherwise of the drone.
    pub fn view(&self) -> TrackView {
        let last = |k: usize| self.samples.iter().rev().find_map(|s| s[k]);
        let [north, east] = last(1).or_else(|| last(0)).unwrap_or_default();
        let tenth = |x: f64| (10.0 * x).round() / 10.0;
        let of = |k: usize| {
            let places = self.samples.iter().map(move |s| s[k]);
            places
                .map(|p| p.map(|[n, e]| [tenth(n - north), tenth(e - east)]))
                .collect()
        };
        TrackView {
            drone: of(0),
            deck: of(1),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn track_rate_length_and_frame() {
        let mut track = GroundTrack::default();
        for k in 0..10_000_u32 {
            let at = f64::from(k) * 0.1;
            track.add(Time::from_secs(at), 1, Some([at, 0.0]), Some([at - 3.0, 4.0]));
        }
        let view = track.view();
        assert_eq!((view.drone.len(), view.deck.len()), (SAMPLES, SAMPLES));
        assert_eq!(view.deck.last(), Some(&Some([0.0, 0.0])));
        assert_eq!(view.drone.last(), Some(&Some([3.0, -4.0])));
        let [first, second] = [view.deck[0].unwrap()[0], view.deck[1].unwrap()[0]];
        assert!((second - first - 2.0).abs() < 0.11, "{first} {second}");
        track.add(Time::from_secs(1001.0), 2, Some([0.0, 0.0]), None);
        assert_eq!(track.view().drone, [Some([0.0, 0.0])]);
    }
}
