//! Sizes of rooms, keys and terms of the whole project; each file is read once. `tidy/words.toml` lists the terms
//! that the project does not use, with their replacements.

use std::collections::{BTreeMap, BTreeSet};

mod source;
mod terms;

use source::{ROOMS, SourceFile, keys, project};
use terms::{Bans, Places, places, replacement};

/// Maximum number of places that a message lists; the diff shows the rest.
const MAX_LISTED: usize = 30;

/// Maximum code lines of each room, by the table in ARCHITECTURE.md.
fn room_limits(architecture: &SourceFile) -> BTreeMap<&str, usize> {
    let lines = architecture.lines.iter().map(|l| l.comment.as_str());
    let section = lines.skip_while(|l| *l != "## Sizes").skip(1);
    let rows = section.take_while(|l| !l.starts_with("## "));
    rows.filter_map(|line| {
        let (room, rest) = line.strip_prefix("| `")?.split_once("/` |")?;
        let digits: String = rest
            .chars()
            .take_while(|c| *c != '|')
            .filter(char::is_ascii_digit)
            .collect();
        Some((room, digits.parse().ok()?))
    })
    .collect()
}

/// Number in groups of three digits, as in ARCHITECTURE.md.
fn grouped(number: usize) -> String {
    if number < 1000 {
        return number.to_string();
    }
    format!("{} {:03}", grouped(number / 1000), number % 1000)
}

/// Table of each room's code lines and limit, and a message for each room above its limit.
fn rooms(sources: &[SourceFile]) -> (String, Vec<String>) {
    let architecture = sources.iter().find(|s| s.path == "ARCHITECTURE.md").unwrap();
    let limits = room_limits(architecture);
    let (mut table, mut problems) = (String::from("code lines, limit\n"), Vec::new());
    for room in ROOMS {
        let own = sources.iter().filter(|s| s.is_rust && s.room == Some(room));
        let lines: usize = own.map(SourceFile::code_lines).sum();
        let limit = limits.get(room).copied().unwrap_or_default();
        table += &format!("  {:>9} {:>9}  {room}\n", grouped(lines), grouped(limit));
        if lines > limit {
            let next = grouped(lines.next_multiple_of(100));
            problems.push(format!(
                "{room}/ has {} code lines, and ARCHITECTURE.md (Sizes) gives it {}: remove code, or write {next} there in \
                 the same commit, with the reason in its message",
                grouped(lines),
                grouped(limit)
            ));
        }
    }
    (table, problems)
}

/// Message for each configuration key that no code reads.
fn unread_keys(sources: &[SourceFile]) -> Vec<String> {
    let all: Vec<_> = sources.iter().map(|s| (s, keys(&s.lines))).collect();
    let read: BTreeSet<&str> = all.iter().flat_map(|(_, (_, read))| read).copied().collect();
    let unread = all.iter().flat_map(|(source, (declared, _))| {
        let unread = declared.iter().filter(|(_, key)| !read.contains(key));
        unread.map(|(row, key)| format!("{} {key}: no code reads it; remove the key", source.place(*row)))
    });
    unread.collect()
}

fn terms_in_use(places: &Places, bans: &Bans) -> Vec<String> {
    let messages = places.iter().map(|(term, all)| {
        let count = all.len();
        let listed = all[..count.min(MAX_LISTED)].join("\n    ");
        let write = replacement(bans, term);
        format!(
            "{term:?}: {count} places: write {write}, or add a phrase of another meaning to allow\n    {listed}"
        )
    });
    messages.collect()
}

#[test]
fn tidy() {
    let bans: Bans = toml::from_str(include_str!("tidy/words.toml")).unwrap();
    let sources = project();
    let (table, mut problems) = rooms(&sources);
    println!("{table}");
    problems.extend(unread_keys(&sources));
    problems.extend(terms_in_use(&places(&sources, &bans), &bans));
    assert!(problems.is_empty(), "{}", problems.join("\n"));
}
