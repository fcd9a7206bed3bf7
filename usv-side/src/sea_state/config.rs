//! Settings of the identification.

use alight_shared::config;

config! {
    /// Settings of the identification of the sea.
    pub struct SeaStateConfig {
        /// Length of the record, s.
        /// Source: "spectrum of the last minute".
        pub window_s: f64 = 60.0, in 20.0..=120.0;
        /// Length that the record is cut to while predictions fail, s.
        /// Chosen: five periods of a 5 s sea.
        pub short_window_s: f64 = 25.0;
        /// Shortest record that is tried, s.
        /// Chosen: four periods of a 5 s sea.
        pub min_window_s: f64 = 20.0;
        /// Time between two refinements, s.
        /// Chosen: a third of a wave period, within the CPU share.
        pub update_period_s: f64 = 1.5, in 0.2..=10.0;
        /// Width of the bins that samples are averaged into, s.
        /// Chosen: 5 Hz, five times the fastest deck (0.95 Hz).
        pub bin_s: f64 = 0.2, in 0.1..=0.5;
        /// Lowest angular frequency of a component, rad/s.
        /// Chosen: waves of 20 s, longer than any sea that rocks a small boat.
        pub omega_min_radps: f64 = 0.3, in 0.1..=2.0;
        /// Highest angular frequency of a component, rad/s.
        /// Chosen: small decks in a harbour rock at up to 0.95 Hz (6 rad/s).
        pub omega_max_radps: f64 = 7.0;
        /// Noise of the vertical acceleration in a bin, m/s².
        /// Source: VRX sensor noise 0.021 m/s² a sample, and lever arms.
        pub acceleration_noise_mps2: f64 = 0.02;
        /// Noise of the tilt in a bin, rad.
        /// Source: 0.1 deg: gyro-carried attitude within a wave period.
        pub tilt_noise_rad: f64 = 0.0018;
        /// Standard deviation of the vertical acceleration below which the sea is calm, m/s².
        /// Chosen: half of what the smallest named sea (0.3 m, 5 s) makes, four times over.
        pub calm_acceleration_mps2: f64 = 0.06;
        /// Standard deviation of each component of the tilt below which the sea is calm, rad.
        pub calm_tilt_rad: f64 = 0.006;
        /// Bandwidth of what the components leave unexplained, Hz: sets how many independent samples
        /// the information criterion counts.
        /// Chosen: the waves' own band, in which residuals are left.
        pub residual_band_hz: f64 = 0.5;
        /// Share of a channel's variance that is not worth a component, 0 to 1.
        /// Chosen: half of what second-order waves leave in a 14 deg sea; four times as much and
        /// two waves 5 % apart are taken for one.
        pub negligible: f64 = 0.0015;
        /// Two components closer than this many cycles over the record are taken for one.
        /// Chosen: closer, and their amplitudes grow without bound.
        pub min_separation: f64 = 0.2;
        /// The same on a vessel that covers more than 30 m in the record: there a pair can trade
        /// frequency against direction.
        /// Chosen: on a square at 2 m/s closer pairs made the estimator's surge diverge in rough
        /// seas.
        pub min_separation_under_way: f64 = 0.4;
    }
    check |this, at| {
        at.range("min_window_s", this.min_window_s, 10.0, this.window_s)?;
        at.range(
            "short_window_s",
            this.short_window_s,
            this.min_window_s,
            this.window_s,
        )?;
        // The bins sample each period at least four times.
        let fastest = core::f64::consts::FRAC_PI_2 / this.bin_s;
        at.range(
            "omega_max_radps",
            this.omega_max_radps,
            this.omega_min_radps,
            fastest,
        )?;
    }
}
