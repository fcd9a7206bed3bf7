//! Response of a hull to waves as a table: complex motion per metre of wave amplitude, by frequency and direction.
//!
//! Axes of the file: x forward, y to port, z up. The motion amidships at the still-water line is `Re(H a
//! exp(-i (omega t + phase)))` in the wave `a cos(omega t + phase)`. A direction is that in which the wave
//! travels relative to the bow, counter-clockwise from above: 0 following sea, 90 from starboard to port, 180
//! head sea. Waves to the other side are the mirror image: sway, roll and yaw change sign.

use core::f64::consts::PI;

use super::HullError;

/// Surge, sway, heave, roll, pitch, yaw.
pub const DOFS: usize = 6;
pub const COLUMNS: [&str; 14] = [
    "omega_radps",
    "direction_deg",
    "surge_re",
    "surge_im",
    "sway_re",
    "sway_im",
    "heave_re",
    "heave_im",
    "roll_re",
    "roll_im",
    "pitch_re",
    "pitch_im",
    "yaw_re",
    "yaw_im",
];
/// Sign of each degree of freedom after mirroring.
const MIRRORED: [f64; DOFS] = [1.0, -1.0, 1.0, -1.0, 1.0, -1.0];
/// Largest plausible response, m/m or rad/m; a larger value indicates a wrong unit (deg for rad).
const MAX_RESPONSE: f64 = 20.0;
const MAX_ROWS: usize = 200_000;

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Response {
    /// Real parts, m/m and rad/m.
    pub re: [f64; DOFS],
    pub im: [f64; DOFS],
}

impl Response {
    fn mirrored(&self) -> Response {
        Response {
            re: core::array::from_fn(|d| MIRRORED[d] * self.re[d]),
            im: core::array::from_fn(|d| MIRRORED[d] * self.im[d]),
        }
    }
    fn mix<const N: usize>(parts: [(f64, &Response); N]) -> Response {
        let sum = |f: &dyn Fn(&Response) -> f64| parts.iter().map(|(w, r)| w * f(r)).sum();
        Response {
            re: core::array::from_fn(|d| sum(&|r| r.re[d])),
            im: core::array::from_fn(|d| sum(&|r| r.im[d])),
        }
    }
}

/// Responses on a full grid of frequencies and directions.
#[derive(Clone, Debug, PartialEq)]
pub struct ResponseTable {
    /// Frequencies, ascending, rad/s.
    omega: Vec<f64>,
    /// Directions, ascending from 0 to pi, rad.
    direction: Vec<f64>,
    /// Responses by frequency, then direction.
    responses: Vec<Response>,
}

impl ResponseTable {
    pub fn parse(text: &str, origin: &str) -> Result<Self, HullError> {
        let at = |line: usize, message: String| HullError::Row {
            origin: origin.into(),
            line,
            message,
        };
        let mut rows = (1..)
            .zip(text.lines())
            .map(|(n, l)| (n, l.trim()))
            .filter(|(_, l)| !l.is_empty() && !l.starts_with('#'));
        let (first, header) = rows.next().ok_or_else(|| at(1, "the file is empty".into()))?;
        if !header.split(',').map(str::trim).eq(COLUMNS) {
            let hint = if header.starts_with("t_s") {
                "; a recording of the deck is given with --deck-motion"
            } else if !header.is_ascii() || header.starts_with("CDF") {
                "; python -m alight.convert FILE.nc makes it from Capytaine's NetCDF"
            } else {
                ""
            };
            let message = format!("the columns must be {}{hint}", COLUMNS.join(","));
            return Err(at(first, message));
        }
        let mut table = ResponseTable {
            omega: Vec::new(),
            direction: Vec::new(),
            responses: Vec::new(),
        };
        // Position of the next row in the grid of directions and frequencies.
        let mut column = 0;
        let mut last = first;
        for (line, row) in rows {
            last = line;
            if table.responses.len() >= MAX_ROWS {
                return Err(at(line, format!("more than {MAX_ROWS} rows")));
            }
            let values = numbers(row).map_err(|message| at(line, message))?;
            let omega = values[0];
            let direction = values[1];
            let complete = !table.direction.is_empty() && column == table.direction.len();
            match table.omega.last() {
                Some(now) if omega == *now && (table.omega.len() == 1 || !complete) => {}
                Some(now) if omega > *now => {
                    if table.omega.len() > 1 && !complete {
                        return Err(at(
                            line,
                            format!(
                                "omega {now} has {column} directions, the first has {}",
                                table.direction.len()
                            ),
                        ));
                    }
                    if table.omega.len() == 1 {
                        table.whole_circle().map_err(|message| at(line, message))?;
                    }
                    table.omega.push(omega);
                    column = 0;
                }
                Some(now) => {
                    let message = format!("omega_radps {omega} follows {now}, but must ascend");
                    return Err(at(line, message));
                }
                None if omega > 0.0 => table.omega.push(omega),
                None => return Err(at(line, format!("omega_radps {omega} is not above 0"))),
            }
            table
                .take_direction(column, direction)
                .map_err(|message| at(line, message))?;
            column += 1;
            table.responses.push(Response {
                re: core::array::from_fn(|d| values[2 + 2 * d]),
                im: core::array::from_fn(|d| values[3 + 2 * d]),
            });
        }
        if table.omega.len() < 2 || column != table.direction.len() {
            return Err(at(
                last,
                "the table ends early: it needs two or more frequencies, each with all directions".into(),
            ));
        }
        Ok(table)
    }

    /// Reads a row's direction, deg. The first frequency's directions must ascend; those of the others must
    /// be the same.
    fn take_direction(&mut self, column: usize, direction: f64) -> Result<(), String> {
        if self.omega.len() == 1 {
            if self
                .direction
                .last()
                .is_some_and(|d| direction.to_radians() <= *d)
            {
                return Err(format!("direction_deg {direction} does not ascend"));
            }
            self.direction.push(direction.to_radians());
        } else if self.direction.get(column) != Some(&direction.to_radians()) {
            return Err(format!(
                "direction_deg {direction} differs from the first frequency's"
            ));
        }
        Ok(())
    }

    fn whole_circle(&self) -> Result<(), String> {
        let ends = self.direction.first().zip(self.direction.last());
        if self.direction.len() >= 3 && ends == Some((&0.0, &PI)) {
            return Ok(());
        }
        Err(format!(
            "the frequency above has {} directions; three or more are needed, from 0 to 180 deg",
            self.direction.len()
        ))
    }

    pub fn range(&self) -> [f64; 2] {
        let value = |v: Option<&f64>| v.copied().unwrap_or_default();
        [value(self.omega.first()), value(self.omega.last())]
    }

    /// Responses in all directions, interpolated linearly between frequencies and constant beyond the ends.
    pub fn at_frequency(&self, omega: f64) -> ResponseAtFrequency {
        let [low, high] = self.range();
        let omega = omega.clamp(low, high);
        let i = self
            .omega
            .partition_point(|w| *w <= omega)
            .clamp(1, self.omega.len() - 1)
            - 1;
        let f = (omega - self.omega[i]) / (self.omega[i + 1] - self.omega[i]);
        let n = self.direction.len();
        let node = |j: usize| {
            Response::mix([
                (1.0 - f, &self.responses[i * n + j]),
                (f, &self.responses[(i + 1) * n + j]),
            ])
        };
        let inner: Vec<(f64, Response)> = (0..n).map(|j| (self.direction[j], node(j))).collect();
        // An additional node beyond each end mirrors its neighbour.
        let mut nodes = Vec::with_capacity(n + 2);
        let mirror = |about: f64, (d, r): (f64, Response)| (2.0 * about - d, r.mirrored());
        nodes.push(mirror(0.0, inner[1]));
        nodes.extend(&inner);
        nodes.push(mirror(PI, inner[n - 2]));
        ResponseAtFrequency { nodes }
    }
}

/// Parses fourteen finite numbers of plausible magnitude.
fn numbers(row: &str) -> Result<[f64; 14], String> {
    let mut values = [0.0; 14];
    let mut cells = row.split(',').map(str::trim);
    for (value, name) in values.iter_mut().zip(COLUMNS) {
        let text = cells
            .next()
            .ok_or_else(|| format!("{name} is missing: 14 values are needed"))?;
        *value = text
            .parse()
            .map_err(|_| format!("{name} is `{text}`, not a number"))?;
        let [min, max] = match name {
            "omega_radps" => [0.0, 100.0],
            "direction_deg" => [0.0, 180.0],
            _ => [-MAX_RESPONSE, MAX_RESPONSE],
        };
        if !(min..=max).contains(value) {
            return Err(format!("{name} is {text}, allowed is {min} to {max}"));
        }
    }
    match cells.count() {
        0 => Ok(values),
        more => Err(format!("{more} values too many: exactly 14 are needed")),
    }
}

#[derive(Clone, Debug)]
pub struct ResponseAtFrequency {
    nodes: Vec<(f64, Response)>,
}

impl ResponseAtFrequency {
    /// Response to a wave that travels in `direction` relative to the bow (rad, counter-clockwise from above,
    /// not wrapped). Interpolated by a cubic with slopes from the neighbours (Catmull and Rom 1974), so that
    /// a turning vessel has a finite acceleration.
    pub fn towards(&self, direction: f64) -> Response {
        let wrapped = alight_shared::frames::wrap_angle(direction);
        let there = wrapped.abs();
        let i = self
            .nodes
            .partition_point(|n| n.0 <= there)
            .clamp(2, self.nodes.len() - 2)
            - 1;
        let [(x0, a), (x1, b), (x2, c), (x3, d)] =
            core::array::from_fn(|k| (self.nodes[i + k - 1].0, &self.nodes[i + k - 1].1));
        let h = x2 - x1;
        let s = (there - x1) / h;
        let s2 = s * s;
        let s3 = s * s * s;
        let h00 = 2.0 * s3 - 3.0 * s2 + 1.0;
        let h10 = s3 - 2.0 * s2 + s;
        let h01 = -2.0 * s3 + 3.0 * s2;
        let h11 = s3 - s2;
        let left = h10 * h / (x2 - x0);
        let right = h11 * h / (x3 - x1);
        let response = Response::mix([(-left, a), (h00 - right, b), (h01 + left, c), (right, d)]);
        if wrapped < 0.0 {
            response.mirrored()
        } else {
            response
        }
    }
}
