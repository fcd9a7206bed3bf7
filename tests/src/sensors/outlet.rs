//! Outlet of every sensor: rate, latency, outages, and headers with its sender's identity and clock.

use core::marker::PhantomData;

use alight_shared::msg::Header;
use alight_shared::time::{Clock, Span, Time, TrueTime};

use super::clocks::ClockModel;
use super::delay::DelayLine;
use super::noise::{SampleSchedule, Windows};

/// Most measurements of one sensor under way at a time.
const QUEUE: usize = 256;

/// Identity that a sender writes into headers.
#[derive(Clone, Copy, Debug)]
pub struct SenderIdentity {
    pub vessel: u32,
    /// The drone; 0 from the vessel.
    pub drone: u32,
    /// The start of the sender.
    pub boot: u32,
    /// Clock of the sender.
    pub clock: ClockModel,
}

impl SenderIdentity {
    /// The header of its message number `sequence` at `t`.
    pub fn header<C: Clock>(&self, sequence: u32, t: Time<TrueTime>) -> Header<C> {
        Header::new(self.vessel, self.drone, self.boot, sequence, self.clock.read(t))
    }
}

/// The way of a sensor's measurements `M`, stamped on the clock `C`.
#[derive(Clone, Debug)]
pub(crate) struct Outlet<M, C> {
    schedule: SampleSchedule,
    latency: Span,
    outages: Windows,
    identity: SenderIdentity,
    sequence: u32,
    line: DelayLine<M>,
    clock: PhantomData<C>,
}

impl<M, C: Clock> Outlet<M, C> {
    pub(crate) fn new(rate_hz: f64, latency_s: f64, outages: &Windows, identity: SenderIdentity) -> Self {
        Outlet {
            schedule: SampleSchedule::new(rate_hz),
            latency: Span::from_secs(latency_s),
            outages: outages.clone(),
            identity,
            sequence: 0,
            line: DelayLine::new(QUEUE),
            clock: PhantomData,
        }
    }
    /// Seconds since the previous measurement (0 at the first) when one is due at `t`.
    pub(crate) fn due(&mut self, t: Time<TrueTime>) -> Option<f64> {
        self.schedule.due(t)
    }
    /// Sends the measurement of `t` unless it is missed or falls into an outage.
    pub(crate) fn send(
        &mut self,
        t: Time<TrueTime>,
        missed: bool,
        measure: impl FnOnce(Header<C>) -> Option<M>,
    ) {
        if missed || self.outages.cover(t) {
            return;
        }
        if let Some(measurement) = measure(self.identity.header(self.sequence, t)) {
            self.sequence = self.sequence.wrapping_add(1);
            self.line.push(t + self.latency, measurement);
        }
    }
    /// Messages that have arrived by `t`.
    pub(crate) fn arrived(&mut self, t: Time<TrueTime>) -> Vec<M> {
        self.line.arrived(t)
    }
}
