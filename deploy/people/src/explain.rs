//! `alight explain`: advice on the messages of mission, page and status, by code or text.

use std::{
    cmp::Reverse,
    collections::{BTreeMap, BTreeSet},
    sync::LazyLock,
};

use alight_computer::{
    exit::{CliError, Exit},
    terminal::{self, WIDTH, wrap},
};
use alight_shared::{
    autopilot_parameters::{PARAMETERS, Wanted},
    msg::{Reason, ReasonCode},
};
use clap::Args;
use serde::Deserialize;

const MAX_SHOWN: usize = 5;
/// Value that suits no parameter.
const UNSUITABLE: f64 = -99.0;

#[derive(Args, Debug)]
pub struct ExplainArgs {
    /// Code of a reason or text of a message, such as: deck not detected yet [default: all messages]
    #[arg(value_name = "CODE|MESSAGE")]
    pub message: Vec<String>,
}

#[derive(Default, Deserialize)]
struct Explanations {
    reason: BTreeMap<String, String>,
    message: BTreeMap<String, String>,
}

static EXPLANATIONS: LazyLock<Explanations> =
    LazyLock::new(|| toml::from_str(include_str!("explain.toml")).unwrap_or_default());

#[derive(Debug, PartialEq)]
struct Explained {
    code: String,
    text: String,
    advice: &'static str,
}

/// Advice on a reason; empty if there is nothing to do.
pub fn advice(code: ReasonCode) -> &'static str {
    EXPLANATIONS
        .reason
        .get(&format!("{code:?}"))
        .map_or("", String::as_str)
}

pub fn run(args: &ExplainArgs) -> Result<Exit, CliError> {
    let all = all();
    let query = args.message.join(" ");
    let shown: Vec<&Explained> = if query.is_empty() {
        all.iter().collect()
    } else {
        matching(&all, &query)
    };
    if shown.is_empty() {
        return Err(CliError(format!(
            "no message like: {query}; alight explain alone lists all messages"
        )));
    }
    for explained in shown {
        terminal::line(lines(explained));
    }
    Ok(Exit::Success)
}

fn all() -> Vec<Explained> {
    let reasons = ReasonCode::ALL.iter().flat_map(|code| {
        texts(*code).into_iter().map(move |text| Explained {
            code: format!("{code:?}"),
            text,
            advice: advice(*code),
        })
    });
    let messages = EXPLANATIONS.message.iter().map(|(text, advice)| Explained {
        code: String::new(),
        text: pattern(text),
        advice,
    });
    reasons.chain(messages).collect()
}

/// Texts of a reason; a reason about autopilot parameters has one text per parameter.
fn texts(code: ReasonCode) -> Vec<String> {
    use ReasonCode::{AutopilotParameter, AutopilotParameterUnknown};
    if !matches!(code, AutopilotParameter | AutopilotParameterUnknown) {
        let texts = code.texts().iter().map(|text| pattern(text));
        return texts.filter(|text| !text.is_empty()).collect();
    }
    let mut all = Vec::new();
    for (number, parameter) in PARAMETERS.iter().enumerate() {
        let text = if parameter.wanted == Wanted::Any {
            format!("{}: {}", parameter.name, parameter.why)
        } else {
            Reason::new(code, UNSUITABLE, number as f64).to_string()
        };
        let text = pattern(&text);
        if !all.contains(&text) {
            all.push(text);
        }
    }
    all
}

/// Replaces each number that is not part of a name, and each placeholder in braces, by `…`.
fn pattern(text: &str) -> String {
    let number = |part: &str| {
        part.split_once('}')
            .map_or(part.into(), |(_, rest)| format!("0{rest}"))
    };
    let text: String = text.split('{').map(number).collect();
    let mut out = String::new();
    for c in text.chars() {
        let in_name = out.ends_with(|c: char| c.is_alphanumeric() || c == '_');
        let in_figure = out.ends_with('…');
        if c.is_ascii_digit() && !in_name {
            if !in_figure {
                out.push('…');
            }
        } else if !(c == '.' && in_figure) {
            out.push(c);
        }
    }
    out
}

fn tokens(text: &str) -> BTreeSet<String> {
    let all = text.split(|c: char| !c.is_alphabetic());
    all.map(str::to_lowercase).collect()
}
fn content(text: &str) -> BTreeSet<String> {
    tokens(text).into_iter().filter(|w| w.len() > 3).collect()
}

/// Message with the code or text `query`, or the messages that share the most terms with it, shortest first. A line of the
/// page may contain a whole message among other text.
fn matching<'a>(all: &'a [Explained], query: &str) -> Vec<&'a Explained> {
    let is = |text: &str| text.eq_ignore_ascii_case(query.trim());
    let by_code: Vec<&Explained> = all.iter().filter(|e| is(&e.code) || is(&e.text)).collect();
    if !by_code.is_empty() {
        return by_code;
    }
    let wanted = content(query);
    let common = |e: &Explained| {
        let own = content(&e.text);
        let common = own.intersection(&wanted).count();
        let is_whole = common > 1 && common == own.len();
        // A match of fewer than two thirds of the terms is a coincidence.
        let counts = is_whole || 3 * common >= 2 * wanted.len();
        if counts { common } else { 0 }
    };
    let most = all.iter().map(common).max().unwrap_or_default();
    if most == 0 {
        return Vec::new();
    }
    let mut best: Vec<&Explained> = all.iter().filter(|e| common(e) == most).collect();
    let typed = tokens(query);
    let common = |e: &Explained| tokens(&e.text).intersection(&typed).count();
    best.sort_by_key(|e| (Reverse(common(e)), e.text.len()));
    best.truncate(MAX_SHOWN);
    best
}

fn lines(explained: &Explained) -> String {
    let advice = if explained.advice.is_empty() {
        "Nothing to do."
    } else {
        explained.advice
    };
    let mut out = String::new();
    wrap(&mut out, 0, WIDTH, &explained.text);
    out += "\n ";
    wrap(&mut out, 2, WIDTH, advice);
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::{fs, path::Path};

    #[test]
    fn advice_on_every_reason() {
        let codes: BTreeSet<String> = ReasonCode::ALL.iter().map(|c| format!("{c:?}")).collect();
        let explained: BTreeSet<String> = EXPLANATIONS.reason.keys().cloned().collect();
        assert!(codes.len() > 40, "{}", codes.len());
        assert_eq!(codes, explained, "explain.toml has to list each reason once");
    }

    #[test]
    fn advice_in_strong_wind() {
        use ReasonCode::{Deviated, LikelySlides, LikelyTilted, NoVision, TooFar, TooFast};
        for code in [Deviated, LikelySlides, LikelyTilted, NoVision, TooFar, TooFast] {
            assert!(advice(code).contains("wind"), "{code:?}");
        }
    }

    #[test]
    fn messages_by_their_text_and_code() {
        let all = all();
        let found = |query: &str| matching(&all, query).first().map(|e| e.code.clone());
        assert_eq!(found("waits: deck not detected yet"), Some("NoVision".into()));
        assert_eq!(found("novision"), Some("NoVision".into()));
        assert_eq!(
            found("deck forecast 150.00 s old (limit 0.30)"),
            Some("ForecastStale".into())
        );
        assert_eq!(
            found("the deck is closed: by its crew"),
            Some("DeckReserved".into())
        );
        assert_eq!(found("COM_OF_LOSS_T is 1 s"), Some("AutopilotParameter".into()));
        for text in ["GO", "NO-GO", "ACT"] {
            assert_eq!(matching(&all, text)[0].text, text);
        }
        let taken = matching(&all, "abort taken: Landed, nothing to stop")[0].advice;
        assert!(taken.contains("has stopped"), "{taken}");
        for unknown in ["weather tomorrow", "not at home on the deck after noon"] {
            assert_eq!(found(unknown), None, "{unknown}");
        }
        assert_eq!(found("not at rest on the deck after 180 s"), Some(String::new()));
        // A message within a line of the page.
        let held = "mission: the drone is in state Hold: deck not detected for 1.20 s (limit 1.00)";
        assert_eq!(found(held), Some("VisionLost".into()));
    }

    #[test]
    fn advice_on_every_text_of_page_and_status() {
        const STATUS: &str = "certificate drone findings mod sources vessel";
        const FOUND: &str = ".warning(~.broken(~.stopping(~found =~FOUND: &str =~Some(~begins =~counts =~unknown(~\
                             =>~(|| {~unit)|~|id|~in [";
        const SENSORS: &str =
            "age_counts bus bus/devices bus/network heights node plausible signalk/mod nmea/account rtcm ubx";
        const STYLES: &str =
            "font prefers element( aria camera-image track-scale turns wide title padStart describe(";
        let read = |name: &str| {
            let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").join(name);
            let code = fs::read_to_string(path).unwrap().replace("\\\"", "'");
            let code = code.split("\n#[cfg(test)]").next().unwrap();
            let code = code.split("\npub fn state(").next().unwrap();
            let lines = code.lines().map(|line| line.split("// ").next().unwrap());
            lines.collect::<Vec<_>>().join("\n")
        };
        let mut texts = BTreeSet::new();
        for (folder, names, begins) in [
            ("deploy/people/src/status", STATUS, FOUND),
            ("deploy/people/src/status", "go", "{~=>~(~="),
            ("deploy/computer/src/process", "lateness", "Some("),
            ("deploy/computer/src/process", "sealed", "let message = || {"),
            ("deploy/computer/src/vessel", "deck_inputs", "Some("),
            ("deploy/computer/src/vessel", "helm_lamp", "failed.map(|e|"),
            ("deploy/people/src/tools", "view view_vessel", "Err("),
            ("deploy/people/src/view", "server", "return Err(~let why ="),
            ("shared/src/msg", "aboard", "f,"),
            ("shared/src/msg", "mission", "(for_s: f32) -> String {"),
            ("shared/src/msg", "state", "=>"),
            ("shared/src", "tags", "f,~write_str("),
            (
                "shared/src/mavlink",
                "signing",
                "other_key,~old,~unsigned,~unchecked,",
            ),
            (
                "usv-side/src/sensors",
                SENSORS,
                "::fault(~::fine(~text =~=>~=> (~ {",
            ),
        ] {
            for begin in begins.split('~') {
                let code = names.split(' ').map(|name| read(&format!("{folder}/{name}.rs")));
                let code: String = code.collect();
                let found = code.split(begin).skip(1).filter_map(|rest| rest.split_once('"'));
                let found = found.filter(|(before, _)| ["", "format!("].contains(&before.trim()));
                let found: Vec<&str> = found.filter_map(|(_, text)| text.split('"').next()).collect();
                assert!(!found.is_empty(), "no text after {begin} in {names}");
                texts.extend(found.into_iter().map(pattern));
            }
        }
        let script = read("deploy/people/src/view/page/view.js").replace('`', "\"");
        let lines = script
            .lines()
            .filter(|line| !STYLES.split(' ').any(|style| line.contains(style)));
        texts.extend(lines.flat_map(|line| line.split('"').skip(1).step_by(2).map(pattern)));
        texts.retain(|text| text.contains(' ') && content(text).len() > 1);
        let all = all();
        for text in &texts {
            let mut like = matching(&all, text).into_iter();
            let known = like.any(|e| content(&e.text).is_superset(&content(text)));
            assert!(known, "explain.toml lacks: {text}");
        }
        assert!(texts.len() > 140, "{}", texts.len());
    }

    #[test]
    fn lines_of_every_message_within_a_terminal() {
        for line in all().iter().map(lines).collect::<Vec<_>>().join("\n").lines() {
            assert!(line.chars().count() <= WIDTH, "{line}");
        }
    }

    #[test]
    fn pattern_of_a_text_with_numbers() {
        assert_eq!(
            pattern("11.37 m off (limit 1.50), EK3_SRC1 -0.2"),
            "… m off (limit …), EK3_SRC1 -…"
        );
    }
}
