//! The documents as a book: every page is in its table of contents, every link leads somewhere, every message that a
//! person may meet is in the troubleshooting page.

use std::path::{Path, PathBuf};

use alight_shared::msg::ReasonCode;
use serde::Deserialize;
use serde::de::IntoDeserializer;
use serde::de::value::Error;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

fn read(path: &Path) -> String {
    std::fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

/// The files below `directory` that end so, without what is built.
fn files(directory: &Path, endings: &[&str]) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(directory).unwrap().flatten() {
        let (path, name) = (entry.path(), entry.file_name().into_string().unwrap());
        if path.is_dir() && name != "target" && !name.starts_with('.') {
            found.extend(files(&path, endings));
        } else if endings.iter().any(|e| name.ends_with(e)) {
            found.push(path);
        }
    }
    found
}

/// Targets of the links `[text](target)`.
fn links(text: &str) -> impl Iterator<Item = &str> {
    text.split("](").skip(1).filter_map(|rest| rest.split(')').next())
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
            let path = link.split(['#', ' ']).next().unwrap_or_default();
            let target = page.parent().unwrap().join(path);
            assert!(target.exists(), "{}: {link} leads nowhere", page.display());
        }
    }
    // So do the pages that the program and its configurations name.
    let named = ["src", "vessel", "drone"].map(|d| root().join("deploy").join(d));
    for source in named.iter().flat_map(|d| files(d, &[".rs", ".toml"])) {
        for rest in read(&source).split("docs/").skip(1) {
            let end = rest.find(|c: char| !(c.is_alphanumeric() || ".-_/".contains(c)));
            let name = rest[..end.unwrap_or(rest.len())].trim_end_matches('.');
            let is_page = name.ends_with(".md") && name != ".md";
            let target = root().join("deploy/docs").join(name);
            assert!(!is_page || target.exists(), "{}: docs/{name}", source.display());
        }
    }
}

#[test]
fn troubleshooting_reasons_and_topics() {
    let page = read(&root().join("deploy/docs/troubleshooting.md"));
    let code = |k: u32| ReasonCode::deserialize(IntoDeserializer::<Error>::into_deserializer(k)).ok();
    let codes: Vec<ReasonCode> = (0..1000).map_while(code).collect();
    assert!(codes.len() > 40, "{}", codes.len());
    for code in codes {
        assert!(
            page.contains(&format!("`{code:?}`")),
            "{code:?}: run deploy/scripts/troubleshooting"
        );
    }
    let sources = ["deploy/people/src/tools/check", "deploy/people/src/status"]
        .map(|d| files(&root().join(d), &[".rs"]));
    for source in sources.concat() {
        let text = read(&source);
        // The tests' own are none, and what is always fine is no trouble.
        let code = text.split("#[cfg(test)]").next().unwrap();
        for rest in code.split("Topic(\"").skip(1) {
            let (topic, rest) = rest.split_once('"').unwrap();
            if rest.starts_with(").fine(") {
                continue;
            }
            assert!(
                page.contains(&format!("| {topic} |")),
                "{topic}: run deploy/scripts/troubleshooting"
            );
        }
    }
}

/// A hash (FNV-1a) of the sources of the link to the autopilot and of the pilot: what flew.
fn link_version(root: &Path) -> String {
    let flies = ["uav-side/src/autopilot", "uav-side/src/pilot"].map(|d| files(&root.join(d), &[".rs"]));
    let mut sources = flies.concat();
    sources.sort();
    let bytes = sources.iter().flat_map(|path| std::fs::read(path).unwrap());
    let hash = bytes.fold(0xcbf2_9ce4_8422_2325_u64, |h, b| {
        (h ^ u64::from(b)).wrapping_mul(0x0100_0000_01b3)
    });
    format!("{hash:016x}")
}

/// What is wrong with the tables of flights with makers' firmware: each names our version, and says where what flew has
/// changed since.
fn stale_tables(page: &str, link: &str) -> Vec<String> {
    let mut wrong = Vec::new();
    let mut marker: Option<&str> = None;
    for block in page.split("\n\n") {
        if let Some(flown) = block.trim().strip_prefix("<!-- flown: version ") {
            marker = Some(flown);
        } else if block.starts_with('|') && block.lines().next().is_some_and(|head| head.contains("flown by"))
        {
            let Some(flown) = marker.take() else {
                wrong.push(format!("no version above: {block}"));
                continue;
            };
            let after = page.split(block).nth(1).unwrap_or_default();
            let said = after
                .trim_start()
                .starts_with("The link and the pilot have changed since");
            if !flown.contains(&format!("link {link}")) && !said {
                wrong.push(format!(
                    "flown with {flown}, and nothing says that the link is {link} now"
                ));
            }
        }
    }
    wrong
}

#[test]
fn version_of_every_table_with_makers_firmware() {
    let link = link_version(&root());
    for page in ["firmware.md", "sitl.md"] {
        let wrong = stale_tables(&read(&root().join("deploy/docs").join(page)), &link);
        assert!(
            wrong.is_empty(),
            "{page}: {wrong:#?}\nwrite below a table that was flown before: The link and the pilot have changed since: ..."
        );
    }
    let table = "| flown by | good |\n|---|---|\n| PX4 | 1 of 1 |";
    let flown = |link: &str| format!("<!-- flown: version 1234567, link {link} -->\n\n{table}\n\nNext.");
    assert!(stale_tables(&flown("aa"), "aa").is_empty());
    assert_eq!(stale_tables(&flown("bb"), "aa").len(), 1);
    assert_eq!(stale_tables(table, "aa").len(), 1);
}
