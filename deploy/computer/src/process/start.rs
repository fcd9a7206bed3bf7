//! Start of a process of Alight that ends with whoever started it: it holds the reading end of a pipe as its standard input and
//! ends when that closes, so that none outlives a starter that was killed.

use std::ffi::OsStr;
use std::fs::File;
use std::io::{self, BufRead, BufReader, ErrorKind};
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::Sender;

use crate::io::store::STATE_VARIABLE;
use crate::process::notify::SOCKET_VARIABLE;

/// Surroundings of a process.
#[derive(Clone, Copy, Debug, Default)]
pub struct ProcessSurroundings<'a> {
    /// File to which its standard error is appended; None: it goes where this process writes its own.
    pub errors: Option<&'a Path>,
    /// Directory of the state that outlives it; None: that of the service manager.
    pub state: Option<&'a Path>,
    /// It reports that it is ready to this socket; None: to the service manager.
    pub notified: Option<&'a Path>,
}

/// Starts what stands before the program, the program and its arguments, `arguments`; its standard output comes by `lines`.
pub fn start<W: AsRef<OsStr>>(
    arguments: impl IntoIterator<Item = W>,
    around: ProcessSurroundings<'_>,
    lines: Sender<String>,
) -> io::Result<Child> {
    let mut arguments = arguments.into_iter();
    let program = arguments.next().ok_or(ErrorKind::InvalidInput)?;
    let errors: Stdio = match around.errors {
        Some(file) => File::options().create(true).append(true).open(file)?.into(),
        None => Stdio::inherit(),
    };
    let mut command = Command::new(program);
    command
        .args(arguments)
        .arg("--supervised")
        .envs(around.state.map(|directory| (STATE_VARIABLE, directory)))
        .envs(around.notified.map(|socket| (SOCKET_VARIABLE, socket)));
    // A group of its own: the terminal's Ctrl-C reaches the starter only, which ends all.
    command.process_group(0);
    let mut child = command
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(errors)
        .spawn()?;
    if let Some(output) = child.stdout.take() {
        let read = move || {
            let all = BufReader::new(output).lines().map_while(Result::ok);
            all.take_while(|line| lines.send(line.clone()).is_ok())
                .for_each(drop);
        };
        if let Err(e) = std::thread::Builder::new().spawn(read) {
            // No reader would empty its pipe.
            let _gone = child.kill().and_then(|()| child.wait());
            return Err(e);
        }
    }
    Ok(child)
}
