//! A table's text: its encoding, where its header is and what separates its cells.

use std::borrow::Cow;

use csv::{ReaderBuilder, StringRecord, Trim};

use super::column::{self, Name};

/// Lines that may stand before the header.
const MAX_PREAMBLE: usize = 100;
/// What begins a remark.
const COMMENTS: [&str; 3] = ["#", "%", "//"];

/// What separates cells.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Delimiter {
    Comma,
    Semicolon,
    Tab,
    Bar,
    Spaces,
}

impl Delimiter {
    const ALL: [Delimiter; 5] = [
        Delimiter::Comma,
        Delimiter::Semicolon,
        Delimiter::Tab,
        Delimiter::Bar,
        Delimiter::Spaces,
    ];
    /// For people.
    pub(super) const fn name(self) -> &'static str {
        match self {
            Delimiter::Comma => "commas",
            Delimiter::Semicolon => "semicolons",
            Delimiter::Tab => "tabs",
            Delimiter::Bar => "vertical bars",
            Delimiter::Spaces => "spaces",
        }
    }
    const fn byte(self) -> u8 {
        match self {
            Delimiter::Comma => b',',
            Delimiter::Semicolon => b';',
            Delimiter::Tab | Delimiter::Spaces => b'\t',
            Delimiter::Bar => b'|',
        }
    }
    /// A reader of `text` without a header.
    pub(super) fn reader(self, text: &str) -> csv::Reader<&[u8]> {
        ReaderBuilder::new()
            .has_headers(false)
            .delimiter(self.byte())
            .trim(Trim::All)
            .flexible(true)
            .from_reader(text.as_bytes())
    }
    /// The text as [`Delimiter::reader`] takes it, line by line.
    pub(super) fn prepared(self, text: &str) -> Cow<'_, str> {
        if self != Delimiter::Spaces {
            return Cow::Borrowed(text);
        }
        let mut out = String::with_capacity(text.len());
        for line in text.split_inclusive('\n') {
            let mut words = line.split_whitespace();
            out.extend(words.next());
            words.for_each(|w| {
                out.push('\t');
                out += w;
            });
            out.push('\n');
        }
        Cow::Owned(out)
    }
    /// The cells of a line.
    fn cells(self, line: &str) -> Vec<String> {
        let text = self.prepared(line);
        let mut record = StringRecord::new();
        match self.reader(&text).read_record(&mut record) {
            Ok(true) => record.iter().map(str::to_owned).collect(),
            Ok(false) | Err(_) => Vec::new(),
        }
    }
}

/// The text of a file: UTF-8, UTF-16 behind its mark, or Latin-1, and what is to be said of it.
pub(super) fn decode(bytes: &[u8]) -> (Cow<'_, str>, Option<&'static str>) {
    let wide = |bytes: &[u8], unit: fn([u8; 2]) -> u16| {
        let units = bytes.as_chunks::<2>().0.iter().map(|b| unit(*b));
        char::decode_utf16(units)
            .map(|c| c.unwrap_or(char::REPLACEMENT_CHARACTER))
            .collect::<String>()
    };
    let (text, note) = match bytes {
        [0xff, 0xfe, rest @ ..] => (Cow::Owned(wide(rest, u16::from_le_bytes)), None),
        [0xfe, 0xff, rest @ ..] => (Cow::Owned(wide(rest, u16::from_be_bytes)), None),
        [0xef, 0xbb, 0xbf, rest @ ..] => latin(rest),
        _ => latin(bytes),
    };
    // The ends of lines of old computers.
    match text.contains('\r') && !text.contains('\n') {
        true => (Cow::Owned(text.replace('\r', "\n")), note),
        false => (text, note),
    }
}

fn latin(bytes: &[u8]) -> (Cow<'_, str>, Option<&'static str>) {
    match core::str::from_utf8(bytes) {
        Ok(text) => (Cow::Borrowed(text), None),
        Err(_) => (
            Cow::Owned(bytes.iter().map(|b| char::from(*b)).collect()),
            Some("the text is no UTF-8 and was read as Latin-1"),
        ),
    }
}

/// Where the rows are, and what their columns are called.
#[derive(Clone, Debug)]
pub(super) struct Layout {
    pub(super) delimiter: Delimiter,
    pub(super) names: Vec<String>,
    /// The header's line, counted from 1.
    pub(super) line: u64,
    /// Where the rows begin: the byte, and how many lines are before.
    pub(super) body: (usize, u64),
    pub(super) notes: Vec<String>,
}

/// What a remark says; None for a line that is none.
pub(super) fn comment(line: &str) -> Option<&str> {
    let line = line.trim_start();
    COMMENTS
        .iter()
        .find_map(|c| line.strip_prefix(c))
        .map(|l| l.trim_start_matches(['#', '%', '/', ' ']))
}

/// A way to read a line as a header.
struct Header {
    delimiter: Delimiter,
    names: Vec<String>,
    /// The time is among them.
    timed: bool,
    /// Other columns that are known, and those of them that state their unit.
    known: usize,
    stated: usize,
}

impl Header {
    /// The best way.
    fn of(line: &str) -> Header {
        let all = Delimiter::ALL.map(|delimiter| {
            let names = delimiter.cells(line);
            let read: Vec<Name> = names.iter().map(|c| column::name(c)).collect();
            Header {
                delimiter,
                names,
                timed: read.iter().any(|n| matches!(n, Name::Time(_))),
                known: read
                    .iter()
                    .filter(|n| n.is_known() && !matches!(n, Name::Time(_)))
                    .count(),
                stated: read.iter().filter(|n| matches!(n, Name::Quantity(_, _))).count(),
            }
        });
        let rank = |h: &Header| (h.timed, h.stated, h.known, h.names.len().min(2));
        let [first, rest @ ..] = all;
        rest.into_iter()
            .fold(first, |best, h| if rank(&h) > rank(&best) { h } else { best })
    }
    /// A time and something else with its unit.
    fn is_certain(&self) -> bool {
        self.timed && self.stated > 0
    }
    /// A time and something else, and no sentence in which they are mentioned.
    fn is_likely(&self) -> bool {
        let others = self.names.len() > self.known + 1;
        let prose = self.delimiter == Delimiter::Spaces && others;
        self.timed && self.known > 0 && !prose
    }
}

/// Lines that may be the header, with their numbers and where they end.
fn lines(text: &str) -> impl Iterator<Item = (u64, &str, usize)> {
    let mut end = 0;
    let numbered = text.split_inclusive('\n').zip(1_u64..).map(move |(line, n)| {
        end += line.len();
        (n, line, end)
    });
    numbered
        .filter(|(_, l, _)| !l.trim().is_empty())
        .take(MAX_PREAMBLE)
}

/// The header, with its line, where that ends, and whether it is in a remark.
fn header(text: &str) -> Option<(Header, u64, usize, bool)> {
    let of = |(n, line, end): (u64, &str, usize)| {
        let remark = comment(line);
        (Header::of(remark.unwrap_or(line)), n, end, remark.is_some())
    };
    let certain = lines(text).map(of).find(|h| h.0.is_certain());
    certain.or_else(|| lines(text).map(of).find(|h| h.0.is_likely()))
}

/// There is a header: a time and something that is read.
pub(super) fn has_header(text: &str) -> bool {
    header(text).is_some()
}

/// Finds the header. Where no line is one, the first line that is no remark is taken, for what is wrong with it.
pub(super) fn layout(text: &str) -> Layout {
    let first = || {
        let (n, line, end) = lines(text).find(|(_, l, _)| comment(l).is_none())?;
        Some((Header::of(line), n, end, false))
    };
    let (delimiter, names, line, end, remark) = match header(text).or_else(first) {
        Some((h, line, end, remark)) => (h.delimiter, h.names, line, end, remark),
        None => (Delimiter::Comma, Vec::new(), 1, text.len(), false),
    };
    let mut layout = Layout {
        delimiter,
        names,
        line,
        body: (end, line),
        notes: Vec::new(),
    };
    let before: Vec<&str> = lines(text)
        .take_while(|(n, _, _)| *n < line)
        .map(|(_, l, _)| l)
        .collect();
    let passed_over = before
        .iter()
        .filter(|l| comment(l).is_none() && !is_separator_line(l))
        .count();
    if passed_over > 0 {
        layout.notes.push(format!(
            "{passed_over} lines before the header, which is line {line}, were passed over"
        ));
    }
    if remark {
        layout
            .notes
            .push(format!("the header is the remark in line {line}"));
    }
    if delimiter != Delimiter::Comma {
        layout
            .notes
            .push(format!("its cells are separated by {}", delimiter.name()));
    }
    layout.take_units(text);
    layout
}

/// `sep=;`, by which a spreadsheet is recognised.
fn is_separator_line(line: &str) -> bool {
    line.trim()
        .trim_matches('"')
        .to_ascii_lowercase()
        .starts_with("sep=")
}

impl Layout {
    /// Units in a line of their own below the names.
    fn take_units(&mut self, text: &str) {
        let next = lines(text).find(|(n, _, _)| *n > self.line);
        let Some((n, line, end)) = next.filter(|(_, l, _)| comment(l).is_none()) else {
            return;
        };
        let units = self.delimiter.cells(line);
        let bare = |u: &str| u.trim_matches(['[', ']', '(', ')', ' ']).to_owned();
        let is_value = |u: &String| u.bytes().any(|b| b.is_ascii_digit()) && !u.contains('/');
        if units.len() != self.names.len() || units.iter().any(is_value) {
            return;
        }
        let with: Vec<String> = self
            .names
            .iter()
            .zip(&units)
            .map(|(name, unit)| match bare(unit).as_str() {
                "" => name.clone(),
                unit => format!("{name} [{unit}]"),
            })
            .collect();
        let stated = |name: &String| matches!(column::name(name), Name::Quantity(_, _) | Name::Time(Some(_)));
        let more =
            with.iter().filter(|n| stated(n)).count() > self.names.iter().filter(|n| stated(n)).count();
        if more {
            self.names = with;
            self.body = (end, n);
            self.notes.push(format!("the units are those of line {n}"));
        }
    }
}
