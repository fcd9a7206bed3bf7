//! Agreement of the integral of a rate over an interval with the change of its quantity.
//!
//! Over a short step, noise exceeds the change of the quantity; an interval averages the noise. The rate is
//! rejected only if most intervals of a window disagree, so a jump of the quantity does not count against it.

use alight_shared::time::{Time, VesselClock};

use super::verdict::{ChannelState, Doubt, Taken};

/// Fraction of disagreeing intervals above which the rate is rejected; with a lag of a tenth of the motion's
/// period, half of them disagree.
const MAX_DISAGREEING: f64 = 0.6;

pub(super) struct Lengths {
    pub(super) interval_s: f64,
    /// Maximum time between two values, s; after a longer gap the rate is unknown.
    pub(super) step_s: f64,
    /// Number of intervals of a window.
    pub(super) window: u32,
}

/// Comparison of a rate with two components and a quantity `P`.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Agreement<P> {
    begin: Option<(Time<VesselClock>, P)>,
    last: Option<(Time<VesselClock>, [f64; 2])>,
    integral: [f64; 2],
    /// Intervals in the window, disagreeing ones, and sum of their squared differences.
    intervals: u32,
    disagreeing: u32,
    squares: f64,
    since: Option<Time<VesselClock>>,
}

impl<P: Copy> Agreement<P> {
    /// Adds a quantity and its rate, or the reason why the rate is impossible. `compare` returns integral
    /// minus change, and whether it is too large; None without information.
    pub(super) fn take(
        &mut self,
        (verdict, lengths): (&mut ChannelState, &Lengths),
        at: Time<VesselClock>,
        quantity: P,
        rate: Result<[f64; 2], Doubt>,
        compare: impl FnOnce(P, P, [f64; 2]) -> Option<(f64, bool)>,
    ) -> Taken {
        let since = match rate {
            Ok(rate) => self.add((&mut *verdict, lengths), at, quantity, rate, compare),
            Err(doubt) => {
                (self.begin, self.last) = (None, None);
                verdict.reject(at, doubt).then_some(self.since.unwrap_or(at))
            }
        };
        Taken {
            believed: rate.is_ok() && !verdict.is_out(),
            since,
        }
    }
    fn add(
        &mut self,
        (verdict, lengths): (&mut ChannelState, &Lengths),
        at: Time<VesselClock>,
        quantity: P,
        rate: [f64; 2],
        compare: impl FnOnce(P, P, [f64; 2]) -> Option<(f64, bool)>,
    ) -> Option<Time<VesselClock>> {
        let step = self.last.map(|(then, before)| ((at - then).secs(), before));
        let Some((dt, before)) = step.filter(|(dt, _)| *dt > -1.0 && *dt <= lengths.step_s) else {
            (self.begin, self.last) = (Some((at, quantity)), Some((at, rate)));
            self.integral = [0.0; 2];
            return None;
        };
        if dt <= 0.0 {
            return None;
        }
        self.last = Some((at, rate));
        for (sum, (a, b)) in self.integral.iter_mut().zip(rate.into_iter().zip(before)) {
            *sum += 0.5 * (a + b) * dt;
        }
        let (begun, from) = self.begin?;
        if (at - begun).secs() < lengths.interval_s {
            return None;
        }
        self.begin = Some((at, quantity));
        let (off, disagrees) = compare(from, quantity, core::mem::take(&mut self.integral))?;
        self.since.get_or_insert(begun);
        self.intervals += 1;
        self.disagreeing += u32::from(disagrees);
        self.squares += off * off;
        if self.intervals < lengths.window {
            return None;
        }
        let n = f64::from(self.intervals);
        let rms = (self.squares / n).sqrt() / lengths.interval_s;
        let doubt = (f64::from(self.disagreeing) > MAX_DISAGREEING * n).then_some(Doubt::Disagreement(rms));
        (self.intervals, self.disagreeing, self.squares) = (0, 0, 0.0);
        let since = self.since.take();
        since.filter(|_| verdict.judge(at, doubt))
    }
}
