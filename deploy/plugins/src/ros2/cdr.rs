//! Encoding of messages in XCDR1, little endian, after the four-byte encapsulation header (DDSI-RTPS 2.3, section
//! 10.2), as ROS 2's middlewares write them.

use byteorder::LittleEndian;
use serde::Serialize;

/// Plain CDR, little endian, no options.
const HEADER: [u8; 4] = [0, 1, 0, 0];

/// None if a field's type cannot be represented in CDR.
pub fn encode(message: &impl Serialize) -> Option<Vec<u8>> {
    let mut bytes = HEADER.to_vec();
    cdr_encoding::to_writer::<_, LittleEndian, _>(&mut bytes, message).ok()?;
    Some(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ros2::messages::{
        Covariance, DiagnosticArray, DiagnosticStatus, KeyValue, PoseWithCovariance,
        PoseWithCovarianceStamped, Quaternion, RosHeader, RosOdometry, RosPose, RosTime, TfMessage,
        TransformStamped, TriggerResponse, Twist, TwistWithCovariance, Vector3, level,
    };

    // Bytes from pyzeros 0.1.0 with ros2_pyterfaces 0.3.0 (`.serialize()` of the same values); `0*16` is 16 zero
    // bytes.
    const TF: &str = "000100000200000000f1536515cd5b07040000006d617000050000006465636b 0*10 f83f 0*32 \
        333333333333e33f9a9999999999e93f00f1536515cd5b07040000006d617000050000006465636b 0*14 f83f 0*32 \
        333333333333e33f9a9999999999e93f";
    const DIAGNOSTICS: &str = "0001000000f1536515cd5b07010000000000000002000000010000000e00000064726f6e6520313a206c \
        696e6b0000000a000000302e342073206f6c640000000800000064726f6e65203100010000000700000072656d65647900000800 \
        0000616e74656e6e6100030000000200000061000000010000000000000001 0*11";
    const POSE: &str = "0001000000f1536515cd5b07040000006d617000000000000000f83f00000000000002c00000000000002440 \
        0*16 333333333333e33f9a9999999999e93f000000000000e03f 0*54 f03f 0*54 f83f 0*55 40 0*54 0440 0*54 0840";
    const ODOMETRY: &str = "0001000000f1536515cd5b07040000006d6170000a000000626173655f6c696e6b 0*9 \
        f83f00000000000002c00000000000002440 0*16 333333333333e33f9a9999999999e93f000000000000e03f 0*54 f03f \
        0*54 f83f 0*55 40 0*54 0440 0*54 0840000000000000084000000000000010c0000000000000c03f 0*22 \
        e0bf000000000000d03f 0*54 e03f 0*54 e83f 0*54 f03f 0*54 f43f 0*54 f83f";
    const RESPONSE: &str = "00010000010000000e00000064726f6e6520313a2049646c6500";

    fn bytes(text: &str) -> Vec<u8> {
        let part = |part: &str| match part.strip_prefix("0*") {
            Some(zeros) => vec![0; zeros.parse().unwrap()],
            None => (0..part.len() / 2)
                .map(|k| u8::from_str_radix(&part[2 * k..2 * k + 2], 16).unwrap())
                .collect(),
        };
        text.split_whitespace().flat_map(part).collect()
    }
    fn header(frame_id: &str) -> RosHeader {
        RosHeader {
            stamp: RosTime::from_nanos(1_700_000_000_123_456_789),
            frame_id: frame_id.into(),
        }
    }
    fn diagonal(step: f64) -> Covariance {
        let mut all = Covariance::default();
        for k in 0..6 {
            all[k][k] = step * (k + 1) as f64;
        }
        all
    }
    const TURNED: Quaternion = Quaternion {
        x: 0.0,
        y: 0.0,
        z: 0.6,
        w: 0.8,
    };
    fn vector(x: f64, y: f64, z: f64) -> Vector3 {
        Vector3 { x, y, z }
    }
    fn pose() -> PoseWithCovariance {
        PoseWithCovariance {
            pose: RosPose {
                position: vector(1.5, -2.25, 10.0),
                orientation: TURNED,
            },
            covariance: diagonal(0.5),
        }
    }

    #[test]
    fn cdr_bytes_of_poses() {
        let stamped = PoseWithCovarianceStamped {
            header: header("map"),
            pose: pose(),
        };
        assert_eq!(encode(&stamped).unwrap(), bytes(POSE));
        let odometry = RosOdometry {
            header: header("map"),
            child_frame_id: "base_link".into(),
            pose: pose(),
            twist: TwistWithCovariance {
                twist: Twist {
                    linear: vector(3.0, -4.0, 0.125),
                    angular: vector(0.0, 0.0, -0.5),
                },
                covariance: diagonal(0.25),
            },
        };
        assert_eq!(encode(&odometry).unwrap(), bytes(ODOMETRY));
        let transform = TransformStamped {
            header: header("map"),
            child_frame_id: "deck".into(),
            translation: vector(1.5, 0.0, 0.0),
            rotation: TURNED,
        };
        let transforms = vec![transform.clone(), transform];
        assert_eq!(encode(&TfMessage { transforms }).unwrap(), bytes(TF));
    }

    #[test]
    fn cdr_bytes_of_texts() {
        let link = DiagnosticStatus {
            level: level::WARN,
            name: "drone 1: link".into(),
            message: "0.4 s old".into(),
            hardware_id: "drone 1".into(),
            values: vec![KeyValue {
                key: "remedy".into(),
                value: "antenna".into(),
            }],
        };
        let silent = DiagnosticStatus {
            level: level::STALE,
            name: "a".into(),
            ..DiagnosticStatus::default()
        };
        let all = DiagnosticArray {
            header: header(""),
            status: vec![link, silent],
        };
        assert_eq!(encode(&all).unwrap(), bytes(DIAGNOSTICS));
        let response = TriggerResponse {
            success: true,
            message: "drone 1: Idle".into(),
        };
        assert_eq!(encode(&response).unwrap(), bytes(RESPONSE));
    }

    #[test]
    fn stamp_of_any_time() {
        let stamp = |ns| {
            let s = RosTime::from_nanos(ns);
            (s.sec, s.nanosec)
        };
        assert_eq!(stamp(1_700_000_000_000_000_001), (1_700_000_000, 1));
        assert_eq!(stamp(-1), (-1, 999_999_999));
        assert_eq!(stamp(i64::MAX), (i32::MAX, 0));
        assert_eq!(stamp(i64::MIN), (0, 0));
    }
}
