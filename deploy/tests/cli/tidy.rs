//! Sizes, names and terms of the whole project: each file is read once. `tidy/words.toml` lists terms with their
//! replacement; `tidy/limits.toml` holds what is too large or too frequent today, and its limits only go down.

use std::collections::{BTreeMap, BTreeSet};

mod source;
mod terms;

use source::{ROOMS, SourceFile, functions, keys, project, public_type};
use terms::{Ban, Bans, add_terms, replacement};

const MAX_FILE_LINES: usize = 600;
const MAX_FUNCTION_LINES: usize = 80;
/// Places that a message lists; the change itself shows the rest.
const MAX_LISTED: usize = 30;

/// Tables of `limits.toml`, what their numbers count, and what to do about one more.
const TABLES: [(&str, &str, &str); 5] = [
    ("files", "files over 600 lines, by room", "split the file"),
    (
        "functions",
        "functions over 80 lines, by room",
        "split the function",
    ),
    (
        "keys",
        "configuration keys that no code reads, by room",
        "remove the key",
    ),
    (
        "types",
        "declarations of a public type name",
        "give the new type a name of its own",
    ),
    ("terms", "places of a term", ""),
];

/// Places by what is counted there, in a table of `limits.toml`.
type Places = BTreeMap<&'static str, BTreeMap<String, Vec<String>>>;

fn add(places: &mut Places, table: &'static str, item: &str, place: String) {
    let items = places.entry(table).or_default();
    items.entry(item.to_owned()).or_default().push(place);
}

fn add_sizes(sources: &[SourceFile], places: &mut Places) {
    for source in sources {
        let Some(room) = source.room.filter(|_| source.is_rust) else {
            continue;
        };
        let length = source.lines.len();
        if length > MAX_FILE_LINES {
            add(places, "files", room, format!("{}: {length} lines", source.path));
        }
        for (row, name, length) in functions(&source.lines) {
            if length > MAX_FUNCTION_LINES {
                let place = format!("{} {name}: {length} lines", source.place(row));
                add(places, "functions", room, place);
            }
        }
    }
}

fn add_types(sources: &[SourceFile], places: &mut Places) {
    for source in sources {
        for (row, line) in source.lines.iter().enumerate() {
            if let Some(name) = public_type(&line.code) {
                add(places, "types", name, source.place(row));
            }
        }
    }
    places.entry("types").or_default().retain(|_, all| all.len() > 1);
}

fn add_keys(sources: &[SourceFile], places: &mut Places) {
    let all: Vec<_> = sources.iter().map(|s| (s, keys(&s.lines))).collect();
    let read: BTreeSet<&str> = all.iter().flat_map(|(_, (_, read))| read).copied().collect();
    for (source, (declared, _)) in &all {
        for (row, key) in declared.iter().filter(|(_, key)| !read.contains(key)) {
            let place = format!("{} {key}", source.place(*row));
            add(places, "keys", source.room.unwrap_or_default(), place);
        }
    }
}

/// Code lines that each room may have, of the table in ARCHITECTURE.md.
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

/// A number in groups of three digits, as ARCHITECTURE.md has it.
fn grouped(number: usize) -> String {
    if number < 1000 {
        return number.to_string();
    }
    format!("{} {:03}", grouped(number / 1000), number % 1000)
}

/// A table of each room's code lines and limit, and a sentence for each room above it.
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

type Limits = BTreeMap<String, BTreeMap<String, usize>>;

/// A sentence for each count that is not its limit.
fn differences(places: &Places, limits: &Limits, bans: &[Ban]) -> Vec<String> {
    let (no_places, no_limits) = (BTreeMap::new(), BTreeMap::new());
    let mut problems = Vec::new();
    for (table, unit, advice) in TABLES {
        let counted = places.get(table).unwrap_or(&no_places);
        let limits = limits.get(table).unwrap_or(&no_limits);
        let items: BTreeSet<&String> = counted.keys().chain(limits.keys()).collect();
        for item in items {
            let all = counted.get(item).map(Vec::as_slice).unwrap_or_default();
            let (count, limit) = (all.len(), limits.get(item).copied().unwrap_or(0));
            // Of words there are too many for every lower count to be a change of the limits.
            if count < limit && table != "terms" {
                problems.push(format!(
                    "[{table}] {item:?}: {count} for a limit of {limit}: lower the limit to {count}"
                ));
            }
            if count <= limit {
                continue;
            }
            let advice = match table {
                "terms" => format!(
                    "write {}, or add a phrase of another meaning to allow",
                    replacement(bans, item)
                ),
                _ => advice.to_owned(),
            };
            let listed = all[..count.min(MAX_LISTED)].join("\n    ");
            let rest = if count > MAX_LISTED { "\n    ..." } else { "" };
            problems.push(format!(
                "[{table}] {item:?}: {count} for a limit of {limit} ({unit}): {advice}\n    {listed}{rest}"
            ));
        }
    }
    problems
}

/// Counts in the form of `limits.toml`.
fn as_limits(places: &Places) -> String {
    let mut text = String::new();
    for (table, unit, _) in TABLES {
        text += &format!("\n# {unit}\n[{table}]\n");
        for (item, all) in places.get(table).into_iter().flatten() {
            text += &format!("{item:?} = {}\n", all.len());
        }
    }
    text
}

/// Counts, each with its places or its replacement.
fn as_table(places: &Places, bans: &[Ban]) -> String {
    let mut text = String::new();
    for (table, unit, _) in TABLES {
        let items = places.get(table);
        let total: usize = items.into_iter().flatten().map(|(_, all)| all.len()).sum();
        text += &format!("\n{unit}: {total}\n");
        for (item, all) in items.into_iter().flatten() {
            let detail = match table {
                "terms" => format!("-> {}", replacement(bans, item)),
                _ => all.join(", "),
            };
            text += &format!("  {:>5}  {item}  {detail}\n", all.len());
        }
    }
    text
}

#[test]
fn tidy() {
    let Bans { ban: bans } = toml::from_str(include_str!("tidy/words.toml")).unwrap();
    let limits: Limits = toml::from_str(include_str!("tidy/limits.toml")).unwrap();
    let unknown = limits
        .keys()
        .find(|k| TABLES.iter().all(|(table, ..)| table != k));
    assert_eq!(unknown, None, "a table of limits.toml that holds nothing");
    let sources = project();
    let mut places = Places::new();
    add_sizes(&sources, &mut places);
    add_types(&sources, &mut places);
    add_keys(&sources, &mut places);
    add_terms(&sources, &bans, &mut places);
    let (table, mut problems) = rooms(&sources);
    println!("{table}{}", as_table(&places, &bans));
    let differences = differences(&places, &limits, &bans);
    let measured = if differences.is_empty() {
        String::new()
    } else {
        format!(
            "\n\nAll counts, as limits.toml would have them:\n{}",
            as_limits(&places)
        )
    };
    problems.extend(differences);
    assert!(problems.is_empty(), "{}{measured}", problems.join("\n"));
}
