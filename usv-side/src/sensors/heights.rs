//! Heights above the ellipsoid from heights above the sea: by the receiver's own separation, or by the geoid's model.

use alight_shared::geodesy::Datum;
use alight_shared::geoid::{LocalGeoid, Undulation};

use super::Remark;

/// A stated separation this far from the geoid is no receiver's: the coarsest tables are off by 22.5 m, m.
pub(super) const DOUBTFUL_M: f64 = 25.0;

/// Heights of an antenna above the mean sea, m: between a low water (and a geoid that is off by some metres) and a mast at
/// high water.
pub(super) const ANTENNA_M: core::ops::Range<f64> = -10.0..45.0;
/// A separation of exactly zero is stated by no receiver with a table where the sea lies further than this from the ellipsoid, m.
const ZERO_M: f64 = 2.0;
/// Two separations of one source further apart are of two receivers, m, and so many changes from the one to the other show it.
const APART_M: f64 = 2.0;
const CHANGES: u32 = 5;

/// The separation of sea and ellipsoid for a source's heights, and an account of whose it was.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct EllipsoidHeights {
    geoid: LocalGeoid,
    /// Fixes whose receiver stated its separation, and fixes for which the model stood in.
    stated: u64,
    modelled: u64,
    /// Fixes without any height.
    flat: u64,
    /// Newest model, where it stood in.
    model: Undulation,
    /// Newest stated separation that cannot be a receiver's geoid, and the model there, m.
    doubtful: Option<(f64, f64)>,
    /// Separations of exactly zero that count for none.
    zeros: u64,
    /// Newest stated separation, and how often it changed from one to another that is not near, and to which, m.
    newest_m: Option<f64>,
    changes: u32,
    apart: Option<(f64, f64)>,
}

impl EllipsoidHeights {
    /// Height of the sea at `place` above the ellipsoid, and its spread, m. The receiver's own separation is taken:
    /// the height above the sea is its own. Where it cannot be a geoid, the two witnesses' difference is the spread.
    /// A separation of exactly zero counts for none where `above_m`, the height that comes with it, is one of a boat's antenna
    /// above the sea; else nothing decides it.
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

    /// A fix has no height.
    pub(super) fn none(&mut self) {
        self.flat += 1;
    }

    /// Whose separation the heights have; None without a fix.
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
