//! Lasting faults of the world: frozen processes, missing or wrong measurements, radio losses, weak rotors.
//! Instantaneous events (kill, jump, order) are methods of [`super::world::World`].

use core::cell::RefCell;
use std::rc::Rc;

use alight_shared::{
    bus::Reader as _,
    frames::body_from_camera,
    msg::{DroneState, GnssFix, Header, HeadingFix, ImuSample, LandedState, RangeSample, TagPose, UvdarFix},
    plain::Plain,
    process::ProcessKind::{self, Camera, Uvdar},
    time::{DroneClock, Span},
};
use alight_uav::autopilot::message::MavResult;
use alight_usv::sensors::Readings;
use nalgebra::{Rotation3, UnitQuaternion, Vector3};

use super::{
    bus::{BusSide, LockStep},
    mutant::Mutant,
};
use crate::{
    autopilots::simulated::FailsafeConditions, physics::drone::MAX_ROTORS, radio::ChannelFault,
    sensors::moving_base::MovingBaseFaults,
};

/// Active faults of the first drone, the vessel and their radio; none by default.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Failing {
    pub frozen: Frozen,
    /// Radio faults: to the drone, to the vessel.
    pub radio: [ChannelFault; 2],
    pub vessel: VesselSensorFaults,
    pub drone: DroneSensorFaults,
    pub moving_base: MovingBaseFaults,
    pub autopilot: AutopilotFaults,
    pub mutant: Option<Mutant>,
    /// Thrust loss of the first rotor, and of all rotors, 0 to 1.
    pub weak: [f64; 2],
    /// Rate errors of the steady clocks of vessel and drone, s/s; -1 stops a clock.
    pub clock_rates: [f64; 2],
    /// Force and moment on the vessel in its body axes: surge, sway, heave, roll, pitch, yaw, N and Nm.
    pub push: [f64; 6],
    /// Amplitude of the roll moment caused by another ship's wake, Nm.
    pub wake_nm: f64,
    pub solve_s: f64,
    /// Position of a second vessel with the same identity, m north of the first; 0: no second vessel.
    pub twin_m: f64,
}

#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Frozen {
    /// Frozen processes of the drone; their input waits, up to the capacity of its topics.
    pub processes: Vec<ProcessKind>,
    /// The drone's computer is frozen: packets and bytes wait, measurements are lost.
    pub computer: bool,
    /// The vessel's computer is frozen: orders wait, measurements are lost.
    pub vessel: bool,
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct VesselSensorFaults {
    pub imu_lost: bool,
    pub gnss_lost: bool,
    pub heading_lost: bool,
    pub heading_off_rad: f64,
    /// Error of every second heading, rad, as from two devices on one bus.
    pub heading_mixed_rad: f64,
    /// Error of GNSS fixes, north and up, m.
    pub gnss_off_m: [f64; 2],
    /// Error of every second fix, m to the north, as from a second receiver on the line.
    pub gnss_mixed_m: f64,
    /// For IMU, GNSS and heading: the sensor repeats its first value.
    pub stuck: [bool; 3],
    /// Angular rate, velocity and heading that are sent as zero.
    pub zero: [bool; 3],
    /// Lead of the clocks of IMU, receiver and compass, s.
    pub ahead_s: [f64; 3],
    /// Rate error of the compass's clock, s/s.
    pub compass_clock_rate: f64,
    /// Growth of the delay on the devices' lines, s/s.
    pub line_fills: f64,
    pub gyro_off_radps: f64,
    /// The yaw rate has the other sign.
    pub yaw_rate_inverted: bool,
    /// The angular rates are in deg/s.
    pub rates_in_degrees: bool,
    /// Roll has the other sign: in the angular rate, and in the specific force across.
    pub roll_inverted: bool,
    /// Clipping limit of the measured specific force, m/s2; 0: no limit.
    pub clip_mps2: f64,
    /// Delay of measurements, s; the vessel stamps them on arrival.
    pub late_s: f64,
    /// Rotation of the IMU about the vessel's x axis, rad.
    pub mounting_rad: f64,
}

impl VesselSensorFaults {
    /// Applies the faults; `held` stores the first value of each stuck sensor.
    pub fn spoil(&self, readings: &mut Readings, held: &mut HeldReadings) {
        if self.imu_lost {
            readings.imu.clear();
        }
        if self.gnss_lost {
            readings.gnss.clear();
        }
        if self.heading_lost {
            readings.heading.clear();
        }
        for m in &mut readings.heading {
            m.heading += self.heading_off_rad;
        }
        let [north, up] = self.gnss_off_m;
        for m in &mut readings.gnss {
            m.position = [m.position[0] + north, m.position[1], m.position[2] - up];
        }
        for m in readings.heading.iter_mut().filter(|m| m.header.sequence % 2 == 1) {
            m.heading += self.heading_mixed_rad;
        }
        for m in readings.gnss.iter_mut().filter(|m| m.header.sequence % 2 == 1) {
            m.position[0] += self.gnss_mixed_m;
        }
        let turned = Rotation3::from_axis_angle(&Vector3::x_axis(), self.mounting_rad);
        for m in &mut readings.imu {
            m.gyro = (turned * Vector3::from(m.gyro)).into();
            m.gyro[0] += self.gyro_off_radps;
            m.accelerometer = (turned * Vector3::from(m.accelerometer)).into();
            if self.clip_mps2 > 0.0 {
                m.accelerometer = m.accelerometer.map(|a| a.clamp(-self.clip_mps2, self.clip_mps2));
            }
        }
        self.hold(readings, held);
        self.change_sign_and_unit(readings);
        self.clear(readings);
        shift(readings, [Span::from_secs(self.late_s); 4]);
    }
    fn change_sign_and_unit(&self, readings: &mut Readings) {
        for m in &mut readings.imu {
            if self.yaw_rate_inverted {
                m.gyro[2] = -m.gyro[2];
            }
            if self.roll_inverted {
                m.gyro[0] = -m.gyro[0];
                m.accelerometer[1] = -m.accelerometer[1];
            }
            if self.rates_in_degrees {
                m.gyro = m.gyro.map(f64::to_degrees);
            }
        }
    }
    fn clear(&self, readings: &mut Readings) {
        let [rates, velocity, heading] = self.zero;
        if rates {
            readings.imu.iter_mut().for_each(|m| m.gyro = [0.0; 3]);
        }
        if velocity {
            readings.gnss.iter_mut().for_each(|m| m.velocity = [0.0; 3]);
        }
        if heading {
            readings.heading.iter_mut().for_each(|m| m.heading = 0.0);
        }
    }
    fn hold(&self, readings: &mut Readings, held: &mut HeldReadings) {
        let [imu, gnss, heading] = self.stuck;
        held.imu = held.imu.filter(|_| imu);
        held.gnss = held.gnss.filter(|_| gnss);
        held.heading = held.heading.filter(|_| heading);
        for m in readings.imu.iter_mut().filter(|_| imu) {
            let first = held.imu.get_or_insert(*m);
            m.gyro = first.gyro;
            m.accelerometer = first.accelerometer;
        }
        for m in readings.gnss.iter_mut().filter(|_| gnss) {
            let header = m.header;
            *m = *held.gnss.get_or_insert(*m);
            m.header = header;
        }
        for m in readings.heading.iter_mut().filter(|_| heading) {
            m.heading = held.heading.get_or_insert(*m).heading;
        }
    }
}

/// Shifts the times of IMU, GNSS, heading and attitude.
pub fn shift(readings: &mut Readings, [imu, gnss, heading, attitude]: [Span; 4]) {
    for m in &mut readings.imu {
        m.header.at += imu;
    }
    for m in &mut readings.gnss {
        m.header.at += gnss;
    }
    for m in &mut readings.heading {
        m.header.at += heading;
    }
    for m in &mut readings.attitude {
        m.header.at += attitude;
    }
}

#[derive(Clone, Copy, Debug, Default)]
pub struct HeldReadings {
    imu: Option<ImuSample>,
    gnss: Option<GnssFix>,
    heading: Option<HeadingFix>,
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DroneSensorFaults {
    pub blind: bool,
    pub range_lost: bool,
    pub range_stuck: bool,
    /// Range error, m; positive if ranges are too long.
    pub range_off_m: f64,
    /// Every range is 0, as from a device that reports a missing echo as 0.
    pub range_zero: bool,
    /// Fraction of detections that are lost.
    pub lost: f64,
    /// Additional standard deviation of detections, m, as from motion blur.
    pub scatter_m: f64,
    /// Error of every third detection, m to the right in the image, as from another tag.
    pub false_tag_m: f64,
    /// Delay of the image stamps, s.
    pub images_late_s: f64,
    /// Position of another vessel relative to ours, NED, m; the cameras detect its deck instead.
    pub neighbour_offset_m: [f64; 3],
}

impl DroneSensorFaults {
    fn spoil_tags(&self, tags: &mut Vec<TagPose>) {
        tags.retain(|m| !self.blind && by_chance(m.header.sequence, 0) >= self.lost);
        for m in tags {
            let n = m.header.sequence;
            for (axis, p) in (1..).zip(&mut m.position) {
                // Uniform with a standard deviation of 1.
                *p += self.scatter_m * 12.0_f64.sqrt() * (by_chance(n, axis) - 0.5);
            }
            if n % 3 == 0 {
                m.position[0] += self.false_tag_m;
            }
        }
    }
    fn spoil_fixes(&self, fixes: &mut Vec<UvdarFix>) {
        fixes.retain(|_| !self.blind);
    }
    /// `repeated_m` stores the first range, which a stuck rangefinder repeats.
    pub(super) fn spoil_ranges(&self, ranges: &mut Vec<RangeSample>, repeated_m: &mut Option<f64>) {
        if self.range_lost {
            ranges.clear();
        }
        if !self.range_stuck {
            *repeated_m = None;
        }
        for RangeSample { range_m, .. } in ranges {
            *range_m = (*range_m + self.range_off_m).max(0.0);
            if self.range_stuck {
                *range_m = *repeated_m.get_or_insert(*range_m);
            }
            if self.range_zero {
                *range_m = 0.0;
            }
        }
    }
}

/// Active sensor faults, read by the wrappers between cameras and bus.
pub(super) type Spoiled = Rc<RefCell<DroneSensorFaults>>;

pub(super) fn spoil_sensors(bus: &LockStep, faults: &Spoiled) {
    let tag = |m: &mut TagPose, by: &DetectionShift| by.shift(&mut m.header, &mut m.position);
    spoil_detections(bus, Camera, faults, tag, DroneSensorFaults::spoil_tags);
    let fix = |m: &mut UvdarFix, by: &DetectionShift| by.shift(&mut m.header, &mut m.position);
    spoil_detections(bus, Uvdar, faults, fix, DroneSensorFaults::spoil_fixes);
}

fn spoil_detections<M: Plain>(
    bus: &LockStep,
    row: ProcessKind,
    faults: &Spoiled,
    shift: fn(&mut M, &DetectionShift),
    spoil: fn(&DroneSensorFaults, &mut Vec<M>),
) {
    let now = Rc::clone(faults);
    let mut drones = bus.receiver::<DroneState>();
    let mut attitude = UnitQuaternion::identity();
    bus.wrap(row, BusSide::Written, move |now_ns, mut detections: Vec<M>| {
        attitude = drones.newest(now_ns).map_or(attitude, |d| d.attitude());
        let faults = now.borrow();
        let by = DetectionShift::of(&faults, &attitude);
        for m in &mut detections {
            shift(m, &by);
        }
        spoil(&faults, &mut detections);
        detections
    });
}

struct DetectionShift {
    late: Span,
    /// Offset in camera axes, m.
    offset: Vector3<f64>,
}

impl DetectionShift {
    /// `attitude` is the autopilot's estimate.
    fn of(faults: &DroneSensorFaults, attitude: &UnitQuaternion<f64>) -> DetectionShift {
        let offset = attitude.inverse() * Vector3::from(faults.neighbour_offset_m);
        DetectionShift {
            late: Span::from_secs(faults.images_late_s),
            offset: body_from_camera().transpose() * offset,
        }
    }
    fn shift(&self, header: &mut Header<DroneClock>, position: &mut [f64; 3]) {
        header.at += self.late;
        for (p, by) in position.iter_mut().zip(self.offset.iter()) {
            *p += by;
        }
    }
}

/// Pseudo-random number from 0 to 1 that depends only on the message's number, which makes flights repeatable.
fn by_chance(sequence: u32, axis: u32) -> f64 {
    let mixed = sequence
        .wrapping_mul(4)
        .wrapping_add(axis)
        .wrapping_mul(0x9e37_79b9);
    f64::from((mixed ^ (mixed >> 15)).wrapping_mul(0x85eb_ca6b) >> 8) / f64::from(1_u32 << 24)
}

#[derive(Clone, Debug, Default, PartialEq)]
pub struct AutopilotFaults {
    pub silent: bool,
    pub cut: bool,
    /// Ids of messages that are not sent.
    pub muted: Vec<u32>,
    /// Answer to every command; commands are not executed.
    pub answer: Option<MavResult>,
    pub no_battery: bool,
    /// The reported charge freezes (0), or toggles between the frozen value and one higher by this amount.
    pub battery_stuck: Option<f64>,
    /// Charge that the gauge reads, 0 to 1.
    pub battery_reads: Option<f64>,
    pub drain_per_s: f64,
    pub landed_report: Option<LandedState>,
    /// Northward drift of the autopilot's position, m/s, as under slow spoofing.
    pub drift_mps: f64,
    pub conditions: FailsafeConditions,
}

/// `[first, all]`: thrust loss of the first rotor, and of all rotors.
pub(super) fn weakened([first, all]: [f64; 2], motors: [f64; MAX_ROTORS]) -> [f64; MAX_ROTORS] {
    let mut weak = motors.map(|m| m * (1.0 - all));
    if let Some(motor) = weak.first_mut() {
        *motor *= 1.0 - first;
    }
    weak
}
