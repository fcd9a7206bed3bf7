//! Chart of one landing in the layout of the paper's figure 4 and of the Python module's `plots.landing`: the path
//! from above, and, over the time to touchdown, the displacement to the deck, the velocities, and the differences in
//! roll and pitch, and in yaw.

use std::path::Path;

use alight_shared::frames::wrap_angle;
use plotters::prelude::*;

use crate::harness::{
    outcome::Outcome,
    trace::{Trace, TracePoint},
};

use super::{Area, Axes, Drawn, Line, MARK, colour, lines, range_of};

const SIZE: (u32, u32) = (1200, 960);
const PATH_WIDTH: u32 = 534;
/// Time before the touchdown that the panels over time show, s; the path is complete.
const PANEL_S: f64 = 15.0;
/// Dash patterns of the first, second and third line of a panel, which distinguish them without colour.
const DASHES: [Option<(i32, i32)>; 3] = [None, Some((7, 4)), Some((2, 3))];

/// Title of the chart of a trial.
pub fn title(o: &Outcome) -> String {
    let sea = &o.sea;
    let seed = o.seed;
    let planner = &o.planner;
    let name = o.outcome.name();
    let contact = o.position_error_m.zip(o.touchdown_speed_mps);
    let contact = contact.map_or(String::new(), |(off_m, speed_mps)| {
        format!(", {off_m:.2} m off the centre at {speed_mps:.2} m/s")
    });
    format!("Landing: sea {sea}, seed {seed}, planner {planner}, {name}{contact}")
}

/// Draws the last landing of a trace to `path`; without a landing, its last seconds.
pub fn write(trace: &Trace, title: &str, path: &Path) -> Drawn {
    let mut svg = String::new();
    let trace = with_continuous_yaw(trace);
    draw(&trace, title, SVGBackend::with_string(&mut svg, SIZE))?;
    Ok(std::fs::write(path, svg)?)
}

/// Unwraps the yaw, so that it does not jump from 180 to -180 deg, and shifts its end into that range.
fn with_continuous_yaw(trace: &Trace) -> Trace {
    let mut trace = trace.clone();
    let mut after: Option<f64> = None;
    for point in trace.points.iter_mut().rev() {
        let yaw = &mut point.relative_euler[2];
        *yaw = after.map_or(*yaw, |after| after + wrap_angle(*yaw - after));
        after = Some(*yaw);
    }
    trace
}

/// Quantity of a panel: name, pattern index, colour index, and value at a point.
type Value<'a> = (&'a str, usize, usize, &'a dyn Fn(&TracePoint) -> f64);

struct Panel<'a> {
    name: &'a str,
    values: &'a [Value<'a>],
}

fn draw(trace: &Trace, title: &str, backend: SVGBackend<'_>) -> Drawn {
    let root = backend.into_drawing_area();
    root.fill(&WHITE)?;
    let (left, right) = root
        .titled(title, ("sans-serif", 22))?
        .split_horizontally(PATH_WIDTH);
    let panels = right.split_evenly((4, 1));
    paths(&left, trace)?;
    let degrees = |k: usize| move |p: &TracePoint| p.relative_euler[k].to_degrees();
    let charts = [
        Panel {
            name: "displacement to the deck, m",
            values: &[
                ("forward", 0, 0, &|p| p.displacement[0]),
                ("starboard", 1, 1, &|p| p.displacement[1]),
                ("height", 2, 2, &|p| p.displacement[2]),
            ],
        },
        // One colour per axis; the pattern distinguishes drone and deck.
        Panel {
            name: "velocity of drone and deck, m/s",
            values: &[
                ("north", 0, 0, &|p| p.drone_velocity[0]),
                ("east", 0, 1, &|p| p.drone_velocity[1]),
                ("up", 0, 2, &|p| -p.drone_velocity[2]),
                ("deck: dashed", 1, 0, &|p| p.deck_velocity[0]),
                ("", 1, 1, &|p| p.deck_velocity[1]),
                ("", 1, 2, &|p| -p.deck_velocity[2]),
            ],
        },
        Panel {
            name: "roll and pitch difference, deg",
            values: &[("roll", 0, 0, &degrees(0)), ("pitch", 1, 1, &degrees(1))],
        },
        Panel {
            name: "yaw difference, deg",
            values: &[("yaw", 0, 0, &degrees(2))],
        },
    ];
    for (k, (area, panel)) in panels.iter().zip(&charts).enumerate() {
        over_time(area, trace, panel, k + 1 < charts.len())?;
    }
    root.present()?;
    Ok(())
}

/// Zero of the time axis: the touchdown, otherwise the end.
fn zero(trace: &Trace) -> f64 {
    let end = trace.points.last().map_or(0.0, |p| p.t_s);
    trace.touchdown_s.unwrap_or(end)
}

/// Points in the last `before_s` before the zero of the time axis.
fn shown(trace: &Trace, before_s: f64) -> impl DoubleEndedIterator<Item = &TracePoint> {
    let until = zero(trace);
    let inside = until - before_s..=until;
    trace.points.iter().filter(move |p| inside.contains(&p.t_s))
}

/// Draws a panel; among panels one above another (`shared`) only the lowest shows the times.
fn over_time(area: &Area<'_>, trace: &Trace, panel: &Panel<'_>, shared: bool) -> Drawn {
    let until = zero(trace);
    let line = |(name, pattern, number, value): &Value<'_>| Line {
        name: (*name).into(),
        colour: colour(*number),
        dash: DASHES.get(*pattern).copied().flatten(),
        points: shown(trace, PANEL_S).map(|p| (p.t_s - until, value(p))).collect(),
    };
    let nought = Line {
        name: String::new(),
        colour: MARK,
        dash: Some((1, 3)),
        points: vec![(-PANEL_S, 0.0), (0.0, 0.0)],
    };
    let drawn: Vec<Line> = panel.values.iter().map(line).chain([nought]).collect();
    let across = match trace.touchdown_s {
        Some(_) => "time to touchdown, s",
        None => "time to the end of the recording, s",
    };
    let axes = Axes {
        caption: "",
        names: [if shared { "" } else { across }, panel.name],
        shared,
        across: -PANEL_S..0.0,
        up: range_of(drawn.iter().flat_map(|l| l.points.iter().map(|p| p.1))),
    };
    lines(area, &axes, &drawn)
}

fn paths(area: &Area<'_>, trace: &Trace) -> Drawn {
    let path = || shown(trace, f64::INFINITY);
    let ends = || path().flat_map(|p| [p.drone, p.deck]);
    let east = range_of(ends().map(|p| p[1]));
    let north = range_of(ends().map(|p| p[0]));
    let (w, h) = area.dim_in_pixel();
    let stretch = f64::from(w.saturating_sub(70)) / f64::from(h.saturating_sub(90).max(1));
    let half = ((east.end - east.start) / stretch).max(north.end - north.start) / 2.0;
    let ce = (east.end + east.start) / 2.0;
    let cn = (north.end + north.start) / 2.0;
    let axes = Axes {
        caption: "path from above",
        names: ["east, m", "north, m"],
        shared: false,
        across: ce - half * stretch..ce + half * stretch,
        up: cn - half..cn + half,
    };
    let line = |name: &str, colour, pattern: usize, points: Vec<(f64, f64)>| Line {
        name: name.into(),
        colour,
        dash: DASHES.get(pattern).copied().flatten(),
        points,
    };
    let of_drone: Vec<(f64, f64)> = path().map(|p| (p.drone[1], p.drone[0])).collect();
    let mut marks = vec![line(
        "start",
        colour(0),
        0,
        of_drone.first().copied().into_iter().collect(),
    )];
    if trace.touchdown_s.is_some() {
        let last = of_drone.last().copied().into_iter().collect();
        marks.push(line("touchdown", BLACK, 0, last));
    }
    let of_deck = path().map(|p| (p.deck[1], p.deck[0])).collect();
    let mut drawn = vec![
        line("drone", colour(0), 0, of_drone),
        line("deck", colour(1), 1, of_deck),
    ];
    drawn.extend(marks);
    lines(area, &axes, &drawn)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Descent of a metre in 20 s next to a turning deck, one point per second.
    fn trace(touchdown_s: Option<f64>) -> Trace {
        let point = |k: u32| TracePoint {
            t_s: 100.0 + f64::from(k),
            displacement: [0.1, 0.0, 1.0 - 0.05 * f64::from(k)],
            relative_euler: [0.0, 0.0, wrap_angle(3.0 + 0.02 * f64::from(k))],
            ..TracePoint::default()
        };
        Trace {
            step_s: 1.0,
            points: (0..=20).map(point).collect(),
            touchdown_s,
        }
    }

    #[test]
    fn span_before_the_touchdown() {
        let trace = trace(Some(118.5));
        let times: Vec<f64> = shown(&trace, 3.0).map(|p| p.t_s).collect();
        assert_eq!(times, [116.0, 117.0, 118.0]);
    }

    #[test]
    fn yaw_through_half_a_turn() {
        let turned = with_continuous_yaw(&trace(None));
        let yaw: Vec<f64> = turned.points.iter().map(|p| p.relative_euler[2]).collect();
        let steps = yaw.windows(2).map(|w| w[1] - w[0]);
        assert!(steps.clone().all(|s| (s - 0.02).abs() < 1e-9), "{yaw:?}");
        assert!((yaw[20] - wrap_angle(3.4)).abs() < 1e-9, "{yaw:?}");
    }

    #[test]
    fn plot_with_and_without_a_touchdown() {
        for (touchdown_s, axis) in [
            (Some(118.5), "time to touchdown, s"),
            (None, "time to the end of the recording, s"),
        ] {
            let mut svg = String::new();
            draw(
                &trace(touchdown_s),
                "a < b",
                SVGBackend::with_string(&mut svg, SIZE),
            )
            .unwrap();
            assert_eq!(svg.matches(axis).count(), 1, "{svg}");
            assert_eq!(svg.contains("touchdown"), touchdown_s.is_some());
            for name in [
                "a &lt; b",
                "path from above",
                "starboard",
                "velocity of drone and deck, m/s",
                "deck: dashed",
                "roll and pitch difference, deg",
                "yaw difference, deg",
            ] {
                assert!(svg.contains(name), "{name} is missing in {svg}");
            }
        }
    }

    #[test]
    fn plot_of_nothing() {
        let mut svg = String::new();
        draw(
            &Trace::default(),
            "nothing",
            SVGBackend::with_string(&mut svg, SIZE),
        )
        .unwrap();
        assert!(svg.contains("nothing"));
    }
}
