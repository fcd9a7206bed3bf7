//! Heights above the ellipsoid from heights above the sea, by the receiver's own separation or by a geoid model.

use alight_shared::geodesy::Datum;
use alight_shared::geoid::{LocalGeoid, Undulation};

use super::Remark;

/// Minimum difference between a stated separation and the geoid model at which the stated separation is invalid, m. The
/// coarsest tables are wrong by 22.5 m.
pub(super) const DOUBTFUL_M: f64 = 25.0;

/// Range of an antenna's height above mean sea level, m: from low water (and a geoid error of some metres) to a mast at
/// high water.
pub(super) const ANTENNA_M: core::ops::Range<f64> = -10.0..45.0;
/// Distance of the sea from the ellipsoid above which a stated separation of exactly zero is taken as a default value,
/// m.
const ZERO_M: f64 = 2.0;
/// Difference between two separations, m, and number of changes between them, from which two receivers are inferred.
const APART_M: f64 = 2.0;
const CHANGES: u32 = 5;

/// Separation of sea and ellipsoid for a source's heights, with counts of its origin.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct EllipsoidHeights {
    geoid: LocalGeoid,
    /// Number of fixes whose receiver stated its separation, and number of fixes that used the model.
    stated: u64,
    modelled: u64,
    /// Number of fixes without a height.
    flat: u64,
    /// Newest model value used.
    model: Undulation,
    /// Newest invalid stated separation, and the model's value at that place, m.
    doubtful: Option<(f64, f64)>,
    /// Number of separations of exactly zero that were ignored.
    zeros: u64,
    /// Newest stated separation (m), number of changes to a clearly different value, and that value, m.
    newest_m: Option<f64>,
    changes: u32,
    apart: Option<(f64, f64)>,
}

impl EllipsoidHeights {
    /// Height of the sea at `place` above the ellipsoid, and its spread, m. The receiver's own separation is used,
    /// since its height above the sea is based on it. If it cannot be a geoid, the difference from the model is the
    /// spread. A separation of exactly zero is ignored if `above_m`, the height sent with it, is plausible for a boat's
    /// antenna above the sea; otherwise the case is undecided.
    pub(super) fn separation(&mut self, place: &Datum, above_m: f64, stated: Option<f64>) -> (f64, f64) {
        let model = self.geoid.at(place);
        let is_zero = stated == Some(0.0) && model.height_m.abs() > ZERO_M;
        let is_default = is_zero && ANTENNA_M.contains(&above_m);
        self.zeros += u64::from(is_default);
        if let (Some(now), Some(before)) = (stated, self.newest_m)
            && (now - before).abs() > APART_M
        {
            (self.apart, self.changes) = (Some((before, now)), self.changes.saturating_add(1));
        }
        self.newest_m = stated.or(self.newest_m);
        let Some(stated) = stated.filter(|_| !is_default) else {
            self.modelled += 1;
            self.model = model;
            return (model.height_m, model.sigma_m);
        };
        self.stated += 1;
        let apart = (stated - model.height_m).abs();
        self.doubtful = (apart > DOUBTFUL_M || is_zero).then_some((stated, model.height_m));
        (stated, if self.doubtful.is_some() { apart } else { 0.0 })
    }

    /// Counts a fix without a height.
    pub(super) fn none(&mut self) {
        self.flat += 1;
    }

    /// Remark on the origin of the separation; None without a fix.
    pub(super) fn remark(&self) -> Option<Remark> {
        if let Some((a, b)) = self.apart.filter(|_| self.changes >= CHANGES) {
            return Some(Remark::fault(
                format!(
                    "height: the sea's height above the ellipsoid is stated as {a:.1} m and as {b:.1} m in turn: two receivers"
                ),
                "let one of them send heights alone",
            ));
        }
        if let Some((stated, model)) = self.doubtful {
            return Some(Remark::fault(
                format!(
                    "height: the receiver states that the sea lies {stated:.1} m above the ellipsoid, by EGM96 it is \
                     {model:.1} m: taken as stated, +- {:.0} m",
                    (stated - model).abs()
                ),
                "set the receiver to heights above the sea, together with its geoid separation",
            ));
        }
        if self.modelled > 0 {
            let Undulation { height_m, sigma_m } = self.model;
            let zeros = match self.zeros {
                0 => "do not give the sea's height above the ellipsoid".to_owned(),
                n => format!(
                    "give no height of the sea above the ellipsoid, or ({n}) exactly 0, which is none"
                ),
            };
            return Some(Remark::fault(
                format!(
                    "height: {} of {} fixes {zeros}; by EGM96 {height_m:.1} m +- {sigma_m:.1} m",
                    self.modelled,
                    self.modelled + self.stated
                ),
                "let the receiver state its geoid separation (GGA, field 11): the height is uncertain by so much",
            ));
        }
        if self.stated == 0 && self.flat > 0 {
            return Some(Remark::fault(
                format!(
                    "height: none of {} fixes has one, and it stays unknown",
                    self.flat
                ),
                "let the receiver send GGA or GNS",
            ));
        }
        (self.stated > 0).then(|| Remark::fine("height above the ellipsoid by the receiver".into()))
    }
}
