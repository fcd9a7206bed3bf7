//! Parameters of the mission, which a ground station sets some of, too.

use alight_shared::config;
use alight_shared::config::{Check, ConfigError, Keys};
use alight_shared::msg::{BatteryPlace, LandingMode, MissionSettings, VesselLevel};

config! {
    /// Parameters of the state machine. Heights are of the drone's centre of mass above the deck's
    /// mean level, clearances of its foot plane above the deck along the deck's normal.
    pub struct MissionConfig {
        /// Approach height h_a, m.
        /// Source: Procházka et al. 2024: h_a, h_t, v_la, v_fa.
        pub approach_height_m: f64 = 15.0, in 2.0..=200.0;
        /// Tracking height h_t, m.
        pub tracking_height_m: f64 = 7.0;
        /// Speed of descent relative to the deck v_la, m/s.
        pub descent_mps: f64 = 1.0, in 0.05..=3.0;
        /// Speed of descent in the flare v_fa, m/s.
        pub flare_mps: f64 = 0.5, in 0.05..=2.0;
        /// Clearance below which the flare begins, m.
        /// Source: Not published; between 0.5 and 1 m makes no difference in the prototype, 2 m is
        /// worse.
        pub flare_clearance_m: f64 = 0.9;
        /// Clearance below which the flare's conditions are watched and an unmet one stops the
        /// descent, m.
        /// Chosen: 0.7 s of descent to decide in, above the committed height.
        pub decision_clearance_m: f64 = 1.6, in 0.2..=10.0;
        /// Clearance below which only hard reasons break a landing off, m.
        /// Source: Prototype: breaking off below 0.8 m lets the deck rise into the drone.
        pub commit_clearance_m: f64 = 0.8;
        /// Lowest height of any trajectory over the water, m.
        /// Chosen: above the highest waves of a sea of 1 m amplitude.
        pub minimum_altitude_m: f64 = 3.0, in 0.0..=50.0;
        /// Lowest height while descending near or over the deck, m.
        /// Chosen: the deck's surface is 1.3 m above the water.
        pub minimum_altitude_landing_m: f64 = 0.5;
        /// Weakest knowledge of a vessel that permits a landing to begin: "computer" (its broadcast is received), "beacon"
        /// (a beacon gives its place, and the drone looks for its tags there) or "tag" (the camera sees its tags from within 10 m of the deck's centre; what stands around the deck is not known then).
        pub least_vessel: VesselLevel = VesselLevel::Computer;
        /// A beacon alone leads the drone no further than this from where it set out, m: it is not authenticated.
        /// Chosen: a boat that its crew can see.
        pub beacon_max_way_m: f64 = 1000.0, in 50.0..=5000.0;
        /// Height over the deck from which a search sees its tags, and how far around the point below it sees them, m: of the
        /// camera and the tags, from the drone's common settings.
        #[serde(skip)]
        pub search_view_m: [f64; 2] = [12.0, 6.0];
        /// A landing needs vision of the deck; else a radio estimate counts as a detection.
        pub vision_required: bool = true;
        /// The deck counts as detected while its newest vision measurement is no older than this, s.
        pub vision_fresh_s: f64 = 0.5, in 0.0..=120.0;
        /// Tracking ends after this long without a detection, s.
        pub vision_lost_s: f64 = 5.0, in 0.0..=120.0;
        /// Without vision, a radio silence of this length leads to Hold, or to a search where the vessel went (`least_vessel`), and
        /// stops a station over ground until the vessel is back, s.
        pub radio_lost_s: f64 = 5.0, in 0.0..=120.0;
        /// Stably above the deck: relative horizontal speed, m/s.
        pub steady_speed_mps: f64 = 1.2, in 0.01..=10.0;
        /// Stably above the deck for this long, s.
        pub steady_s: f64 = 0.5, in 0.0..=120.0;
        /// No descent begins that succeeds with less than this probability: speed and angle of the contact,
        /// four feet on the deck, and staying there.
        pub min_probability: f64 = 0.95, in 0.0..=1.0;
        /// No descent begins whose contact is unsafe with more than this probability: too hard, too fast along the deck, too
        /// tilted, or with a foot over an edge. A refused landing costs a minute, an unsafe one the drone.
        pub max_harm: f64 = 0.01, in 0.0..=1.0;
        /// Cost of a minute of waiting above the deck, as a probability: the more, the sooner a descent begins that is
        /// likely enough, and the less it waits for the calm between two groups of waves.
        /// Chosen: a battery that lasts ten minutes above the deck.
        pub waiting_cost_per_min: f64 = alight_shared::landing::WAITING_COST_PER_MIN, in 0.0..=10.0;
        /// The predicted deck is feasible up to this horizontal speed, m/s.
        /// Source: The fastest vessel the paper landed on moved at 7 m/s; the drone flies 8.
        pub deck_speed_mps: f64 = 7.5, in 0.01..=50.0;
        /// The predicted deck is feasible up to this vertical speed, m/s.
        /// Source: The planner's limit of 4 m/s less the speed of descent.
        pub deck_heave_mps: f64 = 3.5, in 0.01..=20.0;
        /// The predicted deck is feasible up to this tilt, rad.
        pub deck_tilt_rad: f64 = 0.45, in 0.01..=1.5;
        /// Coefficient of friction between feet and deck, wet: with it slope and wind are judged in which a landed drone
        /// stays.
        pub friction: f64 = alight_shared::landing::FRICTION, in 0.01..=2.0;
        /// Descent needs a detection no older than this, s.
        pub descent_vision_s: f64 = 1.0, in 0.0..=120.0;
        /// Radio no older than this counts as fresh, s.
        /// Source: A radio that is a second late lands as well as one in time (10 of 10, 0.06 m),
        /// and one by retransmission is often that late.
        pub radio_fresh_s: f64 = 1.5, in 0.0..=120.0;
        /// Maximum duration of the descent, s.
        pub descent_timeout_s: f64 = 30.0, in 0.0..=120.0;
        /// Maximum duration of the flare, s.
        pub flare_timeout_s: f64 = 8.0, in 0.0..=120.0;
        /// Feet this far below the deck without touchdown: missed, m.
        pub missed_m: f64 = 0.4, in 0.01..=5.0;
        /// No descent without the vessel's grant of the deck: for vessels with several drones.
        /// Source: One drone needs no grant; the file of the drone's package sets true.
        pub reservation_required: bool = false;
        /// `alight command takeoff` takes off from the deck: Alight chooses the autopilot's mode and arms, after somebody
        /// aboard has cleared the deck (`alight command deck takeoff`) and a countdown.
        pub takeoff: bool = false;
        /// Sorties of unattended cycles since the drone's service started: after `alight command takeoff` the drone goes on with
        /// the autopilot's own mission, comes back and lands, and takes off again once it is ready, while the crew has
        /// cleared the deck for that. 0: each take-off is ordered, and ends in a hold.
        pub sorties_max: u32 = 0;
        /// Charge from which on a drone of unattended cycles is ready by itself, 0 to 1; above 1: by `alight command ready` alone.
        /// Chosen: what a charger reaches before it slows down.
        pub battery_ready: f64 = 0.9, in 0.0..=1.01;
        /// Descents that may be begun.
        pub max_attempts: u32 = 10;
        /// Remaining battery below which the drone lands at the first place of `battery_order` that can be had, 0 to 1.
        pub battery_reserve: f64 = 0.2, in 0.0..=0.9;
        /// Places to land at then, in this order: "deck", "home" (the autopilot's return mode), "here" (its land mode). A deck
        /// that is closed, another drone's or unknown is awaited until the last charge with which the next place can be
        /// reached. The limits of a landing give way in the second half of the reserve. Without a place it climbs and holds.
        /// A descent that has begun is ended on the deck. After an abort or a hold it announces that first, and acts when a
        /// quarter of the reserve is gone; a second one declines the deck. An order that comes below the reserve makes the
        /// deck the first place.
        /// Chosen: from above the deck no way home over open water.
        pub battery_order: Vec<BatteryPlace> = vec![BatteryPlace::Deck, BatteryPlace::Home, BatteryPlace::Here];
        /// A charge below the reserve counts once no reading of this long was above, s.
        /// Chosen: full thrust, under which a voltage sags, lasts 2 s at most.
        pub battery_lasts_s: f64 = 5.0, in 0.0..=60.0;
        /// Voltage below which for that long the battery is empty whatever its gauge reads, V; 0: the gauge alone counts.
        pub battery_minimum_v: f64 = 0.0, in 0.0..=500.0;
        /// Hover time from full until the gauge reads 0, loaded, s: after it a drone in the air has no charge left whatever its gauge
        /// reads, and one whose gauge is silent or stuck empties so fast or faster. 0: not measured; a gauge that falls too slowly is
        /// believed, and a silent or stuck one empties by current or its own fall before, else in 300 s. On a tether: 1e6.
        pub battery_endurance_s: f64 = 0.0, in 0.0..=1e6;
        /// Capacity, by which the current gives the power, Ah; 0: the power is the rate at which the gauge falls.
        pub battery_capacity_ah: f64 = 0.0, in 0.0..=1e3;
        /// Time of one attempt above the deck, from the arrival to the ground or back up, s.
        /// Source: tracking, descent and flare last 20 to 40 s in moderate seas.
        pub battery_attempt_s: f64 = 60.0, in 0.0..=600.0;
        /// Air speed on the way to the vessel, for what the way costs before its speed is measured, m/s.
        /// Source: The planner's horizontal speed.
        pub battery_air_speed_mps: f64 = 8.0, in 1.0..=30.0;
        /// Extent of a landing: "shadow" (a pilot flies and lands; everything is computed and shown, nothing is
        /// commanded), "match" (follows the deck down to `lowest_clearance_m`, holds `match_s` and climbs) or "land".
        pub mode: LandingMode = LandingMode::Land;
        /// With `mode = "match"` the feet come no nearer to the deck, m.
        /// Chosen: the deck of a sea of 1 m does not rise so far while a pilot who is late by a second climbs.
        pub lowest_clearance_m: f64 = 2.0, in 1.0..=50.0;
        /// With `mode = "match"` it follows the deck there for so long, s.
        pub match_s: f64 = 10.0, in 1.0..=60.0;
        /// The whole landing, from the command on, may take this long, s.
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
            "each of \"deck\", \"home\", \"here\" once at most",
        )?;
        at.require(
            (1..=1000).contains(&this.max_attempts),
            "max_attempts",
            this.max_attempts,
            "1 to 1000",
        )?;
    }
}

/// In `match` the plan stays above the lowest clearance by this, m: what forecast and tracking err by.
const MATCH_MARGIN_M: f64 = 0.5;

impl MissionConfig {
    /// Settings that an operator may change.
    pub fn settings(&self) -> MissionSettings {
        MissionSettings {
            mode: self.mode,
            approach_height_m: self.approach_height_m,
            tracking_height_m: self.tracking_height_m,
            lowest_clearance_m: self.lowest_clearance_m,
        }
    }
    /// This mission with other settings, where they are within the limits of the configuration.
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
    /// Cost of a second of waiting, as a probability.
    pub fn waiting_cost_per_s(&self) -> f64 {
        self.waiting_cost_per_min / 60.0
    }
    /// No plan leads lower over the deck, m; None: onto it.
    pub fn lowest_plan_m(&self) -> Option<f64> {
        match self.mode {
            LandingMode::Match => Some(self.lowest_clearance_m + MATCH_MARGIN_M),
            LandingMode::Shadow | LandingMode::Land => None,
        }
    }
}
