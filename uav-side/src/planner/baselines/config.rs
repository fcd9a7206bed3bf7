//! The baselines' figures.

use alight_shared::config::{Check, ConfigError, Keys};
use serde::{Deserialize, Serialize};

use super::gnss_radio::GnssRadioConfig;
use super::mpc_ne::MpcNeConfig;
use super::precision_land::PrecisionLandConfig;
use super::wait_calm::WaitCalmConfig;

/// One table per baseline.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct BaselineConfig {
    /// `mpc-ne`.
    pub mpc_ne: MpcNeConfig,
    /// `wait-calm`.
    pub wait_calm: WaitCalmConfig,
    /// `precision-land`.
    pub precision_land: PrecisionLandConfig,
    /// `gnss-radio`.
    pub gnss_radio: GnssRadioConfig,
}
impl Check for BaselineConfig {
    fn check(&self, at: &Keys<'_>) -> Result<(), ConfigError> {
        self.mpc_ne.check(&at.table("mpc_ne"))?;
        self.wait_calm.check(&at.table("wait_calm"))?;
        self.precision_land.check(&at.table("precision_land"))?;
        self.gnss_radio.check(&at.table("gnss_radio"))
    }
}
