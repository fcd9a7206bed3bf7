//! Stamps that are coarser than the rows: ten rows with one whole second.
//!
//! A logger that writes rows evenly and stamps them with the step `q` of a coarse clock writes `floor(t / q) q`. A line
//! through stamp over number of the row gives the times back, to a constant of less than `q`.

use alight_shared::estimation::median;

use super::Row;

/// Rows with the stamp of the row before, of all, from which on the stamps are coarse.
const COARSE: f64 = 0.2;
/// Rows of one stamp may be this share, and one, more or fewer than is usual.
const EVEN: f64 = 0.2;
/// Most rows that may be left out because their stamps have another number of rows.
const LEFT_OUT: f64 = 0.2;

/// Rows with one stamp.
#[derive(Clone, Copy, Debug)]
struct Run {
    first: usize,
    count: usize,
    t: f64,
}

/// What was done to rows with coarse stamps, for people; or which line is in the way, and why.
pub(super) fn spread(rows: &mut Vec<Row>) -> Result<Option<String>, (u64, String)> {
    let mut notes = Vec::new();
    let mut left_out = vec![false; rows.len()];
    for part in parts(rows) {
        notes.extend(spread_part(rows, &part, &mut left_out)?);
    }
    if notes.is_empty() {
        return Ok(None);
    }
    let mut keep = left_out.iter();
    rows.retain(|_| keep.next().is_none_or(|out| !out));
    rows.sort_by(|a, b| a.t.total_cmp(&b.t));
    Ok(Some(notes.join("; ")))
}

/// The rows of each set of quantities: those that share a quantity are of one.
fn parts(rows: &[Row]) -> Vec<Vec<usize>> {
    let mut masks: Vec<u32> = Vec::new();
    for row in rows {
        let mut mask = row.mask();
        if masks.iter().any(|m| m & mask == mask) {
            continue;
        }
        masks.retain(|m| {
            let shared = m & mask != 0;
            mask |= if shared { *m } else { 0 };
            !shared
        });
        masks.push(mask);
    }
    let mut parts = vec![Vec::new(); masks.len()];
    for (k, row) in rows.iter().enumerate() {
        let own = masks.iter().position(|m| m & row.mask() != 0);
        if let Some(part) = own.and_then(|p| parts.get_mut(p)) {
            part.push(k);
        }
    }
    parts
}

fn spread_part(
    rows: &mut [Row],
    part: &[usize],
    left_out: &mut [bool],
) -> Result<Option<String>, (u64, String)> {
    let mut runs: Vec<Run> = Vec::new();
    for (k, row) in part.iter().filter_map(|k| rows.get(*k)).enumerate() {
        match runs.last_mut() {
            Some(run) if run.t == row.t => run.count += 1,
            Some(_) | None => runs.push(Run {
                first: k,
                count: 1,
                t: row.t,
            }),
        }
    }
    let repeated = part.len() - runs.len();
    if runs.len() < 3 || (repeated as f64) < COARSE * part.len() as f64 {
        return Ok(None);
    }
    let usual = median(runs.iter().map(|r| r.count as f64)).unwrap_or_default();
    let steps = runs.windows(2).map(|w| w[1].t - w[0].t).filter(|d| *d > 0.0);
    let step = median(steps).unwrap_or_default();
    let even = |r: &Run| (r.count as f64 - usual).abs() <= 1.0 + EVEN * usual;
    let last = runs.len() - 1;
    let mut out = 0;
    let mut stretch: Vec<Run> = Vec::new();
    for (k, run) in runs.iter().enumerate() {
        let edge = (k == 0 || k == last) && (run.count as f64) < usual;
        let follows = stretch
            .last()
            .is_none_or(|s| run.t > s.t && run.t - s.t < 1.5 * step);
        if !follows {
            date(rows, part, &stretch, (step, usual));
            stretch.clear();
        }
        if edge || even(run) {
            stretch.push(*run);
            continue;
        }
        date(rows, part, &stretch, (step, usual));
        stretch.clear();
        out += run.count;
        for k in part.iter().skip(run.first).take(run.count) {
            if let Some(left_out) = left_out.get_mut(*k) {
                *left_out = true;
            }
        }
    }
    date(rows, part, &stretch, (step, usual));
    let line = part.first().and_then(|k| rows.get(*k)).map_or(1, |r| r.line);
    if out as f64 > LEFT_OUT * part.len() as f64 {
        let (least, most) = (
            runs.iter().map(|r| r.count).min(),
            runs.iter().map(|r| r.count).max(),
        );
        return Err((
            line,
            format!(
                "the times go in steps of {step:.3} s with {} to {} rows at one time, so that no row can be dated; \
                 record times with fractions of a second",
                least.unwrap_or_default(),
                most.unwrap_or_default()
            ),
        ));
    }
    let mut note = format!(
        "the times go in steps of {step:.3} s, with {usual:.0} rows at one time: the rows are spread evenly over the \
         step, and may be off by so much"
    );
    if out > 0 {
        note += &format!("; {out} rows at times with fewer or more rows are left out");
    }
    Ok(Some(note))
}

/// Dates the rows of a stretch by a line through stamp over number of the row; where it does not fit within a step, each
/// stamp's rows evenly.
fn date(rows: &mut [Row], part: &[usize], stretch: &[Run], (step, usual): (f64, f64)) {
    let (Some(first), Some(last)) = (stretch.first(), stretch.last()) else {
        return;
    };
    let n = last.first + last.count - first.first;
    let at = |r: &Run, k: usize| (r.first + k - first.first) as f64;
    let samples = || stretch.iter().flat_map(|r| (0..r.count).map(move |k| (r, k)));
    let mean_k = 0.5 * (n as f64 - 1.0);
    let mean_t = samples().map(|(r, _)| r.t - first.t).sum::<f64>() / n as f64;
    let (mut kt, mut kk) = (0.0, 0.0);
    for (r, k) in samples() {
        let x = at(r, k) - mean_k;
        kt += x * (r.t - first.t);
        kk += x * x;
    }
    // A stamp or two show no slope.
    let slope = if stretch.len() > 2 && kk > 0.0 {
        kt / kk
    } else {
        step / usual
    };
    let line = |x: f64| first.t + mean_t + slope * (x - mean_k);
    let fits = slope > 0.0 && samples().all(|(r, k)| (r.t - line(at(r, k))).abs() <= step);
    let rows_of_part = part.iter().skip(first.first);
    for ((r, k), row) in samples().zip(rows_of_part) {
        let t = if fits {
            line(at(r, k)) + 0.5 * (step - slope)
        } else {
            r.t + step * k as f64 / r.count as f64
        };
        if let Some(row) = rows.get_mut(*row) {
            row.t = t;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::log::table::Quantity;

    fn rows(times: impl IntoIterator<Item = f64>, q: Quantity) -> Vec<Row> {
        let row = |(k, t): (usize, f64)| {
            let mut row = Row::new(k as u64, t);
            row.cells[q as usize] = Some(k as f64);
            row
        };
        times.into_iter().enumerate().map(row).collect()
    }

    #[test]
    fn rows_of_whole_seconds() {
        // 10 Hz from the middle of a second on; 15 Hz in tenths; a clock of 9.7 Hz.
        for (hz, step, from) in [(10.0, 1.0, 3.45), (15.0, 0.1, 0.0), (9.7, 1.0, 0.2)] {
            let truth: Vec<f64> = (0..600).map(|k| from + f64::from(k) / hz).collect();
            let coarse = truth.iter().map(|t| ((t + 1e-9) / step).floor() * step);
            let mut spread_rows = rows(coarse, Quantity::Roll);
            let note = spread(&mut spread_rows).unwrap().unwrap();
            assert!(note.contains("spread evenly"), "{note}");
            assert_eq!(spread_rows.len(), truth.len());
            for (row, t) in spread_rows.iter().zip(&truth) {
                assert!((row.t - t).abs() < 0.3 / hz + 0.05 * step, "{hz}: {} {t}", row.t);
            }
            let uneven = spread_rows.windows(2).map(|w| w[1].t - w[0].t - 1.0 / hz);
            assert!(uneven.fold(0.0_f64, |a, d| a.max(d.abs())) < 0.01 / hz);
        }
    }

    #[test]
    fn rows_with_a_stamp_of_few() {
        let coarse = (0..600)
            .filter(|k| !(200..207).contains(k))
            .map(|k| f64::from(k / 10));
        let mut rows_left = rows(coarse, Quantity::Roll);
        let note = spread(&mut rows_left).unwrap().unwrap();
        assert!(note.contains("3 rows") && rows_left.len() == 590, "{note}");
        assert!(
            rows_left
                .iter()
                .all(|r| (r.t - r.cells[0].unwrap_or_default() * 0.1).abs() < 0.8)
        );
        // As many as it likes.
        let irregular =
            (0..60_u32).flat_map(|s| core::iter::repeat_n(f64::from(s), 1 + (s * s % 17) as usize));
        let (_, message) = spread(&mut rows(irregular, Quantity::Roll)).unwrap_err();
        assert!(message.contains("fractions"), "{message}");
    }

    #[test]
    fn distinct_times_and_few_repeated_ones() {
        for repeat in [usize::MAX, 7] {
            let times = (0..300).map(|k| 0.1 * (k - usize::from(k % repeat == 1)) as f64);
            let mut all = rows(times, Quantity::Roll);
            let before = all.clone();
            assert_eq!(spread(&mut all), Ok(None));
            assert!(all.iter().zip(&before).all(|(a, b)| a.t == b.t));
        }
        // A roll and a heave at one time are of two sensors.
        let mut two = rows((0..100).map(|k| 0.1 * f64::from(k)), Quantity::Roll);
        two.extend(rows((0..100).map(|k| 0.1 * f64::from(k)), Quantity::Heave));
        two.sort_by(|a, b| a.t.total_cmp(&b.t));
        assert_eq!(spread(&mut two), Ok(None));
    }
}
