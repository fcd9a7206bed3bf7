//! Calibrations of simulated vehicles, whose true parameters are known only to this test.

use alight_shared::{
    msg::{CommandKind, State},
    step::Step,
    time::WorldTime,
    vessel_model::{DOFS, HEAVE, PITCH, ROLL, SURGE, SWAY, YAW},
};
use alight_sim::{
    harness::{
        observer::WorldObserver,
        scenario::{NodeConfigs, Scenario},
        world::World,
    },
    physics::vessel::{VesselConfig, VesselLoad, hull::Hull, rigid::rigid_body_mass},
};
use alight_uav::{
    calibrate::{
        DeckCalibration, DeckCalibrationError, DeckCalibrationResult, DronePlacement, USABLE_M, ValueWithSd,
    },
    predictor::PredictorIn,
};
use alight_usv::{
    ComputerIn,
    calibrate::{DOF_NAMES, Record},
    sensors::Readings,
};
use nalgebra::{Matrix6, Vector3, Vector6};

use crate::at_sea;

/// Passes the predictor's inputs to the calibration after the landing.
struct Press {
    calibration: DeckCalibration,
    stands: bool,
}

impl WorldObserver for Press {
    fn step(&mut self, _: WorldTime, step: &Step<'_>) {
        if let Some(input) = step.input::<PredictorIn>() {
            self.calibration.take(input, self.stands);
        }
    }
}

/// GNSS with corrections, and a tag that the camera detects from the deck.
fn scene() -> Scenario {
    let mut s = at_sea("slight");
    s.deck.tag_side_m = Some(0.12);
    s.sensors.tag.min_distance_m = 0.1;
    s.sensors.vessel_gnss.error.bias_sd_m = 0.01;
    s.sensors.vessel_gnss.error.white_sd_m = 0.01;
    s.drone.navigation.gnss_bias_m = 0.01;
    s.drone.navigation.gnss_noise_m = 0.01;
    s
}

/// Lands and stays for `seconds`. Returns the calibration and the truth: deck centre in the vessel's body
/// frame, and drone position on the deck.
fn press(
    scenario: &Scenario,
    nodes: &NodeConfigs,
    seed: u64,
    seconds: f64,
    receivers_sd_m: Option<[f64; 2]>,
) -> (Result<DeckCalibrationResult, DeckCalibrationError>, [f64; 2]) {
    let config = nodes.drone.predictor();
    let middle = DronePlacement::centred(&config);
    let stand = DronePlacement {
        receivers_sd_m: receivers_sd_m.unwrap_or(middle.receivers_sd_m),
        ..middle
    };
    let mut observer = Press {
        calibration: DeckCalibration::new(&config, stand),
        stands: false,
    };
    let mut world = World::new(scenario, nodes, seed).unwrap();
    world.warm_up(&mut observer);
    world.command(CommandKind::Land);
    let mut landed = None;
    for _ in 0..60_000 {
        world.tick(&mut observer);
        if world.mission_state().state == State::Landed && landed.is_none() {
            landed = Some(world.physics().now().secs() + 3.0);
        }
        observer.stands = landed.is_some_and(|t| world.physics().now().secs() >= t);
        if landed.is_some_and(|t| world.physics().now().secs() >= t + seconds) {
            break;
        }
    }
    assert!(landed.is_some(), "seed {seed} did not land");
    let deck = world.physics().deck();
    let drone = world.physics().drone(0).unwrap();
    let at = deck.attitude.0.inverse() * (drone.position.0 - deck.position.0);
    (observer.calibration.result(), [at.x, at.y])
}

fn within(found: &ValueWithSd, truth: f64, what: &str) {
    let error = (found.value - truth).abs();
    println!(
        "{what}: {:.4} +- {:.4}, truth {truth:.4}: {:.1} sd",
        found.value,
        found.sd,
        error / found.sd
    );
    assert!(error < 3.0 * found.sd, "{what}: {found:?}, truth {truth}");
}

#[test]
fn deck_calibration_of_a_displaced_deck() {
    let mut scenario = scene();
    scenario.deck.centre_m = [0.25, -0.1, -1.42];
    let mut nodes = NodeConfigs::default();
    nodes.vessel.gnss.height_bias_sd_m = 0.02;
    nodes.drone.deck.tag_side_m = scenario.deck.tag_side_m;
    for seed in [1, 2, 3, 4] {
        let (found, truly_at) = press(&scenario, &nodes, seed, 60.0, Some([0.03, 0.03]));
        let found = found.unwrap();
        for (f, (truth, axis)) in found
            .centre
            .iter()
            .zip(scenario.deck.centre_m.into_iter().zip(["x", "y", "z"]))
        {
            within(f, truth, axis);
            assert!(f.sd <= USABLE_M, "{axis}: {f:?}");
        }
        for (f, truth) in found.stood_at.iter().zip(truly_at) {
            within(f, truth, "stands at");
        }
    }
}

#[derive(Default)]
struct Recorder(Record);

impl WorldObserver for Recorder {
    fn step(&mut self, _: WorldTime, step: &Step<'_>) {
        if let Some(input) = step.input::<ComputerIn>() {
            self.0.add(&Readings::of(&input.sensors));
        }
    }
}

fn recorded(scenario: &Scenario, seed: u64, seconds: f64) -> alight_usv::calibrate::VesselCalibration {
    let mut scenario = scenario.clone();
    scenario.start.warm_up_s = seconds;
    let nodes = NodeConfigs::default();
    let mut recorder = Recorder::default();
    let mut world = World::new(&scenario, &nodes, seed).unwrap();
    while world.physics().now().secs() < seconds {
        world.tick(&mut recorder);
    }
    recorder.0.identify(&nodes.vessel)
}

/// Damping and stiffness per mass for small motions. A centre of gravity above the water couples the inertia
/// of sway with roll and of surge with pitch, hence the diagonal of M's inverse.
fn linear(v: &VesselConfig) -> [[f64; 2]; DOFS] {
    let inertia = Vector3::from(v.inertia_kgm2);
    let added =
        [0, 1, 2, 3, 4, 5].map(|i| v.added_mass[i] * if i < 3 { v.mass_kg } else { v.inertia_kgm2[i - 3] });
    let mass = rigid_body_mass(v.mass_kg, Vector3::from(v.centre_of_gravity_m), inertia)
        + Matrix6::from_diagonal(&Vector6::from(added));
    let inverse = mass.try_inverse().unwrap();
    let g = Hull::new(v, alight_shared::geometry::GRAVITY).stiffness;
    let mut of = [[0.0; 2]; DOFS];
    for (i, dof) in [HEAVE, ROLL, PITCH].into_iter().enumerate() {
        let d = 2.0 * v.damping_ratio[i] * (g[i] * mass[(dof, dof)]).sqrt();
        of[dof] = [d * inverse[(dof, dof)], g[i] * inverse[(dof, dof)]];
    }
    of[SURGE][0] = v.linear_drag_nspm[0] * inverse[(SURGE, SURGE)];
    of[SWAY][0] = v.linear_drag_nspm[1] * inverse[(SWAY, SWAY)];
    of[YAW][0] = v.linear_yaw_drag_nms * inverse[(YAW, YAW)];
    of
}

/// Pushes every degree of freedom three times on calm water.
fn pushed(strength: f64) -> Scenario {
    let mut s = at_sea("0,5");
    // A linear model has no drag that is quadratic in speed.
    s.vessel.quadratic_drag_ns2pm2 = [0.0; 2];
    s.vessel.quadratic_yaw_drag_nms2 = 0.0;
    let mut t = 20.0;
    // A load for 3 s, a rest, a load for 1 s, a rest.
    for (dof, by, for_s, rest_s) in [
        (ROLL, 800.0, 3.0, 12.0),
        (PITCH, 1200.0, 3.0, 12.0),
        (HEAVE, 800.0, 3.0, 12.0),
        (YAW, 450.0, 1.0, 30.0),
        (SURGE, 600.0, 1.0, 40.0),
        (SWAY, 1000.0, 1.0, 40.0),
    ] {
        for _ in 0..3 {
            let mut by_n_nm = [0.0; 6];
            by_n_nm[dof] = by * strength;
            s.vessel.loads.push(VesselLoad {
                at_s: t,
                for_s,
                by_n_nm,
            });
            t += rest_s;
        }
    }
    s
}

#[test]
fn vessel_calibration_from_impulses() {
    let mut scenario = pushed(1.0);
    scenario.sensors.vessel_gnss.antenna_m = [-1.0, 0.3, -1.7];
    for seed in [1, 2] {
        let found = recorded(&scenario, seed, 480.0);
        let truth = linear(&scenario.vessel);
        for (dof, decay) in found.decays.iter().enumerate() {
            let d = decay.unwrap_or_else(|e| panic!("{}: {e:?}", DOF_NAMES[dof]));
            for (figure, truth, what) in [
                (d.damping, truth[dof][0], "D/M"),
                (d.stiffness, truth[dof][1], "G/M"),
            ] {
                let off = (figure.value - truth).abs();
                println!(
                    "{} {what} {figure:?} truth {truth:.3}, {} impulses",
                    DOF_NAMES[dof], d.impulses
                );
                // The nonlinearity of the hull causes 5 % of the error.
                assert!(
                    off <= 3.0 * figure.sd + 0.05 * truth,
                    "{} {what} {figure:?} {truth}",
                    DOF_NAMES[dof]
                );
            }
        }
        let antenna = found.antenna_m.unwrap();
        println!("{antenna:?}");
        for (f, truth) in antenna.iter().zip(scenario.sensors.vessel_gnss.antenna_m) {
            assert!((f.value - truth).abs() < 3.0 * f.sd, "{f:?} {truth}");
        }
    }
}
