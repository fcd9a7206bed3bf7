//! `alight tag`: the deck's tags as a list for the configuration and as sheets to print.

use std::path::{Path, PathBuf};

use alight_computer::{
    config::DroneComputerConfig,
    exit::{CliError, Doing, Exit},
    subject::SHIPPED,
    terminal,
};
use alight_shared::{
    config,
    geometry::DeckGeometry,
    tags::{DeckTag, MARGIN, Tags, of_vessel, suggested},
};
use alight_uav::camera::layout::{CELLS, cells, faults};
use clap::{Args, ValueEnum};
use pdf_writer::{Content, Finish, Name, Pdf, Rect, Ref, Str};

/// Tags of the deck.
#[derive(Args, Debug)]
pub struct TagArgs {
    /// Configuration of the drone's computer, for vessel, deck and tags [default: /etc/alight/drone.toml]
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Use the shipped configuration's deck instead of this computer's; other boats may use the same tag numbers
    #[arg(long, conflicts_with = "config")]
    pub shipped: bool,
    /// Use the tags suggested for the deck's size instead of the configured tags
    #[arg(long)]
    pub suggest: bool,
    /// Number of the vessel, which determines the numbers of its tags [default: with --suggest the configuration's]
    #[arg(long, value_name = "N")]
    pub vessel: Option<u32>,
    /// Write printable sheets of the tags at true scale, and a drawing of the deck with their positions
    #[arg(long, value_name = "FILE")]
    pub pdf: Option<PathBuf>,
    /// Paper of the sheets; larger tags are cut into tiles
    #[arg(long, value_enum, default_value = "a4")]
    pub paper: Paper,
}

/// Portrait paper size of ISO 216.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Paper {
    A0,
    A1,
    A2,
    A3,
    A4,
}

impl Paper {
    fn size_mm(self) -> [f64; 2] {
        match self {
            Paper::A0 => [841.0, 1189.0],
            Paper::A1 => [594.0, 841.0],
            Paper::A2 => [420.0, 594.0],
            Paper::A3 => [297.0, 420.0],
            Paper::A4 => [210.0, 297.0],
        }
    }
}

/// Selected configuration and its source; `installed` is the path of this computer's.
fn selected(args: &TagArgs, installed: &Path) -> Result<(DroneComputerConfig, String), CliError> {
    if args.shipped {
        return Ok((DroneComputerConfig::default(), "the shipped configuration".into()));
    }
    let path = match &args.config {
        Some(path) => path.as_path(),
        // An unreadable file is not missing: reading it fails with the reason.
        None if installed.try_exists().unwrap_or(true) => installed,
        None => {
            return Err(CliError(format!(
                "this computer has no {}, which names the tags: name the drone's configuration with --config (alight init \
                 writes one); --shipped takes the shipped deck's tags, whose numbers any boat may have",
                installed.display()
            )));
        }
    };
    Ok((config::load(path)?, path.display().to_string()))
}

pub fn run(args: &TagArgs) -> Result<Exit, CliError> {
    let [_, installed] = SHIPPED.map(Path::new);
    let (computer, from) = selected(args, installed)?;
    let drone = computer.drone;
    let deck = drone.deck;
    let tags = if args.suggest {
        suggested(deck.length_m, deck.width_m)
    } else {
        drone.tags()
    };
    // Printed tags keep their numbers unless others are requested.
    let configured = computer.bridge.vessel_id;
    let numbered = args.vessel.or(args.suggest.then_some(configured));
    let tags = numbered.map_or(tags, |vessel| of_vessel(&tags, vessel));
    let whose = format!("Vessel {}, {}", numbered.unwrap_or(configured), numbers(&tags));
    terminal::note(true, format!("alight tag: {whose}, by {from}"));
    terminal::line(listed(&tags));
    for fault in faults(&tags, &deck) {
        terminal::note(true, format!("alight tag: {fault}"));
    }
    if let Some(path) = &args.pdf {
        let (bytes, pages) = Sheets::print(&whose, &deck, &tags, args.paper);
        std::fs::write(path, bytes).doing(format!("writing {}", path.display()))?;
        let text = format!(
            "{}: {pages} pages. Print at 100 %, without fitting to the page.",
            path.display()
        );
        terminal::note(true, text);
    }
    Ok(Exit::Success)
}

fn numbers(tags: &[DeckTag]) -> String {
    let ids = || tags.iter().map(|tag| tag.id);
    match (tags.len(), ids().min(), ids().max()) {
        (1, Some(id), _) => format!("tag {id}"),
        (count, Some(smallest), Some(largest)) => format!("{count} tags {smallest} to {largest}"),
        (_, _, _) => "no tags".into(),
    }
}

pub fn row(t: &DeckTag) -> String {
    let DeckTag {
        id,
        side_m,
        centre_m: [x, y, z],
    } = t;
    format!("  {{ id = {id}, side_m = {side_m:?}, centre_m = [{x:?}, {y:?}, {z:?}] }},\n")
}

fn listed(tags: &[DeckTag]) -> String {
    let rows: String = tags.iter().map(row).collect();
    format!("[drone.deck]\ntags = [\n{rows}]")
}

const POINTS_PER_MM: f64 = 72.0 / 25.4;
/// Room around a tile for its marks and legend, mm; printers leave 5 mm blank.
const BORDER_MM: f64 = 15.0;
/// Length of cutting marks, mm, and their distance from the corner.
const MARK_MM: [f64; 2] = [5.0, 1.0];
const FONT: Name = Name(b"F");

/// Page in mm from its lower left corner.
struct Page {
    content: Content,
    paper_mm: [f64; 2],
}

impl Page {
    fn new(paper: Paper) -> Page {
        let mut content = Content::new();
        let scale = POINTS_PER_MM as f32;
        content
            .transform([scale, 0.0, 0.0, scale, 0.0, 0.0])
            .set_line_width(0.2);
        Page {
            content,
            paper_mm: paper.size_mm(),
        }
    }
    fn text(&mut self, x: f64, y: f64, height_mm: f64, text: &str) {
        self.content.begin_text().set_font(FONT, height_mm as f32);
        self.content
            .next_line(x as f32, y as f32)
            .show(Str(text.as_bytes()));
        self.content.end_text();
    }
    fn line(&mut self, [x0, y0]: [f64; 2], [x1, y1]: [f64; 2]) {
        self.content
            .move_to(x0 as f32, y0 as f32)
            .line_to(x1 as f32, y1 as f32)
            .stroke();
    }
    fn rectangle(&mut self, x: f64, y: f64, width: f64, height: f64) -> &mut Content {
        self.content.rect(x as f32, y as f32, width as f32, height as f32)
    }
    /// Draws a tag with its margin; its lower left corner is at `x`, `y` and its upper edge points forward.
    fn tag(&mut self, tag: &DeckTag, x: f64, y: f64, scale: f64) {
        let cell = 1e3 * tag.side_m / 8.0 * scale;
        let Some(cells) = cells(tag.id) else { return };
        // White cells on one black square avoid gaps between adjacent black cells.
        self.content.set_fill_gray(0.0);
        self.rectangle(x + cell, y + cell, 8.0 * cell, 8.0 * cell)
            .fill_nonzero();
        self.content.set_fill_gray(1.0);
        for (row, whites) in cells.iter().enumerate().skip(1).take(CELLS - 2) {
            for (column, _) in whites
                .iter()
                .enumerate()
                .skip(1)
                .take(CELLS - 2)
                .filter(|(_, white)| **white)
            {
                let (x, y) = (x + column as f64 * cell, y + (CELLS - 1 - row) as f64 * cell);
                self.rectangle(x, y, cell, cell).fill_nonzero();
            }
        }
        self.content.set_fill_gray(0.0);
    }
    /// Draws a line of 100 mm, which shows whether the printer kept the scale.
    fn ruler(&mut self) {
        let y = 4.0;
        self.line([BORDER_MM, y], [BORDER_MM + 100.0, y]);
        for x in [0.0, 100.0] {
            self.line([BORDER_MM + x, y - 1.5], [BORDER_MM + x, y + 1.5]);
        }
        self.text(BORDER_MM + 102.0, y - 1.0, 3.0, "100 mm");
    }
}

struct Sheets {
    /// Vessel and tag numbers, printed on every sheet.
    whose: String,
    paper: Paper,
    pages: Vec<Page>,
}

impl Sheets {
    fn print(whose: &str, deck: &DeckGeometry, tags: &Tags, paper: Paper) -> (Vec<u8>, usize) {
        let mut sheets = Sheets {
            whose: whose.into(),
            paper,
            pages: Vec::new(),
        };
        sheets.overview(deck, tags);
        tags.iter().for_each(|tag| sheets.tiles(tag));
        let pages = sheets.pages.len();
        (sheets.finish(), pages)
    }
    /// Draws the deck from above, forward up, and the table of its tags.
    fn overview(&mut self, deck: &DeckGeometry, tags: &[DeckTag]) {
        let mut page = Page::new(self.paper);
        let [width, height] = page.paper_mm;
        let (length_mm, across_mm) = (1e3 * deck.length_m, 1e3 * deck.width_m);
        let table = 5.0 * (tags.len() + 3) as f64;
        let room = [width - 2.0 * BORDER_MM, height - 3.0 * BORDER_MM - table];
        let scale = (room[0] / across_mm).min(room[1] / length_mm);
        let (cx, cy) = (0.5 * width, height - 2.0 * BORDER_MM - 0.5 * length_mm * scale);
        let mut y = height - BORDER_MM;
        let title = format!(
            "{}: deck {length_mm:.0} x {across_mm:.0} mm from above, scale 1 : {:.1}; forward is up",
            self.whose,
            1.0 / scale
        );
        page.text(BORDER_MM, y, 3.5, &title);
        let (x0, y0) = (cx - 0.5 * across_mm * scale, cy - 0.5 * length_mm * scale);
        page.rectangle(x0, y0, across_mm * scale, length_mm * scale)
            .stroke();
        for [from, to] in [
            [[x0, cy], [x0 + across_mm * scale, cy]],
            [[cx, y0], [cx, y0 + length_mm * scale]],
        ] {
            page.content.set_dash_pattern([2.0, 2.0], 0.0);
            page.line(from, to);
            page.content.set_dash_pattern([], 0.0);
        }
        y = y0 - 8.0;
        page.text(
            BORDER_MM,
            y,
            3.0,
            "id, family 36h11: black side (with white margin), centre from the deck's centre, mm",
        );
        for tag in tags {
            let side = 1e3 * tag.side_m * MARGIN * scale;
            let [forward, right, _] = tag.centre_m.map(|v| 1e3 * v);
            let (x, below) = (cx + right * scale - 0.5 * side, cy + forward * scale - 0.5 * side);
            page.content.set_fill_gray(1.0);
            page.rectangle(x, below, side, side).fill_nonzero();
            page.tag(tag, x, below, scale);
            page.rectangle(x, below, side, side).stroke();
            page.text(x + 0.3, below + side + 0.3, 2.5, &format!("{}", tag.id));
            y -= 5.0;
            let (side, whole) = (1e3 * tag.side_m, 1e3 * tag.side_m * MARGIN);
            let row = format!(
                "{}:  {side:.1} ({whole:.1}),  forward {forward:.0}, right {right:.0}",
                tag.id
            );
            page.text(BORDER_MM, y, 3.0, &row);
        }
        page.ruler();
        self.pages.push(page);
    }
    /// Draws a tag at true scale in as many tiles as it needs, from its upper left corner.
    fn tiles(&mut self, tag: &DeckTag) {
        let whole = 1e3 * tag.side_m * MARGIN;
        let paper_mm = self.paper.size_mm();
        let [columns, rows] = paper_mm.map(|mm| (whole / (mm - 2.0 * BORDER_MM)).ceil().max(1.0) as usize);
        let (width, height) = (whole / columns as f64, whole / rows as f64);
        for (row, column) in (0..rows).flat_map(|row| (0..columns).map(move |column| (row, column))) {
            let mut page = Page::new(self.paper);
            let (x, y) = (0.5 * (paper_mm[0] - width), 0.5 * (paper_mm[1] - height));
            page.content.save_state();
            page.rectangle(x, y, width, height).clip_nonzero().end_path();
            let below = (rows - 1 - row) as f64 * height;
            page.tag(tag, x - column as f64 * width, y - below, 1.0);
            page.content.restore_state();
            let [length, apart] = MARK_MM;
            for (corner_x, out_x) in [(x, -1.0), (x + width, 1.0)] {
                for (corner_y, out_y) in [(y, -1.0), (y + height, 1.0)] {
                    let from = [corner_x + out_x * apart, corner_y + out_y * apart];
                    page.line([from[0], corner_y], [from[0] + out_x * length, corner_y]);
                    page.line([corner_x, from[1]], [corner_x, from[1] + out_y * length]);
                }
            }
            let legend = format!(
                "Tag {} of 36h11, black side {:.1} mm; row {} of {rows}, column {} of {columns}; this edge forward",
                tag.id,
                1e3 * tag.side_m,
                row + 1,
                column + 1
            );
            page.text(BORDER_MM, y + height + MARK_MM[0] + 3.0, 3.0, &legend);
            page.text(BORDER_MM, y - MARK_MM[0] - 4.0, 3.0, &self.whose);
            page.ruler();
            self.pages.push(page);
        }
    }
    fn finish(self) -> Vec<u8> {
        let mut pdf = Pdf::new();
        let mut refs = (1..).map(Ref::new);
        let mut next = || refs.next().unwrap_or(Ref::new(1));
        let (catalog, tree, font) = (next(), next(), next());
        pdf.catalog(catalog).pages(tree);
        pdf.type1_font(font).base_font(Name(b"Helvetica"));
        let mut kids = Vec::with_capacity(self.pages.len());
        for page in self.pages {
            let (id, content) = (next(), next());
            let [width, height] = page.paper_mm.map(|mm| (mm * POINTS_PER_MM) as f32);
            let mut leaf = pdf.page(id);
            leaf.parent(tree)
                .media_box(Rect::new(0.0, 0.0, width, height))
                .contents(content);
            leaf.resources().fonts().pair(FONT, font);
            leaf.finish();
            pdf.stream(content, &page.content.finish());
            kids.push(id);
        }
        let count = i32::try_from(kids.len()).unwrap_or(i32::MAX);
        pdf.pages(tree).kids(kids).count(count);
        pdf.finish()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tag_list_of_the_shipped_configuration() {
        let tags = DeckGeometry::default().tags();
        let shipped: DroneComputerConfig =
            config::parse(include_str!("../../../drone/drone.toml"), "shipped").unwrap();
        assert_eq!(*shipped.drone.tags(), *tags);
        let read: DroneComputerConfig = config::parse(&listed(&tags), "list").unwrap();
        assert_eq!(*read.drone.tags(), *tags);
    }

    fn written(sheets: (Vec<u8>, usize)) -> String {
        String::from_utf8_lossy(&sheets.0).into_owned()
    }

    #[test]
    fn tags_of_this_computer() {
        let directory = std::env::temp_dir().join(format!("alight-tag-{}", std::process::id()));
        std::fs::create_dir_all(&directory).unwrap();
        let installed = directory.join("drone.toml");
        let args = |config: Option<&Path>, shipped| TagArgs {
            config: config.map(Path::to_path_buf),
            shipped,
            suggest: false,
            vessel: None,
            pdf: None,
            paper: Paper::A4,
        };
        let first = |args: &TagArgs| selected(args, &installed).map(|(c, _)| c.drone.tags()[0].id);
        let why = first(&args(None, false)).unwrap_err().to_string();
        assert!(why.contains("--config") && why.contains("--shipped"), "{why}");
        assert_eq!(first(&args(None, true)).unwrap(), 0);
        let tags = of_vessel(&suggested(2.5, 1.7), 1);
        std::fs::write(&installed, listed(&tags)).unwrap();
        assert_eq!(first(&args(None, false)).unwrap(), 48);
        assert_eq!(first(&args(None, true)).unwrap(), 0);
        assert_eq!(first(&args(Some(installed.as_path()), false)).unwrap(), 48);
        std::fs::remove_dir_all(&directory).unwrap();
    }

    #[test]
    fn sheets_name_vessel_numbers_and_size() {
        let tags = of_vessel(&suggested(2.5, 1.7), 1);
        let whose = format!("Vessel 1, {}", numbers(&tags));
        assert_eq!(whose, "Vessel 1, 11 tags 48 to 58");
        let sheets = Sheets::print(&whose, &DeckGeometry::default(), &tags, Paper::A0);
        let pages = sheets.1;
        let text = written(sheets);
        assert_eq!(text.matches("Vessel 1, 11 tags 48 to 58").count(), pages);
        for tag in tags.iter() {
            let own = format!("Tag {} of 36h11, black side {:.1} mm", tag.id, 1e3 * tag.side_m);
            assert!(text.contains(&own), "{own}");
        }
        assert_eq!(numbers(&[]), "no tags");
    }

    #[test]
    fn tag_sheets_at_true_scale() {
        let deck = DeckGeometry::default();
        let one = |side_m| {
            Tags::filled([DeckTag {
                side_m,
                ..DeckTag::default()
            }])
        };
        // A tag of 125 mm fits on A4; one of 1 m takes 6 x 4 tiles of 180 x 267 mm on A4, and 2 x 1 on A0.
        for (side_m, paper, tiles) in [(0.1, Paper::A4, 1), (0.8, Paper::A4, 24), (0.8, Paper::A0, 2)] {
            let (bytes, pages) = Sheets::print("Vessel 1", &deck, &one(side_m), paper);
            assert_eq!(pages, 1 + tiles, "{side_m} m on {paper:?}");
            let text = String::from_utf8_lossy(&bytes);
            assert!(text.starts_with("%PDF-") && text.contains("/Count "), "{side_m}");
        }
        // Width of the black square in the tile's own millimetres.
        let (bytes, _) = Sheets::print("Vessel 1", &deck, &one(0.1), Paper::A4);
        assert!(String::from_utf8_lossy(&bytes).contains(" 100 100 re"));
    }
}
