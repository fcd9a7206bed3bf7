//! Faults of the world that last: processes that stand still, measurements that do not come or are wrong,
//! a radio that loses, rotors that are weak. What happens once (a kill, a jump, an order) is a call of [`super::world::World`].

use core::cell::RefCell;
use std::rc::Rc;

use alight_shared::bus::Reader as _;
use alight_shared::frames::body_from_camera;
use alight_shared::msg::{
    DroneState, GnssFix, Header, HeadingFix, ImuSample, LandedState, RangeSample, TagPose, UvdarFix,
};
use alight_shared::plain::Plain;
use alight_shared::process::ProcessKind::{self, Camera, Uvdar};
use alight_shared::time::{DroneClock, Span};
use alight_uav::autopilot::message::CommandResult;
use alight_usv::sensors::Readings;
use nalgebra::{Rotation3, UnitQuaternion, Vector3};

use super::bus::{BusSide, LockStep};
use super::mutant::Mutant;
use crate::physics::drone::MAX_ROTORS;
use crate::radio::ChannelFault;
use crate::sensors::moving_base::MovingBaseFaults;

/// Present faults of the first drone, the vessel and the radio between them; none at first.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Failing {
    /// Processes that stand still.
    pub frozen: Frozen,
    /// The radio: to the drone, to the vessel.
    pub radio: [ChannelFault; 2],
    /// The vessel's sensors.
    pub vessel: VesselSensorFaults,
    /// The drone's own.
    pub drone: DroneSensorFaults,
    /// The drone's receiver with a moving base.
    pub moving_base: MovingBaseFaults,
    /// Faults of the autopilot.
    pub autopilot: AutopilotFaults,
    /// A defect of the drone's nodes.
    pub mutant: Option<Mutant>,
    /// Fraction of its thrust that the first rotor lacks, and that all lack, 0 to 1.
    pub weak: [f64; 2],
    /// So much faster than true time the steady clocks run, the vessel's and the drone's, s/s; -1: one stands still.
    pub clock_rates: [f64; 2],
    /// Force and moment on the vessel: surge, sway, heave, roll, pitch, yaw of the body, N and Nm.
    pub push: [f64; 6],
    /// Amplitude of the roll moment of another ship's wake, Nm.
    pub wake_nm: f64,
    /// A plan takes so much longer, s.
    pub solve_s: f64,
    /// A second vessel of the same identity sends, so far north of the first, m; 0: none does.
    pub twin_m: f64,
}

/// Processes that stand still, and computers.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Frozen {
    /// Processes of the drone: what reaches one meanwhile waits, as much as its topics hold.
    pub processes: Vec<ProcessKind>,
    /// The drone's whole computer: packets and bytes wait, measurements are lost.
    pub computer: bool,
    /// The vessel's: orders wait, measurements are lost.
    pub vessel: bool,
}

/// Faults of the vessel's sensors.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct VesselSensorFaults {
    /// No inertial sample comes.
    pub imu_lost: bool,
    /// No fix comes.
    pub gnss_lost: bool,
    /// No heading comes.
    pub heading_lost: bool,
    /// Headings are so far off, rad.
    pub heading_off_rad: f64,
    /// Every second heading is so far off, rad: two devices on one bus.
    pub heading_mixed_rad: f64,
    /// Fixes are so far north, and so high, m.
    pub gnss_off_m: [f64; 2],
    /// Inertial samples, fixes, headings repeat the first one that did.
    pub stuck: [bool; 3],
    /// The rate about the vessel's x is so far off, rad/s.
    pub gyro_off_radps: f64,
    /// Specific force is not measured beyond this, m/s2; 0: no bound.
    pub clip_mps2: f64,
    /// Measurements arrive so late, s, and are stamped then.
    pub late_s: f64,
    /// The inertial sensor was turned about the vessel's x, rad.
    pub mounting_rad: f64,
}

impl VesselSensorFaults {
    /// Applies the faults to readings; `held` has the first of each that is stuck.
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
        shift(readings, Span::from_secs(self.late_s));
    }
    fn hold(&self, readings: &mut Readings, held: &mut HeldReadings) {
        let [imu, gnss, heading] = self.stuck;
        held.imu = held.imu.filter(|_| imu);
        held.gnss = held.gnss.filter(|_| gnss);
        held.heading = held.heading.filter(|_| heading);
        for m in readings.imu.iter_mut().filter(|_| imu) {
            let first = held.imu.get_or_insert(*m);
            (m.gyro, m.accelerometer) = (first.gyro, first.accelerometer);
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

/// The vessel's readings stamped so much later.
pub fn shift(readings: &mut Readings, by: Span) {
    readings.imu.iter_mut().for_each(|m| m.header.at += by);
    readings.gnss.iter_mut().for_each(|m| m.header.at += by);
    readings.heading.iter_mut().for_each(|m| m.header.at += by);
    readings.attitude.iter_mut().for_each(|m| m.header.at += by);
}

/// Readings that stuck sensors repeat.
#[derive(Clone, Copy, Debug, Default)]
pub struct HeldReadings {
    imu: Option<ImuSample>,
    gnss: Option<GnssFix>,
    heading: Option<HeadingFix>,
}

/// Faults of the drone's camera and rangefinder.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DroneSensorFaults {
    /// Nothing is detected.
    pub blind: bool,
    /// No range comes.
    pub range_lost: bool,
    /// Ranges repeat the first one that did.
    pub range_stuck: bool,
    /// Ranges are so much too long, m.
    pub range_off_m: f64,
    /// Ranges are 0, as of a device that measures nothing and does not report that.
    pub range_zero: bool,
    /// Fraction of detections that is lost.
    pub lost: f64,
    /// Detections scatter by this more, m: images are smeared.
    pub scatter_m: f64,
    /// Every third detection is of a tag so far to the right in the image, m.
    pub false_tag_m: f64,
    /// Images are stamped so late, s.
    pub images_late_s: f64,
    /// Offset of another vessel, whose deck the cameras see instead, from this one, NED, m.
    pub neighbour_offset_m: [f64; 3],
}

impl DroneSensorFaults {
    /// Applies the faults to detections of tags.
    fn spoil_tags(&self, tags: &mut Vec<TagPose>) {
        tags.retain(|m| !self.blind && by_chance(m.header.sequence, 0) >= self.lost);
        for m in tags {
            let n = m.header.sequence;
            for (axis, p) in (1..).zip(&mut m.position) {
                // Uniform with the standard deviation of 1.
                *p += self.scatter_m * 12.0_f64.sqrt() * (by_chance(n, axis) - 0.5);
            }
            if n % 3 == 0 {
                m.position[0] += self.false_tag_m;
            }
        }
    }
    /// Applies the faults to fixes by markers.
    fn spoil_fixes(&self, fixes: &mut Vec<UvdarFix>) {
        fixes.retain(|_| !self.blind);
    }
    /// Applies the faults to ranges; `repeated_m` is the one that a stuck rangefinder repeats, m.
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

/// The faults of a drone's sensors as they are now, which wrappers between the cameras and the bus read.
pub(super) type Spoiled = Rc<RefCell<DroneSensorFaults>>;

/// Lets cameras fail by what `faults` are at the time.
pub(super) fn spoil_sensors(bus: &LockStep, faults: &Spoiled) {
    let tag = |m: &mut TagPose, by: &DetectionShift| by.shift(&mut m.header, &mut m.position);
    spoil_detections(bus, Camera, faults, tag, DroneSensorFaults::spoil_tags);
    let fix = |m: &mut UvdarFix, by: &DetectionShift| by.shift(&mut m.header, &mut m.position);
    spoil_detections(bus, Uvdar, faults, fix, DroneSensorFaults::spoil_fixes);
}

/// Applies the faults to the detections of a camera's row.
fn spoil_detections<M: Plain>(
    bus: &LockStep,
    row: ProcessKind,
    faults: &Spoiled,
    shift: fn(&mut M, &DetectionShift),
    spoil: fn(&DroneSensorFaults, &mut Vec<M>),
) {
    let (now, mut drones) = (Rc::clone(faults), bus.receiver::<DroneState>());
    let mut attitude = UnitQuaternion::identity();
    bus.wrap(row, BusSide::Written, move |now_ns, mut detections: Vec<M>| {
        attitude = drones.newest(now_ns).map_or(attitude, |d| d.attitude());
        let faults = now.borrow();
        let by = DetectionShift::of(&faults, &attitude);
        detections.iter_mut().for_each(|m| shift(m, &by));
        spoil(&faults, &mut detections);
        detections
    });
}

/// Delay and offset of detections.
struct DetectionShift {
    late: Span,
    /// Camera axes, m.
    offset: Vector3<f64>,
}

impl DetectionShift {
    /// Delay and offset for a drone with this attitude, by its autopilot.
    fn of(faults: &DroneSensorFaults, attitude: &UnitQuaternion<f64>) -> DetectionShift {
        let offset = attitude.inverse() * Vector3::from(faults.neighbour_offset_m);
        DetectionShift {
            late: Span::from_secs(faults.images_late_s),
            offset: body_from_camera().transpose() * offset,
        }
    }
    fn shift(&self, header: &mut Header<DroneClock>, position: &mut [f64; 3]) {
        header.at += self.late;
        position
            .iter_mut()
            .zip(self.offset.iter())
            .for_each(|(p, by)| *p += by);
    }
}

/// Uniform in 0 to 1 by a message's number: the same in each flight of a list.
fn by_chance(sequence: u32, axis: u32) -> f64 {
    let mixed = sequence
        .wrapping_mul(4)
        .wrapping_add(axis)
        .wrapping_mul(0x9e37_79b9);
    f64::from((mixed ^ (mixed >> 15)).wrapping_mul(0x85eb_ca6b) >> 8) / f64::from(1_u32 << 24)
}

/// Faults of the autopilot and the wire to it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AutopilotFaults {
    /// It sends nothing.
    pub silent: bool,
    /// Nothing passes the cable.
    pub cut: bool,
    /// Messages with these numbers are not sent.
    pub muted: Vec<u32>,
    /// It answers every command so instead of obeying.
    pub answer: Option<CommandResult>,
    /// It reports no battery.
    pub no_battery: bool,
    /// It reports the battery that it had, or toggles by this charge above it.
    pub battery_stuck: Option<f64>,
    /// Additional drain of its battery, 1/s.
    pub drain_per_s: f64,
    /// It reports this landed state.
    pub landed_report: Option<LandedState>,
    /// Drift of its position to the north, m/s, as under a slow spoof.
    pub drift_mps: f64,
    /// The remote control's signal is lost.
    pub remote_control_lost: bool,
    /// The ground station's heartbeats have ceased.
    pub data_link_lost: bool,
}

/// Thrust fractions of weakened rotors, `[first, all]` being the fraction that the first lacks, and that all lack.
pub(super) fn weakened([first, all]: [f64; 2], motors: [f64; MAX_ROTORS]) -> [f64; MAX_ROTORS] {
    let mut weak = motors.map(|m| m * (1.0 - all));
    if let Some(motor) = weak.first_mut() {
        *motor *= 1.0 - first;
    }
    weak
}
