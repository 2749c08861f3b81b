//! Frames, drawn to a buffer and read.

use std::collections::BTreeMap;
use std::sync::Arc;

use ratatui::Terminal;
use ratatui::backend::TestBackend;
use ratatui::layout::Rect;
use wire::{Phase, State};

use super::process_rows::LEFT;
use super::state::{LINES, TRAIL};
use super::view::{Ant, Health, MazeOutline, Metric, Process, Score, View};
use super::*;
use crate::record::throughput::Throughput;

/// A run of the small maze, at its evaluation.
fn view() -> View {
    let process = |name: &str, health, doing: &str, rate| Process {
        name: name.to_owned(),
        pid: Some(4711),
        health,
        doing: doing.to_owned(),
        done: None,
        rate,
        restarts: 0,
        silence: Some(Duration::from_millis(90)),
    };
    let metric = |label, value, history| Metric {
        label,
        value,
        decimals: 3,
        history,
    };
    View {
        run: "runs/small".to_owned(),
        config: "0123456789abcdef".to_owned(),
        phases: &[Phase::Train, Phase::Settle, Phase::Evaluate, Phase::Finish],
        phase: Phase::Evaluate,
        passed: Duration::from_secs(83),
        processes: vec![
            process(
                "graph-builder",
                Health::Alive(State::Settled),
                "20 nodes, 61 edges",
                None,
            ),
            Process {
                done: Some(0.45),
                ..process(
                    "learner",
                    Health::Alive(State::Trained),
                    "low 45%, high 90%",
                    Some((812.0, "updates")),
                )
            },
            process(
                "actor 0",
                Health::Alive(State::Working),
                "",
                Some((10_234.0, "steps")),
            ),
            Process {
                restarts: 3,
                silence: None,
                ..process("actor 1", Health::Restarting, "", None)
            },
        ],
        score: Some(Score {
            successes: 3,
            done: 4,
            episodes: 8,
        }),
        metrics: vec![
            metric("policy lag", 2.5, vec![1.0, 2.5]),
            metric("low policy loss", 0.125, vec![4.0, 2.0, 0.125]),
        ],
        outline: Arc::new(MazeOutline::new(&Layout::named("umaze").unwrap())),
        ants: vec![Ant {
            id: 1,
            trail: vec![[4.0, 0.0], [8.0, 8.0]],
        }],
        lines: vec!["round 1 of 3".to_owned(), "evaluate: 8 episodes".to_owned()],
        colour: true,
    }
}

/// The rows of a frame.
fn drawn(view: &View, width: u16, height: u16) -> Vec<String> {
    let mut terminal = Terminal::new(TestBackend::new(width, height)).unwrap();
    terminal.draw(|frame| frame::draw(view, frame)).unwrap();
    let buffer = terminal.backend().buffer();
    let row = |y| (0..width).map(move |x| buffer[(x, y)].symbol()).collect();
    (0..height).map(row).collect()
}

fn row_with<'r>(rows: &'r [String], word: &str) -> &'r str {
    let found = rows.iter().find(|row| row.contains(word));
    found.unwrap_or_else(|| panic!("no {word} in\n{}", rows.join("\n")))
}

#[test]
fn a_frame_shows_all_of_a_run() {
    for (width, height) in [(120, 40), (80, 24)] {
        let rows = drawn(&view(), width, height);
        let has = |word: &str, others: &[&str]| {
            let row = row_with(&rows, word);
            assert!(others.iter().all(|other| row.contains(other)), "{row}");
        };
        has("runs/small", &["0:01:23"]);
        has("train › settle › evaluate", &["0123456789abcdef"]);
        has("graph-builder", &["settled", "20 nodes", "now"]);
        has("learner", &["trained", "low 45%", "812 updates"]);
        has("actor 0", &["working", "10,234 steps"]);
        has("actor 1", &["restarting", "3"]);
        has("score so far", &["75.0", "3 of 4", "4 to come"]);
        has("policy lag", &["2.500", "▁█"]);
        has("low policy loss", &["0.125", "█▄▁"]);
        has("round 1 of 3", &[]);
        has("evaluate: 8 episodes", &[]);
        has("Ctrl-C", &[]);
        if width == 120 {
            has("learner", &["4711", "█", "45%"]);
        }
    }
}

#[test]
fn ants_are_at_their_positions() {
    let mut view = view();
    let area = Rect::new(0, 0, 36, 18);
    let outline = Arc::clone(&view.outline);
    assert_eq!(maze::fit(&outline, area), area, "12 m by 12 m");
    let dots = |view: &View| {
        let mut buffer = ratatui::buffer::Buffer::empty(area);
        maze::draw(view, style::Theme::new(true), area, &mut buffer);
        let cells = (0..18).flat_map(|y| (0..36).map(move |x| (x, y)));
        let dots = cells.filter(|at| buffer[*at].symbol() == "●");
        dots.map(|(x, y)| (x, y, buffer[(x + 1, y)].symbol().to_owned()))
            .collect::<Vec<_>>()
    };
    // A cell is 12 columns and 6 rows, with y up. The origin is the centre of the start, in the first column
    // and the last row of cells.
    assert_eq!(dots(&view), [(30, 3, "1".to_owned())]);
    view.ants[0].trail = vec![[0.0, 0.0]];
    assert_eq!(dots(&view), [(6, 15, "1".to_owned())]);
    view.ants[0].trail = vec![[-1.9, 9.9]];
    assert_eq!(dots(&view), [(0, 0, "1".to_owned())]);
    for nowhere in [
        [f32::NAN, 0.0],
        [0.0, f32::INFINITY],
        [-2.1, 0.0],
        [0.0, 10.1],
        [1e30, -1e30],
    ] {
        view.ants[0].trail = vec![[0.0, 0.0], nowhere];
        assert!(dots(&view).is_empty(), "{nowhere:?}");
    }
}

#[test]
fn walls_are_between_free_cells_and_wall_cells() {
    let outline = MazeOutline::new(&Layout::named("umaze").unwrap());
    assert_eq!(outline.bounds, [-2.0, -2.0, 10.0, 10.0]);
    // Seven free cells in a row, bent: two sides of each but one more at both ends.
    assert_eq!(outline.walls.len(), 7 * 2 + 2);
    let west_of_start = [-2.0, -2.0, -2.0, 2.0];
    let south_of_next = [2.0, 2.0, 6.0, 2.0];
    assert!(outline.walls.contains(&west_of_start) && outline.walls.contains(&south_of_next));
    assert_eq!(
        (outline.start, outline.goals),
        ([0.0, 0.0], vec![[0.0, 8.0]])
    );
}

#[test]
fn any_size_and_any_value_can_be_drawn() {
    let plain = view();
    let mut odd = view();
    odd.colour = false;
    odd.passed = Duration::MAX;
    odd.score = Some(Score {
        successes: 0,
        done: 0,
        episodes: 0,
    });
    odd.lines = vec!["\x1b[2J\u{200b}日本語\n\n".repeat(99), "é".repeat(999)];
    odd.outline = Arc::new(MazeOutline::new(&Layout::named("giant").unwrap()));
    odd.ants[0] = Ant {
        id: u32::MAX,
        trail: vec![[f32::MAX, f32::MIN]],
    };
    for process in &mut odd.processes {
        process.doing = "日本語\x07".repeat(20);
        process.done = Some(f64::NAN);
        process.rate = Some((f64::MAX, "steps"));
        process.silence = Some(Duration::MAX);
    }
    let process = odd.processes[0].clone();
    odd.processes.extend(vec![process; 70]);
    for metric in &mut odd.metrics {
        metric.value = f64::NAN;
        metric.history = vec![f64::NAN, f64::MAX, f64::MIN];
    }
    let mut empty = view();
    empty.processes.clear();
    empty.metrics.clear();
    empty.ants.clear();
    empty.lines.clear();
    let widths = (1..=130).chain([150, 200]);
    for (width, height) in widths.flat_map(|width| (1..=60).map(move |height| (width, height))) {
        // Every size once, with one view after the other.
        let view = match (width + height) % 3 {
            0 => &plain,
            1 => &odd,
            _ => &empty,
        };
        let rows = drawn(view, width, height);
        assert!(!rows.concat().contains('\x1b'), "{width} by {height}");
    }
    let rows = drawn(&odd, 120, 40);
    row_with(&rows, "more, ");
}

#[test]
fn without_colours_all_is_plain() {
    let mut view = view();
    view.colour = false;
    let mut terminal = Terminal::new(TestBackend::new(100, 30)).unwrap();
    terminal.draw(|frame| frame::draw(&view, frame)).unwrap();
    let cells = &terminal.backend().buffer().content;
    let plain = |cell: &ratatui::buffer::Cell| {
        cell.fg == ratatui::style::Color::Reset && cell.bg == ratatui::style::Color::Reset
    };
    assert!(cells.iter().all(plain));
}

/// The state of a run in umaze.
fn state() -> LiveState {
    let layout = Layout::named("umaze").unwrap();
    LiveState {
        colour: true,
        ..LiveState::new(&config(), Path::new("runs/small"), &layout)
    }
}

fn config() -> Config {
    let text = "[dataset]\npath = \"x\"\n[collect]\n";
    agents::CONFIGS.parse(text, "x.toml", "x", &[]).unwrap()
}

fn actor(id: u32, place: [f32; 2]) -> Status {
    Status {
        role: Role::Actor as u32,
        id,
        place,
        ..Status::default()
    }
}

#[test]
fn untrusted_messages_are_checked_and_bounded() {
    let mut state = state();
    for step in 0..200_u16 {
        let place = [f32::from(step) / 100.0, 0.0];
        state.on_status(Role::Actor, &actor(0, place));
        state.on_status(Role::Actor, &actor(u32::from(step) + 64, place));
        state.on_status(Role::Learner, &actor(1, place));
        state.on_status(Role::Actor, &actor(2, [1e9, 0.0]));
        state.on_metric("low/policy_loss", f64::from(step));
        state.on_metric("low/policy_loss", f64::INFINITY);
        state.on_metric(&format!("made/up_{step}"), 1.0);
        (0..4).for_each(|_| state.add_line("a line"));
    }
    assert_eq!(state.trails.keys().collect::<Vec<_>>(), [&0]);
    assert_eq!(state.trails[&0].len(), TRAIL);
    assert_eq!(state.histories.len(), 1);
    assert_eq!(state.histories["low/policy_loss"].back(), Some(&199.0));
    assert_eq!(state.lines.len(), LINES);
    // An ant without a position is removed.
    state.on_status(Role::Actor, &actor(0, [f32::NAN; 2]));
    assert!(state.trails.is_empty());
}

#[test]
fn a_view_has_history_and_attached_actors() {
    let mut state = state();
    for value in [0.0, 100.0, 100.0, 100.0] {
        state.on_metric("rollout/score", value);
    }
    state.add_line("a\tline");
    let (now, newest) = (
        Instant::now(),
        BTreeMap::from([("high/kl".to_owned(), 0.5)]),
    );
    let mut attached = actor(5, [0.0, 0.0]);
    attached.state = State::Working as u32;
    attached.set_text("hops\x1b[2J");
    let statuses = BTreeMap::from([((Role::Actor, 5), (attached, now))]);
    let throughput = Throughput::new(&config(), 0, now);
    let scene = Scene {
        phase: Phase::Train,
        seconds: 7.5,
        statuses: &statuses,
        slots: vec![],
        newest: &newest,
        throughput: &throughput,
        score: None,
        episodes: 8,
    };
    let view = state.view(&scene);
    assert_eq!(view.passed, Duration::from_millis(7500));
    let metrics: Vec<_> = view.metrics.iter().map(|f| (f.label, f.value)).collect();
    let expected = [("test score, last 20", 75.0), ("high KL (nats)", 0.5)];
    assert_eq!(metrics, expected);
    assert_eq!(view.lines, ["a line"]);
    let process = &view.processes[0];
    assert_eq!(
        (process.name.as_str(), process.pid),
        ("actor 5 +", Some(std::process::id()))
    );
    assert!(process.health == Health::Alive(State::Working));
    assert_eq!(process.doing, "hops [2J");
    // Without a status for long it has left.
    if let Some(before) = now.checked_sub(LEFT + Duration::from_secs(1)) {
        let statuses = BTreeMap::from([((Role::Actor, 5), (attached, before))]);
        let scene = Scene {
            statuses: &statuses,
            slots: vec![],
            ..scene
        };
        assert!(state.view(&scene).processes.is_empty());
    }
}
