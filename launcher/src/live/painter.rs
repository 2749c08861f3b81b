//! The thread that draws: a terminal that takes nothing holds nobody else up.

use std::cell::RefCell;
use std::fs::File;
use std::io::{self, Write};
use std::rc::Rc;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use ratatui::backend::CrosstermBackend;
use ratatui::layout::Rect;
use ratatui::{Terminal, TerminalOptions, Viewport};

use super::frame;
use super::terminal;
use super::view::View;

/// An empty screen.
const CLEAR: &[u8] = b"\x1b[0m\x1b[2J";

/// What is drawn next.
#[derive(Default)]
struct Desk {
    view: Option<View>,
    done: bool,
}

#[derive(Default)]
struct Shared {
    desk: Mutex<Desk>,
    news: Condvar,
}

impl Shared {
    fn desk(&self) -> MutexGuard<'_, Desk> {
        self.desk.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits for the next view; none when there will be no more.
    fn next(&self) -> Option<View> {
        let mut desk = self.desk();
        loop {
            if desk.done {
                return None;
            }
            if let Some(view) = desk.view.take() {
                return Some(view);
            }
            desk = self.news.wait(desk).unwrap_or_else(PoisonError::into_inner);
        }
    }
}

/// Draws views, and gives the terminal back in the end.
pub(crate) struct Painter {
    shared: Arc<Shared>,
    thread: JoinHandle<()>,
}

impl Painter {
    /// Begins; what is said to standard error meanwhile goes to `log`.
    pub(crate) fn start(log: File) -> io::Result<Self> {
        terminal::guard()?;
        let shared = Arc::new(Shared::default());
        let own = Arc::clone(&shared);
        let thread = std::thread::Builder::new()
            .name("view".to_owned())
            .spawn(move || {
                // A terminal that is gone takes no more; the run goes on.
                let _ = paint(&own, &log);
            })?;
        Ok(Self { shared, thread })
    }

    /// Has a view drawn; of those that were not drawn yet only the newest is.
    pub(crate) fn show(&self, view: View) {
        self.shared.desk().view = Some(view);
        self.shared.news.notify_one();
    }

    /// Whether nothing is drawn any more.
    pub(crate) fn is_gone(&self) -> bool {
        self.thread.is_finished()
    }
}

impl Drop for Painter {
    fn drop(&mut self) {
        self.shared.desk().done = true;
        self.shared.news.notify_one();
        // One that is stuck in a write is left to itself.
        let start = Instant::now();
        while !self.thread.is_finished() && start.elapsed() < Duration::from_millis(300) {
            std::thread::sleep(Duration::from_millis(2));
        }
        terminal::close();
    }
}

/// Where a frame's bytes are gathered, so that they are written at once.
#[derive(Clone, Default)]
struct Bytes(Rc<RefCell<Vec<u8>>>);

impl Write for Bytes {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.borrow_mut().write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// The screen as it was drawn last.
struct Screen {
    terminal: Terminal<CrosstermBackend<Bytes>>,
    area: Rect,
}

impl Screen {
    fn new(area: Rect, bytes: &Bytes) -> io::Result<Self> {
        let backend = CrosstermBackend::new(bytes.clone());
        let viewport = Viewport::Fixed(area);
        let terminal = Terminal::with_options(backend, TerminalOptions { viewport })?;
        // Not by the terminal's own means, which would ask where the cursor is.
        bytes.0.borrow_mut().extend_from_slice(CLEAR);
        Ok(Self { terminal, area })
    }
}

fn paint(shared: &Shared, log: &File) -> io::Result<()> {
    let bytes = Bytes::default();
    let mut screen: Option<Screen> = None;
    while let Some(view) = shared.next() {
        let Some(taken) = terminal::take(log)? else {
            continue;
        };
        let ((width, height), anew) = (taken.size()?, taken.anew);
        // A panic in a frame must find the terminal free to be given back.
        drop(taken);
        let area = Rect::new(0, 0, width, height);
        let mut drawn = match screen.take().filter(|screen| !anew && screen.area == area) {
            Some(screen) => screen,
            None => Screen::new(area, &bytes)?,
        };
        drawn.terminal.draw(|frame| frame::draw(&view, frame))?;
        let frame = whole(&std::mem::take(&mut *bytes.0.borrow_mut()));
        let Some(mut taken) = terminal::take(log)?.filter(|taken| !taken.anew) else {
            continue;
        };
        match taken.write(&frame) {
            // It takes nothing just now; what it shows is not known.
            Err(error) if error.kind() == io::ErrorKind::WouldBlock => {}
            written => {
                written?;
                screen = Some(drawn);
            }
        }
        taken.heed_keys();
    }
    Ok(())
}

/// A frame that is shown all at once, by terminals that know how to.
fn whole(drawn: &[u8]) -> Vec<u8> {
    [b"\x1b[?2026h", drawn, b"\x1b[?2026l"].concat()
}
