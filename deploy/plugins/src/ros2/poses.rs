//! Poses of drone and deck as odometry, pose and transforms, published when newer data arrive.
//!
//! `map` is east, north, up from the origin of the drone's autopilot. It stays continuous when the autopilot's
//! estimate jumps ([`DroneState::datum_offset`]), so it differs from the map frame of other sensors.

use alight_computer::process::snapshot::Snapshot;
use alight_shared::{
    msg::{DeckForecast, DeckStage, DroneState},
    time::DroneTime,
};
use nalgebra::{Matrix3, UnitQuaternion, Vector3};

use crate::ros2::{
    frames::{self, BodyVelocity},
    messages::{
        PoseWithCovariance, PoseWithCovarianceStamped, RosHeader, RosOdometry, RosPose, RosTime, TfMessage,
        TransformStamped, Twist, TwistWithCovariance,
    },
};

#[derive(Default)]
pub struct NewPoses {
    pub drone: Option<RosOdometry>,
    pub deck: Option<RosOdometry>,
}

impl NewPoses {
    pub fn deck_pose(&self) -> Option<PoseWithCovarianceStamped> {
        self.deck.as_ref().map(|deck| PoseWithCovarianceStamped {
            header: deck.header.clone(),
            pose: deck.pose,
        })
    }
    pub fn transforms(&self) -> Option<TfMessage> {
        let all = [&self.drone, &self.deck].into_iter().flatten();
        let transforms: Vec<TransformStamped> = all.map(transform).collect();
        (!transforms.is_empty()).then_some(TfMessage { transforms })
    }
}

fn transform(of: &RosOdometry) -> TransformStamped {
    TransformStamped {
        header: of.header.clone(),
        child_frame_id: of.child_frame_id.clone(),
        translation: of.pose.pose.position,
        rotation: of.pose.pose.orientation,
    }
}

pub struct Poses {
    map: String,
    base_link: String,
    deck: String,
    drone_at: Option<DroneTime>,
    deck_at: Option<DroneTime>,
}

impl Poses {
    pub fn new(prefix: &str) -> Poses {
        let named = |name: &str| format!("{prefix}{name}");
        Poses {
            map: named("map"),
            base_link: named("base_link"),
            deck: named("deck"),
            drone_at: None,
            deck_at: None,
        }
    }
    /// Poses from the received messages; `stamp` converts a time of the drone's clock to nanoseconds since 1970.
    pub fn newer(&mut self, snapshot: &Snapshot, stamp: impl Fn(DroneTime) -> i64) -> NewPoses {
        let drone = snapshot.drone.filter(|d| Some(d.header.at) != self.drone_at);
        let forecast = snapshot.forecast.filter(|f| Some(f.header.at) != self.deck_at);
        self.drone_at = snapshot.drone.map(|d| d.header.at);
        self.deck_at = snapshot.forecast.map(|f| f.header.at);
        let header = |at| RosHeader {
            stamp: RosTime::from_nanos(stamp(at)),
            frame_id: self.map.clone(),
        };
        NewPoses {
            drone: drone.map(|d| of_drone(&d, header(d.header.at), &self.base_link)),
            deck: forecast.and_then(|f| of_deck(&f, header(f.header.at), &self.deck)),
        }
    }
}

/// Variance of rates that no autopilot reports, (rad/s)²: so large that no filter relies on them.
const NOT_KNOWN: f64 = 1e6;

fn of_drone(drone: &DroneState, header: RosHeader, child: &str) -> RosOdometry {
    let motion = BodyVelocity {
        velocity: [drone.velocity, drone.velocity_sd],
        rates: Vector3::from(drone.rates),
        rates_covariance: Matrix3::from_diagonal_element(NOT_KNOWN),
    };
    let pose_sd = (drone.position_sd, drone.euler_sd);
    odometry(header, child, drone.position, pose_sd, &drone.attitude(), &motion)
}

/// Odometry of the deck at the forecast's first stage, close to the present; None for an empty forecast.
fn of_deck(forecast: &DeckForecast, header: RosHeader, child: &str) -> Option<RosOdometry> {
    let now: &DeckStage = forecast.stages.first()?;
    let motion = BodyVelocity::of_euler_rates(
        [now.velocity, now.velocity_sd],
        now.euler,
        [now.euler_rates, now.euler_rates_sd],
    );
    let pose_sd = (now.position_sd, now.euler_sd);
    let attitude = frames::of_euler(now.euler);
    Some(odometry(header, child, now.position, pose_sd, &attitude, &motion))
}

fn odometry(
    header: RosHeader,
    child: &str,
    position: [f64; 3],
    (position_sd, euler_sd): ([f64; 3], [f64; 3]),
    ned_from_frd: &UnitQuaternion<f64>,
    motion: &BodyVelocity,
) -> RosOdometry {
    let [linear, angular] = motion.twist(ned_from_frd);
    RosOdometry {
        header,
        child_frame_id: child.into(),
        pose: PoseWithCovariance {
            pose: RosPose {
                position: frames::enu(position),
                orientation: frames::attitude(ned_from_frd),
            },
            covariance: frames::pose_covariance(position_sd, euler_sd),
        },
        twist: TwistWithCovariance {
            twist: Twist { linear, angular },
            covariance: motion.covariance(ned_from_frd),
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::{msg::Header as Identity, time::Time};

    fn snapshot(drone_ns: i64, deck_ns: i64) -> Snapshot {
        let drone = DroneState {
            header: Identity::new(1, 1, 7, 1, Time::from_nanos(drone_ns)),
            position: [1.0, 2.0, -3.0],
            position_sd: [0.1, 0.2, 0.3],
            ..DroneState::default()
        };
        let mut forecast = DeckForecast {
            header: Identity::new(1, 1, 7, 1, Time::from_nanos(deck_ns)),
            ..DeckForecast::default()
        };
        let stage = DeckStage {
            position: [4.0, 5.0, 0.5],
            euler_sd: [0.01, 0.02, 0.03],
            ..DeckStage::default()
        };
        let _fits = forecast.stages.push(stage);
        Snapshot {
            drone: drone.into(),
            forecast: forecast.into(),
            ..Snapshot::default()
        }
    }

    #[test]
    fn poses_in_the_map() {
        let mut poses = Poses::new("a/");
        let new = poses.newer(&snapshot(10, 20), |at| at.nanos() + 1_000_000_000);
        let drone = new.drone.as_ref().unwrap();
        let deck = new.deck.as_ref().unwrap();
        assert_eq!(drone.header.stamp, RosTime { sec: 1, nanosec: 10 });
        assert_eq!(
            (drone.header.frame_id.as_str(), drone.child_frame_id.as_str()),
            ("a/map", "a/base_link")
        );
        assert_eq!(drone.pose.pose.position, frames::enu([1.0, 2.0, -3.0]));
        assert!((drone.pose.covariance[0][0] - 0.04).abs() < 1e-12);
        assert_eq!(deck.header.stamp.nanosec, 20);
        assert!((deck.pose.covariance[5][5] - 9e-4).abs() < 1e-12);
        assert_eq!(new.deck_pose().map(|p| p.pose), Some(deck.pose));
        let children = new.transforms().unwrap().transforms;
        let children: Vec<&str> = children.iter().map(|t| t.child_frame_id.as_str()).collect();
        assert_eq!(children, ["a/base_link", "a/deck"]);
    }

    #[test]
    fn poses_only_when_newer() {
        let mut poses = Poses::new("");
        let mut new = |drone, deck| {
            let new = poses.newer(&snapshot(drone, deck), |at| at.nanos());
            (new.drone.is_some(), new.deck.is_some())
        };
        assert_eq!(new(10, 20), (true, true));
        assert_eq!(new(10, 20), (false, false));
        assert_eq!(new(11, 20), (true, false));
        let nothing = poses.newer(&Snapshot::default(), |at| at.nanos());
        assert!(nothing.transforms().is_none() && nothing.deck_pose().is_none());
    }
}
