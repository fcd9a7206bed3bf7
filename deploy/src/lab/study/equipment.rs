//! Rows of `study sensors` and `study size`: what a boat measures with, how large its deck is, and which drone comes.

use alight_sim::harness::scenario::Scenario;
use alight_sim::physics::drone::Frame;
use alight_sim::sensors::attitude::VesselAttitudeConfig;
use alight_sim::sensors::noise::Windows;
use alight_uav::autopilot::modes::Firmware;

use super::variant::{MakeScene, StudyScene};

/// Larger than any trial, s.
const ALWAYS_S: f64 = 1.0e6;

fn always() -> Windows {
    Windows(vec![[0.0, ALWAYS_S]])
}

/// An autopilot aboard as the vessel's sensor (MAVLink HIGHRES_IMU, GPS_RAW_INT, heading by compass).
/// Source: data sheets of ICM-42688 and NEO-M9N; a compass beside a boat's iron is off by degrees (chosen).
fn autopilot_aboard(w: &mut Scenario) {
    let s = &mut w.sensors;
    s.vessel_imu.rate_hz = 50.0;
    s.vessel_imu.latency_s = 0.01;
    s.vessel_imu.alignment_sd_deg = 0.5;
    s.vessel_imu.accelerometer_bias_sd_mps2 = 0.1;
    s.vessel_gnss.rate_hz = 5.0;
    s.vessel_gnss.latency_s = 0.12;
    s.vessel_gnss.error.bias_sd_m = 1.5;
    s.vessel_heading.bias_sd_deg = 3.0;
}

/// A plotter's receiver and a fluxgate compass at NMEA 0183's usual rates, and an IMU beside them.
/// Source: GGA and RMC once a second at 4800 baud; compass sentences ten times a second (IEC 61162-2).
fn plotter(w: &mut Scenario) {
    let s = &mut w.sensors;
    s.vessel_gnss.rate_hz = 1.0;
    s.vessel_gnss.latency_s = 0.3;
    s.vessel_gnss.error.bias_sd_m = 1.5;
    s.vessel_heading.latency_s = 0.1;
    s.vessel_heading.bias_sd_deg = 3.0;
}

/// An inertial navigation system of two antennas with corrections, which reports attitude, rates and heave and no raw
/// samples. Source: data sheets of such systems: 0.05 deg, 0.02 m, heading 0.2 deg.
fn inertial_navigation(w: &mut Scenario) {
    let s = &mut w.sensors;
    s.vessel_imu.outages_s = always();
    s.vessel_attitude = Some(VesselAttitudeConfig::default());
    s.vessel_gnss.rate_hz = 10.0;
    s.vessel_gnss.error.bias_sd_m = 0.05;
    s.vessel_gnss.error.white_sd_m = 0.02;
    s.vessel_gnss.error.velocity_sd_mps = 0.03;
    s.vessel_heading.white_sd_deg = 0.2;
    s.vessel_heading.bias_sd_deg = 0.2;
}

/// The rows of `study sensors`.
pub fn sensors(row: MakeScene<'_>) -> Vec<StudyScene> {
    let askew = |w: &mut Scenario| {
        w.sensors.vessel_imu.alignment_sd_deg = 2.0;
        if let Some(a) = &mut w.sensors.vessel_attitude {
            a.alignment_sd_deg = 2.0;
        }
    };
    let no_inertial = |w: &mut Scenario| w.sensors.vessel_imu.outages_s = always();
    vec![
        row("default", &|_| {}),
        row("autopilot aboard", &autopilot_aboard),
        row("1 Hz NMEA, compass, IMU", &plotter),
        row("dual-antenna INS", &inertial_navigation),
        row("autopilot aboard, 2 deg askew", &|w| {
            autopilot_aboard(w);
            askew(w);
        }),
        row("1 Hz NMEA, 2 deg askew", &|w| {
            plotter(w);
            askew(w);
        }),
        row("dual-antenna INS, 2 deg askew", &|w| {
            inertial_navigation(w);
            askew(w);
        }),
        row("1 Hz NMEA, compass, no IMU", &|w| {
            plotter(w);
            no_inertial(w);
        }),
        row("10 Hz GNSS, compass, no IMU", &no_inertial),
        row("RTK on both", &|w| {
            w.sensors.vessel_gnss.error.bias_sd_m = 0.02;
            w.sensors.vessel_gnss.error.white_sd_m = 0.02;
            w.drone.navigation.gnss_bias_m = 0.02;
            w.drone.navigation.gnss_noise_m = 0.02;
        }),
        row("GNSS bias 3 m", &|w| {
            w.sensors.vessel_gnss.error.bias_sd_m = 3.0;
            w.drone.navigation.gnss_bias_m = 3.0;
        }),
        row("no UVDAR", &|w| w.sensors.uvdar.outages_s = always()),
        row("no camera at all", &|w| {
            w.sensors.uvdar.outages_s = always();
            w.sensors.tag.outages_s = always();
        }),
        row("tag lost nearer than 3 m", &|w| {
            w.sensors.tag.min_distance_m = 3.0
        }),
        row("IMU bias x 3", &|w| {
            w.sensors.vessel_imu.gyro_bias_sd_radps *= 3.0;
            w.sensors.vessel_imu.accelerometer_bias_sd_mps2 *= 3.0;
        }),
    ]
}

/// Sides of the square decks of `study size`, m.
const DECKS_M: [f64; 4] = [0.8, 1.2, 1.7, 2.5];
/// Masses of its drones, kg.
const MASSES_KG: [f64; 4] = [1.5, 3.5, 8.0, 25.0];
/// Its attitude lags, s.
const LAGS_S: [f64; 5] = [0.15, 0.2, 0.3, 0.4, 0.5];

/// Another deck, as everybody has measured it: square, with the tags that are suggested for it.
fn with_deck(mut scene: StudyScene, side_m: f64) -> StudyScene {
    for deck in [
        &mut scene.world.deck,
        &mut scene.nodes.vessel.deck,
        &mut scene.nodes.drone.deck,
    ] {
        (deck.length_m, deck.width_m) = (side_m, side_m);
    }
    scene
}

/// Another drone, as its owner has measured it: the shipped one made larger in all its parts, with the thrust to weight
/// that it has. Lengths go with the cube root of the mass, moments of inertia with mass times length squared, drag with
/// area. A propeller's lag is the same at the same tip speed: its inertia over its torque times its speed.
fn with_mass(mut scene: StudyScene, mass_kg: f64) -> StudyScene {
    let ratio = mass_kg / scene.world.airframe.mass_kg;
    let length = ratio.cbrt();
    let airframe = &mut scene.world.airframe;
    airframe.mass_kg = mass_kg;
    airframe.max_thrust_n *= ratio;
    (airframe.inertia_kgm2.iter_mut()).for_each(|i| *i *= ratio * length * length);
    for m in [
        &mut airframe.arm_m,
        &mut airframe.moment_per_force_m,
        &mut airframe.feet_below_m,
    ] {
        *m *= length;
    }
    (airframe.feet_span_m.iter_mut())
        .chain(&mut airframe.camera_m)
        .chain(&mut airframe.rangefinder_m)
        .for_each(|m| *m *= length);
    scene.nodes.drone.airframe = *airframe;
    let physical = &mut scene.world.drone.airframe;
    physical.drag_n_per_mps2 *= length * length;
    physical.parked_drag_n_per_mps2 *= length * length;
    physical.rotor_radius_m *= length;
    physical.rotor_above_m *= length;
    scene
}

/// The rows of `study size`.
pub fn size(row: MakeScene<'_>) -> Vec<StudyScene> {
    let mut rows = Vec::new();
    for mass in MASSES_KG {
        for side in DECKS_M {
            let plain = row(&format!("{mass} kg on {side} m"), &|_| {});
            rows.push(with_deck(with_mass(plain, mass), side));
        }
    }
    for lag in LAGS_S {
        let mut scene = row(&format!("attitude lag {lag} s"), &|w| {
            w.drone.autopilot.attitude_lag_s = lag
        });
        scene.nodes.drone.airframe.attitude_lag_s = lag;
        rows.push(scene);
    }
    for (name, firmware) in [("PX4", Firmware::Px4), ("ArduCopter", Firmware::ArduCopter)] {
        rows.push(row(&format!("hexarotor, {name}'s mixer"), &|w| {
            w.drone.airframe.frame = Frame::HexaX;
            w.drone.autopilot.firmware = firmware;
        }));
    }
    // Unknown to the nodes, besides the errors to 5 % that are always drawn.
    rows.extend([
        row("mass 20 % more", &|w| w.drone.airframe.mass_factor = 1.2),
        row("mass 20 % less", &|w| w.drone.airframe.mass_factor = 0.8),
        row("thrust 15 % less", &|w| w.drone.airframe.thrust_factor = 0.85),
    ]);
    rows
}

#[cfg(test)]
mod tests {
    use alight_sim::harness::scenario::{NodeConfigs, Scenario};

    use super::*;

    fn row(name: &str, change: &dyn Fn(&mut Scenario)) -> StudyScene {
        let mut world = Scenario::default();
        change(&mut world);
        StudyScene {
            name: name.into(),
            world,
            nodes: NodeConfigs::default(),
        }
    }

    #[test]
    fn sizes_of_world_and_nodes() {
        let rows = size(&row);
        for scene in &rows {
            let (world, nodes) = (&scene.world, &scene.nodes);
            assert_eq!(world.deck, nodes.drone.deck, "{}", scene.name);
            assert_eq!(world.deck, nodes.vessel.deck, "{}", scene.name);
            assert_eq!(
                world.airframe.mass_kg, nodes.drone.airframe.mass_kg,
                "{}",
                scene.name
            );
            assert!(world.deck.largest_tag_m() < world.deck.width_m, "{}", scene.name);
        }
        let heavy = rows
            .iter()
            .find(|s| s.name == "25 kg on 2.5 m")
            .map(|s| s.world.airframe);
        let wanted = (25.0_f64 / 3.5).cbrt();
        assert!(heavy.is_some_and(|a| (a.arm_m / 0.325 - wanted).abs() < 1e-9 && a.max_thrust_n > 2.8 * 25.0 * 9.8));
    }
}
