//! One landing in the layout of the paper's figure 4: the path from above, and over the time to touchdown the displacement
//! to the deck, the velocities, the difference of roll and pitch, and that of yaw.

use std::path::Path;

use alight_computer::exit::{CliError, Doing};
use alight_shared::frames::wrap_angle;
use alight_sim::harness::outcome::Outcome;
use alight_sim::harness::trace::{Trace, TracePoint};
use plotters::prelude::*;

use super::{Area, Axes, Drawn, Line, MARK, colour, lines, range_of};

/// Of the picture, and of the path in it, px.
const SIZE: (u32, u32) = (1200, 900);
const PATH_WIDTH: u32 = 520;
/// Time before the touchdown that the path and the panels over time show, s.
const PATH_S: f64 = 60.0;
const PANEL_S: f64 = 15.0;

/// What a simulated landing is, and how it ended.
pub fn title(o: &Outcome) -> String {
    let (sea, seed, planner, name) = (&o.sea, o.seed, &o.planner, o.outcome.name());
    format!("Landing at sea {sea}, seed {seed}, planner {planner}: {name}")
}

/// Draws the last landing of a trace to `path`; where nothing landed, its end.
pub fn write(trace: &Trace, title: &str, path: &Path) -> Result<(), CliError> {
    let doing = || format!("writing the plot {}", path.display());
    let mut svg = String::new();
    let trace = with_continuous_yaw(trace);
    draw(&trace, title, SVGBackend::with_string(&mut svg, SIZE)).doing(doing())?;
    std::fs::write(path, svg).doing(doing())
}

/// Over a turn of the drone the yaw runs on instead of jumping from 180 to -180 deg; at the end it is within them.
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

/// A value of a point: its name, whether it is the deck's beside the drone's, and of which number the colour is.
type Value<'a> = (&'a str, bool, usize, &'a dyn Fn(&TracePoint) -> f64);

/// What a panel over time shows.
struct Panel<'a> {
    caption: &'a str,
    unit: &'a str,
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
            caption: "Displacement of the feet in the deck's axes",
            unit: "m",
            values: &[
                ("forward", false, 0, &|p| p.displacement[0]),
                ("starboard", false, 1, &|p| p.displacement[1]),
                ("height", false, 2, &|p| p.displacement[2]),
            ],
        },
        Panel {
            caption: "Velocity",
            unit: "m/s",
            values: &[
                ("drone, north", false, 0, &|p| p.drone_velocity[0]),
                ("east", false, 1, &|p| p.drone_velocity[1]),
                ("up", false, 2, &|p| -p.drone_velocity[2]),
                ("deck, north", true, 0, &|p| p.deck_velocity[0]),
                ("east", true, 1, &|p| p.deck_velocity[1]),
                ("up", true, 2, &|p| -p.deck_velocity[2]),
            ],
        },
        Panel {
            caption: "Roll and pitch, drone minus deck",
            unit: "deg",
            values: &[("roll", false, 0, &degrees(0)), ("pitch", false, 1, &degrees(1))],
        },
        Panel {
            caption: "Yaw, drone minus deck",
            unit: "deg",
            values: &[("yaw", false, 0, &degrees(2))],
        },
    ];
    for (area, panel) in panels.iter().zip(&charts) {
        over_time(area, trace, panel)?;
    }
    root.present()?;
    Ok(())
}

/// Time from which times are counted: the touchdown, else the end.
fn zero(trace: &Trace) -> f64 {
    let end = trace.points.last().map_or(0.0, |p| p.t_s);
    trace.touchdown_s.unwrap_or(end)
}

/// The points of the last `before_s` before that time.
fn shown(trace: &Trace, before_s: f64) -> impl DoubleEndedIterator<Item = &TracePoint> {
    let until = zero(trace);
    let inside = until - before_s..=until;
    trace.points.iter().filter(move |p| inside.contains(&p.t_s))
}

fn over_time(area: &Area<'_>, trace: &Trace, panel: &Panel<'_>) -> Drawn {
    let until = zero(trace);
    let line = |(name, dashed, number, value): &Value<'_>| Line {
        name: (*name).into(),
        colour: colour(*number),
        dashed: *dashed,
        points: shown(trace, PANEL_S).map(|p| (p.t_s - until, value(p))).collect(),
    };
    let mut drawn: Vec<Line> = panel.values.iter().map(line).collect();
    let up = range_of(drawn.iter().flat_map(|l| l.points.iter().map(|p| p.1)));
    let mut across = "time to the end, s";
    if trace.touchdown_s.is_some() {
        across = "time to touchdown, s";
        drawn.push(Line {
            name: "touchdown".into(),
            colour: MARK,
            dashed: false,
            points: vec![(0.0, up.start), (0.0, up.end)],
        });
    }
    let axes = Axes {
        caption: panel.caption,
        names: [across, panel.unit],
        // Room for the names of the lines.
        across: -PANEL_S..0.3 * PANEL_S,
        up,
        places: None,
    };
    lines(area, &axes, &drawn)
}

fn paths(area: &Area<'_>, trace: &Trace) -> Drawn {
    let ends = || shown(trace, PATH_S).flat_map(|p| [p.drone, p.deck]);
    let (east, north) = (range_of(ends().map(|p| p[1])), range_of(ends().map(|p| p[0])));
    // One scale for both axes, so that a circle is a circle.
    let (w, h) = area.dim_in_pixel();
    let stretch = f64::from(w.saturating_sub(70)) / f64::from(h.saturating_sub(70).max(1));
    let half = ((east.end - east.start) / stretch).max(north.end - north.start) / 2.0;
    let (ce, cn) = ((east.end + east.start) / 2.0, (north.end + north.start) / 2.0);
    let axes = Axes {
        caption: "Paths from above",
        names: ["east, m", "north, m"],
        across: ce - half * stretch..ce + half * stretch,
        up: cn - half..cn + half,
        places: None,
    };
    let path = |name: &str, number, dashed, place: fn(&TracePoint) -> [f64; 3]| Line {
        name: name.into(),
        colour: colour(number),
        dashed,
        points: shown(trace, PATH_S).map(|p| (place(p)[1], place(p)[0])).collect(),
    };
    let drawn = [
        path("drone", 0, false, |p| p.drone),
        path("deck", 1, true, |p| p.deck),
    ];
    lines(area, &axes, &drawn)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A descent of a metre in 20 s beside a deck that turns; one point a second.
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
            (None, "time to the end, s"),
        ] {
            let mut svg = String::new();
            draw(
                &trace(touchdown_s),
                "a < b",
                SVGBackend::with_string(&mut svg, SIZE),
            )
            .unwrap();
            assert_eq!(svg.matches(axis).count(), 4, "{svg}");
            assert_eq!(svg.contains("touchdown"), touchdown_s.is_some());
            for name in [
                "a &lt; b",
                "starboard",
                "deck, north",
                "pitch",
                "Paths from above",
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
