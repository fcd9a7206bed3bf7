//! Starts a process of Alight that ends with its starter: the process ends when its standard input, a pipe, closes,
//! which it does even if the starter is killed.

use std::{
    ffi::OsStr,
    fs::File,
    io::{self, BufRead, BufReader, ErrorKind},
    path::Path,
    process::{Child, Command, Stdio},
    sync::mpsc::{SyncSender, TrySendError},
};

use crate::{
    io::store::STATE_VARIABLE,
    process::{notify::SOCKET_VARIABLE, scheduling::session_variable},
};

/// Maximum number of lines of standard output that wait for the starter.
pub const MAX_LINES: usize = 4096;

#[derive(Clone, Copy, Debug, Default)]
pub struct ProcessSurroundings<'a> {
    /// File to which standard error is appended; None: this process's standard error.
    pub errors: Option<&'a Path>,
    /// State directory, which outlives the process; None: the one that the service manager names.
    pub state: Option<&'a Path>,
    /// Socket for the notification of readiness; None: the service manager's.
    pub notified: Option<&'a Path>,
}

/// Starts `prefix`, the program and its `arguments`; `lines` receives its standard output.
pub fn start<W: AsRef<OsStr>>(
    arguments: impl IntoIterator<Item = W>,
    around: ProcessSurroundings<'_>,
    lines: SyncSender<String>,
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
        .envs(around.notified.map(|socket| (SOCKET_VARIABLE, socket)))
        .envs(session_variable());
    let mut child = command
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(errors)
        .spawn()?;
    if let Some(output) = child.stdout.take() {
        let read = move || {
            for line in BufReader::new(output).lines().map_while(Result::ok) {
                // A full queue loses the line, because no process waits for its starter.
                if let Err(TrySendError::Disconnected(_)) = lines.try_send(line) {
                    break;
                }
            }
        };
        if let Err(e) = std::thread::Builder::new().spawn(read) {
            // Without a reader the child's pipe would fill up.
            let _gone = child.kill().and_then(|()| child.wait());
            return Err(e);
        }
    }
    Ok(child)
}
