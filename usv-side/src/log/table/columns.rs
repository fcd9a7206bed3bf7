//! What the columns of a table are, by their names.

use super::column::{self, KNOWN, Name};
use super::text::Layout;
use super::{Quantity, TableError};

/// What the columns are.
pub(super) struct Columns {
    /// Of the time, and its unit in s where it is stated.
    pub(super) time: (usize, Option<f64>),
    /// Of each column the quantity and its unit.
    pub(super) quantities: Vec<Option<(usize, f64)>>,
    pub(super) has: [bool; Quantity::COUNT],
}

impl Columns {
    /// Of the names of `layout`, which gets what was assumed.
    pub(super) fn of(layout: &mut Layout) -> Result<Columns, TableError> {
        let delimiter = layout.delimiter.name();
        let line = layout.line;
        let error = |message: String| TableError::Header {
            line,
            message: format!("{message} (cells separated by {delimiter})"),
        };
        // A line may end with what separates its cells.
        while layout.names.last().is_some_and(String::is_empty) {
            layout.names.pop();
        }
        let names: Vec<Name> = layout.names.iter().map(|n| column::name(n)).collect();
        let called = |k: usize| layout.names.get(k).map_or("", String::as_str);
        let times: Vec<(usize, Option<f64>)> = names
            .iter()
            .enumerate()
            .filter_map(|(k, n)| match n {
                Name::Time(unit) => Some((k, *unit)),
                Name::Quantity(_, _) | Name::WithoutUnit(_) | Name::Other => None,
            })
            .collect();
        let own = |(k, _): &&(usize, Option<f64>)| called(*k) == "t_s";
        if times.iter().filter(own).count() > 1 {
            return Err(error("column `t_s` appears twice".into()));
        }
        let stated = |(_, unit): &&(usize, Option<f64>)| unit.is_some();
        let time = times
            .iter()
            .find(own)
            .or_else(|| times.iter().find(stated))
            .or_else(|| times.first());
        let unclear: Vec<String> = names
            .iter()
            .enumerate()
            .filter_map(|(k, n)| match n {
                Name::WithoutUnit(q) => {
                    let own = KNOWN.get(*q).map_or("", |k| k.name);
                    Some(format!("unknown column `{}`: it states no unit that is known; call it `{own}` where it is that", called(k)))
                }
                Name::Time(_) | Name::Quantity(_, _) | Name::Other => None,
            })
            .collect();
        let Some(time) = time.copied() else {
            let unclear: String = unclear.iter().map(|u| format!("; {u}")).collect();
            return Err(error(format!("column `t_s` is missing{unclear}")));
        };
        let mut columns = Columns {
            time,
            quantities: vec![None; names.len()],
            has: [false; Quantity::COUNT],
        };
        if !unclear.is_empty() {
            let time = match time.1 {
                Some(_) => String::new(),
                None => format!("column `t_s` is missing (`{}` states no unit); ", called(time.0)),
            };
            return Err(error(format!("{time}{}", unclear.join("; "))));
        }
        let mut renamed = Vec::new();
        for (k, name) in names.iter().enumerate() {
            let (Name::Quantity(q, factor), Some(known)) = (name, quantity_of(*name)) else {
                continue;
            };
            if let Some(has) = columns.has.get_mut(*q)
                && core::mem::replace(has, true)
            {
                return Err(error(format!("column `{}` appears twice", known.name)));
            }
            if let Some(slot) = columns.quantities.get_mut(k) {
                *slot = Some((*q, *factor));
            }
            if called(k) != known.name {
                renamed.push(format!("`{}` as {}", called(k), known.name));
            }
        }
        if called(time.0) != "t_s" {
            renamed.insert(0, format!("`{}` as the time", called(time.0)));
        }
        let mut notes = Vec::new();
        if !renamed.is_empty() {
            notes.push(format!(
                "columns are read as Alight's own (roll starboard down, pitch bow up, heave up): {}",
                renamed.join(", ")
            ));
        }
        let left_out: Vec<&str> = names
            .iter()
            .enumerate()
            .filter(|(k, n)| matches!(n, Name::Other) || (matches!(n, Name::Time(_)) && *k != time.0))
            .map(|(k, _)| called(k))
            .filter(|n| !n.is_empty())
            .collect();
        if !columns.has.contains(&true) {
            return Err(error(format!(
                "no column that is read beside the time, but {}",
                left_out.join(", ")
            )));
        }
        if !left_out.is_empty() {
            notes.push(format!("columns that are not read: {}", left_out.join(", ")));
        }
        layout.notes.extend(notes);
        Ok(columns)
    }
}

fn quantity_of(name: Name) -> Option<&'static column::Known> {
    match name {
        Name::Quantity(q, _) => KNOWN.get(q),
        Name::Time(_) | Name::WithoutUnit(_) | Name::Other => None,
    }
}
