//! `alight status --watch`: redrawn to the size of the terminal window; without a terminal, one line per change. The
//! terminal is always restored at the end.

use std::{io::IsTerminal, time::Duration};

use alight_computer::{
    exit::{CliError, Doing},
    terminal,
};
use ratatui::{
    DefaultTerminal, Frame,
    crossterm::event::{self, Event, KeyCode, KeyEvent, KeyModifiers},
    style::{Color, Style},
    text::{Line, Text},
    widgets::Paragraph,
};

use super::{Status, finding::FindingLevel};

const PERIOD: Duration = Duration::from_millis(250);
const MAX_EVENTS: u32 = 64;

/// Shows each status that `look` returns after waiting for the given time, until `look` returns None or the user
/// quits (q, Esc, Ctrl-C).
pub fn run(mut look: impl FnMut(Duration) -> Result<Option<Status>, CliError>) -> Result<(), CliError> {
    if !std::io::stdout().is_terminal() {
        let mut key = None;
        while let Some(status) = look(PERIOD)? {
            if key.as_ref() != Some(&status.key()) {
                terminal::line(status.line());
                key = Some(status.key());
            }
        }
        return Ok(());
    }
    let mut view =
        ratatui::try_init().doing("drawing in the terminal; without --watch the page is printed")?;
    let shown = show(&mut view, &mut look);
    ratatui::try_restore().doing("restoring the terminal: run the command reset")?;
    shown
}

fn show(
    view: &mut DefaultTerminal,
    look: &mut impl FnMut(Duration) -> Result<Option<Status>, CliError>,
) -> Result<(), CliError> {
    while let Some(status) = look(PERIOD)? {
        view.draw(|frame| draw(frame, &status))
            .doing("drawing in the terminal")?;
        if is_ended()? {
            break;
        }
    }
    Ok(())
}

fn is_ended() -> Result<bool, CliError> {
    const READING: &str = "reading the terminal's keys";
    for _ in 0..MAX_EVENTS {
        if !event::poll(Duration::ZERO).doing(READING)? {
            return Ok(false);
        }
        if let Event::Key(key) = event::read().doing(READING)?
            && ends(key)
        {
            return Ok(true);
        }
    }
    Ok(false)
}

fn ends(key: KeyEvent) -> bool {
    match key.code {
        KeyCode::Esc | KeyCode::Char('q') => true,
        KeyCode::Char('c') => key.modifiers.contains(KeyModifiers::CONTROL),
        _ => false,
    }
}

fn draw(frame: &mut Frame<'_>, status: &Status) {
    let area = frame.area();
    let lines = status.lines(area.width.into(), area.height.into());
    let styled = lines.into_iter().enumerate().map(|(k, line)| {
        let style = match line.level {
            FindingLevel::Fine if k == 0 => Style::new().bold(),
            FindingLevel::Fine => Style::new(),
            FindingLevel::Warning => Style::new().fg(Color::Yellow),
            FindingLevel::Broken => Style::new().fg(Color::Red).bold(),
        };
        Line::styled(line.text, style)
    });
    frame.render_widget(Paragraph::new(Text::from_iter(styled)), area);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::status::{Figure, finding::FindingTopic};
    use alight_shared::msg::still_armed;
    use ratatui::{Terminal, backend::TestBackend};

    #[test]
    fn watch_within_its_window() {
        let status = Status {
            title: "land".into(),
            headline: "Tracking since 4.2 s: reached".into(),
            figures: vec![Figure::of("link", "62 ms old", "0.4 % lost")],
            findings: vec![FindingTopic("armed").broken(still_armed(14.0), "keep clear")],
            ..Status::default()
        };
        for (width, height) in [(80, 20), (32, 6), (1, 1)] {
            let mut view = Terminal::new(TestBackend::new(width, height)).unwrap();
            view.draw(|frame| draw(frame, &status)).unwrap();
            let buffer = view.backend().buffer();
            let row = |y: u16| {
                (0..width)
                    .map(|x| buffer[(x, y)].symbol())
                    .collect::<String>()
                    .trim_end()
                    .to_owned()
            };
            let title: String = "land: Tracking since 4.2 s: reached"
                .chars()
                .take(width.into())
                .collect();
            if width > 1 {
                assert!(title.starts_with(&row(0)), "{}", row(0));
                assert!(
                    row(1).starts_with(if width == 32 { "" } else { "ALARM" }),
                    "{}",
                    row(1)
                );
            }
        }
    }
}
