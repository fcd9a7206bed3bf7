use std::collections::BTreeMap;

use serde::Deserialize;

use super::source::SourceFile;

pub(super) type Places = BTreeMap<String, Vec<String>>;

#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Deserialize)]
#[serde(rename_all = "lowercase")]
enum Scope {
    Code,
    Docs,
    Both,
    Name,
    Opening,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Ban {
    terms: Vec<String>,
    write: String,
    #[serde(rename = "where")]
    scope: Scope,
    #[serde(default)]
    allow: Vec<String>,
    #[serde(default)]
    under: Vec<String>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Bans {
    ban: Vec<Ban>,
}

/// Term and the index of its line; an empty term marks an interruption of the text.
type Token = (String, usize);

fn pieces(text: &str) -> Vec<String> {
    let all = text.split(|c: char| !c.is_alphanumeric());
    all.filter(|p| !p.is_empty()).map(str::to_owned).collect()
}

/// Terms in lower case, with the parts of `OneName` separated.
fn lower_pieces(text: &str) -> Vec<String> {
    let mut found: Vec<String> = Vec::new();
    for piece in pieces(text) {
        let c: Vec<char> = piece.chars().collect();
        for k in 0..c.len() {
            let is_inner = |k: usize| {
                let ends = c.get(k + 1).is_some_and(|next| next.is_lowercase());
                c[k].is_uppercase() && (!c[k - 1].is_uppercase() || ends)
            };
            if k == 0 || is_inner(k) {
                found.push(String::new());
            }
            found.last_mut().unwrap().extend(c[k].to_lowercase());
        }
    }
    found
}

fn tokens(source: &SourceFile) -> BTreeMap<Scope, Vec<Token>> {
    let mut all: BTreeMap<Scope, Vec<Token>> = BTreeMap::new();
    let mut add = |scope, row, mut pieces: Vec<String>| {
        if pieces.is_empty() {
            pieces.push(String::new());
        }
        let tokens = all.entry(scope).or_default();
        tokens.extend(pieces.into_iter().map(|p| (p, row)));
    };
    if source.is_rust {
        add(Scope::Code, 0, lower_pieces(&source.path));
        add(Scope::Code, 0, Vec::new());
    }
    let mut was_doc = false;
    for (row, line) in source.lines.iter().enumerate() {
        add(
            Scope::Code,
            row,
            lower_pieces(&format!("{} {}", line.code, line.text)),
        );
        add(Scope::Docs, row, lower_pieces(&line.comment));
        add(Scope::Name, row, pieces(&line.code));
        let is_doc = source.is_rust
            && ["///", "//!"]
                .iter()
                .any(|d| line.comment.trim_start().starts_with(*d));
        if is_doc && !was_doc {
            add(
                Scope::Opening,
                row,
                pieces(&line.comment).into_iter().take(2).collect(),
            );
            add(Scope::Opening, row, Vec::new());
        }
        was_doc = is_doc;
    }
    all
}

struct Rule<'a> {
    term: &'a str,
    phrase: Vec<String>,
    allow: Vec<Vec<String>>,
    under: &'a [String],
}

impl Rule<'_> {
    fn matches(&self, path: &str, tokens: &[Token], at: usize) -> bool {
        let begins = |k: usize, phrase: &[String]| {
            let tokens = &tokens[k..];
            tokens.len() >= phrase.len() && tokens.iter().zip(phrase).all(|((token, _), p)| token == p)
        };
        let is_part = |longer: &Vec<String>| {
            let mut offsets = 0..longer.len().min(at + 1);
            offsets.any(|j| longer[j..].starts_with(&self.phrase) && begins(at - j, longer))
        };
        begins(at, &self.phrase)
            && (self.under.is_empty() || self.under.iter().any(|u| path.starts_with(u.as_str())))
            && !self.allow.iter().any(is_part)
    }
}

fn rules(bans: &Bans) -> BTreeMap<(Scope, String), Vec<Rule<'_>>> {
    let mut rules: BTreeMap<(Scope, String), Vec<Rule<'_>>> = BTreeMap::new();
    for ban in &bans.ban {
        let scopes: &[Scope] = match ban.scope {
            Scope::Both => &[Scope::Code, Scope::Docs],
            Scope::Code | Scope::Docs | Scope::Name | Scope::Opening => std::slice::from_ref(&ban.scope),
        };
        let is_exact = matches!(ban.scope, Scope::Name | Scope::Opening);
        let split = |t: &str| if is_exact { pieces(t) } else { lower_pieces(t) };
        for (scope, term) in scopes.iter().flat_map(|s| ban.terms.iter().map(move |t| (*s, t))) {
            let phrase = split(term);
            let first = phrase.first().cloned().unwrap_or_default();
            assert!(!first.is_empty(), "{term:?} has no letter");
            rules.entry((scope, first)).or_default().push(Rule {
                term,
                phrase,
                allow: ban.allow.iter().map(|a| split(a)).collect(),
                under: &ban.under,
            });
        }
    }
    rules
}

pub(super) fn places(sources: &[SourceFile], bans: &Bans) -> Places {
    let (rules, mut places) = (rules(bans), Places::new());
    for source in sources {
        for (scope, tokens) in tokens(source) {
            for (at, (token, row)) in tokens.iter().enumerate() {
                let candidates = rules.get(&(scope, token.clone()));
                for rule in candidates.into_iter().flatten() {
                    if rule.matches(&source.path, &tokens, at) {
                        let places = places.entry(rule.term.to_owned()).or_default();
                        places.push(source.place(*row));
                    }
                }
            }
        }
    }
    places
}

pub(super) fn replacement<'a>(bans: &'a Bans, term: &str) -> &'a str {
    let own = bans.ban.iter().find(|b| b.terms.iter().any(|t| t == term));
    own.map_or("a term of words.toml", |b| b.write.as_str())
}

#[test]
fn terms_in_names_and_phrases() {
    let text =
        "ban = [{ terms = [\"old thing\"], write = \"new\", where = \"both\", allow = [\"an old thing\"] }]";
    let bans = toml::from_str(text).unwrap();
    let count = |content: &str| {
        let places = places(&[SourceFile::new("shared/a.rs".into(), content)], &bans);
        places.get("old thing").map_or(0, Vec::len)
    };
    assert_eq!(count("fn set_old_thing(a: OldThing) {} // an old\n// thing\n"), 2);
    assert_eq!(count("// old\n\n// thing, olds things\n"), 0);
}
