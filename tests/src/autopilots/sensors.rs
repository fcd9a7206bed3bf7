//! Inertial sensors, magnetometer, barometer and GNSS that feed a firmware.

use alight_shared::{
    frames::{TrueNed, Vector},
    geodesy::Datum,
    time::WorldTime,
};
use alight_uav::autopilot::message::{HilGps, HilSensor};
use nalgebra::Vector3;

use super::FirmwareConfig;
use crate::physics::{
    drone::{
        NavigationConfig, PlantState,
        noise::{GaussMarkov, normal},
    },
    streams::{Stream, Streams},
};

/// Sampling rate to which the configured inertial noise refers, Hz.
const PER_HZ: f64 = 100.0;
/// Temperature (K) and pressure (hPa) of the standard atmosphere at sea level.
const SEA_LEVEL_K: f64 = 288.15;
const SEA_LEVEL_HPA: f64 = 1013.25;
/// Temperature gradient of the standard atmosphere, K/m, and the exponent `g M / (R L)` of its pressure.
const LAPSE_RATE: f64 = 0.0065;
const EXPONENT: f64 = 5.255_88;

/// Sensors with the same noise as those of the simulated autopilot.
pub struct FirmwareSensors {
    config: FirmwareConfig,
    navigation: NavigationConfig,
    datum: Datum,
    gyro_bias: Vector3<f64>,
    accelerometer_bias: Vector3<f64>,
    imu: Stream,
    other: Stream,
    gnss: Stream,
    gnss_bias: [GaussMarkov; 3],
    fixed: Option<WorldTime>,
}

impl FirmwareSensors {
    /// `datum` is the origin of NED.
    pub fn new(
        config: &FirmwareConfig,
        navigation: &NavigationConfig,
        datum: Datum,
        streams: &Streams,
    ) -> FirmwareSensors {
        let mut imu = streams.stream("firmware.imu");
        let mut gnss = streams.stream("firmware.gnss");
        let n = navigation;
        let mut draw = |sd: f64| Vector3::from_fn(|_, _| sd * normal(&mut imu));
        let gyro_bias = draw(n.gyro_bias_rps);
        let accelerometer_bias = draw(n.accelerometer_bias_mps2);
        let gnss_bias = core::array::from_fn(|_| {
            GaussMarkov::new(n.gnss_bias_m, n.gnss_bias_s, 1.0 / n.gnss_hz, &mut gnss)
        });
        FirmwareSensors {
            config: config.clone(),
            navigation: n.clone(),
            datum,
            gyro_bias,
            accelerometer_bias,
            imu,
            other: streams.stream("firmware.other"),
            gnss,
            gnss_bias,
            fixed: None,
        }
    }

    pub fn sample(&mut self, truth: &PlantState, rate_hz: f64) -> HilSensor {
        let n = &self.navigation;
        let denser = (rate_hz / PER_HZ).sqrt();
        let mut noise = |sd: f64| Vector3::from_fn(|_, _| sd * denser * normal(&mut self.imu));
        let limit = n.accelerometer_range_mps2;
        let accelerometer =
            (truth.specific_force + self.accelerometer_bias + noise(n.accelerometer_noise_mps2))
                .map(|a| a.clamp(-limit, limit));
        let gyro = truth.rates + self.gyro_bias + noise(n.gyro_noise_rps);
        let mut draw = |sd: f64| sd * normal(&mut self.other);
        let c = &self.config;
        let field = truth
            .attitude
            .inverse_transform_vector(&Vector3::from(c.field_gauss));
        let magnetometer = field + Vector3::from_fn(|_, _| draw(c.magnetometer_gauss));
        let height = self.datum.height_m - truth.position.z;
        let pressure = pressure_hpa(height) + draw(c.barometer_hpa);
        HilSensor {
            time_us: micros(truth.at),
            accelerometer: accelerometer.into(),
            gyro: gyro.into(),
            magnetometer: magnetometer.into(),
            pressure_hpa: pressure,
            pressure_altitude_m: altitude_m(pressure),
            temperature_degc: SEA_LEVEL_K - LAPSE_RATE * height - 273.15,
        }
    }

    pub fn fix(&mut self, truth: &PlantState) -> Option<HilGps> {
        let n = &self.navigation;
        let due = self
            .fixed
            .is_none_or(|t| (truth.at - t).secs() >= 1.0 / n.gnss_hz - 1e-6);
        if !due {
            return None;
        }
        self.fixed = Some(truth.at);
        let gnss = &mut self.gnss;
        let wrong: [f64; 3] =
            core::array::from_fn(|i| self.gnss_bias[i].step(gnss) + n.gnss_noise_m * normal(gnss));
        let velocity = truth.velocity.map(|v| v + n.gnss_velocity_mps * normal(gnss));
        let place = truth.position + Vector3::from(wrong);
        let at = self.datum.at(&Vector::<TrueNed>::from(place));
        Some(HilGps {
            time_us: micros(truth.at),
            latitude: at.latitude_deg.to_radians(),
            longitude: at.longitude_deg.to_radians(),
            altitude_m: at.height_m,
            velocity: velocity.into(),
            sd_m: [
                n.gnss_bias_m.hypot(n.gnss_noise_m),
                n.gnss_bias_m.hypot(n.gnss_noise_m),
            ],
        })
    }
}

/// Microseconds since the start plus an offset, because a firmware's clock does not start at zero.
fn micros(t: WorldTime) -> u64 {
    1_000_000 + (t.nanos().max(0) / 1000).unsigned_abs()
}

fn pressure_hpa(height_m: f64) -> f64 {
    SEA_LEVEL_HPA
        * (1.0 - LAPSE_RATE * height_m / SEA_LEVEL_K)
            .max(0.1)
            .powf(EXPONENT)
}
fn altitude_m(pressure_hpa: f64) -> f64 {
    SEA_LEVEL_K / LAPSE_RATE * (1.0 - (pressure_hpa / SEA_LEVEL_HPA).max(1e-3).powf(1.0 / EXPONENT))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn standard_atmosphere_inverse() {
        for h in [-10.0, 0.0, 30.0, 500.0] {
            assert!((altitude_m(pressure_hpa(h)) - h).abs() < 1e-3);
        }
        assert!((pressure_hpa(1000.0) - 898.75).abs() < 0.2);
    }
}
