//! Output stage of every sensor: rate, latency, outages and message headers.

use core::marker::PhantomData;

use alight_shared::{
    msg::Header,
    time::{Clock, Span, Time, TrueTime},
};

use super::{
    clocks::ClockModel,
    delay::DelayLine,
    noise::{SampleSchedule, Windows},
};

/// Maximum number of measurements in transit.
const QUEUE: usize = 256;

/// Sender identification in message headers.
#[derive(Clone, Copy, Debug)]
pub struct SenderIdentity {
    pub vessel: u32,
    /// 0 for the vessel.
    pub drone: u32,
    pub boot: u32,
    pub clock: ClockModel,
}

impl SenderIdentity {
    pub fn header<C: Clock>(&self, sequence: u32, t: Time<TrueTime>) -> Header<C> {
        Header::new(self.vessel, self.drone, self.boot, sequence, self.clock.read(t))
    }
}

/// Stamps measurements `M` with the clock `C`.
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
    /// Time since the last measurement (0 at the first), s; None if no measurement is due.
    pub(crate) fn due(&mut self, t: Time<TrueTime>) -> Option<f64> {
        self.schedule.due(t)
    }
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
    pub(crate) fn arrived(&mut self, t: Time<TrueTime>) -> Vec<M> {
        self.line.arrived(t)
    }
}
