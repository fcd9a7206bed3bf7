//! The skipper's switch: what a level that is read, or is not, answers.

use alight_shared::time::{Span, Time, VesselClock};

/// The switch counts as open when it was not read for so long: four periods.
const UNREAD: Span = Span::from_millis(2000);

/// Newest level of the switch that counts, and when it was read.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct ConsentSwitch(Option<(Time<VesselClock>, bool)>);

impl ConsentSwitch {
    /// The answer by the level at `now`, if it was read. Yes is a 0 that was read and then a 1, with no gap between; a 1
    /// behind a gap is a level whose change was not observed. No is a 1 that goes to 0 or is not read any more.
    pub(super) fn answer(&mut self, now: Time<VesselClock>, level: Option<bool>) -> Option<bool> {
        let before = self.0;
        let known = before.filter(|(at, _)| now - *at <= UNREAD);
        self.0 = level.map(|level| (now, level)).or(known);
        match (before, known, level) {
            (_, Some((_, false)), Some(true)) => Some(true),
            (_, Some((_, true)), Some(false)) | (Some((_, true)), None, _) => Some(false),
            (_, Some((_, true)), Some(true) | None)
            | (_, Some((_, false)), Some(false) | None)
            | (Some((_, false)) | None, None, _) => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The answers to these levels, at 2 Hz.
    fn answers(levels: &[Option<bool>]) -> Vec<Option<bool>> {
        let mut switch = ConsentSwitch::default();
        let step =
            |(k, level): (usize, &Option<bool>)| switch.answer(Time::from_secs(0.5 * k as f64), *level);
        levels.iter().enumerate().map(step).collect()
    }

    #[test]
    fn answers_of_a_switch_that_is_not_always_read() {
        let (open, closed, unread) = (Some(false), Some(true), None);
        let (yes, no) = (Some(true), Some(false));
        assert_eq!(answers(&[open, closed, closed, open]), [None, yes, None, no]);
        assert_eq!(
            answers(&[closed, closed, open, closed]),
            [None, None, no, yes],
            "at the start"
        );
        // A reading or two that fail are no gap.
        assert_eq!(answers(&[open, unread, closed]), [None, None, yes]);
        // A gap is a no, and what is read behind it no yes before a 0.
        let gap = [unread; 5];
        let with_gap = |before, after: &[Option<bool>]| {
            let levels = [&[before][..], &gap, after].concat();
            answers(&levels).split_off(1)
        };
        let held = with_gap(closed, &[closed, open, closed]);
        assert_eq!(held, [None, None, None, None, no, None, no, yes]);
        let closed_meanwhile = with_gap(open, &[closed, closed, open, closed]);
        assert_eq!(closed_meanwhile[5..], [None, None, no, yes]);
    }
}
