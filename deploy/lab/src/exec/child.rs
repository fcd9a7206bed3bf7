//! A program that answers each line with a line, within a bounded time and length.

use std::{
    io::{BufRead as _, BufReader, Read as _, Write as _},
    os::unix::process::CommandExt as _,
    process::{Child, ChildStdin, ChildStdout, Command, Stdio},
    sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel},
    thread,
    time::Duration,
};

use alight_computer::process::supervisor::pause;
use alight_shared::time::Span;
use alight_transport::clock::steady_ns;
use rustix::process::{Pid, Signal, kill_process_group};

use super::protocol::MAX_LINE_BYTES;

/// Maximum times for an answer, s.
#[derive(Clone, Copy, Debug)]
pub struct AnswerLimits {
    /// Time for the first answer, including the start of the program.
    pub first_s: f64,
    pub next_s: f64,
}

impl Default for AnswerLimits {
    fn default() -> Self {
        AnswerLimits {
            first_s: 30.0,
            next_s: 5.0,
        }
    }
}

/// Time for which the exit status of an ended program is awaited.
const ENDED_S: f64 = 1.0;
const POLL: Duration = Duration::from_millis(5);

/// Child that runs until this is dropped. Its standard error is that of this program.
#[derive(Debug)]
pub struct AnsweringChild {
    child: Child,
    to: SyncSender<String>,
    answers: Receiver<Vec<u8>>,
    limits: AnswerLimits,
    has_answered: bool,
}

impl AnsweringChild {
    pub fn start(command: &str, limits: AnswerLimits) -> Result<AnsweringChild, String> {
        let mut child = Command::new("sh")
            .args(["-c", command])
            .process_group(0)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .map_err(|e| format!("cannot be started: {e}"))?;
        let (to, lines) = sync_channel(1);
        let (from, answers) = sync_channel(1);
        let input = child.stdin.take();
        let output = child.stdout.take();
        // Both threads end with the child's pipes.
        thread::spawn(move || input.map(|input| write(input, &lines)));
        thread::spawn(move || output.map(|output| read(output, &from)));
        Ok(AnsweringChild {
            child,
            to,
            answers,
            limits,
            has_answered: false,
        })
    }

    pub fn ask(&mut self, line: String) -> Result<(Vec<u8>, Span), String> {
        if self.answers.try_recv().is_ok() {
            return Err("wrote a line that answers no input".into());
        }
        let limit_s = if self.has_answered {
            self.limits.next_s
        } else {
            self.limits.first_s
        };
        let began_ns = steady_ns();
        if self.to.try_send(line).is_err() {
            return Err(self.ending());
        }
        match self.answers.recv_timeout(Duration::from_secs_f64(limit_s)) {
            Ok(answer) if answer.last() != Some(&b'\n') && answer.len() >= MAX_LINE_BYTES => Err(format!(
                "answered with a line of more than {MAX_LINE_BYTES} bytes"
            )),
            Ok(answer) => {
                self.has_answered = true;
                Ok((answer, Span::from_nanos(steady_ns() - began_ns)))
            }
            Err(RecvTimeoutError::Timeout) => Err(format!("did not answer within {limit_s} s")),
            Err(RecvTimeoutError::Disconnected) => Err(self.ending()),
        }
    }

    fn ending(&mut self) -> String {
        let began_ns = steady_ns();
        loop {
            match self.child.try_wait() {
                Ok(Some(status)) => return format!("ended ({status})"),
                Ok(None) if ((steady_ns() - began_ns) as f64) < ENDED_S * 1e9 => pause(POLL),
                Ok(None) | Err(_) => return "closed its input or output".into(),
            }
        }
    }
}

impl Drop for AnsweringChild {
    fn drop(&mut self) {
        // The group includes processes that the shell has started; either call fails if the child has ended.
        let _ended = kill_process_group(Pid::from_child(&self.child), Signal::KILL);
        let _ended = self.child.kill();
        let _status = self.child.wait();
    }
}

fn write(mut input: ChildStdin, lines: &Receiver<String>) {
    for line in lines {
        if input
            .write_all(line.as_bytes())
            .and_then(|()| input.flush())
            .is_err()
        {
            break;
        }
    }
}

fn read(output: ChildStdout, to: &SyncSender<Vec<u8>>) {
    let mut output = BufReader::new(output);
    loop {
        let mut line = Vec::new();
        let read = output
            .by_ref()
            .take(MAX_LINE_BYTES as u64)
            .read_until(b'\n', &mut line);
        if !matches!(read, Ok(1..)) || to.send(line).is_err() {
            break;
        }
    }
}
