//! Documents with headings, texts, tables and charts, as Markdown and as one HTML page.

use std::fmt::Write as _;
use std::path::Path;

use alight_computer::exit::{CliError, Doing};
use alight_computer::table::{Table, escape};

pub enum Block {
    Heading(String),
    Text(String),
    Items(Vec<String>),
    Table(Table),
    /// Shown on the page only.
    Chart(Chart),
    Lines(Vec<String>),
}

#[derive(Clone, Debug)]
pub struct Chart {
    pub caption: String,
    pub svg: String,
}

pub struct Document {
    pub title: String,
    pub blocks: Vec<Block>,
}

const STYLE: &str = "\
    *{box-sizing:border-box}\
    body{font:15px/1.45 system-ui,sans-serif;margin:1.2rem auto;max-width:100rem;padding:0 .8rem;color:#222}\
    h1{font-size:1.5rem}h2{font-size:1.15rem;margin-top:2rem}\
    .wide{overflow-x:auto}table{border-collapse:collapse;font-variant-numeric:tabular-nums}\
    th,td{padding:.25rem .6rem;border-bottom:1px solid #ddd;text-align:right;white-space:nowrap;vertical-align:top}\
    th{border-bottom:2px solid #999}\
    .text{text-align:left}.new td{border-top:2px solid #bbb}.bad{color:#a02020;font-weight:600}\
    .good{color:#1c6b34}small{color:#666}code{font-size:.9em;overflow-wrap:anywhere}\
    svg{display:block;width:100%;max-width:60rem}\
    td:first-child,th:first-child{position:sticky;left:0;background:#fff}\
    pre{overflow-x:auto;background:#f6f6f6;padding:.6rem}";

impl Document {
    pub fn markdown(&self) -> String {
        let mut out = format!("# {}\n", self.title);
        for block in &self.blocks {
            let _ = match block {
                Block::Heading(text) => writeln!(out, "\n## {text}"),
                Block::Text(text) => writeln!(out, "\n{text}"),
                Block::Items(items) => writeln!(out, "\n- {}", items.join("\n- ")),
                Block::Table(table) => write!(out, "\n{}", table.markdown()),
                Block::Chart(_) => Ok(()),
                Block::Lines(lines) => writeln!(out, "\n```\n{}\n```", lines.join("\n")),
            };
        }
        out
    }
    /// Document as one HTML page, readable on wide and narrow screens.
    pub fn html(&self) -> String {
        let mut out = format!(
            "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\">\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\
             <title>{0}</title><style>{STYLE}</style><h1>{0}</h1>",
            escape(&self.title)
        );
        for block in &self.blocks {
            let _ = match block {
                Block::Heading(text) => write!(out, "<h2>{}</h2>", escape(text)),
                Block::Text(text) => write!(out, "<p>{}</p>", escape(text)),
                Block::Items(items) => {
                    let items: String = items.iter().map(|i| format!("<li>{}</li>", escape(i))).collect();
                    write!(out, "<ul>{items}</ul>")
                }
                Block::Table(table) => write!(out, "{}", table.html()),
                Block::Chart(Chart { caption, svg }) => {
                    write!(out, "<h2>{}</h2><div class=\"wide\">{svg}</div>", escape(caption))
                }
                Block::Lines(lines) => write!(out, "<pre>{}</pre>", escape(&lines.join("\n"))),
            };
        }
        out.push_str("</html>\n");
        out
    }
}

pub fn write_files(out: &Path, files: &[(&str, String)]) -> Result<(), CliError> {
    std::fs::create_dir_all(out).doing(format_args!("making {}", out.display()))?;
    for (name, text) in files {
        let path = out.join(name);
        std::fs::write(&path, text).doing(format_args!("writing {}", path.display()))?;
    }
    Ok(())
}
