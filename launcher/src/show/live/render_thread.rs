//! The thread that draws, so that a blocked terminal blocks nothing else.

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

/// Clears the screen.
const CLEAR: &[u8] = b"\x1b[0m\x1b[2J";

/// The next frame to draw.
#[derive(Default)]
struct FrameSlot {
    view: Option<View>,
    done: bool,
}

#[derive(Default)]
struct Shared {
    slot: Mutex<FrameSlot>,
    changed: Condvar,
}

impl Shared {
    fn slot(&self) -> MutexGuard<'_, FrameSlot> {
        self.slot.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits for the next view; `None` at the end.
    fn next(&self) -> Option<View> {
        let mut slot = self.slot();
        loop {
            if slot.done {
                return None;
            }
            if let Some(view) = slot.view.take() {
                return Some(view);
            }
            slot = self
                .changed
                .wait(slot)
                .unwrap_or_else(PoisonError::into_inner);
        }
    }
}

/// Draws views. When it is dropped, the terminal is restored.
pub(crate) struct RenderThread {
    shared: Arc<Shared>,
    thread: JoinHandle<()>,
}

impl RenderThread {
    /// Starts the thread. Meanwhile standard error goes to `log`.
    pub(crate) fn start(log: File) -> io::Result<Self> {
        terminal::guard()?;
        let shared = Arc::new(Shared::default());
        let own = Arc::clone(&shared);
        let thread = std::thread::Builder::new()
            .name("view".to_owned())
            .spawn(move || {
                // On an error the terminal is gone, and the run continues.
                let _ = render(&own, &log);
            })?;
        Ok(Self { shared, thread })
    }

    /// Draws a view. If several are waiting, only the newest is drawn.
    pub(crate) fn show(&self, view: View) {
        self.shared.slot().view = Some(view);
        self.shared.changed.notify_one();
    }

    /// Whether the thread has ended.
    pub(crate) fn is_gone(&self) -> bool {
        self.thread.is_finished()
    }
}

impl Drop for RenderThread {
    fn drop(&mut self) {
        self.shared.slot().done = true;
        self.shared.changed.notify_one();
        // Does not wait for a thread that is blocked in a write.
        let start = Instant::now();
        while !self.thread.is_finished() && start.elapsed() < Duration::from_millis(300) {
            std::thread::sleep(Duration::from_millis(2));
        }
        terminal::close();
    }
}

/// Collects the bytes of a frame, which are written at once.
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

/// The screen as last drawn.
struct Screen {
    terminal: Terminal<CrosstermBackend<Bytes>>,
    area: Rect,
}

impl Screen {
    fn new(area: Rect, bytes: &Bytes) -> io::Result<Self> {
        let backend = CrosstermBackend::new(bytes.clone());
        let viewport = Viewport::Fixed(area);
        let terminal = Terminal::with_options(backend, TerminalOptions { viewport })?;
        // ratatui's own way of clearing would query the cursor position.
        bytes.0.borrow_mut().extend_from_slice(CLEAR);
        Ok(Self { terminal, area })
    }
}

fn render(shared: &Shared, log: &File) -> io::Result<()> {
    let bytes = Bytes::default();
    let mut screen: Option<Screen> = None;
    while let Some(view) = shared.next() {
        let Some(taken) = terminal::take(log)? else {
            continue;
        };
        let ((width, height), anew) = (taken.size()?, taken.anew);
        // Released, so that a panic in drawing can restore the terminal.
        drop(taken);
        let area = Rect::new(0, 0, width, height);
        let mut drawn = match screen.take().filter(|screen| !anew && screen.area == area) {
            Some(screen) => screen,
            None => Screen::new(area, &bytes)?,
        };
        drawn.terminal.draw(|frame| frame::draw(&view, frame))?;
        let frame = synchronized(&std::mem::take(&mut *bytes.0.borrow_mut()));
        let Some(mut taken) = terminal::take(log)?.filter(|taken| !taken.anew) else {
            continue;
        };
        match taken.write(&frame) {
            // The terminal is blocked, and its content is unknown.
            Err(error) if error.kind() == io::ErrorKind::WouldBlock => {}
            written => {
                written?;
                screen = Some(drawn);
            }
        }
        taken.handle_keys();
    }
    Ok(())
}

/// A frame that terminals with synchronized output show at once.
fn synchronized(drawn: &[u8]) -> Vec<u8> {
    [b"\x1b[?2026h", drawn, b"\x1b[?2026l"].concat()
}
