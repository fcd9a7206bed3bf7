//! Tilt in excess of the commanded tilt: an autopilot that loses attitude control exceeds every command.

use alight_shared::{
    msg::{DroneState, SetPoint, SetPointKind},
    time::{DroneClock, Time},
};
use nalgebra::{UnitQuaternion, Vector3};

/// Decay time of a commanded tilt, s: twice the lag of a typical attitude loop.
const MEMORY_S: f64 = 0.5;

#[derive(Clone, Copy, Debug, Default)]
pub(super) struct TiltMonitor {
    commanded: Option<(Time<DroneClock>, f64)>,
}

impl TiltMonitor {
    /// Processes the newest set-point. Before the first command the `drone`'s tilt replaces it.
    pub(super) fn update(&mut self, s: &SetPoint, drone: Option<&DroneState>) {
        if s.kind != SetPointKind::Attitude {
            // The autopilot chooses its own tilt.
            self.commanded = None;
            return;
        }
        let at = s.header.at;
        let is = || drone.map_or(0.0, |d| tilt(&d.attitude()));
        let kept = self.kept(at).unwrap_or_else(is);
        self.commanded = Some((at, kept.max(tilt(&s.attitude()))));
    }
    /// Tilt in excess of the commanded tilt, rad; 0 without a command.
    pub(super) fn excess(&self, drone: &DroneState) -> f64 {
        let is = tilt(&drone.attitude());
        self.kept(drone.header.at).map_or(0.0, |max| (is - max).max(0.0))
    }
    fn kept(&self, at: Time<DroneClock>) -> Option<f64> {
        let fade = |t: Time<DroneClock>| (-(at - t).secs().max(0.0) / MEMORY_S).exp();
        self.commanded.map(|(t, most)| most * fade(t))
    }
}

/// Angle from the vertical, rad.
fn tilt(attitude: &UnitQuaternion<f64>) -> f64 {
    (attitude * Vector3::z()).angle(&Vector3::z())
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::msg::Header;

    fn header(t_s: f64) -> Header<DroneClock> {
        Header::new(1, 1, 1, (t_s * 100.0) as u32, Time::from_secs(t_s))
    }
    fn quaternion(roll: f64) -> [f64; 4] {
        let q = UnitQuaternion::from_euler_angles(roll, 0.0, 1.0);
        [q.w, q.i, q.j, q.k]
    }
    fn commanded(t_s: f64, roll: f64) -> SetPoint {
        SetPoint {
            header: header(t_s),
            kind: SetPointKind::Attitude,
            attitude: quaternion(roll),
            ..SetPoint::default()
        }
    }
    fn drone(t_s: f64, roll: f64) -> DroneState {
        DroneState {
            header: header(t_s),
            attitude: quaternion(roll),
            ..DroneState::default()
        }
    }

    #[test]
    fn tilt_with_the_lag_of_the_attitude_loop() {
        let mut m = TiltMonitor::default();
        let mut is = 0.4;
        m.update(&commanded(0.0, 0.4), None);
        for k in 0..200 {
            let t = 0.01 * f64::from(k);
            // The command reverses at once; the slowest measured loop has a lag of 0.32 s.
            m.update(&commanded(t, -0.05), None);
            is += (-0.05 - is) * 0.01 / 0.32;
            assert!(m.excess(&drone(t, is)) < 0.01, "{t}");
        }
    }

    #[test]
    fn tilt_beyond_every_command() {
        let mut m = TiltMonitor::default();
        m.update(&commanded(1.0, -0.2), None);
        assert!((m.excess(&drone(1.0, 0.5)) - 0.3).abs() < 1e-9);
        let trajectory = SetPoint {
            kind: SetPointKind::Trajectory,
            ..commanded(1.1, 0.0)
        };
        m.update(&trajectory, None);
        assert_eq!(m.excess(&drone(1.1, 0.5)), 0.0);
    }

    #[test]
    fn tilt_of_an_earlier_manoeuvre() {
        // The mission restarts while the drone returns from 0.22 rad.
        let mut m = TiltMonitor::default();
        let mut is = 0.22;
        for k in 0..100 {
            let t = 1.0 + 0.01 * f64::from(k);
            m.update(&commanded(t, 0.0), Some(&drone(t, is)));
            assert!(m.excess(&drone(t, is)) < 0.01, "{t}");
            is -= is * 0.01 / 0.32;
        }
        assert!(m.excess(&drone(2.0, 0.5)) > 0.4);
    }
}
