use alight_shared::config;

config! {
    /// Identities of both ends, and limits of the bridge.
    pub struct BridgeConfig {
        /// Number of the vessel; messages of other vessels are rejected.
        pub vessel_id: u32 = 1;
        /// Number of this drone; messages for other drones are rejected.
        pub drone_id: u32 = 1;
        /// Rate of the link's state, Hz.
        /// Source: `topics::LINK`.
        pub link_rate_hz: f64 = 10.0, in 0.1..=100.0;
        /// Window of the loss statistics, s.
        /// Chosen: 150 estimates at 30 Hz.
        pub loss_window_s: f64 = 5.0, in 0.5..=60.0;
        /// Tolerance for a time of validity later than the clock's bounds permit, s.
        /// Chosen: one period of a 100 Hz loop.
        pub future_margin_s: f64 = 0.01, in 0.0..=1.0;
        /// Estimation of the clock offset.
        pub clock: ClockConfig;
    }
}

config! {
    /// Offset between the vessel's and the drone's clocks.
    pub struct ClockConfig {
        /// Rate of time requests, Hz.
        /// Source: `topics::TIME_REQUEST`.
        pub request_rate_hz: f64 = 2.0, in 0.1..=20.0;
        /// Maximum round trip of an exchange, s; slower replies are rejected.
        /// Chosen: forty times the default one-way delay of 50 ms.
        pub max_round_trip_s: f64 = 2.0, in 0.05..=10.0;
        /// Age at which exchanges are forgotten, s.
        /// Chosen: 60 exchanges; at 50 ppm the oldest has lost 1.5 ms of accuracy.
        pub window_s: f64 = 30.0, in 2.0..=600.0;
        /// Maximum drift of one clock against the other, s/s.
        /// Source: Quartz oscillators with temperature: 20 ppm typical, 50 ppm allowed.
        pub max_drift: f64 = 50e-6, in 0.0..=1e-3;
        /// Change of the offset in both directions that counts as a step, s.
        /// Chosen: the best of ten delays of 50 +- 20 ms varies by about 10 ms.
        pub step_s: f64 = 0.04, in 0.005..=1.0;
        /// Minimum of the stated standard deviation, s.
        /// Chosen: a tenth of the simulated world's tick of 10 ms.
        pub min_sd_s: f64 = 0.001, in 1e-6..=0.1;
    }
}
