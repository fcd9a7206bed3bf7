//! `alight config schema`: message formats of Zenoh and iceoryx2 and the lines of external planners and predictors,
//! for other programs.

use alight_computer::{
    cells,
    exit::{CliError, Exit},
    table::{Cell, Table},
    terminal::{self, WIDTH, wrap},
};
use alight_shared::{
    msg::message_version,
    schema::{self, LineFormat},
    topics::{self, Medium, Topic},
};
use clap::Args;
use schemars::Schema;
use serde_json::json;

const INDENT: usize = 4;

#[derive(Args, Debug)]
#[command(
    after_help = "Topics of the radio are keys of Zenoh, alight/vessel-1/estimate; a query on\n\
alight/vessel-1/@schema/estimate answers with the schema. Topics of memory\nare services of iceoryx2. How to read both: alight help radio"
)]
pub struct SchemaArgs {
    /// Topic whose fields are shown [default: a list of all topics]
    #[arg(value_name = "TOPIC")]
    pub topic: Option<String>,
    /// Print one JSON object, as the last line: topics with their JSON Schemas
    #[arg(long)]
    pub json: bool,
}

/// `lines`: formats in addition to the topics.
pub fn run(args: &SchemaArgs, lines: &[LineFormat]) -> Result<Exit, CliError> {
    let all = all();
    if let Some((name, version, schema)) = lines.iter().find(|l| Some(l.0) == args.topic.as_deref()) {
        let schema = schema();
        if args.json {
            terminal::line(json!({ "name": name, "version": version, "schema": schema }));
        } else {
            let head = format!("{name}: a line of JSON, version {version}");
            terminal::line(fields(vec![head], &schema));
        }
        return Ok(Exit::Success);
    }
    let shown: Vec<&Topic> = match &args.topic {
        None => all.clone(),
        Some(name) => all.iter().copied().filter(|t| t.name == name).collect(),
    };
    if shown.is_empty() {
        let lines = lines.iter().map(|l| l.0);
        let names: Vec<&str> = all.iter().map(|t| t.name).chain(lines).collect();
        return Err(CliError(format!(
            "no topic {}: there are {}",
            args.topic.as_deref().unwrap_or_default(),
            names.join(", ")
        )));
    }
    if args.json {
        let described: Vec<_> = shown.iter().map(|t| t.described()).collect();
        terminal::line(json!({ "message_version": message_version(), "topics": described }));
    } else if args.topic.is_some() {
        let texts: Vec<String> = shown.iter().map(|t| topic_fields(t)).collect();
        terminal::line(texts.join("\n\n"));
    } else {
        terminal::line(list(&shown));
        for (name, version, _) in lines {
            terminal::line(format_args!("{name}: a line of JSON, version {version}"));
        }
    }
    Ok(Exit::Success)
}

fn all() -> Vec<&'static Topic> {
    let reports = [&topics::PROCESS, &topics::VESSEL_PROCESS];
    topics::ALL.iter().chain(reports).collect()
}

fn list(topics: &[&Topic]) -> String {
    let mut table = Table::new(3..=5, ["topic", "message", "on", "Hz", "bytes", "stale s"]);
    for t in topics {
        let stale_s = Cell::number(t.stale_after.secs(), 1);
        let rate = Cell::number(t.rate_hz, if t.rate_hz < 1.0 { 1 } else { 0 });
        table.row(cells![
            t.name,
            t.type_name(),
            t.medium.name(),
            rate,
            t.bytes,
            stale_s
        ]);
    }
    format!(
        "{}\nMessage version {}. Bytes: the most on the radio, the size in memory.\n\
         After `stale s` a message counts as missing.\nFields of one: alight config schema estimate. For programs: --json",
        table.text(),
        message_version(),
    )
}

fn topic_fields(topic: &Topic) -> String {
    let mut lines = vec![format!(
        "{}: {}, version {}, {}, {} Hz, {} bytes",
        topic.name,
        topic.type_name(),
        message_version(),
        topic.medium.name(),
        topic.rate_hz,
        topic.bytes,
    )];
    if topic.medium == Medium::Radio {
        lines.push(format!(
            "encoding: application/octet-stream;{}",
            Topic::encoding_schema()
        ));
    }
    fields(lines, &(topic.schema)())
}

/// Lines for the fields of a schema, appended to those of its heading.
fn fields(mut lines: Vec<String>, schema: &Schema) -> String {
    let fields = schema::fields(schema);
    let width = fields.iter().map(|f| f.path.chars().count()).max().unwrap_or(0);
    for f in &fields {
        lines.push(format!("{:width$}  {}", f.path, f.kind));
        let stated: Vec<&str> = [f.unit.as_str(), &f.frame]
            .into_iter()
            .filter(|t| !t.is_empty())
            .collect();
        let stated = if stated.is_empty() {
            String::new()
        } else {
            format!("[{}] ", stated.join("; "))
        };
        let mut text = " ".repeat(INDENT - 1);
        wrap(&mut text, INDENT, WIDTH, &format!("{stated}{}", f.description));
        lines.extend((!text.trim().is_empty()).then_some(text));
    }
    lines.join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::iter::once;

    #[test]
    fn lines_of_every_schema_within_a_terminal() {
        let all = all();
        let texts = once(list(&all)).chain(all.iter().map(|t| topic_fields(t)));
        for text in texts {
            for line in text.lines() {
                assert!(line.chars().count() <= WIDTH, "{line}");
            }
        }
    }
}
