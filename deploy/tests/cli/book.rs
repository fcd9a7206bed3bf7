//! Documents: every page is in the table of contents, every link leads to a file and a heading, and the total length
//! is limited.

use std::{
    fs,
    path::{Path, PathBuf},
};

use alight_shared::{
    autopilot_parameters::{PARAMETERS, Severity, Wanted},
    wire,
};

const MAX_PAGES: usize = 22;
const MAX_WORDS: usize = 28_000;
const MAX_PAGE_WORDS: usize = 2500;

pub(crate) fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

pub(crate) fn read(path: &Path) -> String {
    fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

/// Files below `directory` with these endings, without build output.
pub(crate) fn files(directory: &Path, endings: &[&str]) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in fs::read_dir(directory).unwrap().flatten() {
        let path = entry.path();
        let name = entry.file_name().into_string().unwrap();
        if path.is_dir() && name != "target" && !name.starts_with('.') {
            found.extend(files(&path, endings));
        } else if endings.iter().any(|e| name.ends_with(e)) {
            found.push(path);
        }
    }
    found
}

fn links(text: &str) -> impl Iterator<Item = &str> {
    text.split("](").skip(1).filter_map(|rest| rest.split(')').next())
}

/// Anchors of the headings, as GitHub and mdbook form them.
fn anchors(text: &str) -> impl Iterator<Item = String> {
    let headings = text.lines().filter(|l| l.starts_with('#'));
    headings.map(|l| {
        let title = l.trim_start_matches('#').trim().to_lowercase();
        let kept = title
            .chars()
            .filter(|c| c.is_alphanumeric() || " -_".contains(*c));
        kept.map(|c| if c == ' ' { '-' } else { c }).collect::<String>()
    })
}

#[test]
fn book_size() {
    let mut pages = 0;
    let mut all = 0;
    for page in files(&root(), &[".md"]) {
        let words = read(&page).split_whitespace().count();
        assert!(words <= MAX_PAGE_WORDS, "{}: {words} words", page.display());
        pages += 1;
        all += words;
    }
    assert!(
        pages <= MAX_PAGES && all <= MAX_WORDS,
        "{pages} pages, {all} words: shorten or merge pages"
    );
}

#[test]
fn book_contents() {
    let docs = root().join("deploy/docs");
    let summary = read(&docs.join("SUMMARY.md"));
    let listed: Vec<PathBuf> = links(&summary).map(|l| docs.join(l)).collect();
    for page in files(&docs, &[".md"]) {
        let is_listed = listed.contains(&page) || page.ends_with("SUMMARY.md");
        assert!(is_listed, "{} is not in SUMMARY.md", page.display());
    }
}

#[test]
fn book_relative_links() {
    for page in files(&root(), &[".md"]) {
        for link in links(&read(&page)).filter(|l| !l.contains("://")) {
            let (path, anchor) = link.split_once('#').unwrap_or((link, ""));
            let target = if path.is_empty() {
                page.clone()
            } else {
                page.parent().unwrap().join(path)
            };
            assert!(target.exists(), "{}: {link} leads nowhere", page.display());
            let is_there = anchor.is_empty() || anchors(&read(&target)).any(|a| a == anchor);
            assert!(is_there, "{}: {link} names no heading", page.display());
        }
    }
    // Pages named by the program and its configurations must exist, too.
    let named = "src computer/src people/src lab/src vessel drone scripts".split(' ');
    let named = named.map(|d| root().join("deploy").join(d));
    for source in named.flat_map(|d| files(&d, &[".rs", ".toml", ".json"])) {
        for rest in read(&source).split("docs/").skip(1) {
            let end = rest.find(|c: char| !(c.is_alphanumeric() || ".-_/".contains(c)));
            let name = rest[..end.unwrap_or(rest.len())].trim_end_matches('.');
            let is_page = name.ends_with(".md") && name != ".md";
            let target = root().join("deploy/docs").join(name);
            assert!(!is_page || target.exists(), "{}: docs/{name}", source.display());
        }
    }
}

/// Hash of the sources of autopilot link and pilot, which the recorded flights test.
fn link_version(root: &Path) -> String {
    let flies = ["uav-side/src/autopilot", "uav-side/src/pilot"].map(|d| files(&root.join(d), &[".rs"]));
    let mut sources = flies.concat();
    sources.sort();
    let bytes: Vec<Vec<u8>> = sources.iter().map(|path| fs::read(path).unwrap()).collect();
    format!("{:016x}", wire::hash_record(&bytes.concat()).unwrap())
}

/// Faults in tables of flights with makers' firmware: each table has to name Alight's version, and to state later
/// changes of the code.
fn stale_tables(page: &str, link: &str) -> Vec<String> {
    let mut wrong = Vec::new();
    let mut marker: Option<&str> = None;
    for block in page.split("\n\n") {
        if let Some(flown) = block.trim().strip_prefix("<!-- flown: version ") {
            marker = Some(flown);
        } else if block.starts_with('|') && block.lines().next().is_some_and(|head| head.contains("flown by"))
        {
            let Some(flown) = marker.take() else {
                wrong.push(format!("no version above the table: {block}"));
                continue;
            };
            let after = page.split(block).nth(1).unwrap_or_default();
            let is_stated = after
                .trim_start()
                .starts_with("The link and the pilot have changed since");
            if !flown.contains(&format!("link {link}")) && !is_stated {
                wrong.push(format!(
                    "flown with {flown}, but nothing states that the link is now {link}"
                ));
            }
        }
    }
    wrong
}

#[test]
fn version_of_every_table_with_makers_firmware() {
    let link = link_version(&root());
    let wrong = stale_tables(&read(&root().join("deploy/docs/firmware.md")), &link);
    assert!(
        wrong.is_empty(),
        "{wrong:#?}\nwrite below a table that was flown before: The link and the pilot have changed since: ..."
    );
    let table = "| flown by | good |\n|---|---|\n| PX4 | 1 of 1 |";
    let flown = |link: &str| format!("<!-- flown: version 1234567, link {link} -->\n\n{table}\n\nNext.");
    assert!(stale_tables(&flown("aa"), "aa").is_empty());
    assert_eq!(stale_tables(&flown("bb"), "aa").len(), 1);
    assert_eq!(stale_tables(table, "aa").len(), 1);
}

/// The documents state name, suitable values and versions of every parameter in the table.
#[test]
fn parameters_in_the_documents() {
    let page = read(&root().join("deploy/docs/autopilots.md"));
    let firmware = read(&root().join("deploy/docs/firmware.md"));
    for p in PARAMETERS {
        let name = match p.severity {
            Severity::Reject => format!("**{}**", p.name),
            Severity::Warn => p.name.to_owned(),
        };
        let cell = match p.wanted {
            Wanted::Bits(bits) => format!("{name} with {bits} added{}", p.versions),
            Wanted::Any => format!("{name}{}", p.versions),
            Wanted::Within(..) | Wanted::Is(..) | Wanted::OneOf(_) => {
                format!("{name} {}{}", p.suitable(), p.versions)
            }
        };
        assert!(page.contains(&cell), "autopilots.md does not contain: {cell}");
        // Values in the instructions for the makers' simulators.
        let mut lines = firmware
            .lines()
            .map(|l| l.trim().trim_start_matches("param set "));
        let set = lines.find_map(|line| line.strip_prefix(p.name)?.strip_prefix(' '));
        let value = set.and_then(|value| value.parse().ok());
        assert!(
            value.is_none_or(|value| p.suits(value)),
            "firmware.md: {} {set:?}",
            p.name
        );
    }
}
