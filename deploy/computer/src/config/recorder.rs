//! Directory and size of the flight recorder.

use alight_shared::config;

const GB: f64 = 1e9;

config! {
    /// The flight recorder.
    pub struct RecorderConfig {
        /// Directory of the flights: each start of the computer's processes records into a subdirectory. Empty: nothing
        /// is recorded.
        pub directory: String = String::new();
        /// Maximum size of all flights together, GB: the oldest are removed whole; if one flight alone exceeds it, its
        /// oldest parts are. 256 MB of the disk are always left to the rest of the computer.
        /// Source: Measured: a drone's computer writes 8 GB an hour while it receives a vessel, a vessel's 0.05.
        pub max_gb: f64 = 32.0, in 1.0..=100000.0;
        /// Images of the cameras are recorded whole, and their detections can be replayed; otherwise by their hashes. A
        /// camera of 640 x 480 px and 30 Hz writes 9 MB/s, one of 1280 x 800 px 31 MB/s.
        pub images: bool = false;
    }
}

impl RecorderConfig {
    pub fn max_bytes(&self) -> u64 {
        // The key's range excludes negative values.
        (self.max_gb * GB) as u64
    }
}
