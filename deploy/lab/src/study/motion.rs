//! `alight study --motion`: motion of a study's decks as CSV, for other simulators and motion platforms.

use std::{collections::BTreeSet, path::Path};

use alight_computer::{
    exit::{CliError, Doing},
    terminal::note,
};
use alight_shared::{
    frames::{Deck, DroneBody, VesselBody},
    step::Step,
    time::WorldTime,
};
use alight_sim::{
    harness::{
        observer::WorldObserver, outcome::TIME_LIMIT_S, physics::TICK, scenario::NodeConfigs, world::World,
    },
    physics::body::RigidState,
};
use alight_usv::computer::ComputerIn;
use nalgebra::Vector3;

use super::{result::write_files, rows::StudyRow, run::file_stem};

const ABOUT: &str = "NAME.csv: true motion of the deck's centre every 0.02 s. roll_deg (starboard down), pitch_deg (bow up),
heading_deg; heave_m (up), surge_m and sway_m (along and to starboard of the mean heading) about their means.
alight trial --deck-motion NAME.csv plays it.
NAME-sensors.csv: measurements of the vessel's sensors, with their errors, by the vessel's clock. imu: body rates
(rad/s), specific force (m/s2); gnss: position of the antenna (north, east, down, m), velocity (m/s); heading (rad);
attitude: roll, pitch (rad); clock, with gnss: the vessel's clock minus the time in NAME.csv (s).
Licence: MIT OR Apache-2.0, as the program.
";

#[derive(Default)]
struct Motion {
    centre: Vector3<f64>,
    /// Time (s), position (NED, m), roll, pitch, heading (rad) of the deck's centre.
    truth: Vec<(f64, Vector3<f64>, Vector3<f64>)>,
    sensors: String,
}

impl WorldObserver for Motion {
    fn truth(
        &mut self,
        t: WorldTime,
        vessel: &RigidState<VesselBody>,
        _: Option<&(RigidState<DroneBody>, Vector3<f64>)>,
    ) {
        if t.nanos() % (2 * TICK.nanos()) == 0 {
            let deck = vessel.at::<Deck>(self.centre);
            self.truth.push((t.secs(), deck.position.0, deck.euler()));
        }
    }
    fn step(&mut self, t: WorldTime, step: &Step<'_>) {
        let mut line = |at_s: f64, sensor: &str, values: &[f64]| {
            let values: Vec<String> = (0..6)
                .map(|k| values.get(k).map_or(String::new(), |v| format!("{v:.6}")))
                .collect();
            self.sensors += &format!("{at_s:.4},{sensor},{}\n", values.join(","));
        };
        for readings in step.input::<ComputerIn>().iter().flat_map(|i| &i.sensors) {
            for m in readings.imu.iter() {
                line(m.header.at.secs(), "imu", &[m.gyro, m.accelerometer].concat());
            }
            for m in readings.gnss.iter() {
                let at_s = m.header.at.secs();
                line(at_s, "gnss", &[m.position, m.velocity].concat());
                line(at_s, "clock", &[step.now_ns as f64 * 1e-9 - t.secs()]);
            }
            for m in readings.heading.iter() {
                line(m.header.at.secs(), "heading", &[m.heading]);
            }
            for m in readings.attitude.iter() {
                line(m.header.at.secs(), "attitude", &m.tilt);
            }
        }
    }
}

impl Motion {
    fn truth_csv(&self) -> String {
        let count = self.truth.len().max(1) as f64;
        let mean = self.truth.iter().map(|(_, p, _)| p).sum::<Vector3<f64>>() / count;
        let (s, c) = self
            .truth
            .iter()
            .fold((0.0, 0.0), |(s, c), (_, _, e)| (s + e.z.sin(), c + e.z.cos()));
        let (s, c) = (s / s.hypot(c), c / s.hypot(c));
        let mut text = String::from("t_s,roll_deg,pitch_deg,heading_deg,heave_m,surge_m,sway_m\n");
        for (t_s, p, euler) in &self.truth {
            let e = euler.map(f64::to_degrees);
            let d = p - mean;
            let surge = c * d.x + s * d.y;
            let sway = c * d.y - s * d.x;
            text += &format!(
                "{t_s:.2},{:.4},{:.4},{:.4},{:.4},{surge:.4},{sway:.4}\n",
                e.x, e.y, e.z, -d.z
            );
        }
        text
    }
}

/// Writes the motion of each scene's first seed into `directory`: the warm-up, and the maximum duration of a landing.
pub fn write(directory: &Path, rows: &[StudyRow], seed: u64, alone: bool) -> Result<(), CliError> {
    let mut written = BTreeSet::new();
    for row in rows.iter().filter(|r| written.insert(&r.scenario)) {
        let nodes = NodeConfigs {
            own: None,
            predictor: None,
            ..row.nodes.clone()
        };
        let doing = format_args!("setting up the scene {} with seed {seed}", row.scenario);
        let mut world = World::new(&row.world, &nodes, seed).doing(doing)?;
        let mut motion = Motion {
            centre: row.world.drawn(seed).deck.centre(),
            sensors: "t_s,sensor,v1,v2,v3,v4,v5,v6\n".into(),
            ..Motion::default()
        };
        world.warm_up(&mut motion);
        for _ in 0..(TIME_LIMIT_S / TICK.secs()) as u64 {
            world.tick(&mut motion);
        }
        let name = file_stem(&row.scenario);
        let truth = format!("{name}.csv");
        let sensors = format!("{name}-sensors.csv");
        write_files(
            directory,
            &[
                ("README.txt", ABOUT.into()),
                (&truth, motion.truth_csv()),
                (&sensors, motion.sensors),
            ],
        )?;
        note(
            alone,
            format_args!("written: {}", directory.join(truth).display()),
        );
    }
    Ok(())
}
