//! Parts that do not move in their frames, repeated for late joiners: the camera on the drone, the vessel below its
//! deck, and the deck's shape.

use alight_shared::geometry::{DeckGeometry, DroneGeometry};

use crate::ros2::{
    frames::{flu, of_camera, still},
    messages::{Marker, MarkerContent, RosHeader, RosPose, RosTime, TfMessage, TransformStamped, Vector3},
};

/// Thickness of the drawn deck, m, below the deck's upper surface.
const THICKNESS_M: f64 = 0.05;
const ORANGE: [f32; 4] = [0.95, 0.55, 0.1, 0.9];
/// Time after which a viewer removes a deck that is no longer repeated, s.
const LIFETIME_S: i32 = 5;

fn header(stamp: RosTime, frame_id: String) -> RosHeader {
    RosHeader { stamp, frame_id }
}

/// The camera's optical frame in `base_link`, and the vessel's frame (forward, left, up, at the waterline) in `deck`.
pub fn transforms(prefix: &str, stamp: RosTime, drone: &DroneGeometry, deck: &DeckGeometry) -> TfMessage {
    let camera = ("base_link", "camera_optical", drone.camera_m.into(), of_camera());
    let vessel = ("deck", "vessel", -deck.centre(), still());
    let placed = [camera, vessel].map(|(frame, child, at, rotation)| TransformStamped {
        header: header(stamp, format!("{prefix}{frame}")),
        child_frame_id: format!("{prefix}{child}"),
        translation: flu(&at),
        rotation,
    });
    TfMessage {
        transforms: placed.into(),
    }
}

/// The deck as a box. A time stamp of zero draws it at the newest pose of its frame.
pub fn marker(prefix: &str, deck: &DeckGeometry) -> Marker {
    let vector = |x, y, z| Vector3 { x, y, z };
    Marker {
        header: header(RosTime::default(), format!("{prefix}deck")),
        ns: "deck".into(),
        id: 0,
        kind: 1,
        action: 0,
        pose: RosPose {
            position: vector(0.0, 0.0, -0.5 * THICKNESS_M),
            orientation: still(),
        },
        scale: vector(deck.length_m, deck.width_m, THICKNESS_M),
        color: ORANGE,
        lifetime: (LIFETIME_S, 0),
        frame_locked: true,
        unused: MarkerContent::default(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ros2::cdr;

    #[test]
    fn fixed_frames_of_drone_and_deck() {
        let mut drone = DroneGeometry::default();
        let mut deck = DeckGeometry::default();
        drone.camera_m = [0.1, 0.2, 0.3];
        deck.centre_m = [-1.0, 0.5, -2.0];
        let all = transforms("a/", RosTime::default(), &drone, &deck).transforms;
        let [camera, vessel] = [0, 1].map(|k: usize| &all[k]);
        let named = [&camera.header.frame_id, &camera.child_frame_id];
        assert_eq!(named, ["a/base_link", "a/camera_optical"]);
        let named = [&vessel.header.frame_id, &vessel.child_frame_id];
        assert_eq!(named, ["a/deck", "a/vessel"]);
        let at = |v: &Vector3| [v.x, v.y, v.z];
        assert_eq!(at(&camera.translation), [0.1, -0.2, -0.3]);
        assert_eq!(at(&vessel.translation), [1.0, 0.5, -2.0]);
    }

    #[test]
    fn cdr_bytes_of_a_marker() {
        let bytes = cdr::encode(&marker("", &DeckGeometry::default())).unwrap();
        let hex: String = bytes.iter().map(|b| format!("{b:02x}")).collect();
        assert_eq!(hex, MARKER.replace(' ', ""));
    }

    // rosbags 0.11.9: `get_typestore(Stores.ROS2_JAZZY).serialize_cdr(...)` of the same values.
    const MARKER: &str = "000100000000000000000000050000006465636b00000000050000006465636b00000000000000000100000000000000 \
        00000000000000000000000000000000000000009a999999999999bf0000000000000000000000000000000000000000 \
        00000000000000000000f03f0000000000000440333333333333fb3f9a9999999999a93f3333733fcdcc0c3fcdcccc3d \
        6666663f0500000000000000010000000000000000000000010000000000000000000000000000000100000000000000 \
        010000000000000000000000000000000100000000000000010000000000000001000000000000000000000000";
}
