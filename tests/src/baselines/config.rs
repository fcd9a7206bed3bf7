//! The baselines' parameters.

use alight_shared::config;

config! {
    /// `mpc-ne`: what is not published, and what is read off a plot.
    ///
    /// Defaults: h_d and vertical S: Gupta 2023, figure 4, read off. The rest is ours, found by hand at Moderate
    /// (0.5 m, 5 s; published 95 %, 0.5 m, 34.5 s, 0.7 m/s) on seeds 100 to 111 and 300 to 311: 14 of 24 landed,
    /// 0.44 m, 29 s, 0.72 m/s; on seeds that had no part in the choice (500 to 511) 2 of 12, 0.56 m, 35 s,
    /// 0.61 m/s. Position, time and speed are as published, success is not: the last 0.7 to 1.5 s are without
    /// vision, and the position continues at the velocity that sway had then, up to 1 m/s from the deck's.
    #[derive(Copy)]
    pub struct MpcNeConfig {
        /// S, horizontal: position (1/m²) and velocity (s²/m²).
        pub horizontal: [f64; 2] = [100.0, 30.0], in 0.0..=1e5;
        /// S, vertical.
        pub vertical: [f64; 2] = [10.0, 6.0], in 0.0..=1e5;
        /// T: increments of jerk.
        pub increment_weight: f64 = 0.02, in 1e-6..=1e3;
        /// alpha_L, 1/rad².
        pub tilt_weight: f64 = 8000.0, in 0.0..=1e7;
        /// h_d: height of the barrier over the deck, m.
        pub barrier_m: f64 = 1.2, in 0.2..=10.0;
        /// Soft limits of horizontal speed (against the deck), acceleration and jerk.
        pub horizontal_limits: [f64; 3] = [3.0, 5.0, 40.0], in 0.1..=1e3;
        /// The same vertically.
        pub vertical_limits: [f64; 3] = [0.6, 4.0, 30.0], in 0.1..=1e3;
        /// The reference below the deck, so that contact is pressed home, m.
        pub press_m: f64 = 0.3, in 0.0..=2.0;
        /// Length of the record that is transformed, s.
        pub window_s: f64 = 20.0, in 2.0..=30.0;
        /// Shortest such record, s.
        pub min_s: f64 = 10.0;
        /// Frequencies are estimated again this often, s.
        pub refresh_s: f64 = 1.0, in 0.1..=60.0;
        /// Modes smaller than this fraction of the largest are dropped.
        pub gate: f64 = 0.15, in 0.0..=1.0;
        /// Kalman filter: standard deviation of a measurement of heave (m) and of tilt (rad).
        pub sd_m_rad: [f64; 2] = [0.03, 0.01], in 1e-4..=10.0;
        /// Kalman filter: random walk of each state of a mode after 1 s, heave and tilt.
        pub walk_m_rad: [f64; 2] = [0.09, 0.03], in 0.0..=10.0;
        /// Kalman filter: random walk of the offset after 1 s, heave and tilt. The authors' offset is
        /// constant; here heave's has to follow the drift of the odometry.
        pub offset_walk_m_rad: [f64; 2] = [0.02, 0.0005], in 0.0..=10.0;
        /// Time constant of the filter of place and drift, s. Surge and sway have no modes: a second
        /// ahead is where this velocity leads.
        pub place_s: f64 = 0.15, in 0.05..=60.0;
        /// A tag older than this is no measurement, s.
        pub fresh_s: f64 = 0.1, in 0.01..=5.0;
    }
    check |this, at| {
        at.range("min_s", this.min_s, 1.0, this.window_s)?;
    }
}

config! {
    /// `wait-calm`: what calm is.
    ///
    /// Defaults: Ours. Tilt and heave rate: the order of published limits for helicopters on small decks
    /// (pitch 2 to 3 deg, roll 5 deg, heave rate 1 to 1.5 m/s). The descent: from 2 m at the mission's 1
    /// m/s, the last 0.9 m at 0.5 m/s.
    #[derive(Copy)]
    pub struct WaitCalmConfig {
        /// Waits with the feet at this height over the deck, m.
        pub wait_m: f64 = 2.0, in 0.2..=20.0;
        /// The descent from there takes this long, s: calm has to last for it.
        pub descent_s: f64 = 2.9, in 0.1..=4.0;
        /// Largest tilt of the deck, deg.
        pub tilt_deg: f64 = 4.0, in 0.1..=45.0;
        /// Largest vertical speed of the deck's centre, m/s.
        pub heave_mps: f64 = 0.6, in 0.01..=10.0;
        /// After this long the limits have doubled, s.
        pub patience_s: f64 = 15.0, in 0.1..=1e4;
        /// Below this clearance it goes on whatever comes, m.
        pub commit_m: f64 = 1.2;
    }
    check |this, at| {
        at.range("commit_m", this.commit_m, 0.0, this.wait_m)?;
    }
}

config! {
    /// `precision-land`: parameters by their names in PX4.
    ///
    /// Defaults: PX4's defaults, except: the camera of a drone on legs sees no tag of 1 m below 0.5 m, so
    /// the final approach begins at 1 m instead of 0.1 m (else it would never touch down); fresh is three
    /// frames at 30 Hz.
    #[derive(Copy)]
    pub struct PrecisionLandConfig {
        /// `MPC_LAND_SPEED`: speed of sinking over the earth, m/s.
        pub sink_mps: f64 = 0.7, in 0.05..=3.0;
        /// `MPC_LAND_CRWL`: the same on a drone with a rangefinder, as this one is, below `crawl_below_m`,
        /// m/s.
        pub crawl_mps: f64 = 0.3;
        /// `MPC_LAND_ALT3`: height of the feet over the target below which it crawls, m.
        pub crawl_below_m: f64 = 1.0, in 0.0..=10.0;
        /// `PLD_HACC_RAD`: sinking begins within this distance in north and in east, m.
        pub begin_within_m: f64 = 0.2, in 0.01..=10.0;
        /// `PLD_FAPPR_ALT`: below this height over the target it sinks on without one, m.
        pub final_approach_m: f64 = 1.0, in 0.0..=10.0;
        /// A detection is a measurement up to this age, s.
        pub fresh_s: f64 = 0.1, in 0.01..=5.0;
        /// `PLD_BTOUT`: without a measurement for this long the target is lost, s.
        pub timeout_s: f64 = 5.0, in 0.1..=60.0;
    }
    check |this, at| {
        at.range("crawl_mps", this.crawl_mps, 0.05, this.sink_mps)?;
    }
}

config! {
    /// `gnss-radio`: how far a velocity is trusted.
    ///
    /// Defaults: Ours: a fifth of a wave's period; two standard deviations of the difference of two
    /// receivers of 1 m each.
    #[derive(Copy)]
    pub struct GnssRadioConfig {
        /// The vertical velocity decays with this time constant, s: heave goes back, constant vertical
        /// velocity over the whole horizon would chase it by metres.
        pub heave_memory_s: f64 = 1.0, in 0.01..=100.0;
        /// In the flare it goes on down to this far below the estimated deck, m: contact ends the descent,
        /// not the receivers' height.
        pub below_m: f64 = 2.8, in 0.0..=10.0;
    }
}
