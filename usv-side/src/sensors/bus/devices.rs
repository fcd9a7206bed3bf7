//! Choice of the best device of a group, and detection of devices that contradict each other.
//!
//! Rate, standard deviation and range of each device are determined over windows of five seconds. The score
//! is the information per second with white errors, `rate / sd²`. Another device is used after three
//! consecutive windows with a clearly higher score; switching back requires the same margin. A difference
//! between two devices beyond their standard deviations is reported after twelve consecutive windows.

use std::collections::BTreeMap;

use alight_shared::frames::wrap_angle;

use crate::sensors::{Remark, config::MAX_DEVICE_NAME};

/// Silence after which another device is used for the group, ns.
const SILENT_NS: i64 = 2_000_000_000;
/// Maximum age of a value compared with a newer one, ns: three periods at 10 Hz.
pub(in crate::sensors) const PAIR_NS: i64 = 300_000_000;
/// Maximum number of devices per group for which evidence is kept.
const MAX_DEVICES: usize = 16;
const WINDOW_NS: i64 = 5_000_000_000;
/// Ratio of scores (10 Hz to 3 Hz), and number of consecutive windows, that change the device. Chosen.
const MARGIN: f64 = 3.0;
const BETTER_WINDOWS: u32 = 3;
/// Number of consecutive windows after which a contradiction is reported: a minute. Chosen.
const DIFFERENT_WINDOWS: u32 = 12;
/// Minimum number of values of a window for a comparison.
const ENOUGH: u32 = 3;
/// Maximum difference between two devices, in standard deviations.
const SIGMAS: f64 = 3.0;
/// Fraction of the range tolerance that applies to the difference of means.
const MEAN_OF_RANGE: f64 = 0.2;
/// Length of one degree of latitude, m.
const DEGREE_M: f64 = 111_120.0;
/// Maximum number of devices listed in a remark.
const MAX_LISTED: usize = 8;

pub(super) const GROUPS: usize = 8;
/// Indices of the groups of headings, rates of turn, angular rates, attitudes, positions and velocities.
pub(in crate::sensors) const HEADINGS: usize = 0;
pub(in crate::sensors) const TURNS: usize = 1;
pub(in crate::sensors) const TILTS: usize = 3;
pub(super) const RATES: usize = 2;
pub(in crate::sensors) const PLACES: usize = 6;
pub(super) const VELOCITIES: usize = 7;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Metric {
    /// Angles, rad, wrapped to half a turn.
    Angle,
    Linear,
    /// Latitudes and longitudes in degrees; the difference is in m.
    Place,
}

impl Metric {
    /// `a` minus `b`.
    fn difference(self, a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
        let [x, y] = [a[0] - b[0], a[1] - b[1]];
        match self {
            Metric::Angle => [wrap_angle(x), wrap_angle(y)],
            Metric::Linear => [x, y],
            Metric::Place => {
                let east = wrap_angle(y.to_radians()).to_degrees();
                [x * DEGREE_M, east * DEGREE_M * a[0].to_radians().cos()]
            }
        }
    }
}

/// Name and limits of a group.
#[derive(Clone, Copy, Debug)]
struct GroupLimits {
    name: &'static str,
    /// Key of `[sensor.sources.mount.devices]` that selects the group's device.
    key: &'static str,
    metric: Metric,
    /// Display unit, and its size in SI.
    unit: (&'static str, f64),
    /// Permitted difference beyond the standard deviations: mounting, antenna positions, slow error.
    floor: f64,
    /// Additional permitted difference as a fraction of the window's range: values differ in time.
    of_range: f64,
    /// Range above which a device moves, so that constant values of another are not measurements; infinite if
    /// constant values are possible.
    moved: f64,
    /// Rate above which a higher rate is no advantage, Hz; zero: the device never changes.
    useful_hz: f64,
}

const DEGREE: (&str, f64) = ("deg", core::f64::consts::PI / 180.0);
const DEGREE_PER_SECOND: (&str, f64) = ("deg/s", core::f64::consts::PI / 180.0);

const fn limits(
    name: &'static str,
    key: &'static str,
    metric: Metric,
    unit: (&'static str, f64),
    [floor, of_range, moved, useful_hz]: [f64; 4],
) -> GroupLimits {
    GroupLimits {
        name,
        key,
        metric,
        unit,
        floor: floor * unit.1,
        of_range,
        moved: moved * unit.1,
        useful_hz,
    }
}

const NEVER: f64 = f64::INFINITY;
/// Chosen: mounting angles of a few degrees; antennas up to 10 m apart with a slow error of 10 m. Filters of
/// rate or speed may differ by any amount. The variation is constant at a place.
const LIMITS: [GroupLimits; GROUPS] = {
    use Metric::{Angle, Linear, Place};
    let m = ("m", 1.0);
    [
        limits("heading", "heading", Angle, DEGREE, [2.0, 0.1, 3.0, 10.0]),
        limits(
            "rate of turn",
            "rate_of_turn",
            Linear,
            DEGREE_PER_SECOND,
            [NEVER, 0.0, 1.0, 10.0],
        ),
        limits(
            "angular rates",
            "attitude",
            Linear,
            DEGREE_PER_SECOND,
            [NEVER, 0.0, 2.0, 10.0],
        ),
        limits("attitude", "attitude", Angle, DEGREE, [3.0, 0.25, 1.0, 10.0]),
        limits("heave", "heave", Linear, m, [0.3, 0.25, 0.2, 10.0]),
        limits("variation", "variation", Angle, DEGREE, [2.0, 0.0, NEVER, 0.0]),
        limits("position", "position", Place, m, [20.0, 0.1, 10.0, 10.0]),
        limits(
            "velocity",
            "velocity",
            Linear,
            ("m/s", 1.0),
            [NEVER, 0.0, NEVER, 0.0],
        ),
    ]
};

/// Names of the network's devices by number: the name under which each sends, and the name that it claimed.
#[derive(Clone, Debug, Default)]
pub(in crate::sensors) struct DeviceNames(BTreeMap<u32, [String; 2]>);

impl DeviceNames {
    /// The caller limits the number of devices.
    pub(in crate::sensors) fn insert(&mut self, device: u32, names: [&str; 2]) {
        let printed = |name: &str| {
            name.chars()
                .filter(|c| !c.is_control())
                .take(MAX_DEVICE_NAME)
                .collect()
        };
        self.0.insert(device, names.map(printed));
    }
    pub(super) fn is_named(&self, device: u32, name: &str) -> bool {
        match self.0.get(&device) {
            Some(names) => names.iter().any(|n| n == name),
            None => device.to_string() == name,
        }
    }
    pub(super) fn shown(&self, device: u32) -> String {
        match self.0.get(&device) {
            Some([name, claimed]) if claimed.is_empty() => name.clone(),
            Some([name, claimed]) => format!("{name} ({claimed})"),
            None => device.to_string(),
        }
    }
}

/// Value from a device, as evidence for or against it.
#[derive(Clone, Copy, Debug)]
pub(in crate::sensors) struct DeviceSample {
    /// SI; for a position latitude and longitude, deg.
    pub(in crate::sensors) value: [f64; 2],
    /// Standard deviation assumed if the device states none, and the stated standard deviation, SI.
    pub(in crate::sensors) sd: f64,
    pub(in crate::sensors) stated_sd: Option<f64>,
}

#[derive(Clone, Copy, Debug)]
struct DeviceWindow {
    count: u32,
    first: [f64; 2],
    /// Extreme differences from the first value.
    low: [f64; 2],
    high: [f64; 2],
    /// Largest standard deviation.
    sd: f64,
    stated_sd: Option<f64>,
    /// Number of values compared with the device in use, and sums of squared differences and of differences.
    compared: u32,
    squares: f64,
    sums: [f64; 2],
}

impl DeviceWindow {
    fn new(sample: &DeviceSample) -> Self {
        DeviceWindow {
            count: 0,
            first: sample.value,
            low: [0.0; 2],
            high: [0.0; 2],
            sd: 0.0,
            stated_sd: None,
            compared: 0,
            squares: 0.0,
            sums: [0.0; 2],
        }
    }
    fn add(&mut self, metric: Metric, sample: &DeviceSample, used: Option<[f64; 2]>) {
        self.count = self.count.saturating_add(1);
        let moved = metric.difference(sample.value, self.first);
        for ((low, high), x) in self.low.iter_mut().zip(&mut self.high).zip(moved) {
            (*low, *high) = (low.min(x), high.max(x));
        }
        self.sd = self.sd.max(sample.sd);
        if let Some(stated) = sample.stated_sd {
            self.stated_sd = Some(self.stated_sd.map_or(stated, |sd| sd.max(stated)));
        }
        if let Some(used) = used {
            let [x, y] = metric.difference(sample.value, used);
            self.compared = self.compared.saturating_add(1);
            self.squares += x * x + y * y;
            self.sums = [self.sums[0] + x, self.sums[1] + y];
        }
    }
    fn range(&self) -> f64 {
        (self.high[0] - self.low[0]).max(self.high[1] - self.low[1])
    }
    fn sd(&self) -> f64 {
        self.stated_sd.unwrap_or(self.sd)
    }
}

#[derive(Clone, Copy, Debug)]
struct GroupDevice {
    device: u32,
    /// Newest value and its time, ns.
    newest: ([f64; 2], i64),
    window: Option<DeviceWindow>,
    /// Times of the last velocity and the last height of a receiver, ns.
    parts_ns: [Option<i64>; 2],
    /// Rate (Hz) and standard deviation (SI) of the last window.
    rate_hz: f64,
    sd: f64,
    /// Consecutive windows with constant values, and consecutive windows with a better score than the device in use.
    still: u32,
    better: u32,
    /// Device in use that differs, consecutive windows with a difference, and sum of the RMS differences, SI.
    differs: (u32, u32, f64),
    /// Consecutive windows with a difference beyond the tolerance.
    beyond: u32,
}

impl GroupDevice {
    fn score(&self, limits: &GroupLimits) -> f64 {
        let rate = self.rate_hz.min(limits.useful_hz);
        if self.still > 0 || rate <= 0.0 || !self.sd.is_finite() {
            return 0.0;
        }
        rate / self.sd.max(1e-9).powi(2)
    }
    /// Whether this device provides velocity and height if the other does.
    fn has_parts_of(&self, other: &GroupDevice, at_ns: i64) -> bool {
        let has = |part: Option<i64>| part.is_some_and(|then_ns| is_near(at_ns, then_ns, WINDOW_NS));
        let mut parts = self.parts_ns.into_iter().zip(other.parts_ns);
        parts.all(|(own, others)| has(own) || !has(others))
    }
}

#[derive(Clone, Debug, Default)]
pub(in crate::sensors) struct DeviceGroup {
    /// Selected device, and time of its last value, ns.
    kept: Option<(u32, i64)>,
    /// Device that replaces the selected one while that is silent, and time of its last value, ns.
    stand_in: Option<(u32, i64)>,
    /// At most [`MAX_DEVICES`], in order of appearance.
    devices: Vec<GroupDevice>,
    /// Start of the window, ns.
    begun_ns: Option<i64>,
    /// Last change of the device: before, after, and reason.
    change: Option<(u32, u32, String)>,
}

impl DeviceGroup {
    pub(super) fn kept(&self) -> Option<u32> {
        self.kept.map(|(device, _)| device)
    }
    /// Whether another device provides this group.
    pub(super) fn is_spare(&self, device: u32, at_ns: i64) -> bool {
        let gives = |(of, newest): (u32, i64)| of != device && is_near(at_ns, newest, SILENT_NS);
        let is_kept = self.kept.is_none_or(|(of, _)| of == device);
        !is_kept && [self.kept, self.stand_in].into_iter().flatten().any(gives)
    }
    /// Device that provides the group at that time.
    pub(super) fn giving(&self, at_ns: i64) -> Option<u32> {
        let (device, newest) = self.stand_in.or(self.kept)?;
        is_near(at_ns, newest, SILENT_NS).then_some(device)
    }
    /// Records a value of a device, which is used from then on if the configuration selects it.
    pub(super) fn gave(&mut self, device: u32, at_ns: i64, is_chosen: bool) {
        let is_kept = self.kept.is_none_or(|(of, _)| of == device);
        if is_kept || is_chosen {
            (self.kept, self.stand_in) = (Some((device, at_ns)), None);
        } else {
            self.stand_in = Some((device, at_ns));
        }
    }
    /// Records a velocity (0) or a height (1) from a receiver.
    pub(super) fn note_part(&mut self, device: u32, part: usize, at_ns: i64) {
        let of = self.devices.iter_mut().find(|d| d.device == device);
        if let Some(noted) = of.and_then(|d| d.parts_ns.get_mut(part)) {
            *noted = Some(at_ns);
        }
    }
    /// Adds a value of a device of group `k` as evidence. `is_free` permits it to change the device in use.
    pub(super) fn observe(
        &mut self,
        k: usize,
        (device, at_ns): (u32, i64),
        sample: &DeviceSample,
        used: Option<u32>,
        is_free: bool,
    ) {
        let Some(limits) = LIMITS.get(k) else { return };
        self.close(limits, at_ns, used, is_free);
        let known = self.devices.iter().position(|d| d.device == device);
        if known.is_none() {
            if self.devices.len() >= MAX_DEVICES {
                return;
            }
            self.devices.push(GroupDevice {
                device,
                newest: (sample.value, at_ns),
                window: None,
                parts_ns: [None; 2],
                rate_hz: 0.0,
                sd: f64::INFINITY,
                still: 0,
                better: 0,
                differs: (device, 0, 0.0),
                beyond: 0,
            });
        }
        let used = used.filter(|of| *of != device);
        let of_used = self.devices.iter().find(|d| Some(d.device) == used);
        let of_used = of_used.map(|d| d.newest);
        let value = of_used.filter(|(_, then_ns)| is_near(at_ns, *then_ns, PAIR_NS));
        let Some(own) = self.devices.iter_mut().find(|d| d.device == device) else {
            return;
        };
        own.newest = (sample.value, at_ns);
        let window = own.window.get_or_insert_with(|| DeviceWindow::new(sample));
        window.add(limits.metric, sample, value.map(|(value, _)| value));
    }
    /// Ends the window if it is over. A gap or a change of the clock is not evidence.
    fn close(&mut self, limits: &GroupLimits, at_ns: i64, used: Option<u32>, is_free: bool) {
        let begun = *self.begun_ns.get_or_insert(at_ns);
        let elapsed_ns = at_ns.saturating_sub(begun);
        if (0..WINDOW_NS).contains(&elapsed_ns) {
            return;
        }
        self.begun_ns = Some(at_ns);
        if (WINDOW_NS..2 * WINDOW_NS).contains(&elapsed_ns) {
            self.weigh(limits, elapsed_ns as f64 * 1e-9, used);
            if is_free {
                self.change_device(limits, at_ns);
            }
        }
        self.devices.iter_mut().for_each(|d| d.window = None);
    }
    fn weigh(&mut self, limits: &GroupLimits, seconds: f64, used: Option<u32>) {
        let ranges = self.devices.iter().filter_map(|d| Some(d.window?.range()));
        let largest = ranges.fold(0.0, f64::max);
        let of_used = self.devices.iter().find(|d| Some(d.device) == used);
        let of_used = of_used.and_then(|d| Some((d.device, d.window?)));
        for d in &mut self.devices {
            d.rate_hz = d.window.map_or(0.0, |w| f64::from(w.count) / seconds);
            d.sd = d.window.map_or(f64::INFINITY, |w| w.sd());
            let stands = |w: DeviceWindow| w.count >= ENOUGH && w.range() <= 0.0 && largest >= limits.moved;
            d.still = match d.window.is_some_and(stands) {
                true => d.still.saturating_add(1),
                false => 0,
            };
            let other = of_used.filter(|(of, _)| *of != d.device);
            let compared = other.zip(d.window).filter(|(_, w)| w.compared >= ENOUGH);
            let different = compared.and_then(|((of, used), own)| {
                let n = f64::from(own.compared);
                let (rms, mean) = ((own.squares / n).sqrt(), own.sums[0].hypot(own.sums[1]) / n);
                let range = limits.of_range * own.range().max(used.range());
                let noise = SIGMAS * (own.sd() + used.sd());
                let allowed = limits.floor + noise;
                // In waves, time differences affect the mean less than the root mean square.
                let mean = mean - MEAN_OF_RANGE * range;
                let is_beyond = rms > allowed + range || mean > allowed;
                d.beyond = if is_beyond { d.beyond.saturating_add(1) } else { 0 };
                let differ = is_beyond || allowed.is_finite() && mean > noise;
                differ.then_some((of, rms))
            });
            d.differs = match (different, d.differs) {
                (Some((of, rms)), (before, windows, sum)) if of == before => {
                    (of, windows.saturating_add(1), sum + rms)
                }
                (Some((of, rms)), _) => (of, 1, rms),
                (None, _) => (d.device, 0, 0.0),
            };
        }
    }
    fn change_device(&mut self, limits: &GroupLimits, at_ns: i64) {
        let Some((kept, _)) = self.kept.filter(|_| limits.useful_hz > 0.0) else {
            return;
        };
        let Some(own) = self.devices.iter().find(|d| d.device == kept).copied() else {
            return;
        };
        let score = own.score(limits);
        let mut best: Option<(f64, GroupDevice)> = None;
        for d in &mut self.devices {
            let other = d.score(limits);
            let has_all = score <= 0.0 || d.has_parts_of(&own, at_ns);
            let is_better = d.device != kept && has_all && other > MARGIN * score;
            d.better = if is_better { d.better.saturating_add(1) } else { 0 };
            if d.better >= BETTER_WINDOWS && best.is_none_or(|(of_best, _)| other > of_best) {
                best = Some((other, *d));
            }
        }
        let Some((_, to)) = best else { return };
        (self.kept, self.stand_in) = (Some((to.device, to.newest.1)), None);
        self.devices.iter_mut().for_each(|d| d.better = 0);
        let stands = if own.still > 0 {
            ", whose values do not change"
        } else {
            ""
        };
        let (unit, size) = limits.unit;
        let has_sds = to.sd.is_finite() && own.sd.is_finite() && to.sd != own.sd;
        let sds = match has_sds {
            true => format!(
                ", a standard deviation of {:.2} {unit} instead of {:.2} {unit}",
                to.sd / size,
                own.sd / size
            ),
            false => String::new(),
        };
        let why = format!(
            "{:.1} Hz instead of {:.1} Hz{sds}{stands}",
            to.rate_hz, own.rate_hz
        );
        self.change = Some((kept, to.device, why));
    }
    /// Remarks on the evidence of group `k`, with messages up to `now_ns`.
    pub(super) fn remarks(&self, k: usize, names: &DeviceNames, now_ns: i64) -> Vec<Remark> {
        let Some(limits) = LIMITS.get(k) else {
            return Vec::new();
        };
        let (name, key, (unit, size)) = (limits.name, limits.key, limits.unit);
        let chooses =
            format!("{key} = \"DEVICE\" in [sensor.sources.mount.devices] chooses the device that is used");
        let mut all = Vec::new();
        let speaking = |d: &&GroupDevice| is_near(now_ns, d.newest.1, 2 * WINDOW_NS);
        for d in self.devices.iter().filter(speaking) {
            let (of, windows, sum) = d.differs;
            let seconds = |windows: u32| f64::from(windows) * WINDOW_NS as f64 * 1e-9;
            if windows >= DIFFERENT_WINDOWS {
                let text = format!(
                    "{name} of devices {} and {} differ by {:.1} {unit} over the last {:.0} s",
                    names.shown(of),
                    names.shown(d.device),
                    sum / f64::from(windows) / size,
                    seconds(windows)
                );
                all.push(if d.beyond >= DIFFERENT_WINDOWS {
                    let remedy = format!("check the mounting and calibration of both; {chooses}");
                    Remark::fault(text + ": more than their accuracies allow", remedy)
                } else {
                    Remark::fine(text + ", as mounting angles may")
                });
            }
            if d.still >= BETTER_WINDOWS {
                all.push(Remark::fault(
                    format!(
                        "{name} of device {} has not changed for {:.0} s while another's has",
                        names.shown(d.device),
                        seconds(d.still)
                    ),
                    format!("restart the device and check its cable; {chooses}"),
                ));
            }
        }
        if let Some((before, after, why)) = &self.change {
            all.push(Remark::fine(format!(
                "{name}: device {} is used in place of {}: {why}",
                names.shown(*after),
                names.shown(*before)
            )));
        }
        all
    }
    /// Remark on a selected device of group `k` that never appeared, or is silent, at `now_ns`.
    pub(super) fn missing_choice(
        &self,
        k: usize,
        (choice, names): (&str, &DeviceNames),
        now_ns: i64,
    ) -> Option<Remark> {
        let limits = LIMITS.get(k)?;
        let (name, key) = (limits.name, limits.key);
        let of_choice = |d: &&GroupDevice| names.is_named(d.device, choice);
        let given = self.kept.filter(|(of, _)| names.is_named(*of, choice));
        let others: Vec<&GroupDevice> = self.devices.iter().filter(|d| !of_choice(d)).collect();
        let listed = others.iter().take(MAX_LISTED).map(|d| names.shown(d.device));
        let mut listed: Vec<String> = listed.collect();
        if others.len() > MAX_LISTED {
            listed.push("others".into());
        }
        let came = match listed.is_empty() {
            true => "no other device sends it".to_owned(),
            false => format!("sent by {}", listed.join(", ")),
        };
        let text = match given {
            Some((_, then_ns)) if is_near(now_ns, then_ns, SILENT_NS) => return None,
            Some((_, then_ns)) => format!(
                "{name}: the chosen device {choice} has sent nothing valid for {:.0} s; {came}",
                now_ns.abs_diff(then_ns) as f64 * 1e-9
            ),
            None => format!("{name}: the chosen device {choice} has sent nothing valid yet; {came}"),
        };
        Some(Remark::fault(
            text,
            format!(
                "check the device and its power, or correct {key} in [sensor.sources.mount.devices]; empty uses the better one"
            ),
        ))
    }
}

pub(in crate::sensors) fn is_near(a_ns: i64, b_ns: i64, limit_ns: i64) -> bool {
    a_ns.abs_diff(b_ns) <= limit_ns.unsigned_abs()
}
