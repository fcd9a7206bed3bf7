//! Recorded motion: read, checked, cleaned of repeated stamps, interpolated over gaps.

mod quality;

use std::path::{Path, PathBuf};

use thiserror::Error;

use self::quality::Knots;
use crate::physics::spline::smooth_step;

/// Degrees of freedom of a recording, in this order.
pub const ROLL: usize = 0;
/// Pitch.
pub const PITCH: usize = 1;
/// Heave.
pub const HEAVE: usize = 2;
/// Heading.
pub const HEADING: usize = 3;
/// Surge.
pub const SURGE: usize = 4;
/// Sway.
pub const SWAY: usize = 5;
/// Number of channels.
pub const CHANNELS: usize = 6;

/// Column names with the greatest magnitude that a row may have.
pub(super) const COLUMNS: [(&str, f64); CHANNELS] = [
    ("roll_deg", 80.0),
    ("pitch_deg", 80.0),
    ("heave_m", 50.0),
    ("heading_deg", 1e5),
    ("surge_m", 1e5),
    ("sway_m", 1e5),
];
const TIME: &str = "t_s";
/// Most rows read, and most knots that gaps may add.
const MAX_ROWS: usize = 2_000_000;
/// Most knots in one gap.
const MAX_BRIDGE: usize = 2000;

/// Why a recording was rejected.
#[derive(Debug, Error)]
pub enum DeckMotionError {
    /// The file could not be read.
    #[error("reading deck motion {path}: {source}; check the path and its permissions")]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// The first line is not what is expected.
    #[error(
        "deck motion {origin}, line 1: {message}; the columns are t_s, roll_deg, pitch_deg and any of \
         heave_m, heading_deg, surge_m, sway_m"
    )]
    Header {
        /// The file.
        origin: String,
        /// What is wrong.
        message: String,
    },
    /// A row that cannot be used.
    #[error("deck motion {origin}, line {line}: {message}; correct or remove the row")]
    Row {
        /// The file.
        origin: String,
        /// Its line, counted from 1.
        line: u64,
        /// What is wrong.
        message: String,
    },
    /// Usable, but not as a whole.
    #[error("deck motion {origin}: {message}")]
    Whole {
        /// The file.
        origin: String,
        /// What is wrong.
        message: String,
    },
}

/// Cleaned knots: strictly ascending times (s from the first), values in rad and m, heading unwrapped.
#[derive(Clone, Debug, PartialEq)]
pub struct Recording {
    /// Times, s.
    pub t: Vec<f64>,
    /// Values by channel; zero where [`Recording::has`] says no.
    pub y: Vec<[f64; CHANNELS]>,
    /// Which channels the file has.
    pub has: [bool; CHANNELS],
    /// Time average per channel, of the recorded stretches.
    pub mean: [f64; CHANNELS],
    /// How many stretches without data were bridged.
    pub gaps: usize,
    /// What was done to channels that carry less than their rows say.
    pub remarks: Vec<String>,
}

impl Recording {
    /// Reads a file.
    pub fn load(path: &Path) -> Result<Self, DeckMotionError> {
        let bytes = std::fs::read(path).map_err(|source| DeckMotionError::Read {
            path: path.into(),
            source,
        })?;
        Self::parse(&bytes, &path.display().to_string())
    }

    /// Reads CSV text; `origin` names it in errors.
    pub fn parse(bytes: &[u8], origin: &str) -> Result<Self, DeckMotionError> {
        let (mut t, mut y, has) = rows(bytes, origin)?;
        let whole = |message: String| DeckMotionError::Whole {
            origin: origin.into(),
            message,
        };
        unwrap_heading(&mut y);
        let mut steps: Vec<f64> = t.windows(2).map(|w| w[1] - w[0]).filter(|d| *d > 0.0).collect();
        steps.sort_unstable_by(f64::total_cmp);
        let median = steps.get(steps.len() / 2).copied().unwrap_or(0.0);
        merge_close(&mut t, &mut y, 0.25 * median);
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
        // A gap is where five samples or more are missing.
        let longest = 5.0 * median;
        let knots = Knots {
            t: &t,
            y: &mut y,
            step: median,
            longest,
        };
        let remarks = quality::smooth(knots, &has);
        let mean = time_average(&t, &y, longest);
        let (t, y, gaps) = bridge(t, y, longest, median).ok_or_else(|| {
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

type Rows = (Vec<f64>, Vec<[f64; CHANNELS]>, [bool; CHANNELS]);

/// Header and rows: numbers checked, degrees to radians.
fn rows(bytes: &[u8], origin: &str) -> Result<Rows, DeckMotionError> {
    let header = |message: String| DeckMotionError::Header {
        origin: origin.into(),
        message,
    };
    let mut reader = csv::ReaderBuilder::new()
        .trim(csv::Trim::All)
        .flexible(true)
        .from_reader(bytes);
    let names = reader.headers().map_err(|e| header(e.to_string()))?.clone();
    let mut columns = Vec::with_capacity(names.len());
    let mut has = [false; CHANNELS];
    let mut time = None;
    for (i, name) in names.iter().enumerate() {
        // Some programs write a byte order mark.
        let name = name.trim_start_matches('\u{feff}');
        if name == TIME {
            if time.replace(i).is_some() {
                return Err(header(format!("column `{TIME}` appears twice")));
            }
            columns.push(None);
            continue;
        }
        let Some(channel) = COLUMNS.iter().position(|c| c.0 == name) else {
            return Err(header(format!("unknown column `{name}`")));
        };
        if has[channel] {
            return Err(header(format!("column `{name}` appears twice")));
        }
        has[channel] = true;
        columns.push(Some(channel));
    }
    let time = time.ok_or_else(|| header(format!("column `{TIME}` is missing")))?;
    for channel in [ROLL, PITCH] {
        if !has[channel] {
            return Err(header(format!("column `{}` is missing", COLUMNS[channel].0)));
        }
    }

    let (mut t, mut y) = (Vec::new(), Vec::new());
    let mut record = csv::StringRecord::new();
    loop {
        let coming = reader.position().byte();
        let row = |byte: u64, message: String| DeckMotionError::Row {
            origin: origin.into(),
            line: line_of(bytes, byte),
            message,
        };
        match reader.read_record(&mut record) {
            Ok(true) => {}
            Ok(false) => break,
            Err(e) => {
                let at = e.position().map_or(coming, csv::Position::byte);
                return Err(row(at, e.to_string()));
            }
        }
        let here = record.position().map_or(coming, csv::Position::byte);
        if record.len() != columns.len() {
            return Err(row(
                here,
                format!("{} values for {} columns", record.len(), columns.len()),
            ));
        }
        if t.len() >= MAX_ROWS {
            return Err(row(here, format!("more than {MAX_ROWS} rows")));
        }
        let number = |i: usize, name: &str, limit: f64| -> Result<f64, DeckMotionError> {
            let text = record.get(i).unwrap_or_default();
            let v: f64 = text
                .parse()
                .map_err(|_| row(here, format!("{name} is `{text}`, not a number")))?;
            if v.abs() <= limit {
                Ok(v)
            } else {
                Err(row(
                    here,
                    format!("{name} is {text}, allowed is -{limit} to {limit}"),
                ))
            }
        };
        let at = number(time, TIME, 1e10)?;
        if t.last().is_some_and(|last| at < *last) {
            return Err(row(here, format!("{TIME} {at} lies before the row above")));
        }
        let mut values = [0.0; CHANNELS];
        for (i, channel) in columns.iter().enumerate() {
            if let Some(c) = *channel {
                let v = number(i, COLUMNS[c].0, COLUMNS[c].1)?;
                values[c] = match c {
                    ROLL | PITCH | HEADING => v.to_radians(),
                    _ => v,
                };
            }
        }
        t.push(at);
        y.push(values);
    }
    Ok((t, y, has))
}

/// The line, counted from 1, of the first row at or after `byte`: the reader's own count stays at the empty
/// lines that it skips.
fn line_of(bytes: &[u8], byte: u64) -> u64 {
    let start = usize::try_from(byte).unwrap_or(usize::MAX).min(bytes.len());
    let (before, rest) = bytes.split_at(start);
    let empty = rest.iter().take_while(|b| matches!(b, b'\n' | b'\r'));
    let feeds = |b: &&u8| **b == b'\n';
    (1 + before.iter().filter(feeds).count() + empty.filter(feeds).count()) as u64
}

/// Takes each heading to the turn nearest to the one before.
fn unwrap_heading(y: &mut [[f64; CHANNELS]]) {
    use core::f64::consts::TAU;
    for i in 1..y.len() {
        let before = y[i - 1][HEADING];
        let turns = ((before - y[i][HEADING]) / TAU).round();
        y[i][HEADING] += turns * TAU;
    }
}

/// Replaces rows that follow closer than `min_step` (repeated stamps among them) by their average: a spline
/// through two different values at nearly the same time would fling.
fn merge_close(t: &mut Vec<f64>, y: &mut Vec<[f64; CHANNELS]>, min_step: f64) {
    let mut kept = 0;
    let mut i = 0;
    while i < t.len() {
        let first = t[i];
        let (mut sum_t, mut sum, mut n) = (0.0, [0.0; CHANNELS], 0.0);
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

/// Trapezoidal time average over the steps that are no gaps.
fn time_average(t: &[f64], y: &[[f64; CHANNELS]], longest: f64) -> [f64; CHANNELS] {
    let (mut sum, mut time) = ([0.0; CHANNELS], 0.0);
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

/// Puts knots into every gap longer than `longest`: the motion before dies away, the motion after comes up
/// and a smooth step leads from one to the other, never outside what was recorded. A cubic over the bare
/// gap would swing out with the slopes at its ends. None when that would take too many knots.
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
    let (mut out_t, mut out_y) = (Vec::with_capacity(t.len()), Vec::with_capacity(y.len()));
    let mut gaps = 0;
    // Memory of the motion at either side, s.
    let fade = 3.0 * median;
    for i in 0..t.len() {
        if i > 0 && t[i] - t[i - 1] > longest {
            gaps += 1;
            let (t0, t1) = (t[i - 1], t[i]);
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
