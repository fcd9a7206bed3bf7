//! Heights above the ellipsoid from heights above the sea: by the receiver's own separation, or by the geoid's model.

use alight_shared::geodesy::Datum;
use alight_shared::geoid::{LocalGeoid, Undulation};

use super::Remark;

/// A stated separation this far from the geoid is no receiver's: the coarsest tables are off by 22.5 m, m.
pub(super) const DOUBTFUL_M: f64 = 25.0;

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
}

impl EllipsoidHeights {
    /// Height of the sea at `place` above the ellipsoid, and its spread, m. The receiver's own separation is taken:
    /// the height above the sea is its own. Where it cannot be a geoid, the two witnesses' difference is the spread.
    pub(super) fn separation(&mut self, place: &Datum, stated: Option<f64>) -> (f64, f64) {
        let model = self.geoid.at(place);
        let Some(stated) = stated else {
            self.modelled += 1;
            self.model = model;
            return (model.height_m, model.sigma_m);
        };
        self.stated += 1;
        let apart = (stated - model.height_m).abs();
        self.doubtful = (apart > DOUBTFUL_M).then_some((stated, model.height_m));
        (stated, if self.doubtful.is_some() { apart } else { 0.0 })
    }

    /// A fix has no height.
    pub(super) fn none(&mut self) {
        self.flat += 1;
    }

    /// Whose separation the heights have; None without a fix.
    pub(super) fn remark(&self) -> Option<Remark> {
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
            return Some(Remark::fault(
                format!(
                    "height: {} of {} fixes do not give the sea's height above the ellipsoid; by EGM96 {height_m:.1} m \
                     +- {sigma_m:.1} m",
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
