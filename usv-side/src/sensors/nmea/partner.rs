//! Tracks whether a part of an epoch is still to come: velocity, rate of a heading, sentence with the height.
//! A part has a period; epochs in between are complete without it.

/// Consecutive epochs without a due part after which it is no longer awaited.
const MAX_EPOCHS_WITHOUT: u8 = 3;
/// Resolution of times, ns: a hundredth of a second.
const STAMP_NS: i64 = 10_000_000;

#[derive(Clone, Copy, Debug)]
pub(in crate::sensors) struct Partner {
    newest_ns: Option<i64>,
    /// Intervals between the three newest epochs with the part, ns. The smaller is used, because a part may have been lost.
    apart_ns: [Option<i64>; 2],
    /// Consecutive epochs without the due part.
    without: u8,
}

impl Default for Partner {
    /// State of a part that has not arrived yet, and is not awaited.
    fn default() -> Self {
        Partner {
            newest_ns: None,
            apart_ns: [None; 2],
            without: MAX_EPOCHS_WITHOUT,
        }
    }
}

impl Partner {
    /// Whether to wait for the part in the epoch at `at_ns`.
    pub(in crate::sensors) fn is_due(&self, at_ns: i64) -> bool {
        if self.without >= MAX_EPOCHS_WITHOUT {
            return false;
        }
        let period = self.apart_ns.into_iter().flatten().min();
        let Some((newest, period)) = self.newest_ns.zip(period) else {
            return true;
        };
        let since = at_ns.saturating_sub(newest);
        // A time before the previous one means that the clock was set back.
        since <= 0 || since.saturating_add(STAMP_NS) >= period
    }
    pub(in crate::sensors) fn end_epoch(&mut self, at_ns: i64, has_it: bool) {
        if !has_it {
            self.without += u8::from(self.is_due(at_ns));
            return;
        }
        let apart = self.newest_ns.map(|newest| at_ns.saturating_sub(newest));
        if let Some(apart) = apart.filter(|apart| *apart > 0) {
            let [newer, _] = self.apart_ns;
            self.apart_ns = [Some(apart), newer];
        }
        (self.newest_ns, self.without) = (Some(at_ns), 0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        fixtures::sentence,
        sensors::{Mount, Mounting, SensorDecoder, SourceMeasurement, nmea::NmeaDecoder},
    };
    use alight_shared::msg::{GnssFix, NOT_MEASURED_SD};

    const S: i64 = 1_000_000_000;
    const PLACE: &str = "5000.00000,N,01430.00000,E";

    #[test]
    fn partner_of_every_second_epoch_that_is_lost_once() {
        let mut p = Partner::default();
        assert!(!p.is_due(0), "never received");
        let mut due = Vec::new();
        for k in 0..20 {
            due.push(p.is_due(k * S));
            p.end_epoch(k * S, k % 2 == 0 && k != 10);
        }
        // The part is awaited until its period is known, then when it is due, and again after its return.
        let expected = |k: usize| k > 0 && (k <= 2 || k.is_multiple_of(2) || k == 11);
        assert_eq!(due, (0..20).map(expected).collect::<Vec<_>>());
    }

    #[test]
    fn partner_that_ends_or_whose_clock_is_set_back() {
        let mut p = Partner::default();
        (0..5).for_each(|k| p.end_epoch(k * S, true));
        assert!(p.is_due(5 * S) && p.is_due(-3600 * S));
        (5..8).for_each(|k| p.end_epoch(k * S, false));
        assert!(!p.is_due(8 * S));
    }

    /// Fixes from sentences with times (hundredths of a second), each with the sentence that completed it.
    fn fixes_by_sentence(sentences: &[(i64, String)]) -> Vec<(usize, i64, GnssFix)> {
        let mut d = NmeaDecoder::new(&Mounting::new(&Mount::default()));
        let mut all = Vec::new();
        for (k, (_, body)) in sentences.iter().enumerate() {
            let mut out: Vec<SourceMeasurement> = Vec::new();
            d.push(sentence(body).as_bytes(), &mut out);
            all.extend(out.iter().filter_map(|m| {
                let fix = *m.measurement.gnss()?;
                Some((k, m.at_ns / 10_000_000 - 12 * 360_000, fix))
            }));
        }
        all
    }
    fn time(hundredths: i64) -> String {
        format!("1200{:02}.{:02}", hundredths / 100, hundredths % 100)
    }
    fn gga(at: i64) -> (i64, String) {
        (at, format!("GPGGA,{},{PLACE},1,12,0.8,3.0,M,45.0,M,,", time(at)))
    }
    fn rmc(at: i64) -> (i64, String) {
        (at, format!("GPRMC,{},A,{PLACE},5.0,0.0,010126,,,A", time(at)))
    }

    #[test]
    fn nmea_positions_that_come_more_often_than_heights() {
        // RMC at 1 or 5 Hz, and GGA at 0.5 or 1 Hz, before or after RMC.
        for (step, ratio, leads) in [
            (100, 2, true),
            (100, 2, false),
            (20, 5, true),
            (20, 5, false),
            (10, 10, false),
        ] {
            let mut sentences = Vec::new();
            for k in 0..40 {
                let (at, whole) = (k * step, k % ratio == 0);
                sentences.extend((leads && whole).then(|| gga(at)));
                sentences.push(rmc(at));
                sentences.extend((!leads && whole).then(|| gga(at)));
            }
            let all = fixes_by_sentence(&sentences);
            let case = format!("{step} {ratio} {leads}");
            let learnt = 2 * ratio * step;
            let (mut count, mut high) = (0, 0);
            for (k, at, fix) in all.iter().filter(|(_, at, _)| *at > learnt) {
                // No fix waits for a sentence of a later epoch.
                assert_eq!(sentences[*k].0, *at, "{case}");
                count += 1;
                let has_height = fix.position_sd[2] < NOT_MEASURED_SD;
                assert_eq!(has_height, at % (ratio * step) == 0, "{case} {at}: {fix:?}");
                high += u32::from(has_height);
                assert!(fix.velocity_sd[0] < 1.0, "{case} {at}");
            }
            let epochs = 40 - 2 * ratio - 1;
            assert!(
                count == epochs && i64::from(high) >= epochs / ratio,
                "{case}: {count}"
            );
        }
    }

    #[test]
    fn nmea_heights_that_come_more_often_than_velocities() {
        let mut sentences = Vec::new();
        for k in 0..40 {
            sentences.push(gga(100 * k));
            sentences.extend((k % 2 == 0).then(|| rmc(100 * k)));
        }
        let all = fixes_by_sentence(&sentences);
        let late = all
            .iter()
            .filter(|(k, at, _)| *at > 400 && sentences[*k].0 != *at);
        assert_eq!((late.count(), all.len()), (0, 40));
    }

    #[test]
    fn nmea_position_with_an_empty_gga() {
        let mut sentences = Vec::new();
        for k in 0..40 {
            sentences.push(rmc(100 * k));
            sentences.push((100 * k, format!("GPGGA,{},,,,,1,,,,M,,M,,", time(100 * k))));
        }
        let all = fixes_by_sentence(&sentences);
        assert!(all.len() >= 38, "{}", all.len());
        assert!(all.iter().all(|(k, at, _)| sentences[*k].0 == *at));
    }
}
