//! Parameters of the mission; a ground station can set some of them.

use alight_shared::{
    config,
    config::{Check, ConfigError, Keys},
    msg::{BatteryPlace, LandingMode, MissionSettings, VesselLevel},
};

config! {
    /// Parameters of the state machine. Heights are those of the drone's centre of mass above the deck's mean level;
    /// clearances are those of its foot plane above the deck, along the deck's normal.
    pub struct MissionConfig {
        /// Approach height h_a, m.
        /// Source: Procházka et al. 2024: h_a, h_t, v_la, v_fa.
        pub approach_height_m: f64 = 15.0, in 2.0..=200.0;
        /// Tracking height h_t, m.
        pub tracking_height_m: f64 = 7.0;
        /// Descent speed relative to the deck v_la, m/s.
        pub descent_mps: f64 = 1.0, in 0.05..=3.0;
        /// Descent speed in the flare v_fa, m/s.
        pub flare_mps: f64 = 0.5, in 0.05..=2.0;
        /// Clearance below which the flare begins, m.
        /// Source: Not published. Between 0.5 and 1 m the prototype shows no difference; 2 m is worse.
        pub flare_clearance_m: f64 = 0.9;
        /// Clearance below which the flare's conditions are checked, and an unmet condition stops the descent, m.
        /// Chosen: 0.7 s of descent for the decision, above the commit clearance.
        pub decision_clearance_m: f64 = 1.6, in 0.2..=10.0;
        /// Clearance below which only hard reasons abort a landing, m.
        /// Source: Prototype: in an abort below 0.8 m the deck rises into the drone.
        pub commit_clearance_m: f64 = 0.8;
        /// Minimum height of any trajectory above the water, m.
        /// Chosen: above the highest waves of a sea of 1 m amplitude.
        pub minimum_altitude_m: f64 = 3.0, in 0.0..=50.0;
        /// Minimum height during the descent near or above the deck, m.
        /// Chosen: the deck's surface is 1.3 m above the water.
        pub minimum_altitude_landing_m: f64 = 0.5;
        /// Minimum information about a vessel for a landing to begin: "computer" (its broadcast is received), "beacon"
        /// (a beacon gives its position, where the drone searches for its tags) or "tag" (the camera detects its tags
        /// from within 10 m of the deck's centre; obstacles around the deck are then unknown).
        #[serde(alias = "least_vessel")]
        pub min_vessel: VesselLevel = VesselLevel::Computer;
        /// Maximum distance from its start to which an (unauthenticated) beacon alone may lead the drone, m.
        /// Chosen: a boat within view of its crew.
        pub beacon_max_way_m: f64 = 1000.0, in 50.0..=5000.0;
        /// Height above the deck from which a search can detect its tags, and radius of the area that it then covers,
        /// m. Both follow from the camera and the tags in the drone's common settings.
        #[serde(skip)]
        pub search_view_m: [f64; 2] = [12.0, 6.0];
        /// Require vision of the deck for a landing. If false, a radio estimate counts as a detection.
        pub vision_required: bool = true;
        /// Age up to which a vision measurement counts as a detection of the deck, s.
        pub vision_fresh_s: f64 = 0.5, in 0.0..=120.0;
        /// Time without a detection after which tracking ends, s.
        pub vision_lost_s: f64 = 5.0, in 0.0..=120.0;
        /// Radio silence after which a drone without vision enters Hold or searches for the vessel (`min_vessel`), and
        /// a station stays fixed over ground until the vessel is received again, s.
        pub radio_lost_s: f64 = 5.0, in 0.0..=120.0;
        /// Relative horizontal speed below which the drone is stable above the deck, m/s.
        pub steady_speed_mps: f64 = 1.2, in 0.01..=10.0;
        /// Time for which the drone must be stable above the deck, s.
        pub steady_s: f64 = 0.5, in 0.0..=120.0;
        /// Minimum probability of a landing: contact speed and angle, four feet on the deck, no sliding. A descent begins
        /// at 0.85 of it, but never with a lower probability to stay on the deck.
        pub min_probability: f64 = 0.95, in 0.0..=1.0;
        /// Maximum probability of an unsafe contact: too hard, too fast along the deck, too tilted, or with a foot over
        /// an edge. A descent begins below 0.15. In gusts it pauses low above the deck until the probability is below
        /// this, and the drone breaks off at the last height from which it can climb above twice this (without gusts:
        /// 0.07 more than this). A rejected landing costs a minute, an unsafe one the drone.
        pub max_harm: f64 = 0.01, in 0.0..=1.0;
        /// Cost of a minute of waiting above the deck, as a probability. With a higher cost, a sufficiently safe
        /// descent begins sooner and waits less for a calm period between wave groups.
        /// Chosen: a battery that lasts ten minutes above the deck.
        pub waiting_cost_per_min: f64 = alight_shared::landing::WAITING_COST_PER_MIN, in 0.0..=10.0;
        /// Maximum vertical speed of a predicted deck to land on, m/s.
        /// Source: The planner's limit of 4 m/s less the speed of descent.
        pub deck_heave_mps: f64 = 3.5, in 0.01..=20.0;
        /// Maximum tilt of a predicted deck to land on, rad.
        pub deck_tilt_rad: f64 = 0.45, in 0.01..=1.5;
        /// Friction coefficient of feet on a wet deck; it limits the slope and wind in which a drone lands.
        pub friction: f64 = alight_shared::landing::FRICTION, in 0.01..=2.0;
        /// Maximum age of the detection for a descent, s.
        pub descent_vision_s: f64 = 1.0, in 0.0..=120.0;
        /// Age up to which radio data count as fresh, s.
        /// Source: landings with a radio delay of 1 s (retransmission) are as accurate (10 of 10, 0.06 m).
        pub radio_fresh_s: f64 = 1.5, in 0.0..=120.0;
        /// Maximum duration of the descent, s.
        pub descent_timeout_s: f64 = 30.0, in 0.0..=120.0;
        /// Maximum duration of the flare, s.
        pub flare_timeout_s: f64 = 8.0, in 0.0..=120.0;
        /// Depth of the feet below the deck without a touchdown at which the landing counts as missed, m.
        pub missed_m: f64 = 0.4, in 0.01..=5.0;
        /// Require the vessel's grant of the deck for a descent; needed on vessels with several drones.
        /// Source: A single drone needs no grant; the drone package's configuration file sets true.
        pub reservation_required: bool = false;
        /// Take off from the deck on `alight order takeoff`: Alight selects the autopilot's mode and arms after the
        /// crew has cleared the deck (`alight order deck takeoff`) and a countdown.
        pub takeoff: bool = false;
        /// Maximum number of unattended sorties since the drone's service started: after `alight order takeoff` the
        /// drone flies the autopilot's own mission, returns, lands, and takes off again once it is ready, as long as
        /// the crew keeps the deck cleared for it. 0: each take-off needs an order and ends in a hold.
        pub sorties_max: u32 = 0;
        /// Charge above which a drone in unattended cycles is ready for take-off, 0 to 1. Above 1, only `alight order
        /// ready` makes it ready.
        /// Chosen: the charge at which a charger slows down.
        pub battery_ready: f64 = 0.9, in 0.0..=1.01;
        /// Maximum number of descents.
        pub max_attempts: u32 = 10;
        /// Remaining charge below which the drone lands at the first available place of `battery_order`, 0 to 1.
        pub battery_reserve: f64 = 0.2, in 0.0..=0.9;
        /// Landing places below the reserve, in order of preference: "deck", "home" (the autopilot's return mode),
        /// "here" (its land mode). If the deck is closed, granted to another drone or unknown, the drone waits for it
        /// until its charge is just enough to reach the next place. The limits of a landing are relaxed in the second
        /// half of the reserve. If no place is available, the drone climbs and holds. A descent in progress ends on the
        /// deck. After an abort or a hold the drone announces the landing and begins it when a quarter of the reserve
        /// is used; a second abort declines the deck. An order below the reserve makes the deck the first place.
        /// Chosen: a drone above the deck should not fly home over open water.
        pub battery_order: Vec<BatteryPlace> = vec![BatteryPlace::Deck, BatteryPlace::Home, BatteryPlace::Here];
        /// Time for which all readings must be below the reserve before the drone acts, s.
        /// Chosen: full thrust, which lowers the voltage, lasts 2 s at most.
        pub battery_lasts_s: f64 = 5.0, in 0.0..=60.0;
        /// Voltage below which the battery counts as empty after that time, V. 0: only the gauge counts.
        pub battery_minimum_v: f64 = 0.0, in 0.0..=500.0;
        /// Hover time of the loaded drone from full to a gauge of 0, s. After this time in the air the battery counts
        /// as empty whatever its gauge reads, and a silent or stuck gauge is extrapolated at this rate or faster. 0:
        /// not measured; a gauge that falls too slowly is then accepted, and a silent or stuck gauge is extrapolated
        /// from the current, from its previous rate, or with 300 s. On a tether: 1e6.
        pub battery_endurance_s: f64 = 0.0, in 0.0..=1e6;
        /// Battery capacity that converts current to a discharge rate, Ah. 0: the rate at which the gauge falls is
        /// used.
        pub battery_capacity_ah: f64 = 0.0, in 0.0..=1e3;
        /// Duration of one attempt above the deck, from arrival to touchdown or return to height, s.
        /// Source: tracking, descent and flare last 20 to 40 s in moderate seas.
        pub battery_attempt_s: f64 = 60.0, in 0.0..=600.0;
        /// Assumed airspeed on the way to the vessel, for the charge needed, until the speed is measured, m/s.
        /// Source: The planner's horizontal speed.
        pub battery_air_speed_mps: f64 = 8.0, in 1.0..=30.0;
        /// Extent of a landing: "shadow" (a pilot flies and lands; Alight computes and displays everything but commands
        /// nothing), "match" (Alight follows the deck down to `lowest_clearance_m`, holds for `match_s` and climbs) or
        /// "land".
        pub mode: LandingMode = LandingMode::Land;
        /// With `mode = "match"`: minimum clearance of the feet above the deck, m.
        /// Chosen: a deck in a sea of 1 m rises by less while a pilot who reacts 1 s late climbs.
        pub lowest_clearance_m: f64 = 2.0, in 1.0..=50.0;
        /// With `mode = "match"`: duration at `lowest_clearance_m`, s.
        pub match_s: f64 = 10.0, in 1.0..=60.0;
        /// Maximum duration of the whole landing, from the command on, s.
        pub mission_timeout_s: f64 = 600.0, in 10.0..=36_000.0;
    }
    check |this, at| {
        let highest = this.tracking_height_m - 1.0;
        if this.mode == LandingMode::Match {
            at.range("lowest_clearance_m", this.lowest_clearance_m, 1.0, highest)?;
        }
        at.range(
            "tracking_height_m",
            this.tracking_height_m,
            2.0,
            this.approach_height_m,
        )?;
        at.range(
            "flare_clearance_m",
            this.flare_clearance_m,
            0.1,
            this.decision_clearance_m,
        )?;
        at.range(
            "commit_clearance_m",
            this.commit_clearance_m,
            0.05,
            this.flare_clearance_m,
        )?;
        at.range(
            "minimum_altitude_landing_m",
            this.minimum_altitude_landing_m,
            0.0,
            this.minimum_altitude_m,
        )?;
        let order = &this.battery_order;
        let repeats = (1..order.len()).any(|k| order.iter().skip(k).zip(order).any(|(a, b)| a == b));
        at.require(
            !repeats,
            "battery_order",
            format!("{order:?}"),
            "\"deck\", \"home\", \"here\", each at most once",
        )?;
        at.require(
            (1..=1000).contains(&this.max_attempts),
            "max_attempts",
            this.max_attempts,
            "1 to 1000",
        )?;
    }
}

/// Margin above the lowest clearance of a plan in `match`, m: error of forecast and tracking.
const MATCH_MARGIN_M: f64 = 0.5;

impl MissionConfig {
    pub fn settings(&self) -> MissionSettings {
        MissionSettings {
            mode: self.mode,
            approach_height_m: self.approach_height_m,
            tracking_height_m: self.tracking_height_m,
            lowest_clearance_m: self.lowest_clearance_m,
        }
    }
    /// This configuration with other settings; an error if they violate its limits.
    pub fn with(&self, settings: &MissionSettings) -> Result<MissionConfig, ConfigError> {
        let changed = MissionConfig {
            mode: settings.mode,
            approach_height_m: settings.approach_height_m,
            tracking_height_m: settings.tracking_height_m,
            lowest_clearance_m: settings.lowest_clearance_m,
            ..self.clone()
        };
        changed.check(&Keys::ROOT)?;
        Ok(changed)
    }
    pub fn waiting_cost_per_s(&self) -> f64 {
        self.waiting_cost_per_min / 60.0
    }
    /// Minimum height of a plan above the deck, m; None if the plan may touch down.
    pub fn lowest_plan_m(&self) -> Option<f64> {
        match self.mode {
            LandingMode::Match => Some(self.lowest_clearance_m + MATCH_MARGIN_M),
            LandingMode::Shadow | LandingMode::Land => None,
        }
    }
}
