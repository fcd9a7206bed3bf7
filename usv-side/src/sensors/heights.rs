//! Heights above the ellipsoid from heights above the sea, by a receiver's separation or a geoid model.

use alight_shared::{
    geodesy::Datum,
    geoid::{LocalGeoid, Undulation},
};

use super::Remark;

/// Difference from the geoid model that makes a separation invalid, m; the coarsest tables err by 22.5 m.
pub(super) const DOUBTFUL_M: f64 = 25.0;

/// Range of an antenna's height above mean sea level, m: from low water (with geoid error) to a masthead at high water.
pub(super) const ANTENNA_M: core::ops::Range<f64> = -10.0..45.0;
/// Sea minus ellipsoid above which a stated separation of exactly zero is a default value, m.
const ZERO_M: f64 = 2.0;
/// Maximum difference between a separation and the negated model value, m, and minimum size of the separation, m, at which
/// its sign is wrong.
const MIRRORED_M: f64 = 2.0;
/// Usual height of an antenna above the water, m.
const USUAL_M: core::ops::Range<f64> = -5.0..15.0;
/// Difference between separations, m, and number of changes, that show two receivers.
const APART_M: f64 = 2.0;
const CHANGES: u32 = 5;

/// Separation of sea and ellipsoid for a source's heights, with counts of its origin.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct EllipsoidHeights {
    geoid: LocalGeoid,
    /// Number of fixes whose receiver stated its separation, and number of fixes that used the model.
    stated: u64,
    modelled: u64,
    flat: u64,
    /// Newest model value used.
    model: Undulation,
    /// Newest invalid stated separation, and the model's value at that place, m.
    doubtful: Option<(f64, f64)>,
    /// Newest stated height above the sea that would be usual only as a height above the ellipsoid, and its separation, m.
    twice: Option<(f64, f64)>,
    /// Number of separations of exactly zero that were ignored.
    zeros: u64,
    /// Newest stated separation (m), number of changes to a clearly different value, and that value, m.
    newest_m: Option<f64>,
    changes: u32,
    apart: Option<(f64, f64)>,
}

impl EllipsoidHeights {
    /// Height of the sea at `place` above the ellipsoid, and its spread, m. The receiver's separation is used, because its height
    /// is based on it; if it cannot be a geoid height, the spread is the difference from the model; if `above_m`, sent with it, may
    /// already include it, at least its size. A separation of exactly zero is ignored if `above_m` is plausible above the sea;
    /// otherwise it is used, and its spread is the difference from the model.
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
        let mirrored = (stated + model.height_m).abs() <= MIRRORED_M && stated.abs() > MIRRORED_M;
        self.doubtful = (apart > DOUBTFUL_M || is_zero || mirrored).then_some((stated, model.height_m));
        let is_twice = !USUAL_M.contains(&above_m) && USUAL_M.contains(&(above_m - stated));
        self.twice = is_twice.then_some((above_m, stated));
        let doubt_m = if self.doubtful.is_some() { apart } else { 0.0 };
        (
            stated,
            if is_twice {
                doubt_m.max(stated.abs())
            } else {
                doubt_m
            },
        )
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
                    "height: the sea's height above the ellipsoid alternates between {a:.1} m and {b:.1} m: two receivers"
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
        if let Some((above_m, stated)) = self.twice {
            return Some(Remark::fault(
                format!(
                    "height: the receiver states {above_m:.1} m above the sea, and the sea {stated:.1} m above the \
                     ellipsoid: the altitude may already include that; used as stated, +- {:.0} m",
                    stated.abs()
                ),
                "set the receiver to heights above the sea, together with its geoid separation",
            ));
        }
        if self.modelled > 0 {
            let Undulation { height_m, sigma_m } = self.model;
            let zeros = match self.zeros {
                0 => "do not state the sea's height above the ellipsoid".to_owned(),
                n => format!(
                    "state no height of the sea above the ellipsoid, or ({n}) exactly 0, which is invalid"
                ),
            };
            return Some(Remark::fault(
                format!(
                    "height: {} of {} fixes {zeros}; by EGM96 {height_m:.1} m +- {sigma_m:.1} m",
                    self.modelled,
                    self.modelled + self.stated
                ),
                "let the receiver state its geoid separation (GGA, field 11); until then the height is uncertain by this much",
            ));
        }
        if self.stated == 0 && self.flat > 0 {
            return Some(Remark::fault(
                format!("height: none of {} fixes has one, so it stays unknown", self.flat),
                "let the receiver send GGA or GNS",
            ));
        }
        (self.stated > 0).then(|| Remark::fine("height above the ellipsoid by the receiver".into()))
    }
}
