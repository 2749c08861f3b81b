//! The live view of a whole run, in a pseudo-terminal; and lines where there is none.

#![allow(clippy::unwrap_used)] // Helpers of tests are tests too.

use std::fs::File;
use std::io::{Read, Write};
use std::num::NonZero;
use std::os::fd::OwnedFd;
use std::os::unix::ffi::OsStrExt;
use std::path::Path;
use std::process::{Child, Command};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use rustix::fs::{Mode, OFlags};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{Action, LocalModes, Winsize, tcflow, tcgetattr, tcsetwinsize};
use system_tests::{
    SMALL, binary, eventually, finished, kill, one_at_a_time, shared_memory, start,
};

/// A run in a terminal that is read all the while.
struct Session {
    launcher: Child,
    /// The terminal's other end.
    keys: File,
    /// The end that the run has.
    terminal: OwnedFd,
    /// Nobody reads it any more.
    hung_up: Arc<AtomicBool>,
    screen: Arc<Mutex<vt100::Parser>>,
}

/// Gives a terminal a size in rows and columns.
fn resize(terminal: &OwnedFd, rows: u16, columns: u16) -> (NonZero<u16>, NonZero<u16>) {
    let size = Winsize {
        ws_row: rows,
        ws_col: columns,
        ws_xpixel: 0,
        ws_ypixel: 0,
    };
    tcsetwinsize(terminal, size).unwrap();
    (NonZero::new(rows).unwrap(), NonZero::new(columns).unwrap())
}

/// Launches the small run in a terminal of its own.
fn launch(folder: &Path, arguments: &[&str], environment: &[(&str, &str)]) -> Session {
    std::fs::write(folder.join("small.toml"), SMALL).unwrap();
    let controller =
        openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC).unwrap();
    grantpt(&controller).unwrap();
    unlockpt(&controller).unwrap();
    let name = ptsname(&controller, vec![]).unwrap();
    let path = Path::new(std::ffi::OsStr::from_bytes(name.as_bytes()));
    let open = || {
        let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::CLOEXEC;
        rustix::fs::open(path, flags, Mode::empty()).unwrap()
    };
    let terminal = open();
    let (rows, columns) = resize(&terminal, 30, 100);
    // A session of its own, which the terminal controls as a shell's would be.
    let mut command = Command::new("setsid");
    command
        .arg("--ctty")
        .arg(binary())
        .args(["launch", "small.toml"])
        .args(arguments)
        .current_dir(folder)
        .env("TERM", "xterm-256color")
        .env_remove("NO_COLOR")
        .env_remove("CI")
        .envs(environment.iter().copied())
        .stdin(open())
        .stdout(open())
        .stderr(open());
    let launcher = command.spawn().unwrap();
    let screen = Arc::new(Mutex::new(vt100::Parser::new(rows, columns, 500)));
    let keys = File::from(controller);
    let hung_up = Arc::new(AtomicBool::new(false));
    let (mut output, seen) = (keys.try_clone().unwrap(), Arc::clone(&screen));
    let stop = Arc::clone(&hung_up);
    std::thread::spawn(move || {
        let mut bytes = [0; 4096];
        while !stop.load(Ordering::SeqCst)
            && let Ok(n @ 1..) = output.read(&mut bytes)
        {
            seen.lock().unwrap().process(&bytes[..n]);
        }
    });
    Session {
        launcher,
        keys,
        terminal,
        hung_up,
        screen,
    }
}

impl Session {
    fn text(&self) -> String {
        self.screen.lock().unwrap().screen().contents()
    }

    fn is_view(&self) -> bool {
        self.screen.lock().unwrap().screen().alternate_screen()
    }

    fn wait_for(&self, what: &str, holds: impl Fn(&str) -> bool) {
        let seen = eventually(Duration::from_secs(90), || holds(&self.text()));
        assert!(seen, "no {what} on\n{}", self.text());
    }

    /// Closes the terminal's other end, as a window that is closed does.
    fn hang_up(&mut self) {
        self.hung_up.store(true, Ordering::SeqCst);
        self.keys = File::open("/dev/null").unwrap();
    }

    fn press(&mut self, key: u8) {
        self.keys.write_all(&[key]).unwrap();
    }

    /// Whether what is typed is echoed and taken line by line.
    fn is_for_a_shell(&self) -> bool {
        let modes = tcgetattr(&self.terminal).unwrap().local_modes;
        modes.contains(LocalModes::ECHO | LocalModes::ICANON | LocalModes::ISIG)
    }

    /// Waits for the end; the exit code, and the screen as a shell would find it.
    fn end(mut self) -> (Option<i32>, String) {
        let ended = || matches!(self.launcher.try_wait(), Ok(Some(_)));
        let done = eventually(Duration::from_secs(60), ended);
        if !done {
            let _ = self.launcher.kill();
        }
        let code = self.launcher.wait().unwrap().code();
        assert!(done, "it did not end:\n{}", self.text());
        // The reader may be behind.
        self.wait_for("screen of before", |_| !self.is_view());
        assert!(self.is_for_a_shell(), "the terminal's modes are back");
        (code, self.text())
    }
}

impl Drop for Session {
    fn drop(&mut self) {
        let _ = self.launcher.kill();
        let _ = self.launcher.wait();
    }
}

const LONG: [&str; 4] = [
    "--set",
    "low.updates=1000000",
    "--set",
    "rollouts.seconds=600",
];

#[test]
fn a_terminal_shows_the_run_and_has_its_modes_back_after_ctrl_c() {
    let _one = one_at_a_time();
    let folder = tempfile::tempdir().unwrap();
    let mut session = launch(folder.path(), &LONG, &[]);
    assert!(session.is_for_a_shell());
    session.wait_for("processes", |text| {
        ["graph-builder", "learner", "actor 0", "actor 1"]
            .iter()
            .all(|name| text.contains(name))
    });
    assert!(session.is_view() && !session.is_for_a_shell());
    session.wait_for("name", |text| text.contains("runs/small"));
    session.wait_for("losses", |text| text.contains("low policy loss"));
    session.wait_for("ants", |text| text.contains("●0") && text.contains("●1"));
    session.wait_for("rates", |text| {
        text.contains("updates") && text.contains("steps")
    });
    // Another size, in the midst of it.
    let (rows, columns) = resize(&session.terminal, 12, 50);
    let mut parser = session.screen.lock().unwrap();
    parser.screen_mut().set_size(rows, columns);
    drop(parser);
    // There is no room for two lines of head any more.
    let one_line = |head: &str| head.contains("runs/small") && head.contains("train");
    session.wait_for("small frame", |text| {
        text.lines().next().is_some_and(one_line)
    });
    session.press(3);
    let (code, text) = session.end();
    assert_eq!(code, Some(130), "{text}");
    assert!(text.contains("ended by signal"), "{text}");
    let log = folder.path().join("runs/small/logs/launcher.log");
    assert_eq!(std::fs::read_to_string(log).unwrap(), "");
}

#[test]
fn q_is_ctrl_c_and_a_failure_is_told_on_the_screen_of_before() {
    let _one = one_at_a_time();
    let folder = tempfile::tempdir().unwrap();
    let mut session = launch(folder.path(), &LONG, &[("NO_COLOR", "1")]);
    session.wait_for("processes", |text| text.contains("actor 1"));
    let coloured = |session: &Session| {
        let parser = session.screen.lock().unwrap();
        let screen = parser.screen();
        let cells = (0..30).flat_map(|row| (0..100).map(move |column| (row, column)));
        let mut cells = cells.filter_map(|(row, column)| screen.cell(row, column));
        cells.any(|cell| cell.fgcolor() != vt100::Color::Default)
    };
    assert!(!coloured(&session));
    session.press(b'q');
    let (code, text) = session.end();
    assert_eq!(code, Some(130), "{text}");

    let hopeless = ["--set", "actor.restarts=0"];
    let session = launch(folder.path(), &[&LONG[..], &hopeless].concat(), &[]);
    session.wait_for("actors", |text| text.contains("●1"));
    let children = system_tests::of_role(&session.launcher, "actor");
    assert_eq!(children.len(), 2);
    assert!(children.iter().all(|pid| kill(*pid, "-9")));
    let (code, text) = session.end();
    assert_eq!(code, Some(1), "{text}");
    assert!(text.contains("formica: actor-"), "{text}");
}

#[test]
fn a_terminal_that_takes_nothing_or_is_gone_does_not_harm_the_run() {
    let _one = one_at_a_time();
    let folder = tempfile::tempdir().unwrap();
    let session = launch(folder.path(), &[], &[]);
    session.wait_for("processes", |text| text.contains("actor 1"));
    // As Ctrl-S does in a terminal that heeds it.
    tcflow(&session.terminal, Action::OOff).unwrap();
    let score = folder.path().join("runs/small/score.json");
    assert!(
        eventually(Duration::from_secs(120), || score.is_file()),
        "the run goes on to its score"
    );
    tcflow(&session.terminal, Action::OOn).unwrap();
    let (code, text) = session.end();
    assert_eq!(code, Some(0), "{text}");
    assert!(text.contains("normalized score"), "{text}");

    // One that is gone ends the run in order, as it would end other programs.
    let mut session = launch(folder.path(), &LONG, &[]);
    session.wait_for("processes", |text| text.contains("actor 1"));
    session.hang_up();
    let ended = || matches!(session.launcher.try_wait(), Ok(Some(_)));
    assert!(eventually(Duration::from_secs(60), ended));
    assert_eq!(session.launcher.wait().unwrap().code(), Some(130));
    let run = folder.path().join("runs/small-2");
    assert!(run.join("progress.json").is_file());
    assert_eq!(shared_memory(&run), Vec::<String>::new());
}

#[test]
fn without_a_terminal_and_with_plain_there_are_lines_alone() {
    let _one = one_at_a_time();
    let folder = tempfile::tempdir().unwrap();
    let (code, told) = finished(start(folder.path(), &[]), Duration::from_secs(300));
    assert_eq!(code, Some(0), "{told}");
    assert!(
        told.contains("train | ") && told.contains("normalized score"),
        "{told}"
    );
    assert!(!told.contains('\x1b') && !told.contains('\r'), "{told:?}");
    let events = std::fs::read_dir(folder.path().join("runs/small/tensorboard")).unwrap();
    assert_eq!(events.count(), 1);
    let metrics = std::fs::read_to_string(folder.path().join("runs/small/metrics.csv")).unwrap();
    assert!(
        metrics.contains(",launcher,0,throughput/steps_per_s,"),
        "{metrics}"
    );

    let mut session = launch(folder.path(), &[&LONG[..], &["--plain"]].concat(), &[]);
    session.wait_for("lines", |text| text.contains("train | "));
    assert!(!session.is_view() && session.is_for_a_shell());
    session.press(3);
    assert_eq!(session.end().0, Some(130));
}

#[test]
fn ctrl_z_gives_the_terminal_back_and_fg_draws_the_view_again() {
    let _one = one_at_a_time();
    let folder = tempfile::tempdir().unwrap();
    let mut session = launch(folder.path(), &LONG, &[]);
    session.wait_for("actors", |text| text.contains("●1"));
    session.press(26);
    let back = || !session.is_view() && session.is_for_a_shell();
    assert!(eventually(Duration::from_secs(10), back));
    assert!(kill(session.launcher.id(), "-CONT"));
    session.wait_for("view", |text| text.contains("actor 1"));
    assert!(session.is_view() && !session.is_for_a_shell());
    // Stopped without being asked, it cannot give the terminal back; a shell mends that, and clears it.
    assert!(kill(session.launcher.id(), "-STOP"));
    session
        .screen
        .lock()
        .unwrap()
        .process(b"\x1b[?1049l\x1b[2J");
    assert!(kill(session.launcher.id(), "-CONT"));
    assert!(eventually(Duration::from_secs(10), || session.is_view()));
    session.wait_for("view", |text| text.contains("actor 1"));
    session.press(3);
    assert_eq!(session.end().0, Some(130));
}
