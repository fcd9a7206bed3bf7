//! The polar of an envelope as SVG: a circle for each sea state, bow up; in the ring of each wind a cell for each direction
//! that it comes from, filled by the parts that landed, were refused or unsafe.

use core::f64::consts::TAU;
use std::error::Error;

use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::envelope::{Cell, Grid};

const LANDED: RGBColor = RGBColor(122, 184, 122);
const REFUSED: RGBColor = RGBColor(244, 204, 120);
const UNSAFE: RGBColor = RGBColor(205, 70, 70);
const LINE: RGBColor = RGBColor(30, 30, 30);
/// Side of a panel, height of title and legend, px.
const PANEL: u32 = 400;
const HEAD: u32 = 40;
const FOOT: u32 = 34;
/// Part of the radius for the boat in the middle.
const HUB: f64 = 0.17;
/// Panels in a row.
const COLUMNS: usize = 3;

type Plane<'a, 'b> = ChartContext<'a, SVGBackend<'b>, Cartesian2d<RangedCoordf64, RangedCoordf64>>;
type Drawn = Result<(), Box<dyn Error>>;

/// At this radius in this direction, clockwise from the bow.
fn at(radius: f64, angle: f64) -> (f64, f64) {
    (radius * angle.sin(), radius * angle.cos())
}
fn arc(radius: f64, [from, to]: [f64; 2]) -> impl DoubleEndedIterator<Item = (f64, f64)> {
    let steps = (((to - from) / 0.05).ceil() as u32).max(1);
    (0..=steps).map(move |k| at(radius, from + (to - from) * f64::from(k) / f64::from(steps)))
}
/// A part of a ring between two radii and two angles.
fn wedge([inner, outer]: [f64; 2], angles: [f64; 2]) -> Vec<(f64, f64)> {
    arc(outer, angles).chain(arc(inner, angles).rev()).collect()
}
fn text(size: u32) -> TextStyle<'static> {
    ("sans-serif", size)
        .into_font()
        .color(&LINE)
        .pos(Pos::new(HPos::Center, VPos::Center))
}

/// Draws the cells of a grid.
pub fn draw(grid: &Grid, cells: &[Cell], title: &str) -> Result<String, Box<dyn Error>> {
    let columns = grid.states.len().clamp(1, COLUMNS);
    let rows = grid.states.len().div_ceil(columns).max(1);
    let size = (PANEL * columns as u32, HEAD + PANEL * rows as u32 + FOOT);
    let mut svg = String::new();
    {
        let root = SVGBackend::with_string(&mut svg, size).into_drawing_area();
        root.fill(&WHITE)?;
        let middle = size.0 as i32 / 2;
        root.draw(&Text::new(title.to_owned(), (middle, HEAD as i32 / 2), text(20)))?;
        legend(&root, size.1 as i32 - FOOT as i32 / 2)?;
        let (_, body) = root.split_vertically(HEAD);
        let (body, _) = body.split_vertically(PANEL * rows as u32);
        for (panel, state) in body.split_evenly((rows, columns)).iter().zip(&grid.states) {
            let mut plane = ChartBuilder::on(panel).build_cartesian_2d(-1.25..1.25, -1.25..1.25)?;
            polar(&mut plane, grid, cells, *state)?;
        }
        root.present()?;
    }
    Ok(svg)
}

fn legend(root: &DrawingArea<SVGBackend<'_>, plotters::coord::Shift>, y: i32) -> Drawn {
    let style = ("sans-serif", 13)
        .into_font()
        .color(&LINE)
        .pos(Pos::new(HPos::Left, VPos::Center));
    for (k, (colour, name)) in [(LANDED, "landed"), (REFUSED, "refused"), (UNSAFE, "unsafe")]
        .into_iter()
        .enumerate()
    {
        let x = 12 + 84 * k as i32;
        root.draw(&Rectangle::new([(x, y - 6), (x + 12, y + 6)], colour.filled()))?;
        root.draw(&Text::new(name, (x + 18, y), style.clone()))?;
    }
    root.draw(&PathElement::new([(266, y), (286, y)], LINE.stroke_width(3)))?;
    root.draw(&Text::new("limit", (292, y), style))?;
    Ok(())
}

/// The circle of one sea state.
fn polar(plane: &mut Plane<'_, '_>, grid: &Grid, cells: &[Cell], state: u8) -> Drawn {
    let fastest = grid.winds.last().copied().unwrap_or(1.0).max(1e-9);
    let radius = |wind: f64| HUB + (1.0 - HUB) * wind / fastest;
    let half = 0.5 * TAU / f64::from(grid.directions.max(1));
    let mut labels = Vec::new();
    for c in cells.iter().filter(|c| c.state == state) {
        let ring = grid.winds.iter().position(|w| *w == c.wind_mps).unwrap_or(0);
        let below = ring.checked_sub(1).and_then(|k| grid.winds.get(k)).copied();
        let (radii, middle) = (
            [below.map_or(HUB, radius), radius(c.wind_mps)],
            c.from_deg.to_radians(),
        );
        let mut from = middle - half;
        for (n, colour) in [
            (c.landed, LANDED),
            (c.refused, REFUSED),
            (c.unsafe_count(), UNSAFE),
        ] {
            let to = from + 2.0 * half * n as f64 / c.trials.max(1) as f64;
            if n > 0 {
                plane.draw_series([Polygon::new(wedge(radii, [from, to]), colour)])?;
            }
            from = to;
        }
        let outline = wedge(radii, [middle - half, middle + half]);
        let outline: Vec<_> = outline.iter().chain(outline.first()).copied().collect();
        plane.draw_series([PathElement::new(outline, WHITE.stroke_width(2))])?;
        labels.push((
            format!("{}/{}", c.landed, c.trials),
            at(0.5 * (radii[0] + radii[1]), middle),
        ));
    }
    let limit: Vec<_> = (grid.bearings())
        .flat_map(|from| {
            let r = grid.limit(cells, state, from).map_or(HUB, radius);
            arc(r, [from.to_radians() - half, from.to_radians() + half])
        })
        .collect();
    let closed: Vec<_> = limit.iter().chain(limit.first()).copied().collect();
    plane.draw_series([PathElement::new(closed, LINE.stroke_width(3))])?;
    plane.draw_series(
        labels
            .into_iter()
            .map(|(label, place)| Text::new(label, place, text(12))),
    )?;
    // The boat, bow up, and the scales.
    let hull = [
        (0.0, 0.13),
        (0.045, 0.05),
        (0.045, -0.11),
        (-0.045, -0.11),
        (-0.045, 0.05),
    ];
    plane.draw_series([Polygon::new(hull.to_vec(), RGBColor(120, 120, 120))])?;
    let scale = grid.winds.iter().map(|w| (format!("{w}"), at(radius(*w), half)));
    let bearings = grid
        .bearings()
        .map(|b| (format!("{b:.0}°"), at(1.1, b.to_radians())));
    let sea = core::iter::once((format!("sea state {state}; wind from, m/s"), (0.0, -1.21)));
    plane.draw_series(
        scale
            .chain(bearings)
            .chain(sea)
            .map(|(label, place)| Text::new(label, place, text(13))),
    )?;
    Ok(())
}
