//! `alight study --tasks`: prints a study as commands, one per line, each of which flies a row and a block of seeds,
//! for a scheduler with several workers (HyperQueue's `--each-line`, GNU parallel, xargs).

use alight_computer::exit::CliError;

use crate::{args::StudyArgs, scene::quoted};

/// Maximum number of commands: schedulers handle fewer and longer commands better.
const TASKS: u64 = 100_000;
/// Flags that differ between the commands, with values.
const OWN: [&str; 5] = ["--tasks", "--trials", "--seed0", "--out", "--jobs"];

/// Commands for `rows` rows; `given` is the command line that requested them, including the program's name.
pub fn commands(
    args: &StudyArgs,
    seed0: u64,
    seeds: u32,
    rows: usize,
    given: &[String],
) -> Result<Vec<String>, CliError> {
    let blocks = args.trials.div_ceil(seeds);
    let count = rows as u64 * u64::from(blocks);
    if count > TASKS {
        return Err(CliError(format!(
            "--tasks {seeds}: {count} commands are more than {TASKS}; give each more seeds"
        )));
    }
    let Some(out) = &args.out else {
        return Err(CliError(
            "--tasks: name the directory for the rows of all commands with --out".into(),
        ));
    };
    let shared = kept(given)
        .iter()
        .map(|a| quoted(a))
        .collect::<Vec<_>>()
        .join(" ");
    let command = |row: usize, block: u32| {
        let from = u64::from(block * seeds);
        let trials = seeds.min(args.trials - block * seeds);
        let seed0 = seed0.saturating_add(from);
        let out = out.join(format!("row-{row}-seed-{seed0}"));
        let out = quoted(&out.display().to_string());
        format!("{shared} --row {row} --seed0 {seed0} --trials {trials} --jobs 1 --out {out}")
    };
    Ok((1..=rows)
        .flat_map(|row| (0..blocks).map(move |block| (row, block)))
        .map(|(row, block)| command(row, block))
        .collect())
}

pub fn given() -> String {
    let given = std::env::args_os().map(|a| quoted(&a.to_string_lossy()));
    given.collect::<Vec<_>>().join(" ")
}

fn kept(given: &[String]) -> Vec<&str> {
    let mut kept = Vec::new();
    let mut all = given.iter().map(String::as_str);
    while let Some(argument) = all.next() {
        if OWN.contains(&argument) {
            let _value = all.next();
        } else if !OWN
            .iter()
            .any(|own| argument.split_once('=').is_some_and(|(flag, _)| flag == *own))
        {
            kept.push(argument);
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::args::typed;

    fn of(arguments: &[&str], rows: usize) -> Result<Vec<String>, CliError> {
        let args: StudyArgs = typed(core::iter::once(&"study").chain(arguments));
        let given: Vec<String> = ["alight", "study"]
            .iter()
            .chain(arguments)
            .map(|w| (*w).to_owned())
            .collect();
        commands(&args, args.seed0.unwrap_or(1), args.tasks.unwrap(), rows, &given)
    }

    #[test]
    fn tasks_of_rows_and_blocks_of_seeds() {
        let arguments = [
            "my study.toml",
            "--tasks",
            "20",
            "--trials=50",
            "--seed0",
            "7",
            "--out",
            "all",
            "--wind",
            "6",
        ];
        let all = of(&arguments, 2).unwrap();
        assert_eq!(all.len(), 6);
        assert_eq!(
            all[0],
            "alight study 'my study.toml' --wind 6 --row 1 --seed0 7 --trials 20 --jobs 1 --out all/row-1-seed-7"
        );
        assert!(
            all[5].ends_with("--row 2 --seed0 47 --trials 10 --jobs 1 --out all/row-2-seed-47"),
            "{}",
            all[5]
        );
        // Each command is valid for this program, and does not request commands itself.
        let last = all[5].replace('\'', "");
        let args: StudyArgs = typed(last.split_whitespace().skip(1).filter(|w| *w != "my"));
        assert!(args.tasks.is_none() && args.row == Some(2));
        let without = of(&["wind", "--tasks", "1"], 1);
        assert!(without.is_err_and(|e| e.to_string().contains("--out")));
        let many = of(&["wind", "--tasks", "1", "--trials", "1000000", "--out", "x"], 9);
        assert!(many.is_err_and(|e| e.to_string().contains("give each more seeds")));
    }
}
