//! Every configuration key is read by code.

use std::collections::BTreeSet;

use crate::book::{files, read, root};

fn is_name(c: char) -> bool {
    c.is_alphanumeric() || c == '_'
}

/// A key is read as a field after a dot, or alone on a line of a pattern.
#[test]
fn configuration_keys_that_no_code_reads() {
    let mut declared = BTreeSet::new();
    let mut used = BTreeSet::new();
    for path in files(&root(), &[".rs"]) {
        let mut is_table = false;
        for line in read(&path).lines() {
            // Texts name keys, too.
            let line: String = line.split('"').step_by(2).collect();
            let code = line.split("//").next().unwrap_or_default();
            is_table = (is_table && code != "}") || code.trim_end() == "config! {";
            let code = code.trim();
            if !is_table {
                let fields = code.split('.').skip(1);
                used.extend(fields.map(|f| f.split(|c| !is_name(c)).next().unwrap_or_default().to_owned()));
                used.extend(code.strip_suffix(',').map(str::to_owned));
            } else if let Some((key, _)) = code.strip_prefix("pub ").and_then(|c| c.split_once(':')) {
                declared.insert(key.to_owned());
            }
        }
    }
    let unread: Vec<&String> = declared.difference(&used).collect();
    assert!(declared.len() > 100, "{declared:?}");
    assert!(
        unread.is_empty(),
        "no code reads these keys, remove them: {unread:?}"
    );
}
