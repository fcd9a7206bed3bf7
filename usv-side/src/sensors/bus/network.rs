//! Devices of a source by group: the one in use, and contradictions between devices.

use super::{
    devices::{DeviceGroup, DeviceNames, DeviceSample, GROUPS, PLACES, RATES, VELOCITIES, is_near},
    name_text,
};
use crate::sensors::{
    Mounting, Remark,
    config::{BusDevices, device_name},
};

/// Time from the first message after which an absent selected device is reported as missing, ns.
const MISSED_NS: i64 = 5_000_000_000;
/// Maximum number of stated variations that are kept.
const MAX_STATED: usize = 16;
/// Maximum difference between valid variations, rad (2 deg); covers ten-year-old tables.
const VARIATIONS_APART: f64 = 0.035;

#[derive(Clone, Debug, Default)]
pub(in crate::sensors) struct Devices {
    /// Name of the device selected in the configuration for each group, or empty.
    choices: [String; GROUPS],
    pub(super) groups: [DeviceGroup; GROUPS],
    pub(in crate::sensors) names: DeviceNames,
    /// Times of the first and the newest message, ns.
    times_ns: Option<[i64; 2]>,
    /// All positions are used unless a device is selected.
    is_merged: bool,
}

impl Devices {
    pub(in crate::sensors) fn new(mounting: &Mounting) -> Self {
        Devices {
            choices: choices(&mounting.mount.devices),
            ..Devices::default()
        }
    }
    /// Uses all positions, unless a device is selected, because sentences give one per epoch.
    pub(in crate::sensors) fn merged(mut self) -> Self {
        self.is_merged = true;
        self
    }
    pub(in crate::sensors) fn arrive(&mut self, at_ns: i64) {
        let [first_ns, _] = self.times_ns.unwrap_or([at_ns; 2]);
        self.times_ns = Some([first_ns, at_ns]);
    }
    /// Whether the configuration selects this device for group `k`.
    pub(in crate::sensors) fn is_chosen(&self, k: usize, device: u32) -> bool {
        let choice = self.choices.get(k).filter(|choice| !choice.is_empty());
        choice.is_some_and(|choice| self.names.is_named(device, choice))
    }
    /// Device of group `k` at that time. Unless selected, the device of the velocity is the receiver of the positions.
    fn giving(&self, k: usize, at_ns: i64) -> Option<u32> {
        let own = self.groups.get(k)?.giving(at_ns);
        if k != VELOCITIES {
            return own;
        }
        let chosen = own.filter(|of| self.is_chosen(k, *of));
        chosen.or_else(|| self.groups.get(PLACES)?.giving(at_ns))
    }
    /// Whether another device provides group `k`.
    pub(in crate::sensors) fn is_spare(&self, k: usize, device: u32, at_ns: i64) -> bool {
        let has_choice = self.choices.get(k).is_some_and(|choice| !choice.is_empty());
        if self.is_chosen(k, device) || self.is_merged && k == PLACES && !has_choice {
            return false;
        }
        match k {
            VELOCITIES => self.giving(k, at_ns).is_some_and(|of| of != device),
            _ => self.groups.get(k).is_some_and(|g| g.is_spare(device, at_ns)),
        }
    }
    /// Records a value of group `k`. A selected or better (`is_better`) device is used from then on.
    pub(in crate::sensors) fn gave(&mut self, k: usize, device: u32, at_ns: i64, is_better: bool) {
        let is_kept = is_better || self.is_chosen(k, device);
        if let Some(group) = self.groups.get_mut(k) {
            group.gave(device, at_ns, is_kept);
        }
    }
    /// Adds a value of a device of group `k` as evidence for or against it.
    pub(in crate::sensors) fn observe(&mut self, k: usize, of: (u32, i64), sample: &DeviceSample) {
        let used = self.giving(k, of.1);
        let kept = self.groups.get(k).and_then(DeviceGroup::kept);
        let is_fixed = kept.is_some_and(|of| self.is_chosen(k, of)) || self.is_merged && k == PLACES;
        if let Some(group) = self.groups.get_mut(k) {
            group.observe(k, of, sample, used, !is_fixed);
        }
    }
    pub(in crate::sensors) fn remarks(&self) -> Vec<Remark> {
        let Some([first_ns, now_ns]) = self.times_ns else {
            return Vec::new();
        };
        let is_missed = !is_near(now_ns, first_ns, MISSED_NS);
        let mut all = Vec::new();
        for (k, (group, choice)) in self.groups.iter().zip(&self.choices).enumerate() {
            // A device selected for its attitude need not provide angular rates.
            if is_missed && !choice.is_empty() && k != RATES {
                all.extend(group.missing_choice(k, (choice.as_str(), &self.names), now_ns));
            }
            all.extend(group.remarks(k, &self.names, now_ns));
        }
        all
    }
}

/// Magnetic variations as stated by devices, rad, east positive.
#[derive(Clone, Debug, Default)]
pub(in crate::sensors) struct Variations {
    stated: Vec<(u32, f64)>,
    /// A heading was referred to true north by a variation of exactly zero.
    zero_used: bool,
}

const VARIATION: usize = 5;

impl Variations {
    pub(in crate::sensors) fn state(&mut self, device: u32, variation: f64) {
        let is_full = self.stated.len() >= MAX_STATED;
        match self.stated.iter_mut().find(|(of, _)| *of == device) {
            Some(known) => known.1 = variation,
            None if is_full => {}
            None => self.stated.push((device, variation)),
        }
    }
    /// Records the variation of a heading that is used.
    pub(in crate::sensors) fn used(&mut self, variation: f64) {
        self.zero_used |= variation == 0.0;
    }
    /// Variation of the selected device, otherwise of `own`, otherwise of the first device. A variation of exactly
    /// zero means a compass without a table if another device states one.
    pub(in crate::sensors) fn of(&self, own: Option<u32>, devices: &Devices) -> Option<f64> {
        let stated =
            |is: &dyn Fn(u32, f64) -> bool| self.stated.iter().find(|(of, v)| is(*of, *v)).map(|(_, v)| *v);
        stated(&|of, _| devices.is_chosen(VARIATION, of))
            .or_else(|| stated(&|of, v| Some(of) == own && v != 0.0))
            .or_else(|| stated(&|_, v| v != 0.0))
            .or_else(|| stated(&|_, _| true))
    }
    /// Remark on contradicting variations, and on a used one of exactly zero without another.
    pub(in crate::sensors) fn remarks(&self, devices: &Devices) -> Option<Remark> {
        let used = self.of(None, devices)?;
        let (of, _) = self.stated.iter().find(|(_, v)| *v == used)?;
        let name = |device: u32| devices.names.shown(device);
        if used == 0.0 && self.zero_used {
            return Some(Remark::fault(
                format!(
                    "magnetic variation: exactly 0.0 deg by {} and stated by no other device: a compass without a table?",
                    name(*of)
                ),
                "compare it with the chart; set the variation at the compass or the receiver",
            ));
        }
        let (other, apart) = self
            .stated
            .iter()
            .find(|(_, v)| (v - used).abs() > VARIATIONS_APART)?;
        let is_default = if *apart == 0.0 { ", taken as not set" } else { "" };
        Some(Remark::fault(
            format!(
                "magnetic variation: {:+.1} deg by {}, {:+.1} deg by {}{is_default}",
                used.to_degrees(),
                name(*of),
                apart.to_degrees(),
                name(*other)
            ),
            "correct the variation of the wrong one; variation = \"DEVICE\" in [sensor.sources.mount.devices] chooses the other",
        ))
    }
}

/// Names of the selected devices by group; an NMEA 2000 NAME with all its digits.
fn choices(d: &BusDevices) -> [String; GROUPS] {
    [
        &d.heading,
        &d.rate_of_turn,
        &d.attitude,
        &d.attitude,
        &d.heave,
        &d.variation,
        &d.position,
        &d.velocity,
    ]
    .map(|name| match device_name(name) {
        Some(number) => name_text(number),
        None => name.clone(),
    })
}
