use alight_shared::config;

const GB: f64 = 1e9;

config! {
    /// The flight recorder.
    pub struct RecorderConfig {
        /// Directory of the flights: each start of the computer's processes records into a new subdirectory. Empty:
        /// nothing is recorded.
        pub directory: String = String::new();
        /// Maximum size of all flights, GB: the oldest flights are removed first, then the oldest parts of the
        /// current flight. 256 MB of the disk always remain free for other programs. Source: Measured: a drone's
        /// computer writes 8 GB an hour while it receives a vessel, a vessel's computer 0.05.
        pub max_gb: f64 = 32.0, in 1.0..=100000.0;
        /// Records camera images in full, so that detections can be replayed; otherwise only their hashes. A camera
        /// with 640 x 480 px at 30 Hz writes 9 MB/s, one with 1280 x 800 px 31 MB/s.
        pub images: bool = false;
    }
}

impl RecorderConfig {
    pub fn max_bytes(&self) -> u64 {
        // The key's range excludes negative values.
        (self.max_gb * GB) as u64
    }
}
