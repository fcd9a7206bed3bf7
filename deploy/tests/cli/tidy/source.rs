//! Sources and documents of the project, read into lines whose code, texts and comments are apart.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// Top folders of the sources.
pub(super) const ROOMS: [&str; 6] = ["shared", "bridge", "usv-side", "uav-side", "tests", "deploy"];

/// Kind of a character in a source.
#[derive(Clone, Copy)]
enum Part {
    Code,
    Text,
    Comment,
}

/// State of the lexer.
#[derive(Clone, Copy)]
enum State {
    Code,
    Comment,
    /// A comment in a block, and its depth.
    Block(usize),
    Text,
    /// A raw string, and the number of its `#`.
    Raw(usize),
}

impl State {
    /// The state after the first bytes of `rest`, their number and their kind.
    fn advance(self, before: char, rest: &str) -> (Self, usize, Part) {
        let one = rest.chars().next().map_or(0, char::len_utf8);
        match self {
            Self::Code => Self::begin(before, rest, one),
            Self::Comment if rest.starts_with('\n') => (Self::Code, 1, Part::Comment),
            Self::Block(depth) if rest.starts_with("/*") => (Self::Block(depth + 1), 2, Part::Comment),
            Self::Block(1) if rest.starts_with("*/") => (Self::Code, 2, Part::Comment),
            Self::Block(depth) if rest.starts_with("*/") => (Self::Block(depth - 1), 2, Part::Comment),
            Self::Comment | Self::Block(_) => (self, one, Part::Comment),
            Self::Text if rest.starts_with('\\') => {
                let two = rest.chars().take(2).map(char::len_utf8).sum();
                (self, two, Part::Text)
            }
            Self::Text if rest.starts_with('"') => (Self::Code, 1, Part::Text),
            Self::Raw(hashes) if is_raw_end(rest, hashes) => (Self::Code, hashes + 1, Part::Text),
            Self::Text | Self::Raw(_) => (self, one, Part::Text),
        }
    }

    /// [`Self::advance`] from the state of code.
    fn begin(before: char, rest: &str, one: usize) -> (Self, usize, Part) {
        if rest.starts_with("//") {
            return (Self::Comment, 2, Part::Comment);
        }
        if rest.starts_with("/*") {
            return (Self::Block(1), 2, Part::Comment);
        }
        if rest.starts_with('"') {
            return (Self::Text, 1, Part::Text);
        }
        if let Some((hashes, length)) = raw_start(rest).filter(|_| !is_name(before)) {
            return (Self::Raw(hashes), length, Part::Text);
        }
        match character(rest) {
            Some(length) => (Self::Code, length, Part::Text),
            None => (Self::Code, one, Part::Code),
        }
    }
}

/// Number of `#` and length of the beginning of a raw string.
fn raw_start(rest: &str) -> Option<(usize, usize)> {
    let after = rest.strip_prefix(['b', 'c']).unwrap_or(rest).strip_prefix('r')?;
    let string = after.trim_start_matches('#');
    let hashes = after.len() - string.len();
    string
        .starts_with('"')
        .then(|| (hashes, rest.len() - string.len() + 1))
}

fn is_raw_end(rest: &str, hashes: usize) -> bool {
    rest.strip_prefix('"')
        .is_some_and(|r| r.bytes().take_while(|b| *b == b'#').count() >= hashes)
}

/// Length of a character literal; none for a lifetime.
fn character(rest: &str) -> Option<usize> {
    let inner = rest.strip_prefix('\'')?;
    if inner.starts_with('\\') {
        return Some(rest.get(3..)?.find('\'')? + 4);
    }
    let mut chars = inner.chars();
    let length = chars.next()?.len_utf8();
    (chars.next() == Some('\'')).then_some(length + 2)
}

/// A line, its characters by kind.
#[derive(Default)]
pub(super) struct SourceLine {
    pub(super) code: String,
    pub(super) text: String,
    pub(super) comment: String,
}

fn lex(source: &str) -> Vec<SourceLine> {
    let (mut lines, mut line) = (Vec::new(), SourceLine::default());
    let (mut state, mut before, mut rest) = (State::Code, '\n', source);
    while !rest.is_empty() {
        let (next, length, part) = state.advance(before, rest);
        let (taken, remaining) = rest.split_at(length);
        for c in taken.chars() {
            match part {
                _ if c == '\n' => lines.push(std::mem::take(&mut line)),
                Part::Code => line.code.push(c),
                Part::Text => line.text.push(c),
                Part::Comment => line.comment.push(c),
            }
            before = c;
        }
        (state, rest) = (next, remaining);
    }
    if !source.ends_with('\n') {
        lines.push(line);
    }
    lines
}

/// A source or a document; each line of a document is a comment.
pub(super) struct SourceFile {
    pub(super) path: String,
    pub(super) room: Option<&'static str>,
    pub(super) is_rust: bool,
    pub(super) lines: Vec<SourceLine>,
}

impl SourceFile {
    pub(super) fn new(path: String, content: &str) -> Self {
        let is_rust = path.ends_with(".rs");
        let document = |l: &str| SourceLine {
            comment: l.to_owned(),
            ..SourceLine::default()
        };
        Self {
            room: ROOMS
                .into_iter()
                .find(|room| path.split('/').next() == Some(*room)),
            lines: if is_rust {
                lex(content)
            } else {
                content.lines().map(document).collect()
            },
            path,
            is_rust,
        }
    }
    /// `path:line`, from the index of the line.
    pub(super) fn place(&self, row: usize) -> String {
        format!("{}:{}", self.path, row + 1)
    }
    /// Lines that are neither blank nor comments alone.
    pub(super) fn code_lines(&self) -> usize {
        let is_code = |l: &&SourceLine| !(l.code.trim().is_empty() && l.text.trim().is_empty());
        self.lines.iter().filter(is_code).count()
    }
}

/// Sources and documents below `directory`, without what is built.
fn files(directory: &Path, found: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(directory).unwrap().flatten() {
        let (path, name) = (entry.path(), entry.file_name().into_string().unwrap());
        let is_built = name == "out" || name.starts_with("target");
        if name.starts_with('.') {
            continue;
        }
        if path.is_dir() {
            if !is_built {
                files(&path, found);
            }
        } else if name.ends_with(".rs") || name.ends_with(".md") {
            found.push(path);
        }
    }
}

pub(super) fn project() -> Vec<SourceFile> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let mut paths = Vec::new();
    files(&root, &mut paths);
    paths.sort();
    let read = |path: &PathBuf| {
        let content = std::fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
        let relative = path.strip_prefix(&root).unwrap();
        SourceFile::new(relative.to_str().unwrap().to_owned(), &content)
    };
    paths.iter().map(read).collect()
}

fn is_name(c: char) -> bool {
    c.is_alphanumeric() || c == '_'
}

/// The name at the beginning of `code`.
fn name(code: &str) -> &str {
    &code[..code.find(|c: char| !is_name(c)).unwrap_or(code.len())]
}

/// Index of the line that closes the first brace from a place on; none where `;` comes first.
fn closing(lines: &[SourceLine], row: usize, column: usize) -> Option<usize> {
    let (mut braces, mut inner) = (0, 0);
    for (k, line) in lines.iter().enumerate().skip(row) {
        let start = if k == row { column } else { 0 };
        for c in line.code[start..].chars() {
            match c {
                '(' | '[' => inner += 1,
                ')' | ']' => inner -= 1,
                ';' if braces == 0 && inner == 0 => return None,
                '{' => braces += 1,
                '}' => braces -= 1,
                _ => {}
            }
            if c == '}' && braces == 0 && inner == 0 {
                return Some(k);
            }
        }
    }
    None
}

/// Index of the first line, name and number of lines of each function with a body.
pub(super) fn functions(lines: &[SourceLine]) -> Vec<(usize, &str, usize)> {
    let mut found = Vec::new();
    for (row, line) in lines.iter().enumerate() {
        let named = |(k, keyword): (usize, &str)| {
            let is_whole = !line.code[..k].chars().next_back().is_some_and(is_name);
            let name = name(&line.code[k + keyword.len()..]);
            (is_whole && !name.is_empty()).then_some((k, name))
        };
        let Some((column, name)) = line.code.match_indices("fn ").find_map(named) else {
            continue;
        };
        if let Some(end) = closing(lines, row, column) {
            found.push((row, name, end + 1 - row));
        }
    }
    found
}

/// Name of the type that a line declares for other modules.
pub(super) fn public_type(code: &str) -> Option<&str> {
    let rest = code.trim_start().strip_prefix("pub")?;
    let rest = match rest.strip_prefix('(') {
        Some(inner) => inner.split_once(')')?.1,
        None => rest,
    };
    let (kind, rest) = rest.strip_prefix(' ')?.split_once(' ')?;
    let is_type = ["struct", "enum", "trait", "union", "type"].contains(&kind);
    is_type.then(|| name(rest)).filter(|n| !n.is_empty())
}

/// Keys of a file's configuration tables, each with the index of its line; fields that code outside the tables reads.
pub(super) fn keys(lines: &[SourceLine]) -> (Vec<(usize, &str)>, BTreeSet<&str>) {
    let (mut declared, mut read) = (Vec::new(), BTreeSet::new());
    let mut table_end = None;
    for (row, line) in lines.iter().enumerate() {
        if line.code.trim_end() == "config! {" {
            table_end = closing(lines, row, 0);
        }
        let code = line.code.trim();
        if table_end.is_some_and(|end| row <= end) {
            let field = code.strip_prefix("pub ").map(name).unwrap_or_default();
            if code
                .strip_prefix("pub ")
                .and_then(|c| c.strip_prefix(field))
                .is_some_and(|c| c.starts_with(':'))
            {
                declared.push((row, field));
            }
            continue;
        }
        // A field after a point, or alone in a line of a pattern.
        read.extend(code.split('.').skip(1).map(name));
        read.extend(code.strip_suffix(',').filter(|c| c.chars().all(is_name)));
    }
    (declared, read)
}

#[test]
fn lines_of_a_source_by_kind() {
    let source = "/// A doc.\nfn f<'a>() {\n    g('{', \"// }\\\"\", r#\"\"{\"#); // rest\n}\n\n/* one\n/* two */ */ x\n";
    let lines = lex(source);
    let code: Vec<&str> = lines.iter().map(|l| l.code.trim()).collect();
    assert_eq!(code, ["", "fn f<'a>() {", "g(, , );", "}", "", "", "x"]);
    assert_eq!(lines[2].text, "'{'\"// }\\\"\"r#\"\"{\"#");
    assert_eq!(functions(&lines), [(1, "f", 3)]);
    assert_eq!(SourceFile::new("shared/a.rs".into(), source).code_lines(), 4);
}
