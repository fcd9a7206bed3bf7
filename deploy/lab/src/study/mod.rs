//! `alight study`: one quantity measured over many seeds.

pub mod definition;
pub mod envelope;
mod forecasts;
mod motion;
pub mod result;
mod rows;
mod run;
mod table;
mod tasks;

use alight_computer::{
    exit::{CliError, Doing, Exit},
    terminal,
};

use super::args::StudyArgs;

/// `program`: version and commit.
pub fn run(args: &StudyArgs, program: &str) -> Result<Exit, CliError> {
    let Some(name) = args.name.as_deref() else {
        return Err(CliError("STUDY is missing: alight help study lists them".into()));
    };
    if !args.dirs.is_empty() && name != "merge" {
        return Err(CliError("directories are given to `study merge` only".into()));
    }
    match name {
        name if args.tasks.is_some() => print_tasks(args, name)?,
        "merge" => merge(args, program)?,
        name => fly(args, name, program)?,
    }
    Ok(Exit::Success)
}

fn print_tasks(args: &StudyArgs, name: &str) -> Result<(), CliError> {
    if name == "merge" {
        return Err(CliError(
            "--tasks cannot be used with study merge, which flies nothing".into(),
        ));
    }
    let definition = definition::parse(&definition::text(name)?, name)?;
    let rows = rows::expand(&definition, args).doing(format_args!("study {name}"))?;
    let given = std::env::args_os().map(std::ffi::OsString::into_string);
    let given: Vec<String> = given
        .collect::<Result<_, _>>()
        .map_err(|argument| CliError(format!("--tasks: {} is not valid UTF-8", argument.display())))?;
    let seeds = args.tasks.unwrap_or(args.trials);
    for command in tasks::commands(
        args,
        run::first_seed(args, &definition),
        seeds,
        rows.rows.len(),
        &given,
    )? {
        terminal::line(command);
    }
    Ok(())
}

fn fly(args: &StudyArgs, name: &str, program: &str) -> Result<(), CliError> {
    let text = definition::text(name)?;
    let definition = definition::parse(&text, name)?;
    let mut rows = rows::expand(&definition, args).doing(format_args!("study {name}"))?;
    let run = run::GridRun::of(args, &text, program, &definition, &rows.rows);
    if let Some(row) = args.row {
        rows.keep(row).doing(format_args!("study {name}"))?;
    }
    if let Some(directory) = &args.motion {
        return motion::write(directory, &rows.rows, run.seed0, run.alone);
    }
    if args.forecasts {
        return forecasts::fly(args.form, &run, &rows.rows);
    }
    if let Some(record) = &args.verify {
        return run::verify(record, &run, &rows.rows);
    }
    let outcomes = run::fly_grid(&run, &rows.rows)?;
    let study = table::Study {
        args,
        program,
        definition: &definition,
        rows: &rows,
        result: &run.result,
        outcomes: &outcomes,
    };
    study.publish()
}

fn merge(args: &StudyArgs, program: &str) -> Result<(), CliError> {
    let Some(out) = &args.out else {
        return Err(CliError(
            "study merge: give the directory for the joined rows with --out".into(),
        ));
    };
    let Some(first) = args.dirs.first() else {
        return Err(CliError("study merge: name the directories of the shards".into()));
    };
    let (outcomes, joined) = run::join(&args.dirs, out)?;
    let file = first.join(run::STUDY_FILE).display().to_string();
    let definition = definition::parse(&definition::text(&file)?, &file)?;
    let rows = rows::expand(&definition, args).doing(format_args!("study {file}"))?;
    let study = table::Study {
        args,
        program,
        definition: &definition,
        rows: &rows,
        result: &joined,
        outcomes: &outcomes,
    };
    study.publish()
}
