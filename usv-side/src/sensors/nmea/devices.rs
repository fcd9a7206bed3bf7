//! Devices of a stream of sentences (talkers and proprietary sentences), and choice of its clock.

use super::{HEADINGS, MAX_SPARE, NmeaDecoder, SourceMeasurement, TILTS, Untimed, account::Why};
use crate::sensors::bus::DeviceSample;

/// Maximum number of talkers distinguished.
const MAX_TALKERS: usize = 16;
/// Difference between two clocks, ns (GPS time is 18 s ahead of UTC), and majority of sentences that changes the clock.
const OTHER_CLOCK_NS: i64 = 10_000_000_000;
const MAX_OTHERS: u8 = 10;

impl NmeaDecoder {
    /// Device number of a sentence.
    pub(super) fn device(&mut self, address: &str) -> u32 {
        let talker = match address.starts_with('P') {
            true => address,
            false => address.get(..address.len().saturating_sub(3)).unwrap_or(address),
        };
        let known = self.talkers.iter().position(|t| t == talker);
        let number = known.unwrap_or(self.talkers.len());
        if known.is_none() && number < MAX_TALKERS {
            self.talkers.push(talker.into());
            self.devices.names.insert(number as u32, [talker, ""]);
        }
        number as u32
    }
    /// Adds a value of group `k` with its standard deviation as evidence. Returns whether it is used.
    pub(super) fn is_used(
        &mut self,
        k: usize,
        address: &str,
        (value, sd): ([f64; 2], f64),
        is_better: bool,
    ) -> bool {
        let device = self.device(address);
        // In a recording, the epoch gives the time.
        let Some(at_ns) = self.attribution.now_ns.or(self.epoch.as_ref().map(|e| e.at_ns)) else {
            return true;
        };
        let stated_sd = None;
        self.devices.arrive(at_ns);
        self.devices
            .observe(k, (device, at_ns), &DeviceSample { value, sd, stated_sd });
        let is_spare = self.devices.is_spare(k, device, at_ns) && !is_better;
        if !is_spare {
            self.devices.gave(k, device, at_ns, is_better);
        }
        !is_spare
    }
    /// Whether a time is from the clock in use: that of most sentences, not of an instrument in local time.
    pub(super) fn is_of_clock(&mut self, address: &str, at_ns: i64) -> bool {
        let (of, newest_ns, others) = self.clock.get_or_insert_with(|| (address.into(), at_ns, 0));
        let is_near = (at_ns - *newest_ns).abs() <= OTHER_CLOCK_NS;
        if is_near || of == address {
            (*newest_ns, *others) = (at_ns, others.saturating_sub(1));
            return true;
        }
        *others += 1;
        let changes = *others >= MAX_OTHERS;
        if changes {
            self.clock = Some((address.into(), at_ns, 0));
        }
        changes
    }
    /// Roll and pitch of a sentence without a time, with heading and heave if available.
    pub(super) fn own_tilt(
        &mut self,
        address: &str,
        tilt: [f64; 2],
        heading: Option<f64>,
        heave: Option<f64>,
        out: &mut Vec<SourceMeasurement>,
    ) {
        let heading = heading.filter(|h| self.is_true_used(address, *h));
        match self.is_used(TILTS, address, (tilt, self.mounting.tilt_sd()), false) {
            true => self.untimed(Untimed::Tilt(tilt, heading, heave), out),
            false => self.leave_out(address, Why::Spare),
        }
    }
    pub(super) fn true_heading(&mut self, address: &str, heading: Option<f64>, sd: f64) {
        let heading = heading.filter(|h| self.is_true_used(address, *h));
        if let Some((heading, e)) = heading.zip(self.epoch.as_mut()) {
            e.heading.get_or_insert((heading, sd));
        }
    }
    /// Whether a true heading is used; it takes precedence over a magnetic one.
    pub(super) fn is_true_used(&mut self, address: &str, heading: f64) -> bool {
        let is_first = self.without_true >= MAX_SPARE;
        let value = ([heading, 0.0], self.mounting.heading_sd());
        let is_used = self.is_used(HEADINGS, address, value, is_first);
        self.without_true = if is_used { 0 } else { self.without_true };
        is_used
    }
    pub(super) fn state_variation(&mut self, address: &str, variation: Option<f64>) {
        let device = self.device(address);
        variation
            .into_iter()
            .for_each(|v| self.variation.state(device, v));
    }
}
