//! Configuration of a vessel's sources: format, mounting, and accuracy where a source states none.

use alight_shared::{
    config,
    config::{ConfigError, Keys},
    frames::wrap_angle,
    geodesy::Datum,
    msg::{AttitudeFix, GnssFix, HeadingFix, ImuSample, MAX_SOURCES, NOT_MEASURED_SD},
};
use nalgebra::{Quaternion, Rotation3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

use super::{
    MavlinkDecoder, N2kDecoder, NmeaDecoder, SensorDecoder, SignalKDecoder, UbxDecoder, rtcm::NoMeasurements,
};
use crate::config::{GnssConfig, ImuConfig};

/// Sign of a source's heave.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum HeaveSign {
    /// Up is positive.
    #[default]
    Up,
    /// Down is positive.
    Down,
    /// Not measured: the field is ignored.
    None,
}

config! {
    /// Device of a boat's network for each quantity. NMEA 2000: its address, "0" to "253", or its NAME, "0x"
    /// and up to 16 hexadecimal digits. Signal K: its `$source`. NMEA 0183: its talker, "HE", or a
    /// proprietary sentence, "PASHR". Empty: the first device, until another proves better. While a selected
    /// device is silent, another replaces it.
    pub struct BusDevices {
        /// Device of the heading.
        pub heading: String = String::new();
        /// Device of the rate of turn.
        pub rate_of_turn: String = String::new();
        /// Device of roll and pitch, and of angular rates.
        pub attitude: String = String::new();
        /// Device of the heave.
        pub heave: String = String::new();
        /// Device of positions and whole fixes.
        pub position: String = String::new();
        /// Device of the velocity; empty: the receiver of the position.
        pub velocity: String = String::new();
        /// Device of the magnetic variation.
        pub variation: String = String::new();
    }
}

impl BusDevices {
    fn each(&self) -> [(&'static str, &str); 7] {
        [
            ("heading", &self.heading),
            ("rate_of_turn", &self.rate_of_turn),
            ("attitude", &self.attitude),
            ("heave", &self.heave),
            ("position", &self.position),
            ("velocity", &self.velocity),
            ("variation", &self.variation),
        ]
    }
    /// Checks that a source of this format can have these devices.
    fn check_of(&self, format: Format, at: &Keys<'_>) -> Result<(), ConfigError> {
        let allowed = match format {
            Format::N2k => "an address, 0 to 253, or a NAME, 0x and up to 16 hexadecimal digits",
            Format::SignalK => "a $source of the server, of 64 characters at most",
            Format::Nmea => "a talker of two letters (HE), or the name of a maker's sentence (PASHR)",
            Format::Ubx | Format::Mavlink | Format::Rtcm => {
                "empty: only nmea, n2k and signalk have devices to choose from"
            }
        };
        let fits = |device: &str| match format {
            Format::N2k => is_address(device) || device_name(device).is_some(),
            Format::SignalK => device.trim() == device && device.chars().count() <= MAX_DEVICE_NAME,
            Format::Nmea => (2..=8).contains(&device.len()) && device.bytes().all(|b| b.is_ascii_uppercase()),
            Format::Ubx | Format::Mavlink | Format::Rtcm => false,
        };
        let mut chosen = self.each().into_iter().filter(|(_, device)| !device.is_empty());
        chosen.try_for_each(|(key, device)| at.require(fits(device), key, format!("{device:?}"), allowed))
    }
}

/// Highest address of a device on NMEA 2000; higher ones are reserved.
pub(super) const MAX_ADDRESS: u8 = 253;
/// Maximum length of a device's name, characters.
pub(super) const MAX_DEVICE_NAME: usize = 64;

/// Whether a text is an NMEA 2000 address, without leading zeros.
fn is_address(text: &str) -> bool {
    text.parse::<u8>()
        .is_ok_and(|a| a <= MAX_ADDRESS && a.to_string() == text)
}
/// NAME of an NMEA 2000 device (ISO 11783-5, 64 bits).
pub(super) fn device_name(text: &str) -> Option<u64> {
    let digits = text.strip_prefix("0x").or(text.strip_prefix("0X"))?;
    let is_hexadecimal = digits.bytes().all(|b| b.is_ascii_hexdigit());
    u64::from_str_radix(digits, 16).ok().filter(|_| is_hexadecimal)
}

config! {
    /// Position, orientation and accuracy of a source's sensors.
    pub struct Mount {
        /// Orientation of the inertial or attitude sensor in the vessel: roll, pitch, yaw (ZYX), deg. This is
        /// its reading while the vessel lies level and heads north.
        pub mounting_deg: [f64; 3] = [0.0; 3], in -180.0..=180.0;
        /// Position of the inertial sensor in the vessel's body frame, m; defaults to `vessel.imu.lever_arm_m`.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub lever_arm_m: Option<[f64; 3]> = None, in -50.0..=50.0;
        /// Position of the GNSS antenna in the vessel's body frame, m; defaults to `vessel.gnss.antenna_m`.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub antenna_m: Option<[f64; 3]> = None, in -50.0..=50.0;
        /// Position of the second receiver's antenna (MAVLink's GPS2_RAW) in the vessel's body frame, m.
        pub second_antenna_m: [f64; 3] = [0.0; 3], in -50.0..=50.0;
        /// Heading reading (of two antennas, or a compass) while the vessel heads north, deg.
        pub heading_offset_deg: f64 = 0.0, in -360.0..=360.0;
        /// Standard deviation of roll and pitch, deg.
        /// Chosen: between a motion sensor of a survey boat (0.02) and a small AHRS (0.5).
        pub tilt_sd_deg: f64 = 0.2, in 1e-3..=45.0;
        /// Positive direction of heave: up, down, or none if not measured.
        pub heave: HeaveSign = HeaveSign::Up;
        /// Sentences without a time (HDT, THS, ROT, VTG, PRDID) belong to the next time stamp, not to the previous
        /// one. Applies to recordings, and live until pauses between arrivals show the order.
        /// Source: most receivers start an epoch with a sentence that has a time.
        pub untimed_lead: bool = false;
        /// Standard deviation of heave, m.
        /// Source: data sheets of motion sensors, 0.05 m or 5 %.
        pub heave_sd_m: f64 = 0.05, in 1e-4..=100.0;
        /// Standard deviation of the heading, deg.
        /// Chosen: two antennas 1 m apart give 0.3 to 0.5.
        pub heading_sd_deg: f64 = 0.5, in 1e-3..=90.0;
        /// Standard deviation of the position, horizontal and vertical, m; zero to use the source's own.
        pub position_sd_m: [f64; 2] = [0.0; 2], in 0.0..=1000.0;
        /// Standard deviation of the velocity, m/s; zero to use the source's own.
        pub velocity_sd_mps: f64 = 0.0, in 0.0..=100.0;
        /// Devices of the source's network to use.
        pub devices: BusDevices;
    }
}

/// Protocol of a source.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Format {
    /// NMEA 0183 sentences.
    #[default]
    Nmea,
    /// u-blox's UBX.
    Ubx,
    Mavlink,
    /// NMEA 2000: frames of a CAN interface, or text of a gateway: Yacht Devices RAW, Actisense N2K ASCII, candump, canboat.
    N2k,
    /// Deltas of a Signal K server.
    #[serde(rename = "signalk")]
    SignalK,
    /// RTCM 3 from a moving base only; no measurements.
    Rtcm,
}

impl Format {
    /// Creates a decoder of this format. For MAVLink, `system` is the system number, or 0 for the first boat.
    pub fn decoder(self, mounting: &Mounting, system: u8) -> Box<dyn SensorDecoder> {
        match self {
            Format::Nmea => Box::new(NmeaDecoder::new(mounting)),
            Format::Ubx => Box::new(UbxDecoder::new(mounting)),
            Format::N2k => Box::new(N2kDecoder::new(mounting)),
            Format::SignalK => Box::new(SignalKDecoder::new(mounting)),
            Format::Mavlink => Box::new(MavlinkDecoder::new(mounting).of_system(system)),
            Format::Rtcm => Box::new(NoMeasurements),
        }
    }
    /// Whether a datagram may come from such a source: not if it has only NMEA sentences of unsupported kinds
    /// (wind, AIS). The decoder reports other formats.
    pub fn speaks(self) -> impl Fn(&[u8]) -> bool + Send + Sync {
        move |datagram| match self {
            Format::Nmea => {
                let mut decoder = NmeaDecoder::new(&Mounting::default());
                decoder.push(datagram, &mut Vec::new());
                let found = decoder.decoded();
                found.good > 0 || found.ignored == 0 || decoder.is_foreign()
            }
            Format::Ubx | Format::Mavlink | Format::N2k | Format::SignalK | Format::Rtcm => true,
        }
    }
}

config! {
    pub struct SourceConfig {
        /// Name of the source in messages to the crew.
        pub name: String = "source".into();
        /// URL of the source: `serial:///dev/ttyUSB0:115200`, `udpin://0.0.0.0:10110`, `tcpout://HOST:PORT`,
        /// `can://can0`, `ws://HOST:3000` (Signal K), ...
        /// Source: most multiplexers send NMEA over UDP like this.
        pub connect: String = "udpin://0.0.0.0:10110".into();
        /// Protocol of the source.
        pub format: Format = Format::Nmea;
        /// The vessel's system on a MAVLink link; zero: the first that a heartbeat identifies as a boat.
        /// Source: MAV_TYPE of the heartbeat; an autopilot set up as another vehicle needs its number here.
        pub system: u8 = 0;
        /// File with the key for MAVLink 2 signing: a passphrase, whose SHA-256 is the key, or 64 hexadecimal
        /// digits. Empty: nothing is signed or checked.
        pub signing_key: String = String::new();
        /// Forward RTCM 3 frames of this receiver, the drones' moving base. Always on with format `rtcm`.
        pub rtcm: bool = false;
        /// Minimum delay from a measurement to its arrival, s: from the data sheet, or half a round trip.
        pub latency_s: f64 = 0.0, in 0.0..=0.5;
        /// Mounting and accuracy of the source's sensors.
        pub mount: Mount;
    }
    check |this, at| {
        at.require(
            !this.connect.is_empty(),
            "connect",
            "empty",
            "a URL, such as udpin://0.0.0.0:10110",
        )?;
        // The format follows from these address types.
        for (kind, format, name) in [("can:", Format::N2k, "n2k"), ("ws:", Format::SignalK, "signalk")] {
            let fits = !this.connect.starts_with(kind) || this.format == format;
            let given = format!("{:?}", this.format).to_lowercase();
            at.require(fits, "format", given, &format!("{name:?} at {}", this.connect))?;
        }
        at.require(
            this.signing_key.is_empty() || this.format == Format::Mavlink,
            "signing_key",
            &this.signing_key,
            "empty: only MAVLink is signed",
        )?;
        let has_frames = matches!(this.format, Format::Nmea | Format::Ubx | Format::Rtcm);
        let formats = "false: only sources of nmea, ubx and rtcm have RTCM 3 frames";
        at.require(!this.rtcm || has_frames, "rtcm", this.rtcm, formats)?;
        let devices = &this.mount.devices;
        devices.check_of(this.format, &at.table("mount").table("devices"))?;
    }
}

impl SourceConfig {
    pub fn is_base(&self) -> bool {
        self.rtcm || self.format == Format::Rtcm
    }
}

config! {
    pub struct SourcesConfig {
        /// Sources, in order of preference for measurements that use one source at a time.
        pub sources: Vec<SourceConfig> = Default::default();
    }
    check |this, at| {
        let most = MAX_SOURCES / 2;
        let count = this.sources.len();
        at.require(count <= most, "sources", count, "at most 4 sources")?;
        let bases = this.sources.iter().filter(|s| s.is_base()).count();
        let one = "at most one with rtcm: a drone's receiver has one base";
        at.require(bases <= 1, "sources", format!("{bases} with rtcm"), one)?;
        this.sources
            .iter()
            .try_for_each(|s| s.check(&at.table("sources")))?;
    }
}

impl SourcesConfig {
    /// Copy of this source with missing positions set to those of the vessel.
    pub fn placed(&self, imu: &ImuConfig, gnss: &GnssConfig) -> SourcesConfig {
        let mut placed = self.clone();
        for source in &mut placed.sources {
            source.mount.lever_arm_m.get_or_insert(imu.lever_arm_m);
            source.mount.antenna_m.get_or_insert(gnss.antenna_m);
        }
        placed
    }
}

/// Converts readings of a source into measurements of the vessel.
#[derive(Clone, Debug)]
pub struct Mounting {
    pub mount: Mount,
    /// Rotation from sensor to vessel.
    turn: Rotation3<f64>,
}

impl Default for Mounting {
    fn default() -> Self {
        Mounting::new(&Mount::default())
    }
}

impl Mounting {
    pub fn new(mount: &Mount) -> Self {
        let [roll, pitch, yaw] = mount.mounting_deg.map(f64::to_radians);
        Mounting {
            mount: mount.clone(),
            turn: Rotation3::from_euler_angles(roll, pitch, yaw),
        }
    }
    pub fn vector(&self, v: [f64; 3]) -> [f64; 3] {
        (self.turn * Vector3::from(v)).into()
    }
    /// Roll, pitch, yaw of the vessel for these sensor readings (rad): `R_nb = R_ns R_bs'`.
    pub fn attitude(&self, [roll, pitch, yaw]: [f64; 3]) -> [f64; 3] {
        let vessel = Rotation3::from_euler_angles(roll, pitch, yaw) * self.turn.inverse();
        let (roll, pitch, yaw) = vessel.euler_angles();
        [roll, pitch, yaw]
    }
    /// Heading of the vessel for this reading, rad.
    pub fn heading(&self, shown: f64) -> f64 {
        wrap_angle(shown - self.mount.heading_offset_deg.to_radians())
    }
    /// Heave of the vessel, m down, for this reading.
    pub fn heave(&self, shown: f64) -> Option<f64> {
        match self.mount.heave {
            HeaveSign::Up => Some(-shown),
            HeaveSign::Down => Some(shown),
            HeaveSign::None => None,
        }
    }
    /// Inertial sample from rates (rad/s) and specific force (m/s²) in sensor axes.
    pub fn imu(&self, gyro: [f64; 3], force: [f64; 3]) -> ImuSample {
        ImuSample {
            gyro: self.vector(gyro),
            accelerometer: self.vector(force),
            lever_arm: Some(self.mount.lever_arm_m.unwrap_or_default()),
            ..ImuSample::default()
        }
    }
    /// Fix of the antenna at `datum` with the source's standard deviations.
    pub fn fix(
        &self,
        datum: Datum,
        velocity: [f64; 3],
        position_sd: [f64; 3],
        velocity_sd: [f64; 3],
    ) -> GnssFix {
        GnssFix {
            datum,
            velocity,
            position_sd: self.position_sd(position_sd),
            velocity_sd: self.velocity_sd(velocity_sd),
            lever_arm: Some(self.mount.antenna_m.unwrap_or_default()),
            ..GnssFix::default()
        }
    }
    /// Tilt of the vessel (rad) with the configured standard deviation.
    pub fn tilt(&self, tilt: [f64; 2]) -> AttitudeFix {
        AttitudeFix {
            tilt,
            tilt_sd: self.tilt_sd(),
            ..AttitudeFix::default()
        }
    }
    /// Heading of the vessel (rad) with the configured standard deviation.
    pub fn heading_fix(&self, heading: f64) -> HeadingFix {
        HeadingFix {
            heading,
            heading_sd: self.heading_sd(),
            ..HeadingFix::default()
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
    /// Standard deviations of a position, m: the source's own if none are configured.
    pub fn position_sd(&self, own: [f64; 3]) -> [f64; 3] {
        let [across, down] = self.mount.position_sd_m;
        configured_sd([across, across, down], own)
    }
    /// Standard deviations of a velocity, m/s: the source's own if none are configured.
    pub fn velocity_sd(&self, own: [f64; 3]) -> [f64; 3] {
        configured_sd([self.mount.velocity_sd_mps; 3], own)
    }
}

/// Configured standard deviations of the measured components; the source's own where zero.
fn configured_sd(configured: [f64; 3], own: [f64; 3]) -> [f64; 3] {
    core::array::from_fn(|k| match own[k] < NOT_MEASURED_SD && configured[k] > 0.0 {
        true => configured[k],
        false => own[k],
    })
}

/// Roll, pitch, yaw (rad) of the quaternion w, x, y, z; None if it is not close to unit length.
pub(crate) fn euler(q: [f64; 4]) -> Option<[f64; 3]> {
    let [w, x, y, z] = q;
    let q = Quaternion::new(w, x, y, z);
    (0.5..2.0).contains(&q.norm()).then(|| {
        let (roll, pitch, yaw) = UnitQuaternion::from_quaternion(q).euler_angles();
        [roll, pitch, yaw]
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn default_place_of_a_source() {
        let own = Mount {
            antenna_m: Some([1.0, 2.0, -3.0]),
            ..Mount::default()
        };
        let sources = [Mount::default(), own].map(|mount| SourceConfig {
            mount,
            ..SourceConfig::default()
        });
        let config = SourcesConfig {
            sources: sources.into(),
        };
        let (imu, gnss) = (ImuConfig::default(), GnssConfig::default());
        let placed = config.placed(&imu, &gnss).sources;
        let lever_arms = |k: usize| {
            let mounting = Mounting::new(&placed[k].mount);
            let fix = mounting.fix(Datum::default(), [0.0; 3], [1.0; 3], [1.0; 3]);
            (mounting.imu([0.0; 3], [0.0; 3]).lever_arm, fix.lever_arm)
        };
        assert_eq!(lever_arms(0), (Some(imu.lever_arm_m), Some(gnss.antenna_m)));
        assert_eq!(lever_arms(1), (Some(imu.lever_arm_m), Some([1.0, 2.0, -3.0])));
    }

    #[test]
    fn devices_that_a_format_can_have() {
        use alight_shared::config::Check;
        for (format, device, fits) in [
            (Format::N2k, "35", true),
            (Format::N2k, "253", true),
            (Format::N2k, "254", false),
            (Format::N2k, "035", false),
            (Format::N2k, "0xC0788C00E7E04312", true),
            (Format::N2k, "0xC0788C00E7E043120", false),
            (Format::N2k, "0x", false),
            (Format::N2k, "0x+1", false),
            (Format::N2k, "compass", false),
            (Format::SignalK, "can0.35", true),
            (Format::SignalK, " can0.35", false),
            (Format::Nmea, "35", false),
            (Format::Nmea, "", true),
            (Format::Nmea, "HE", true),
            (Format::Nmea, "PASHR", true),
            (Format::Nmea, "he", false),
            (Format::Ubx, "HE", false),
        ] {
            let mut source = SourceConfig {
                format,
                ..SourceConfig::default()
            };
            source.mount.devices.rate_of_turn = device.into();
            match source.check(&Keys::ROOT) {
                Ok(()) => assert!(fits, "{format:?} {device}"),
                Err(e) => assert!(
                    !fits && e.to_string().contains("`mount.devices.rate_of_turn`"),
                    "{format:?} {device}: {e}"
                ),
            }
        }
    }

    #[test]
    fn sources_that_are_a_moving_base() {
        use alight_shared::config::Check;
        let source = |format, rtcm| SourceConfig {
            format,
            rtcm,
            ..SourceConfig::default()
        };
        let fault = |sources: &[SourceConfig]| {
            let config = SourcesConfig {
                sources: sources.to_vec(),
            };
            config.check(&Keys::ROOT).err().map(|e| e.to_string())
        };
        let [nmea, ubx, rtcm] = [Format::Nmea, Format::Ubx, Format::Rtcm].map(|format| source(format, true));
        for one in [&nmea, &ubx, &rtcm, &source(Format::Rtcm, false)] {
            assert!(
                one.is_base() && fault(&[one.clone(), SourceConfig::default()]).is_none(),
                "{one:?}"
            );
        }
        let two = fault(&[ubx, source(Format::Rtcm, false)]).unwrap();
        assert!(two.contains("`sources` is 2 with rtcm"), "{two}");
        let mavlink = fault(&[source(Format::Mavlink, true)]).unwrap();
        assert!(
            mavlink.contains("rtcm` is true") && mavlink.contains("nmea, ubx and rtcm"),
            "{mavlink}"
        );
    }

    #[test]
    fn mounting_rotation() {
        let mounting = Mounting::new(&Mount {
            mounting_deg: [180.0, 7.0, 90.0],
            heading_offset_deg: 90.0,
            ..Mount::default()
        });
        let vessel = Rotation3::from_euler_angles(0.2, -0.1, 2.0);
        let shown = vessel * mounting.turn;
        let (r, p, y) = shown.euler_angles();
        let back = mounting.attitude([r, p, y]);
        for (a, b) in back.iter().zip([0.2, -0.1, 2.0]) {
            assert!((a - b).abs() < 1e-12, "{back:?}");
        }
        let force = vessel.inverse() * Vector3::new(0.0, 0.0, -9.81);
        let measured = mounting.turn.inverse() * force;
        let turned = Vector3::from(mounting.vector(measured.into()));
        assert!((turned - force).norm() < 1e-12);
        assert!((mounting.heading(2.0 + core::f64::consts::FRAC_PI_2) - 2.0).abs() < 1e-12);
    }
}
