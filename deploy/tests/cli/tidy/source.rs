//! Sources and documents of the project, as lines with code, string literals and comments separated.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

pub(super) const ROOMS: [&str; 6] = ["shared", "bridge", "usv-side", "uav-side", "tests", "deploy"];

#[derive(Default)]
pub(super) struct SourceLine {
    pub(super) code: String,
    pub(super) text: String,
    pub(super) comment: String,
}

/// Splits a source into lines. A string literal continues on the next line only after a backslash; the lines of a raw
/// string count as code.
fn lex(source: &str) -> Vec<SourceLine> {
    let mut is_text = false;
    let line = |line: &str| {
        let mut found = SourceLine::default();
        // Removes quotes that neither begin nor end a literal.
        let line = ["\\\\", "\\\"", "'\"'"]
            .iter()
            .fold(line.to_owned(), |line, quote| line.replace(quote, " "));
        let mut rest = line.as_str();
        loop {
            if is_text {
                let end = rest.find('"').unwrap_or(rest.len());
                found.text += &rest[..end];
                is_text = end == rest.len() && rest.ends_with('\\');
                rest = rest.get(end + 1..).unwrap_or_default();
            }
            let (quote, comment) = (rest.find('"'), rest.find("//").unwrap_or(rest.len()));
            let Some(quote) = quote.filter(|quote| *quote < comment) else {
                found.code += &rest[..comment];
                found.comment += &rest[comment..];
                return found;
            };
            found.code += &rest[..quote];
            rest = &rest[quote + 1..];
            is_text = true;
        }
    };
    source.lines().map(line).collect()
}

/// Source or document; every line of a document counts as a comment.
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
    /// Number of lines that are neither blank nor only a comment.
    pub(super) fn code_lines(&self) -> usize {
        let is_code = |l: &&SourceLine| !(l.code.trim().is_empty() && l.text.trim().is_empty());
        self.lines.iter().filter(is_code).count()
    }
}

/// Collects sources and documents below `directory`, without build output.
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

fn name(code: &str) -> &str {
    &code[..code.find(|c: char| !is_name(c)).unwrap_or(code.len())]
}

/// Keys of the file's configuration tables, each with the index of its line; and the fields that code outside the
/// tables reads.
pub(super) fn keys(lines: &[SourceLine]) -> (Vec<(usize, &str)>, BTreeSet<&str>) {
    let (mut declared, mut read) = (Vec::new(), BTreeSet::new());
    let mut is_table = false;
    for (row, line) in lines.iter().enumerate() {
        is_table = (is_table && line.code != "}") || line.code.trim_end() == "config! {";
        let code = line.code.trim();
        if is_table {
            let field = code.strip_prefix("pub ").and_then(|c| c.split_once(':'));
            declared.extend(
                field
                    .map(|(key, _)| (row, key))
                    .filter(|(_, key)| key.chars().all(is_name)),
            );
            continue;
        }
        // A field after a dot, or alone on a line of a pattern.
        read.extend(code.split('.').skip(1).map(name));
        read.extend(code.strip_suffix(',').filter(|c| c.chars().all(is_name)));
    }
    (declared, read)
}

#[test]
fn lines_of_a_source_by_kind() {
    let source = "/// A doc.\nfn f<'a>() {\n    g('\"', \"// \\\"a \\\n    b\", c); // rest\n}\n\nconfig! {\n    pub key: f64 = 1.0;\n}\n";
    let lines = lex(source);
    let code: Vec<&str> = lines.iter().map(|l| l.code.trim()).collect();
    let table = ["config! {", "pub key: f64 = 1.0;", "}"];
    assert_eq!(code[..6], ["", "fn f<'a>() {", "g( ,", ", c);", "}", ""]);
    assert_eq!(code[6..], table);
    assert_eq!(
        (lines[2].text.as_str(), lines[3].comment.as_str()),
        ("//  a \\", "// rest")
    );
    assert_eq!(SourceFile::new("shared/a.rs".into(), source).code_lines(), 7);
    assert_eq!(keys(&lines).0, [(7, "key")]);
}
