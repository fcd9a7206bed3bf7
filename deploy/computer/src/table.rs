//! Tables for a terminal.

use std::{
    fmt::{Display, Write as _},
    io::IsTerminal,
    ops::RangeBounds,
};

use crate::terminal::WIDTH;

/// Text of a cell.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Cell(String);

impl<T: Display> From<T> for Cell {
    fn from(value: T) -> Cell {
        Cell(value.to_string())
    }
}

impl From<&Cell> for Cell {
    fn from(cell: &Cell) -> Cell {
        cell.clone()
    }
}

impl Cell {
    pub fn number(value: impl Into<Option<f64>>, digits: usize) -> Cell {
        number(value, digits).into()
    }
    /// Adds a note in brackets, unless it is empty.
    pub fn note(mut self, note: impl Display) -> Cell {
        let note = note.to_string();
        if !note.is_empty() {
            self.0 += &format!(" ({note})");
        }
        self
    }
}

#[macro_export]
macro_rules! cells {
    ($($value:expr),* $(,)?) => { [$($crate::table::Cell::from(&$value)),*] };
}

/// Table with text left-aligned and numbers right-aligned.
#[derive(Clone, Debug, Default)]
pub struct Table {
    heads: Vec<String>,
    is_number: Vec<bool>,
    rows: Vec<Vec<Cell>>,
}

impl Table {
    /// Table with these headings and no rows; `numbers` are the columns that contain numbers.
    pub fn new<H: Display>(numbers: impl RangeBounds<usize>, heads: impl IntoIterator<Item = H>) -> Table {
        let heads: Vec<String> = heads.into_iter().map(|h| h.to_string()).collect();
        Table {
            is_number: (0..heads.len()).map(|k| numbers.contains(&k)).collect(),
            heads,
            rows: Vec::new(),
        }
    }
    pub fn row(&mut self, cells: impl IntoIterator<Item = Cell>) {
        self.rows.push(cells.into_iter().collect());
    }
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }
    /// Text for a terminal: one line per row, columns as wide as their longest cell. Columns beyond the terminal's
    /// width follow in further blocks, each of which repeats the columns before the first number.
    pub fn text(&self) -> String {
        let lines: Vec<Vec<String>> = core::iter::once(self.heads.clone())
            .chain(self.rows.iter().map(|r| r.iter().map(|c| c.0.clone()).collect()))
            .collect();
        let mut widths = vec![0; self.heads.len()];
        for line in &lines {
            for (width, cell) in widths.iter_mut().zip(line) {
                *width = cell.chars().count().max(*width);
            }
        }
        let names = self.is_number.iter().take_while(|is| !**is).count().max(1);
        let named = widths.iter().take(names).map(|width| width + 2).sum::<usize>();
        let mut block = 0;
        let mut used = named;
        // Block of each column; None: the column is in every block.
        let blocks = widths.iter().enumerate().map(|(k, width)| {
            let own = width + 2;
            if k > names && used + own > WIDTH {
                block += 1;
                used = named;
            }
            used += if k < names { 0 } else { own };
            (k >= names).then_some(block)
        });
        let blocks: Vec<Option<usize>> = blocks.collect();
        let mut out = String::new();
        for (b, line) in (0..=block).flat_map(|b| lines.iter().map(move |line| (b, line))) {
            let mut text = String::new();
            let columns = line.iter().zip(&widths).zip(&self.is_number).zip(&blocks);
            for (((cell, width), is_number), _) in columns.filter(|(_, of)| of.is_none_or(|of| of == b)) {
                let _ = if *is_number {
                    write!(text, "  {cell:>width$}")
                } else {
                    write!(text, "  {cell:<width$}")
                };
            }
            let _ = writeln!(out, "{}", text.trim_end());
        }
        out
    }
}

pub fn number(value: impl Into<Option<f64>>, digits: usize) -> String {
    let finite = value.into().filter(|v| v.is_finite());
    finite.map_or_else(|| "-".into(), |v| format!("{v:.digits$}"))
}

#[derive(Clone, Copy, Debug)]
pub enum Colour {
    Red = 31,
    Green = 32,
    Yellow = 33,
}

impl Colour {
    /// Bold text in this colour on a terminal without NO_COLOR; otherwise plain.
    pub fn bold(self, text: &str) -> String {
        let forbidden = std::env::var_os("NO_COLOR").is_some_and(|v| !v.is_empty());
        self.written(text, std::io::stdout().is_terminal() && !forbidden)
    }
    fn written(self, text: &str, coloured: bool) -> String {
        if !coloured {
            return text.into();
        }
        format!("\x1b[1;{}m{text}\x1b[0m", self as u8)
    }
}

pub fn verdict(text: &str, good: bool) -> String {
    let colour = if good { Colour::Green } else { Colour::Red };
    colour.bold(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn table_on_a_terminal() {
        let mut table = Table::new(1.., ["sea", "error m"]);
        table.row(cells!["a<b", Cell::number(0.25, 2).note("p95 0.30")]);
        table.row(cells!["calm", Cell::number(None, 2)]);
        assert_eq!(
            table.text(),
            "  sea           error m\n  a<b   0.25 (p95 0.30)\n  calm                -\n"
        );
    }

    #[test]
    fn wide_table_in_blocks_of_a_terminal() {
        let mut table = Table::new(1.., ["sea", &"v".repeat(40), &"w".repeat(40)]);
        table.row(cells!["calm", 1, 2]);
        let text = table.text().replace(['v', 'w', ' '], "");
        assert_eq!(text, "sea\ncalm1\nsea\ncalm2\n");
    }

    #[test]
    fn colour_of_a_terminal_only() {
        assert_eq!(Colour::Red.written("UNSAFE", true), "\x1b[1;31mUNSAFE\x1b[0m");
        assert_eq!(Colour::Red.written("UNSAFE", false), "UNSAFE");
    }
}
