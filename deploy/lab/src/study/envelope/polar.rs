//! Polar diagram of an envelope as SVG: a circle for each sea state, bow up, a ring for each wind, a cell for each
//! direction from which the wind blows. The blue of a cell shows the fraction that landed, the pattern its class:
//! landed, rejected or unsafe.

use core::f64::consts::TAU;
use std::error::Error;

use alight_sim::studies::statistics::successes_to_show;
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::grid::{Class, EnvelopeCell, EnvelopeGrid};

/// Ends of the colour scale of the fraction that landed, none to all: ColorBrewer's Blues, darker with every landing.
/// Unsafe is Okabe and Ito's vermilion, which differs from them for every kind of colour vision. Black text on these
/// colours has a contrast of at least 5.
const NONE_LANDED: RGBColor = RGBColor(222, 235, 247);
const ALL_LANDED: RGBColor = RGBColor(49, 130, 189);
const UNSAFE: RGBColor = RGBColor(213, 94, 0);
const LINE: RGBColor = RGBColor(30, 30, 30);
/// Side of a panel, height of title and legend, px.
const PANEL: u32 = 440;
const HEAD: u32 = 40;
const FOOT: u32 = 120;
/// Fraction of the radius for the boat in the middle.
const HUB: f64 = 0.25;
const COLUMNS: usize = 3;
/// Maximum angle per side of a polyline for an arc, rad: it deviates from a circle of 160 px radius by 0.2 px.
const MAX_STEP: f64 = 0.1;

type Plane<'a, 'b> = ChartContext<'a, SVGBackend<'b>, Cartesian2d<RangedCoordf64, RangedCoordf64>>;
type Drawn = Result<(), Box<dyn Error>>;

fn at(radius: f64, angle: f64) -> (f64, f64) {
    (radius * angle.sin(), radius * angle.cos())
}
fn arc(radius: f64, [from, to]: [f64; 2]) -> impl DoubleEndedIterator<Item = (f64, f64)> {
    let steps = (((to - from) / MAX_STEP).ceil() as u32).max(1);
    (0..=steps).map(move |k| at(radius, from + (to - from) * f64::from(k) / f64::from(steps)))
}
/// Part of a ring between two radii and two angles, rad.
fn wedge([inner, outer]: [f64; 2], angles: [f64; 2]) -> Vec<(f64, f64)> {
    arc(outer, angles).chain(arc(inner, angles).rev()).collect()
}
/// Colour of a class in which this fraction landed, 0 to 1.
pub fn colour(class: Class, landed: f64) -> RGBColor {
    let fraction = landed.clamp(0.0, 1.0);
    let between =
        |none: u8, all: u8| (f64::from(none) + fraction * (f64::from(all) - f64::from(none))).round() as u8;
    match class {
        Class::Landed | Class::Rejected => RGBColor(
            between(NONE_LANDED.0, ALL_LANDED.0),
            between(NONE_LANDED.1, ALL_LANDED.1),
            between(NONE_LANDED.2, ALL_LANDED.2),
        ),
        Class::Unsafe => UNSAFE,
    }
}
/// Lines of a class's pattern on a part of a ring: none for landed, arcs for rejected, a net for unsafe.
fn pattern(class: Class, [inner, outer]: [f64; 2], [from, to]: [f64; 2]) -> Vec<Vec<(f64, f64)>> {
    let arcs = (1..4).map(|k| arc(inner + (outer - inner) * f64::from(k) / 4.0, [from, to]).collect());
    let spokes = (1..6).map(|k| {
        let angle = from + (to - from) * f64::from(k) / 6.0;
        vec![at(inner, angle), at(outer, angle)]
    });
    match class {
        Class::Landed => Vec::new(),
        Class::Rejected => arcs.collect(),
        Class::Unsafe => arcs.chain(spokes).collect(),
    }
}
fn text(size: u32) -> TextStyle<'static> {
    ("sans-serif", size)
        .into_font()
        .color(&LINE)
        .pos(Pos::new(HPos::Center, VPos::Center))
}

pub fn draw(grid: &EnvelopeGrid, cells: &[EnvelopeCell], title: &str) -> Result<String, Box<dyn Error>> {
    let columns = grid.states.len().clamp(1, COLUMNS);
    let rows = grid.states.len().div_ceil(columns).max(1);
    let size = (PANEL * columns as u32, HEAD + PANEL * rows as u32 + FOOT);
    let mut svg = String::new();
    {
        let root = SVGBackend::with_string(&mut svg, size).into_drawing_area();
        root.fill(&WHITE)?;
        let middle = size.0 as i32 / 2;
        root.draw(&Text::new(title.to_owned(), (middle, HEAD as i32 / 2), text(20)))?;
        legend(&root, (size.1 - FOOT) as i32, grid)?;
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

fn legend(
    root: &DrawingArea<SVGBackend<'_>, plotters::coord::Shift>,
    top: i32,
    grid: &EnvelopeGrid,
) -> Drawn {
    let style = text(13).pos(Pos::new(HPos::Left, VPos::Center));
    let (mut x, y) = (12, top + 12);
    for class in [Class::Landed, Class::Rejected, Class::Unsafe] {
        let box_of = [(x, y - 8), (x + 20, y + 8)];
        let fraction = if class == Class::Landed { 1.0 } else { 0.0 };
        root.draw(&Rectangle::new(box_of, colour(class, fraction).filled()))?;
        let across = (1..4).map(|k| [(x, y - 8 + 4 * k), (x + 20, y - 8 + 4 * k)]);
        let up = (1..5).map(|k| [(x + 4 * k, y - 8), (x + 4 * k, y + 8)]);
        let net: Vec<_> = match class {
            Class::Landed => Vec::new(),
            Class::Rejected => across.collect(),
            Class::Unsafe => across.chain(up).collect(),
        };
        for line in net {
            root.draw(&PathElement::new(line, LINE.mix(0.4)))?;
        }
        root.draw(&Text::new(class.name(), (x + 26, y), style.clone()))?;
        x += 92;
    }
    scale(root, y + 22)?;
    let percent = 100.0 * grid.rate;
    let limit = if grid.too_few().is_some() {
        "no limit".to_owned()
    } else {
        root.draw(&PathElement::new([(x, y), (x + 20, y)], LINE.stroke_width(3)))?;
        x += 26;
        format!("limit: {percent:.0} % shown")
    };
    root.draw(&Text::new(limit, (x, y), style.clone()))?;
    let mut lines = vec![
        format!("landed: {percent:.0} % or more; rejected: fewer, none unsafe;"),
        "unsafe: one or more. In a cell: landed of tried, after ! unsafe of tried".into(),
        "rings: relative wind, 10 m above the water, m/s; waves come with it".into(),
    ];
    if grid.too_few().is_some() {
        let needed = successes_to_show(grid.rate);
        lines.push(format!(
            "no limit: {percent:.0} % needs {needed} landings a cell; only {} were flown",
            grid.trials
        ));
    }
    for (line, k) in lines.into_iter().zip(1..) {
        root.draw(&Text::new(line, (12, y + 22 + 18 * k), style.clone()))?;
    }
    Ok(())
}

/// Colour scale of the fraction that landed in fifths, none to all.
fn scale(root: &DrawingArea<SVGBackend<'_>, plotters::coord::Shift>, y: i32) -> Drawn {
    let style = text(13).pos(Pos::new(HPos::Left, VPos::Center));
    root.draw(&Text::new("fraction that landed: 0 %", (12, y), style.clone()))?;
    for k in 0..6 {
        let box_of = [(170 + 20 * k, y - 8), (190 + 20 * k, y + 8)];
        let fill = colour(Class::Landed, f64::from(k) / 5.0);
        root.draw(&Rectangle::new(box_of, fill.filled()))?;
    }
    root.draw(&Text::new("100 %", (298, y), style))?;
    Ok(())
}

fn polar(plane: &mut Plane<'_, '_>, grid: &EnvelopeGrid, cells: &[EnvelopeCell], state: u8) -> Drawn {
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
        let (class, angles) = (c.class(grid.rate), [middle - half, middle + half]);
        let fill = colour(class, c.landed as f64 / c.trials.max(1) as f64);
        plane.draw_series([Polygon::new(wedge(radii, angles), fill)])?;
        let net = pattern(class, radii, angles);
        plane.draw_series(net.into_iter().map(|l| PathElement::new(l, LINE.mix(0.3))))?;
        let outline = wedge(radii, angles);
        let outline: Vec<_> = outline.iter().chain(outline.first()).copied().collect();
        plane.draw_series([PathElement::new(outline, WHITE.stroke_width(2))])?;
        let count = match class {
            Class::Landed | Class::Rejected => format!("{}/{}", c.landed, c.trials),
            Class::Unsafe => format!("!{}/{}", c.unsafe_count(), c.trials),
        };
        labels.push((count, at(0.5 * (radii[0] + radii[1]), middle), fill));
    }
    let limit: Vec<_> = (grid.bearings())
        .flat_map(|from| {
            let r = grid.limit(cells, state, from).map_or(HUB, radius);
            arc(r, [from.to_radians() - half, from.to_radians() + half])
        })
        .collect();
    let closed: Vec<_> = limit.iter().chain(limit.first()).copied().collect();
    if grid.too_few().is_none() {
        plane.draw_series([PathElement::new(closed, LINE.stroke_width(3))])?;
    }
    for (label, place, back) in labels {
        // A plain background behind the count keeps the pattern from crossing it.
        let half_px = (3 * label.len() as i32 + 2, 7);
        let ground = Rectangle::new([(-half_px.0, -half_px.1), (half_px.0, half_px.1)], back.filled());
        let count = Text::new(label, (0, 0), text(11));
        plane.draw_series([EmptyElement::at(place) + ground + count])?;
    }
    let hull = [
        (0.0, 0.13),
        (0.045, 0.05),
        (0.045, -0.11),
        (-0.045, -0.11),
        (-0.045, 0.05),
    ];
    plane.draw_series([Polygon::new(hull.to_vec(), RGBColor(120, 120, 120))])?;
    let scale = grid
        .winds
        .iter()
        .map(|w| (format!("{w}"), at(radius(*w) + 0.03, half)));
    let bearings = grid
        .bearings()
        .map(|b| (format!("{b:.0}°"), at(1.1, b.to_radians())));
    let labels = scale
        .chain(bearings)
        .map(|(label, place)| Text::new(label, place, text(13)));
    plane.draw_series(labels)?;
    plane.draw_series([Text::new(EnvelopeGrid::sea_name(state), (0.0, 1.2), text(15))])?;
    Ok(())
}
