//! What fails of the world for as long as it does: processes that stand still, measurements that do not come or are wrong,
//! a radio that loses, rotors that are weak. What happens once (a kill, a jump, an order) is a call of [`super::world::World`].

use alight_shared::msg::RangeSample;
use alight_uav::autopilot::message::CommandResult;
use alight_usv::sensors::Readings;

use super::fault::Part;
use super::mutant::Mutant;
use crate::physics::drone::MAX_ROTORS;
use crate::radio::ChannelFault;
use crate::sensors::DroneReadings;

/// What fails of the first drone, the vessel and the radio between them; as made, nothing.
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
    /// What the autopilot does wrong.
    pub autopilot: AutopilotFaults,
    /// A defect of the drone's nodes.
    pub mutant: Option<Mutant>,
    /// Fraction of its thrust that the first rotor lacks, and that all lack, 0 to 1.
    pub weak: [f64; 2],
}

/// Processes that stand still ([`super::world::World::freeze`]), and computers.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Frozen {
    /// Processes of the drone.
    pub parts: Vec<Part>,
    /// The planner's: what reaches it meanwhile is lost.
    pub planner: bool,
    /// The drone's whole computer: packets and bytes wait, measurements are lost.
    pub computer: bool,
    /// The vessel's: orders wait, measurements are lost.
    pub vessel: bool,
}

/// Of the vessel's sensors.
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
    /// Fixes are so far north, and so high, m.
    pub gnss_off_m: [f64; 2],
}

impl VesselSensorFaults {
    /// What becomes of readings.
    pub fn spoil(&self, readings: &mut Readings) {
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
    }
}

/// Of the drone's camera and rangefinder.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DroneSensorFaults {
    /// Nothing is seen.
    pub blind: bool,
    /// No range comes.
    pub range_lost: bool,
    /// Ranges repeat the first one that did.
    pub range_stuck: bool,
    /// Ranges are so much too long, m.
    pub range_off_m: f64,
}

impl DroneSensorFaults {
    /// What becomes of readings; `repeated_m` is the range that a stuck rangefinder repeats, m.
    pub fn spoil(&self, readings: &mut DroneReadings, repeated_m: &mut Option<f64>) {
        if self.blind {
            readings.tags.clear();
            readings.uvdar.clear();
            readings.shots.clear();
        }
        if self.range_lost {
            readings.ranges.clear();
        }
        if !self.range_stuck {
            *repeated_m = None;
        }
        for RangeSample { range_m, .. } in &mut readings.ranges {
            *range_m = (*range_m + self.range_off_m).max(0.0);
            if self.range_stuck {
                *range_m = *repeated_m.get_or_insert(*range_m);
            }
        }
    }
}

/// Of the autopilot and the wire to it.
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
    /// The remote control's signal is lost.
    pub remote_control_lost: bool,
    /// The ground station's heartbeats have ceased.
    pub data_link_lost: bool,
}

impl Failing {
    /// What the rotors give of what is asked of them.
    pub fn weaken(&self, motors: [f64; MAX_ROTORS]) -> [f64; MAX_ROTORS] {
        let [first, all] = self.weak;
        let mut weak = motors.map(|m| m * (1.0 - all));
        if let Some(motor) = weak.first_mut() {
            *motor *= 1.0 - first;
        }
        weak
    }
}
