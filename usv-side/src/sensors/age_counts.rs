//! Ages of measurements at arrival, for reports: the estimator rejects old ones without stating a reason.

use super::Remark;

/// Number of late measurements among the newest 32 above which the cause is not a single delay.
const OFTEN: u32 = 8;

/// Ages of one kind of measurement of a source.
#[derive(Clone, Copy, Debug)]
pub(super) struct AgeCounts {
    kind: &'static str,
    /// Maximum age that an estimator with default settings accepts, s.
    max_s: f64,
    count: u64,
    late: u64,
    /// Age of the newest late measurement, s.
    age_s: f64,
    /// Bit mask of the newest measurements; set if late.
    lately: u32,
}

impl AgeCounts {
    pub(super) fn new(kind: &'static str, max_s: f64) -> Self {
        AgeCounts {
            kind,
            max_s,
            count: 0,
            late: 0,
            age_s: 0.0,
            lately: 0,
        }
    }
    pub(super) fn take(&mut self, age_s: f64) {
        let is_late = age_s > self.max_s;
        self.count += 1;
        self.late += u64::from(is_late);
        self.lately = (self.lately << 1) | u32::from(is_late);
        if is_late {
            self.age_s = age_s;
        }
    }
    /// Remark on late measurements; None if there are none.
    pub(super) fn remark(&self) -> Option<Remark> {
        if self.late == 0 {
            return None;
        }
        let text = format!(
            "{}: {} of {} arrived more than {} s after their time, the newest of them {:.1} s: too old (vessel.{}.max_age_s)",
            self.kind, self.late, self.count, self.max_s, self.age_s, self.kind
        );
        Some(if self.lately.count_ones() >= OFTEN {
            Remark::fault(
                text,
                "let the source send everything of one time at once: fewer sentences, a faster line",
            )
        } else {
            Remark::fine(text)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn age_of_every_second_measurement() {
        let mut d = AgeCounts::new("gnss", 0.6);
        (0..32).for_each(|_| d.take(0.2));
        assert_eq!(d.remark(), None);
        d.take(0.7);
        assert!(d.remark().is_some_and(|r| r.remedy.is_none()), "once");
        (0..32).for_each(|k| d.take(if k % 2 == 0 { 0.1 } else { 1.0 }));
        let remark = d.remark().unwrap();
        assert!(remark.remedy.is_some());
        assert!(
            remark.text.starts_with(
                "gnss: 17 of 65 arrived more than 0.6 s after their time, the newest of them 1.0 s"
            ),
            "{remark:?}"
        );
        (0..32).for_each(|_| d.take(0.2));
        assert!(d.remark().is_some_and(|r| r.remedy.is_none()), "it is over");
    }
}
