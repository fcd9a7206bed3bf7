use alight_shared::{
    frames::{body_from_camera, body_rates, yaw_rotation},
    msg::{RangeSample, TagPose, UvdarFix, VesselEstimate},
    time::{DroneClock, DroneTime},
    vessel_model::{PITCH, ROLL, YAW, turn_tilt},
};
use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};

use super::{
    config::PredictorConfig,
    track::{FrameJump, Pose},
    waves::AXES,
};

/// Limits within which the drone counts as above the deck: lateral offset of the line of sight as a fraction of its
/// height, or in m. Chosen: seeds 100 to 111 of Table II and a hover at 1.5 m.
const OVERHEAD: (f64, f64) = (0.35, 2.0);

/// Standard deviations of the vessel filter's errors that last for seconds, of value and rate, m, rad, and per second.
/// They are due to GNSS errors that the vessel's filter does not average out and that are shorter than the slow error,
/// which is a state here. Chosen.
const WANDER: [f64; AXES] = [0.1, 0.1, 0.05, 1e-3, 1e-3, 1e-2];

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ObservationKind {
    Estimate,
    Tag,
    Uvdar,
    Range,
    /// Receiver with the vessel as its moving base.
    Relative,
}

impl ObservationKind {
    pub(super) const COUNT: usize = 5;
    pub(super) const CAMERA: [ObservationKind; 2] = [ObservationKind::Tag, ObservationKind::Uvdar];
}

pub type Measured = Option<(f64, f64)>;

/// Values and rates of the deck at one time, by degree of freedom. The radio gives the height of the deck on a level
/// vessel, and the tilt of a vessel that heads north by its own compass. The other kinds give the deck's height, with
/// north by the drone's compass.
#[derive(Clone, Copy, Debug)]
pub struct DeckObservation {
    pub at: DroneTime,
    pub kind: ObservationKind,
    /// Position of the deck's centre, tilt of a deck that heads north, and heading.
    pub value: [Measured; AXES],
    pub rate: [Measured; AXES],
    /// Position of the deck's centre relative to the drone, NED, m; zero if the measurement is not along that line.
    pub from_drone: Vector3<f64>,
}

impl DeckObservation {
    /// Shift of the north value per rotation of vision about east, and of the east value per rotation about north,
    /// m/rad. Zero for a view from the side, where errors of heading and distance would be mistaken for the rotation.
    pub fn lever(&self) -> [f64; 2] {
        let (fraction, lateral_m) = OVERHEAD;
        let [x, y, z]: [f64; 3] = self.from_drone.into();
        if x.hypot(y) < (fraction * z).max(lateral_m) {
            [z, -z]
        } else {
            [0.0; 2]
        }
    }
    /// Applies a jump of the autopilot's estimate. Detections stay relative to the drone, radio values move with the
    /// datum, and a relative position stays in the frame even if the heading jumps.
    pub fn shift(&mut self, jump: &FrameJump) {
        let (by, yaw) = match self.kind {
            ObservationKind::Estimate => (jump.datum, 0.0),
            ObservationKind::Relative => (jump.moved, 0.0),
            ObservationKind::Tag | ObservationKind::Uvdar | ObservationKind::Range => match self.value {
                [Some((n, _)), Some((e, _)), Some((d, _)), ..] => {
                    let place = Vector3::new(n, e, d);
                    (jump.of(&place) - place, jump.yaw)
                }
                // A rotation about the vertical does not change a height.
                _ => (jump.moved, 0.0),
            },
        };
        for (v, by) in self.value.iter_mut().zip(by.iter()) {
            if let Some((v, _)) = v {
                *v += by;
            }
        }
        if let [.., Some((north, _)), Some((east, _)), Some((heading, _))] = &mut self.value {
            (*north, *east) = turn_tilt(*north, *east, -yaw);
            *heading += yaw;
        }
        self.from_drone = yaw_rotation(yaw) * self.from_drone;
    }
}

/// Variances of value and rate stated by the vessel; for tilt, the mean of both axes.
pub fn stated(e: &VesselEstimate<DroneClock>) -> [(f64, f64); AXES] {
    let own = |i: usize| {
        let [value, _, rate] = e.covariance(i);
        (value, rate)
    };
    let roll = own(3);
    let pitch = own(4);
    let tilt = (0.5 * (roll.0 + pitch.0), 0.5 * (roll.1 + pitch.1));
    [own(0), own(1), own(2), tilt, tilt, own(5)]
}

/// Estimate in the drone's frame. `clock_sd`, the standard deviation of the clock offset (s), adds uncertainty in
/// proportion to the rate. In tilt, modes and estimate have the same error, and the filter uses their difference.
pub fn estimate(e: &VesselEstimate<DroneClock>, clock_sd: f64) -> DeckObservation {
    let [roll, pitch, yaw] = [e.eta[ROLL], e.eta[PITCH], e.eta[YAW]];
    let rotation = UnitQuaternion::from_euler_angles(roll, pitch, yaw);
    let dot = e.eta_dot.map(f64::from);
    let ddot = e.eta_ddot.map(f64::from);
    let spin = rotation * body_rates(roll, pitch, Vector3::new(dot[3], dot[4], dot[5]));
    let lever_arm = rotation * e.deck_centre();
    // Height on a level vessel, because the part due to tilt is not wave motion.
    let position = e.position() + Vector3::new(lever_arm.x, lever_arm.y, e.deck_centre().z);
    let swing = spin.cross(&lever_arm);
    let velocity = Vector3::new(dot[0] + swing.x, dot[1] + swing.y, dot[2]);
    let tilt = turn_tilt(roll, pitch, -yaw);
    let (s, cos) = yaw.sin_cos();
    // Time derivative of the rotated tilt (small-angle form of turn_tilt).
    let dr = dot[3] - dot[5] * pitch;
    let dp = dot[4] + dot[5] * roll;
    let tilt_rate = (cos * dr - s * dp, s * dr + cos * dp);
    let mut stated = stated(e);
    let height = lever_arm.z * lever_arm.z;
    let tilt_variance = stated[3];
    for (value, rate) in stated.iter_mut().take(2) {
        *value += height * tilt_variance.0;
        *rate += height * tilt_variance.1;
    }
    let values = [position.x, position.y, position.z, tilt.0, tilt.1, yaw];
    let rates = [
        velocity.x,
        velocity.y,
        velocity.z,
        tilt_rate.0,
        tilt_rate.1,
        dot[5],
    ];
    let tilt_acc = ddot[3].hypot(ddot[4]);
    let acc = [ddot[0], ddot[1], ddot[2], tilt_acc, tilt_acc, ddot[5]];
    let noise =
        |i: usize, variance: f64, change: f64| variance.max(WANDER[i].powi(2)) + (change * clock_sd).powi(2);
    DeckObservation {
        at: e.header.at,
        kind: ObservationKind::Estimate,
        value: core::array::from_fn(|i| Some((values[i], noise(i, stated[i].0, rates[i])))),
        rate: core::array::from_fn(|i| Some((rates[i], noise(i, stated[i].1, acc[i])))),
        from_drone: Vector3::zeros(),
    }
}

/// Height of the deck's centre from the vessel's estimate (down, m), and its rate, m/s, including the effect of tilt.
pub fn deck_height(e: &VesselEstimate<DroneClock>) -> [f64; 2] {
    let [roll, pitch, yaw] = [e.eta[ROLL], e.eta[PITCH], e.eta[YAW]];
    let dot = e.eta_dot.map(f64::from);
    let rotation = UnitQuaternion::from_euler_angles(roll, pitch, yaw);
    let spin = rotation * body_rates(roll, pitch, Vector3::new(dot[3], dot[4], dot[5]));
    let lever_arm = rotation * e.deck_centre();
    [e.position().z + lever_arm.z, dot[2] + spin.cross(&lever_arm).z]
}

/// Diagonal of `R diag(v) R'`.
fn turned(r: &Matrix3<f64>, v: &Vector3<f64>) -> Vector3<f64> {
    r.component_mul(r) * v
}

/// Position of the deck's centre, tilt and heading.
pub fn tag(m: &TagPose, drone: &Pose, c: &PredictorConfig) -> DeckObservation {
    let camera = drone.attitude.to_rotation_matrix().into_inner() * body_from_camera();
    let [w, x, y, z] = m.attitude;
    let tag = UnitQuaternion::new_normalize(Quaternion::new(w, x, y, z));
    let deck = nalgebra::Rotation3::from_matrix_unchecked(camera * tag.to_rotation_matrix().into_inner());
    let (roll, pitch, yaw) = deck.euler_angles();
    let tilt = turn_tilt(roll, pitch, -yaw);

    let from_drone = camera * Vector3::from(m.position) + drone.attitude * Vector3::from(c.drone.camera_m);
    let centre = drone.position + from_drone;

    let [px, py, pz, rx, ry, rz] = m.variance;
    let floor = c.tag_min_sd_m.powi(2);
    let noise = turned(&camera, &Vector3::new(px, py, pz)) + drone.variance * c.drone_variance_fraction;
    let angle = turned(&camera, &Vector3::new(rx, ry, rz)).add_scalar(c.tag_min_sd_rad.powi(2));
    let var: [f64; AXES] = [
        noise.x + floor,
        noise.y + floor,
        noise.z + floor,
        angle.x,
        angle.y,
        angle.z,
    ];
    let value = [centre.x, centre.y, centre.z, tilt.0, tilt.1, yaw];
    DeckObservation {
        at: m.header.at,
        kind: ObservationKind::Tag,
        value: core::array::from_fn(|i| Some((value[i], var[i]))),
        rate: [None; AXES],
        from_drone,
    }
}

/// Position of the deck's centre.
pub fn uvdar(m: &UvdarFix, drone: &Pose, c: &PredictorConfig) -> DeckObservation {
    let camera = drone.attitude.to_rotation_matrix().into_inner() * body_from_camera();
    let from_drone = camera * Vector3::from(m.position) + drone.attitude * Vector3::from(c.drone.camera_m);
    let centre = drone.position + from_drone;
    let var = turned(&camera, &Vector3::from(m.variance)) + drone.variance * c.drone_variance_fraction;
    let mut value = [None; AXES];
    for i in 0..3 {
        value[i] = Some((centre[i], var[i] + c.camera_mount_sd_m.powi(2)));
    }
    DeckObservation {
        at: m.header.at,
        kind: ObservationKind::Uvdar,
        value,
        rate: [None; AXES],
        from_drone,
    }
}

#[derive(Clone, Copy, Debug)]
pub struct Plane {
    pub centre: Vector3<f64>,
    pub rotation: UnitQuaternion<f64>,
    /// Standard deviation of the horizontal position, m.
    pub position_sd: f64,
    /// Standard deviation of the tilt, rad.
    pub tilt_sd: f64,
}

/// Height of the deck's centre; None if the spot may lie outside the deck.
pub fn range(m: &RangeSample, drone: &Pose, deck: &Plane, c: &PredictorConfig) -> Option<DeckObservation> {
    let beam = drone.attitude * Vector3::new(0.0, 0.0, 1.0);
    let spot = drone.position + drone.attitude * Vector3::from(c.drone.rangefinder_m) + beam * m.range_m;
    let local = deck.rotation.inverse_transform_vector(&(spot - deck.centre));
    let margin = c.range_margin_m + 2.0 * deck.position_sd;
    if local.x.abs() > 0.5 * c.deck.length_m - margin || local.y.abs() > 0.5 * c.deck.width_m - margin {
        return None;
    }
    let normal = deck.rotation * Vector3::z();
    if normal.z < 0.5 || beam.z < 0.5 {
        return None;
    }
    let lateral = spot - deck.centre;
    let slope = (normal.x * lateral.x + normal.y * lateral.y) / normal.z;
    let reach = (lateral.x * lateral.x + lateral.y * lateral.y) * deck.tilt_sd.powi(2)
        + deck.position_sd.powi(2) * (1.0 - normal.z * normal.z);
    let r = m.variance.max(c.range_min_sd_m.powi(2)) + reach + drone.variance.z * c.drone_variance_fraction;
    let mut value = [None; AXES];
    value[2] = Some((spot.z + slope, r));
    Some(DeckObservation {
        at: m.header.at,
        kind: ObservationKind::Range,
        value,
        rate: [None; AXES],
        from_drone: Vector3::zeros(),
    })
}
