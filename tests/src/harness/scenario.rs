//! Scenario: parameters of the simulated world, and configurations of the nodes.

pub mod draws;
pub mod foresight;

use alight_bridge::BridgeConfig;
use alight_shared::{
    config,
    config::ConfigError,
    geodesy::Datum,
    geometry::{DeckGeometry, DroneGeometry},
    surroundings::SurroundingsConfig,
};
use alight_uav::{
    autopilot::AutopilotLinkConfig,
    planner::{Planner, PlannerKind},
    settings::DroneSettings,
};
use alight_usv::{DeckConfig, VesselNodeConfig};
use thiserror::Error;

use self::{draws::DrawConfig, foresight::ForesightConfig};
use super::storm::fault::Fault;
use crate::{
    baselines::{
        Baseline,
        own::{OwnLaw, OwnPredictor, OwnReport},
    },
    physics::{
        deck_motion::{DeckMotionConfig, DeckMotionError},
        drone::DroneConfig,
        sea::SeaConfig,
        streams::Streams,
        vessel::{
            VesselConfig,
            response::{HullConfig, HullError, HullFiles},
        },
    },
    radio::SimulatedRadioConfig,
    sensors::{SensorConfig, noise::Noise},
};

config! {
    /// Initial state of a drone relative to the vessel.
    pub struct StartConfig {
        /// Horizontal distance, drawn uniformly between these, m.
        /// Source: at least 40 m away at a random place and heading (Procházka 2024); upper bound ours.
        pub distance_m: [f64; 2] = [40.0, 60.0], in 0.0..=500.0;
        /// Height above the still water, drawn uniformly between these, m.
        /// Source: ours, below and above the approach height of 15 m.
        pub height_m: [f64; 2] = [8.0, 20.0], in 2.0..=120.0;
        /// Time for which the vessel's estimator runs before the order to land, s.
        /// Source: the estimator converges in an unknown sea within 60 s.
        pub warm_up_s: f64 = 60.0, in 0.0..=600.0;
        /// Start disarmed at the deck's centre, instead of hovering next to the vessel.
        pub on_deck: bool = false;
        /// Time for which the drone hovers before the order to land, s.
        /// Source: ours; in this time the link finds the autopilot, and a pilot selects its mode.
        pub hover_s: f64 = 5.0, in 1.0..=60.0;
    }
    check |this, at| {
        at.require(
            this.distance_m[0] <= this.distance_m[1] && this.height_m[0] <= this.height_m[1],
            "distance_m, height_m",
            format!("{:?}, {:?}", this.distance_m, this.height_m),
            "lower bound first",
        )?;
    }
}

config! {
    /// Geographic position of the scene, and origins of the drones' frames. The vessel's frame starts at its first fix.
    pub struct PlaceConfig {
        /// Candidate origins of the scene's NED. The seed selects one, and the vessel's devices send bytes.
        /// Default: four positions at sea, in the south, the west, at the date line, in the far north. Heights of
        /// the sea above the ellipsoid follow EGM96 to within metres.
        /// Empty: vessel and drones use the scene's NED, and the devices give quantities, because their byte
        /// formats need latitude and longitude.
        pub among: Vec<Datum> = four_seas();
        /// Distance from a drone's start to the origin of its autopilot's frame, drawn uniformly between these, m.
        /// Chosen: the autopilot is switched on ashore, or some time earlier aboard.
        pub origin_m: [f64; 2] = [0.0, 2000.0], in 0.0..=5000.0;
        /// Height of that origin above still water, drawn uniformly between these, m.
        pub origin_height_m: [f64; 2] = [0.0, 30.0], in 0.0..=1000.0;
    }
    check |this, at| {
        for d in &this.among {
            let at = at.table("among");
            at.range("latitude_deg", d.latitude_deg, -89.0, 89.0)?;
            at.range("longitude_deg", d.longitude_deg, -180.0, 180.0)?;
            at.range("height_m", d.height_m, -1e3, 1e4)?;
        }
        at.require(
            this.origin_m[0] <= this.origin_m[1] && this.origin_height_m[0] <= this.origin_height_m[1],
            "origin_m, origin_height_m",
            format!("{:?}, {:?}", this.origin_m, this.origin_height_m),
            "lower bound first",
        )?;
    }
}

fn four_seas() -> Vec<Datum> {
    vec![
        Datum::new(-33.9, 18.3, 31.0),
        Datum::new(47.6, -122.4, -21.0),
        Datum::new(-16.8, 179.999, 55.0),
        Datum::new(70.1, 19.2, 30.0),
    ]
}

impl PlaceConfig {
    pub(crate) fn drawn(&self, streams: &Streams) -> Option<Datum> {
        let k = (Noise::new(streams, "place").uniform() * self.among.len() as f64) as usize;
        self.among.get(k).or(self.among.last()).copied()
    }
}

config! {
    /// A simulated scene: true parameters, which no node reads.
    pub struct Scenario {
        /// The sea.
        pub sea: SeaConfig;
        /// The vessel.
        pub vessel: VesselConfig;
        /// Response table that moves the vessel, instead of the hull model.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub hull: Option<HullConfig> = None;
        /// Recorded motion of the deck, instead of the vessel's simulated motion.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub deck_motion: Option<DeckMotionConfig> = None;
        /// The true landing deck.
        pub deck: DeckGeometry;
        /// True keep-out volumes, at most 8: two opposite corners of each box in the vessel's body frame, m.
        #[serde(skip_serializing_if = "Vec::is_empty")]
        pub keep_out_m: Vec<[[f64; 3]; 2]> = Vec::new(), in -200.0..=200.0;
        /// The drone's true geometry; its mass and thrust errors are in `drone.airframe`.
        pub airframe: DroneGeometry;
        /// The drone's physics and autopilot.
        pub drone: DroneConfig;
        /// Place on Earth.
        pub place: PlaceConfig;
        /// Distance between the deck centres of the vessel and another boat with the same tags, which rocks
        /// independently, m. None: no other boat.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub neighbour_m: Option<f64> = None, in 1.0..=500.0;
        /// Differences between the true parameters and those in the nodes' configurations.
        pub draws: DrawConfig;
        /// Start of the drone.
        pub start: StartConfig;
        /// Number of drones, each with its own computer. With several drones, each requests a reservation of the deck.
        pub drones: u32 = 1, in 1.0..=8.0;
        /// Sensors and clocks.
        pub sensors: SensorConfig;
        /// The radio.
        pub radio: SimulatedRadioConfig;
        /// Begin the descent at a random moment within 20 s after the drone is steady above the deck, and
        /// continue it regardless of the probability of success, to compare prediction and outcome.
        pub begin_anyway: bool = false;
        /// Parts of the forecasts that are replaced by the truth, for an error budget.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub foresight: Option<ForesightConfig> = None;
        /// Time from the planner's step to the plan's arrival at the pilot, s.
        /// Source: one period of the planner at 50 Hz; a plan is used one period after its inputs are measured.
        pub solve_delay_s: f64 = 0.02, in 0.0..=1.0;
        /// Time for which the world continues after the outcome is known, s.
        pub stay_s: f64 = 0.0, in 0.0..=3600.0;
        /// Faults, in the format of a storm's list; `lasts_s` may be `inf`.
        #[serde(rename = "fault", skip_serializing_if = "Vec::is_empty")]
        pub faults: Vec<Fault> = Vec::new();
    }
    check |this, at| {
        if let Some(hull) = &this.hull {
            hull.check(&at.table("hull"))?;
            at.require(
                this.deck_motion.is_none(),
                "hull",
                &hull.table,
                "no table if `deck_motion` is set: only one of the two can move the deck",
            )?;
        }
        if let Some(motion) = &this.deck_motion {
            motion.check(&at.table("deck_motion"))?;
        }
        Fault::check_all(&this.faults, &at.table("fault"), f64::INFINITY)?;
    }
}

impl Scenario {
    /// Installs a hull: twin-5m, mono-5m, work-12m, or the path of a response table. Deck and sensors are
    /// placed as in the hull's file; the nodes get the values that an installer would measure.
    pub fn install_hull(&mut self, nodes: &mut NodeConfigs, hull: &str) -> Result<(), SetupError> {
        let places = HullFiles::load(hull)?.places;
        self.hull = Some(HullConfig {
            table: hull.into(),
            ..HullConfig::default()
        });
        self.deck = places.deck(&self.deck);
        nodes.vessel.deck = places.deck(&nodes.vessel.deck);
        nodes.drone.deck = places.deck(&nodes.drone.deck);
        let antenna = places.antenna.body();
        let imu = places.imu.body();
        self.sensors.vessel_gnss.antenna_m = antenna;
        nodes.vessel.gnss.antenna_m = antenna;
        self.sensors.vessel_imu.lever_arm_m = imu;
        nodes.vessel.imu.lever_arm_m = imu;
        Ok(())
    }
    /// Sets the deck, the obstacles around it and the drone of the world to these configurations.
    pub fn describe(&mut self, deck: &DeckGeometry, around: &SurroundingsConfig, drone: &DroneGeometry) {
        self.deck = *deck;
        self.airframe = *drone;
        self.keep_out_m = around.keep_out_m.clone();
        // Clamped to the simulated autopilot's range.
        self.drone.autopilot.attitude_lag_s = Some(drone.attitude_lag_s.clamp(0.08, 1.0));
    }
    /// Sets the wind that corresponds to this sea, along its waves.
    pub fn raise_wind(&mut self) {
        let wind = &mut self.drone.wind;
        wind.mean_mps = SeaConfig::wind_of_height(self.sea.significant_height());
        wind.with_waves = true;
    }
}

#[derive(Debug, Error)]
pub enum SetupError {
    #[error(transparent)]
    Config(#[from] ConfigError),
    #[error(transparent)]
    Hull(#[from] HullError),
    #[error(transparent)]
    DeckMotion(#[from] DeckMotionError),
}

#[derive(Clone, Debug, Default, PartialEq)]
pub struct NodeConfigs {
    pub vessel: VesselNodeConfig,
    pub deck: DeckConfig,
    pub bridge: BridgeConfig,
    pub autopilot: AutopilotLinkConfig,
    /// Settings of the drone's other processes.
    pub drone: DroneSettings,
    pub baseline: Option<Baseline>,
    /// Law that replaces that of the drone's planner, or of the baseline.
    pub own: Option<OwnLaw>,
    /// Corrects the forecasts of the drone's predictor.
    pub predictor: Option<OwnPredictor>,
}

impl NodeConfigs {
    pub fn planner_name(&self) -> &str {
        let kind = self.drone.planner.kind;
        let included = self.baseline.map_or_else(|| kind.name(), |b| b.name());
        self.own.as_ref().map_or(included, OwnLaw::name)
    }
    /// The planner as a node; a law that is not part of this program reports to `report`.
    pub fn planner(&self, boot: u32, report: &OwnReport) -> Planner {
        let (config, drone, deck) = (&self.drone.planner, &self.drone.airframe, &self.drone.deck);
        let own = self.own.as_ref().map(|own| own.start(&self.drone, report));
        match own.or_else(|| Some(self.baseline.as_ref()?.law(config, drone))) {
            None => Planner::new(config, drone, deck, boot),
            Some(law) => Planner::with_law(law, config, drone, deck, boot),
        }
    }
    pub fn settings(&self) -> DroneSettings {
        let mut settings = self.drone.clone();
        if let Some(baseline) = &self.baseline {
            settings.mission = baseline.mission(settings.mission);
            settings.predictor = baseline.predictor(settings.predictor);
            // A baseline has no settings of its own and uses those of `alight`.
            settings.planner.kind = PlannerKind::Alight;
        }
        settings
    }
}
