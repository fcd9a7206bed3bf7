//! How a sensor is mounted, and how good it is where it does not say so itself.

use alight_shared::config;
use nalgebra::{Rotation3, Vector3};
use serde::{Deserialize, Serialize};

/// Which way a source counts heave.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum HeaveSign {
    /// Up is positive.
    #[default]
    Up,
    /// Down is positive.
    Down,
    /// It has none: what it says there is to be left alone.
    None,
}

config! {
    /// Place, turn and quality of a source's sensors.
    pub struct Mount {
        /// Its inertial or attitude sensor against the vessel's axes: roll, pitch, yaw (ZYX), deg. What the
        /// sensor says of a vessel that lies level and heads north.
        pub mounting_deg: [f64; 3] = [0.0; 3], in -180.0..=180.0;
        /// Its inertial sensor in the vessel's body frame, m.
        pub lever_arm_m: [f64; 3] = [0.0; 3], in -50.0..=50.0;
        /// Its GNSS antenna in the vessel's body frame, m.
        pub antenna_m: [f64; 3] = [0.0; 3], in -50.0..=50.0;
        /// The antenna of its second receiver (MAVLink's GPS2_RAW), m.
        pub second_antenna_m: [f64; 3] = [0.0; 3], in -50.0..=50.0;
        /// What its heading (of two antennas, or a compass) shows when the vessel heads north, deg.
        pub heading_offset_deg: f64 = 0.0, in -360.0..=360.0;
        /// Standard deviation of its roll and pitch, deg.
        /// Source: Ours: between a motion sensor of a survey boat (0.02) and a small AHRS (0.5).
        pub tilt_sd_deg: f64 = 0.2, in 1e-3..=45.0;
        /// Which way it counts heave: up, down, or none.
        /// Source: Makers differ.
        pub heave: HeaveSign = HeaveSign::Up;
        /// Sentences without a time of their own (HDT, THS, ROT, VTG, PRDID) belong to the time that follows
        /// them in the stream, not to the one before.
        /// Source: Most receivers begin an epoch with a sentence that has its time.
        pub untimed_lead: bool = false;
        /// Standard deviation of its heave, m.
        /// Source: Data sheets of motion sensors: 0.05 m or 5 %.
        pub heave_sd_m: f64 = 0.05, in 1e-4..=100.0;
        /// Standard deviation of its heading, deg.
        /// Source: Ours: two antennas 1 m apart give 0.3 to 0.5.
        pub heading_sd_deg: f64 = 0.5, in 1e-3..=90.0;
        /// Standard deviation of its position, horizontal and vertical, m; zero: as the source says it.
        pub position_sd_m: [f64; 2] = [0.0; 2], in 0.0..=1000.0;
        /// Standard deviation of its velocity, m/s; zero: as the source says it.
        pub velocity_sd_mps: f64 = 0.0, in 0.0..=100.0;
    }
}

/// What a source speaks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Format {
    /// NMEA 0183 sentences.
    #[default]
    Nmea,
    /// u-blox's UBX.
    Ubx,
    /// MAVLink.
    Mavlink,
}

config! {
    /// A source of measurements.
    pub struct SourceConfig {
        /// What it is called in messages.
        pub name: String = "source".into();
        /// Where it is: `serial:///dev/ttyUSB0:115200`, `udpin://0.0.0.0:10110`, `tcpout://HOST:PORT`, ...
        /// Source: NMEA over UDP as most multiplexers send it.
        pub connect: String = "udpin://0.0.0.0:10110".into();
        /// What it speaks.
        pub format: Format = Format::Nmea;
        /// Least time from a measurement to its arrival, s: from its data sheet, or half of a question's way.
        pub latency_s: f64 = 0.0, in 0.0..=0.5;
        /// Where its sensors are and how good.
        pub mount: Mount;
    }
    check |this, at| {
        at.require(
            !this.connect.is_empty(),
            "connect",
            "empty",
            "a URL, such as udpin://0.0.0.0:10110",
        )?;
    }
}

config! {
    /// All sources of a vessel.
    pub struct SourcesConfig {
        /// The sources, in the order of preference for those that are used one at a time.
        pub sources: Vec<SourceConfig> = Default::default();
    }
    check |this, at| {
        let most = alight_shared::msg::MAX_SOURCES / 2;
        let count = this.sources.len();
        at.require(count <= most, "sources", count, "4 sources at most")?;
        this.sources
            .iter()
            .try_for_each(|s| s.check(&at.table("sources")))?;
    }
}

/// A mount, worked out.
#[derive(Clone, Debug)]
pub struct Mounting {
    /// The settings.
    pub mount: Mount,
    /// Vessel from sensor.
    turn: Rotation3<f64>,
}

impl Default for Mounting {
    fn default() -> Self {
        Mounting::new(&Mount::default())
    }
}

impl Mounting {
    /// Of these settings.
    pub fn new(mount: &Mount) -> Self {
        let [roll, pitch, yaw] = mount.mounting_deg.map(f64::to_radians);
        Mounting {
            mount: mount.clone(),
            turn: Rotation3::from_euler_angles(roll, pitch, yaw),
        }
    }
    /// A vector of the sensor's axes in the vessel's.
    pub fn vector(&self, v: [f64; 3]) -> [f64; 3] {
        (self.turn * Vector3::from(v)).into()
    }
    /// Roll, pitch, yaw of the vessel where the sensor shows these (rad): `R_nb = R_ns R_bs'`.
    pub fn attitude(&self, [roll, pitch, yaw]: [f64; 3]) -> [f64; 3] {
        let vessel = Rotation3::from_euler_angles(roll, pitch, yaw) * self.turn.inverse();
        let (roll, pitch, yaw) = vessel.euler_angles();
        [roll, pitch, yaw]
    }
    /// Heading of the vessel where the source shows this one, rad.
    pub fn heading(&self, shown: f64) -> f64 {
        alight_shared::frames::wrap_angle(shown - self.mount.heading_offset_deg.to_radians())
    }
    /// Heave of the vessel, m down, where the source says this.
    pub fn heave(&self, said: f64) -> Option<f64> {
        match self.mount.heave {
            HeaveSign::Up => Some(-said),
            HeaveSign::Down => Some(said),
            HeaveSign::None => None,
        }
    }
    /// Standard deviation of roll and pitch, rad.
    pub fn tilt_sd(&self) -> f64 {
        self.mount.tilt_sd_deg.to_radians()
    }
    /// Standard deviation of the heading, rad.
    pub fn heading_sd(&self) -> f64 {
        self.mount.heading_sd_deg.to_radians()
    }
    /// Standard deviations of a position: the source's own where none is set, m.
    pub fn position_sd(&self, said: [f64; 3]) -> [f64; 3] {
        let [across, down] = self.mount.position_sd_m;
        let set = [across, across, down];
        core::array::from_fn(|k| {
            let measured = said[k] < alight_shared::msg::NOT_MEASURED_SD;
            if set[k] > 0.0 && measured { set[k] } else { said[k] }
        })
    }
    /// Standard deviations of a velocity: the source's own where none is set, m/s.
    pub fn velocity_sd(&self, said: [f64; 3]) -> [f64; 3] {
        let set = self.mount.velocity_sd_mps;
        said.map(|s| {
            let measured = s < alight_shared::msg::NOT_MEASURED_SD;
            if set > 0.0 && measured { set } else { s }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mounting_turns_measurements_into_the_vessel_axes() {
        let mounting = Mounting::new(&Mount {
            mounting_deg: [180.0, 7.0, 90.0],
            heading_offset_deg: 90.0,
            ..Mount::default()
        });
        // What a sensor so mounted shows of a vessel of this attitude.
        let vessel = Rotation3::from_euler_angles(0.2, -0.1, 2.0);
        let shown = vessel * mounting.turn;
        let (r, p, y) = shown.euler_angles();
        let back = mounting.attitude([r, p, y]);
        for (a, b) in back.iter().zip([0.2, -0.1, 2.0]) {
            assert!((a - b).abs() < 1e-12, "{back:?}");
        }
        // Gravity as the sensor feels it is gravity in the vessel's axes.
        let force = vessel.inverse() * Vector3::new(0.0, 0.0, -9.81);
        let felt = mounting.turn.inverse() * force;
        let seen = Vector3::from(mounting.vector(felt.into()));
        assert!((seen - force).norm() < 1e-12);
        assert!((mounting.heading(2.0 + core::f64::consts::FRAC_PI_2) - 2.0).abs() < 1e-12);
    }
}
