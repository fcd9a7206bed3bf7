//! Recorded motion: parsing, checks, merging of repeated stamps, and interpolation across gaps.

mod quality;

use std::path::{Path, PathBuf};

use alight_shared::estimation::median;
use alight_usv::log::table::{CsvRow, CsvTable, Quantity, TableError};
use thiserror::Error;

use self::quality::Knots;
use crate::physics::spline::{Splines, smooth_step};

/// Indices of the degrees of freedom in a recording.
pub const ROLL: usize = 0;
pub const PITCH: usize = 1;
pub const HEAVE: usize = 2;
pub const HEADING: usize = 3;
pub const SURGE: usize = 4;
pub const SWAY: usize = 5;
pub const CHANNELS: usize = 6;

/// CSV quantities in the order of the degrees of freedom.
const QUANTITIES: [Quantity; CHANNELS] = [
    Quantity::Roll,
    Quantity::Pitch,
    Quantity::Heave,
    Quantity::Heading,
    Quantity::Surge,
    Quantity::Sway,
];
/// Maximum number of rows after bridging gaps.
const MAX_ROWS: usize = 2_000_000;
/// Row rate below which fast motion is lost, Hz.
const SLOW_HZ: f64 = 4.9;
const MAX_BRIDGE: usize = 2000;

#[derive(Debug, Error)]
pub enum DeckMotionError {
    #[error("reading deck motion {path}: {source}; check the path and its permissions")]
    Read { path: PathBuf, source: std::io::Error },
    #[error(
        "deck motion {origin}, line {line}: {message}; the columns are t_s, roll_deg, pitch_deg and any of \
         heave_m, heading_deg, surge_m, sway_m"
    )]
    Header {
        origin: String,
        /// Line of the header, from 1.
        line: u64,
        message: String,
    },
    #[error("deck motion {origin}, line {line}: {message}; correct or remove the row")]
    Row {
        origin: String,
        /// Line of the row, from 1.
        line: u64,
        message: String,
    },
    /// All rows are valid, but the recording as a whole is unusable.
    #[error("deck motion {origin}: {message}")]
    Whole { origin: String, message: String },
}

/// Cleaned knots: strictly ascending times from 0 s; values in rad and m; heading unwrapped.
#[derive(Clone, Debug, PartialEq)]
pub struct Recording {
    pub t: Vec<f64>,
    /// Values by channel; zero where [`Recording::has`] is false.
    pub y: Vec<[f64; CHANNELS]>,
    pub has: [bool; CHANNELS],
    /// Time average per channel, gaps excluded.
    pub mean: [f64; CHANNELS],
    pub gaps: usize,
    /// Remarks on channels whose bandwidth or resolution is lower than their rows suggest.
    pub remarks: Vec<String>,
}

impl Recording {
    pub fn load(path: &Path) -> Result<Self, DeckMotionError> {
        let bytes = std::fs::read(path).map_err(|source| DeckMotionError::Read {
            path: path.into(),
            source,
        })?;
        Self::parse(&bytes, &path.display().to_string())
    }

    pub fn parse(bytes: &[u8], origin: &str) -> Result<Self, DeckMotionError> {
        let whole = |message: String| DeckMotionError::Whole {
            origin: origin.into(),
            message,
        };
        let table = table(bytes, origin)?;
        let Channels {
            mut t,
            mut y,
            has,
            mut remarks,
        } = Channels::of(&table).map_err(whole)?;
        unwrap_heading(&mut y);
        let steps = t.windows(2).map(|w| w[1] - w[0]).filter(|d| *d > 0.0);
        let usual = median(steps).unwrap_or_default();
        let rows = t.len();
        merge_close(&mut t, &mut y, 0.25 * usual);
        if t.len() < rows {
            remarks.push(format!(
                "{} rows with (nearly) the same time as the row above are averaged with it",
                rows - t.len()
            ));
        }
        if usual > 1.0 / SLOW_HZ {
            remarks.push(format!(
                "{:.1} rows per second, fewer than 5: fast deck motion is lost",
                1.0 / usual
            ));
        }
        let duration = t.last().zip(t.first()).map_or(0.0, |(b, a)| b - a);
        if t.len() < 4 || duration < 2.0 {
            return Err(whole(format!(
                "{} distinct times over {duration:.3} s are too few; give at least 4 over at least 2 s",
                t.len()
            )));
        }
        let start = t[0];
        for t in &mut t {
            *t -= start;
        }
        // A gap is an interval with at least five missing samples.
        let longest = 5.0 * usual;
        let knots = Knots {
            t: &t,
            y: &mut y,
            step: usual,
            longest,
        };
        remarks.extend(quality::smooth(knots, &has));
        let mean = time_average(&t, &y, longest);
        let (t, y, gaps) = bridge(t, y, longest, usual).ok_or_else(|| {
            whole(format!(
                "more than {MAX_ROWS} values would be needed to bridge its gaps"
            ))
        })?;
        Ok(Recording {
            t,
            y,
            has,
            mean,
            gaps,
            remarks,
        })
    }
}

/// Checks that every row is valid, and that times do not decrease.
fn table(bytes: &[u8], origin: &str) -> Result<CsvTable, DeckMotionError> {
    let origin = || origin.to_owned();
    let error = |e: TableError| match e {
        TableError::Header { line, message } => DeckMotionError::Header {
            origin: origin(),
            line,
            message,
        },
        TableError::Row { line, message } => DeckMotionError::Row {
            origin: origin(),
            line,
            message,
        },
    };
    let row = |line: u64, message: String| error(TableError::Row { line, message });
    let mut table = CsvTable::read(bytes).map_err(error)?;
    for quantity in [Quantity::Roll, Quantity::Pitch] {
        if !table.has(quantity) {
            let message = format!("column `{}` is missing", quantity.name());
            return Err(error(table.header_error(message)));
        }
    }
    let pairs: [&[Quantity]; 1] = [&[Quantity::Roll, Quantity::Pitch]];
    table.require_together(&pairs).map_err(error)?;
    if let Some((line, message)) = table.bad.first {
        return Err(row(line, message));
    }
    match table.backwards {
        Some((line, at)) => Err(row(line, format!("t_s {at} is earlier than the row above"))),
        None => Ok(table),
    }
}

/// Channels at common times.
struct Channels {
    t: Vec<f64>,
    y: Vec<[f64; CHANNELS]>,
    has: [bool; CHANNELS],
    remarks: Vec<String>,
}

impl Channels {
    /// Channels at the times of rows with a roll; channels with rows of their own are interpolated.
    fn of(table: &CsvTable) -> Result<Channels, String> {
        let knots: Vec<&CsvRow> = table
            .rows
            .iter()
            .filter(|r| r.get(Quantity::Roll).is_some())
            .collect();
        let mut channels = Channels {
            t: knots.iter().map(|r| r.t).collect(),
            y: vec![[0.0; CHANNELS]; knots.len()],
            has: [false; CHANNELS],
            remarks: Vec::new(),
        };
        for (c, quantity) in QUANTITIES.into_iter().enumerate() {
            if !table.has(quantity) {
                continue;
            }
            let turn = match c {
                ROLL | PITCH | HEADING => 1_f64.to_radians(),
                _ => 1.0,
            };
            if !table.any(quantity) {
                channels
                    .remarks
                    .push(format!("{} has no values", quantity.name()));
                continue;
            }
            channels.has[c] = true;
            if knots.iter().all(|r| r.get(quantity).is_some()) {
                let values = knots.iter().filter_map(|r| r.get(quantity));
                for (y, v) in channels.y.iter_mut().zip(values) {
                    y[c] = v * turn;
                }
            } else {
                let own = Own::of(&table.rows, quantity, turn)?;
                channels.remarks.extend(own.fill(&channels.t, &mut channels.y, c));
            }
        }
        let unused: Vec<&str> = table
            .unused(&QUANTITIES)
            .into_iter()
            .map(Quantity::name)
            .collect();
        if !unused.is_empty() {
            channels.remarks.push(format!(
                "ignored columns, which are not deck motion: {}",
                unused.join(", ")
            ));
        }
        Ok(channels)
    }
}

struct Own {
    name: &'static str,
    spline: Splines<1>,
    t: Vec<f64>,
    y: Vec<f64>,
    /// Median time between rows, s.
    step: f64,
}

impl Own {
    fn of(rows: &[CsvRow], quantity: Quantity, turn: f64) -> Result<Own, String> {
        let name = quantity.name();
        let (mut t, mut y): (Vec<f64>, Vec<f64>) = (Vec::new(), Vec::new());
        for row in rows {
            let Some(value) = row.get(quantity) else { continue };
            let mut value = value * turn;
            if let (Quantity::Heading, Some(before)) = (quantity, y.last()) {
                value = before + alight_shared::frames::wrap_angle(value - before);
            }
            // The first of several rows with the same time is used.
            if t.last().is_none_or(|last| *last < row.t) {
                t.push(row.t);
                y.push(value);
            }
        }
        let step = median(t.windows(2).map(|w| w[1] - w[0])).unwrap_or_default();
        let rows: Vec<[f64; 1]> = y.iter().map(|v| [*v]).collect();
        let spline = Splines::through(t.clone(), rows).ok_or_else(|| {
            format!(
                "{name} has {} values; give more, or leave the column out",
                t.len()
            )
        })?;
        Ok(Own {
            name,
            spline,
            t,
            y,
            step,
        })
    }
    /// Fills channel `c` at `times` by a cubic spline, with a smooth step across gaps. Returns remarks.
    fn fill(&self, times: &[f64], to: &mut [[f64; CHANNELS]], c: usize) -> Vec<String> {
        let gaps = self
            .t
            .windows(2)
            .filter(|w| w[1] - w[0] > 5.0 * self.step)
            .count();
        for (at, row) in times.iter().zip(to) {
            let k = self.t.partition_point(|t| t <= at);
            let around = k.checked_sub(1).zip((k < self.t.len()).then_some(k));
            row[c] = match around {
                Some((a, b)) if self.t[b] - self.t[a] > 5.0 * self.step => {
                    let s = smooth_step(at - self.t[a], self.t[b] - self.t[a]).y;
                    self.y[a] + s * (self.y[b] - self.y[a])
                }
                Some(_) | None => self.spline.at(*at)[0].y,
            };
        }
        let mut remarks = vec![format!(
            "{} has separate rows at {:.1} Hz and is interpolated; motion with periods below {:.1} s is lost",
            self.name,
            1.0 / self.step,
            2.0 * self.step
        )];
        if gaps > 0 {
            remarks.push(format!("{} has {gaps} gaps, which are bridged", self.name));
        }
        remarks
    }
}

/// Unwraps headings so that each is within half a turn of the previous one.
fn unwrap_heading(y: &mut [[f64; CHANNELS]]) {
    use core::f64::consts::TAU;
    for i in 1..y.len() {
        let before = y[i - 1][HEADING];
        let turns = ((before - y[i][HEADING]) / TAU).round();
        y[i][HEADING] += turns * TAU;
    }
}

/// Averages rows closer than `min_step`, including repeated stamps, because a spline through different values
/// at nearly the same time would overshoot.
fn merge_close(t: &mut Vec<f64>, y: &mut Vec<[f64; CHANNELS]>, min_step: f64) {
    let mut kept = 0;
    let mut i = 0;
    while i < t.len() {
        let first = t[i];
        let mut sum_t = 0.0;
        let mut sum = [0.0; CHANNELS];
        let mut n = 0.0;
        while i < t.len() && (t[i] == first || t[i] - first < min_step) {
            sum_t += t[i] - first;
            for c in 0..CHANNELS {
                sum[c] += y[i][c];
            }
            n += 1.0;
            i += 1;
        }
        t[kept] = first + sum_t / n;
        y[kept] = sum.map(|s| s / n);
        kept += 1;
    }
    t.truncate(kept);
    y.truncate(kept);
}

/// Trapezoidal time average outside gaps.
fn time_average(t: &[f64], y: &[[f64; CHANNELS]], longest: f64) -> [f64; CHANNELS] {
    let mut sum = [0.0; CHANNELS];
    let mut time = 0.0;
    for i in 1..t.len() {
        let dt = t[i] - t[i - 1];
        if dt <= longest {
            time += dt;
            for c in 0..CHANNELS {
                sum[c] += 0.5 * dt * (y[i][c] + y[i - 1][c]);
            }
        }
    }
    sum.map(|s| if time > 0.0 { s / time } else { 0.0 })
}

/// Adds knots to gaps longer than `longest`: the motion before the gap decays, the motion after it builds up,
/// and a smooth step between them stays within the recorded range. A single cubic would overshoot because of
/// the slopes at its ends. None: too many knots.
fn bridge(
    t: Vec<f64>,
    y: Vec<[f64; CHANNELS]>,
    longest: f64,
    median: f64,
) -> Option<(Vec<f64>, Vec<[f64; CHANNELS]>, usize)> {
    let mut low = [f64::MAX; CHANNELS];
    let mut high = [f64::MIN; CHANNELS];
    for row in &y {
        for c in 0..CHANNELS {
            low[c] = low[c].min(row[c]);
            high[c] = high[c].max(row[c]);
        }
    }
    let mut out_t = Vec::with_capacity(t.len());
    let mut out_y = Vec::with_capacity(y.len());
    let mut gaps = 0;
    // Decay time on both sides of a gap, s.
    let fade = 3.0 * median;
    for i in 0..t.len() {
        if i > 0 && t[i] - t[i - 1] > longest {
            gaps += 1;
            let t0 = t[i - 1];
            let t1 = t[i];
            let n = ((t1 - t0) / median).ceil().min(MAX_BRIDGE as f64) as usize;
            if out_t.len() + n > 2 * MAX_ROWS {
                return None;
            }
            let slope = |a: usize, b: usize, c: usize| {
                let dt = t[b] - t[a];
                if dt > 0.0 && dt <= longest {
                    (y[b][c] - y[a][c]) / dt
                } else {
                    0.0
                }
            };
            for k in 1..n {
                let at = t0 + (t1 - t0) * k as f64 / n as f64;
                let b = smooth_step(at - t0, t1 - t0).y;
                let run = |since: f64| fade * (1.0 - (-since / fade).exp());
                let row = core::array::from_fn(|c| {
                    let left = y[i - 1][c] + slope(i.saturating_sub(2), i - 1, c) * run(at - t0);
                    let right = y[i][c] - slope(i, (i + 1).min(t.len() - 1), c) * run(t1 - at);
                    (left + (right - left) * b).clamp(low[c], high[c])
                });
                out_t.push(at);
                out_y.push(row);
            }
        }
        out_t.push(t[i]);
        out_y.push(y[i]);
    }
    Some((out_t, out_y, gaps))
}
