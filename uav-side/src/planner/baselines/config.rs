//! The baselines' figures.

use alight_shared::config;

use super::gnss_radio::GnssRadioConfig;
use super::mpc_ne::MpcNeConfig;
use super::precision_land::PrecisionLandConfig;
use super::wait_calm::WaitCalmConfig;

config! {
    /// One table per baseline.
    #[derive(Copy)]
    pub struct BaselineConfig {
        /// `mpc-ne`.
        pub mpc_ne: MpcNeConfig;
        /// `wait-calm`.
        pub wait_calm: WaitCalmConfig;
        /// `precision-land`.
        pub precision_land: PrecisionLandConfig;
        /// `gnss-radio`.
        pub gnss_radio: GnssRadioConfig;
    }
}
