//! What a trace tells, for people and for programs.

use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, bail, ensure};
use trace::Trace;

use crate::episode_picture;
use crate::floor_plan::floor_plan;
use crate::outputs::{self, Force};
use crate::story::{self, Story, Subgoal};
use crate::table::aligned;

/// Folders below the given one that are looked into: a run's `traces/training`.
const DEPTH: usize = 3;

#[derive(clap::Args)]
pub(crate) struct Args {
    /// Traces, folders of them, or a run
    #[arg(required = true)]
    paths: Vec<PathBuf>,
    /// For programs: an object for a trace, an array for several
    #[arg(long)]
    json: bool,
    /// Write the picture of a trace: maze, graph, chosen nodes, the path walked
    #[arg(long, value_name = "SVG")]
    picture: Option<PathBuf>,
    #[command(flatten)]
    force: Force,
}

/// `formica inspect`: exit code 1 where a trace cannot be read, 3 where one is cut off.
pub(crate) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let single = args.paths.len() == 1 && args.paths[0].is_file();
    let paths = if single {
        args.paths.clone()
    } else {
        gather(&args.paths)?
    };
    if single {
        let trace = trace::read(&paths[0])?;
        let story = Story::of(&trace);
        if let Some(picture) = &args.picture {
            draw(&trace, &story, picture, args.force)?;
        }
        if args.json {
            println!("{}", serde_json::to_string_pretty(&story)?);
        } else {
            print!("{}", told(&paths[0], &trace, &story));
        }
        return Ok(code(false, story.cut.is_some()));
    }
    ensure!(
        args.picture.is_none(),
        "--picture draws one trace; name its file, or see `formica report` for a run's"
    );
    let stories: Vec<(PathBuf, anyhow::Result<Story>)> = paths
        .into_iter()
        .map(|path| {
            let story = trace::read(&path).map(|trace| Story::of(&trace));
            (path, story.map_err(Into::into))
        })
        .collect();
    if args.json {
        println!("{}", serde_json::to_string_pretty(&json(&stories)?)?);
    } else {
        print!("{}", overview(&stories));
    }
    let unread = stories.iter().any(|(_, story)| story.is_err());
    let cut = stories.iter().filter_map(|(_, story)| story.as_ref().ok());
    let cut = cut.into_iter().any(|story| story.cut.is_some());
    Ok(code(unread, cut))
}

fn code(unread: bool, cut: bool) -> ExitCode {
    match (unread, cut) {
        (true, _) => ExitCode::FAILURE,
        (false, true) => ExitCode::from(3),
        (false, false) => ExitCode::SUCCESS,
    }
}

/// All traces in the given folders, by name; of a run those in its `traces`.
fn gather(given: &[PathBuf]) -> anyhow::Result<Vec<PathBuf>> {
    let mut paths = vec![];
    for path in given {
        if !path.is_dir() {
            ensure!(path.exists(), "there is no {}", path.display());
            paths.push(path.clone());
            continue;
        }
        let run = path.join("traces");
        let folder = if run.is_dir() { &run } else { path };
        let before = paths.len();
        search(folder, DEPTH, &mut paths)?;
        if paths.len() == before {
            bail!(
                "there is no trace in {}; a run writes them when it evaluates, and every so many \
                 training episodes with traces.training_every",
                folder.display()
            );
        }
    }
    Ok(paths)
}

/// Traces in a folder and those below it, by name.
pub(crate) fn search(folder: &Path, depth: usize, paths: &mut Vec<PathBuf>) -> anyhow::Result<()> {
    let reading = || format!("reading {}", folder.display());
    let mut entries = vec![];
    for entry in fs::read_dir(folder).with_context(reading)? {
        entries.push(entry.with_context(reading)?.path());
    }
    entries.sort();
    let is_trace = |path: &PathBuf| {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        path.is_file() && (name.ends_with(".mcap") || name.ends_with(".mcap.part"))
    };
    paths.extend(entries.iter().filter(|path| is_trace(path)).cloned());
    for folder in entries.iter().filter(|path| path.is_dir() && depth > 0) {
        search(folder, depth - 1, paths)?;
    }
    Ok(())
}

fn draw(trace: &Trace, story: &Story, path: &Path, force: Force) -> anyhow::Result<()> {
    let title = format!("Episode {} of {}", story.episode, story.run);
    let subtitle = format!(
        "{} in {} steps; {} of {} subgoals reached",
        story.outcome,
        story.steps,
        story.reached(),
        story.subgoals.len()
    );
    let picture = episode_picture::svg(trace, story, title, subtitle)?;
    outputs::write(path, force.existing(), picture.as_bytes())
}

/// A trace in words.
fn told(path: &Path, trace: &Trace, story: &Story) -> String {
    let mut text = String::new();
    let mut line = |told: String| {
        let _ = writeln!(text, "{told}");
    };
    let s = story;
    line(path.display().to_string());
    line(format!(
        "episode {} of the run {} ({}, actor {}), maze {}, seed {}",
        s.episode, s.run, s.purpose, s.actor, s.maze, s.seed
    ));
    line(format!(
        "weights {} and {}, graph {}, config {}, formica {}",
        s.low_version, s.high_version, s.graph_version, s.config, s.formica
    ));
    let how = match s.outcome {
        "success" => "the goal reached",
        "failure" => "the goal not reached",
        _ => "not known how it ended",
    };
    line(format!(
        "{}: {how} in {} steps ({:.1} s), return {}",
        s.outcome, s.steps, s.seconds, s.episode_return
    ));
    if let Some(reason) = &s.cut {
        line(format!("the trace ends before the episode did: {reason}"));
    }
    let place = |[x, y]: [f32; 2]| format!("({x:.1}, {y:.1})");
    line(format!(
        "from {} towards {}: {:.1} m walked, {:.2} m from the goal at the nearest",
        place(s.start),
        place(s.goal),
        s.walked,
        s.nearest
    ));
    line(format!(
        "{} falls, {} steps on the back{}",
        s.falls,
        s.steps_on_back,
        if s.fell { ", and so at the end" } else { "" }
    ));
    line(format!(
        "{} subgoals: {} reached, {} given up",
        s.subgoals.len(),
        s.reached(),
        s.given_up()
    ));
    if !s.subgoals.is_empty() {
        text += "\n";
        text += &aligned(&subgoals(&s.subgoals));
    }
    let nodes = story::nodes(trace);
    let plan = story::layout(trace).ok();
    if let Some(plan) = plan.and_then(|layout| floor_plan(&layout, &nodes, story)) {
        let _ = writeln!(text, "\n{plan}");
    }
    text
}

fn subgoals(subgoals: &[Subgoal]) -> Vec<Vec<String>> {
    let header = [
        "step",
        "at node",
        "to node",
        "probability",
        "value",
        "outcome",
        "steps",
    ];
    let number = |value: Option<f32>| value.map_or("-".to_owned(), |value| format!("{value:.2}"));
    let rows = subgoals.iter().map(|subgoal| {
        vec![
            subgoal.step.to_string(),
            subgoal.node.to_string(),
            subgoal.subgoal_node.to_string(),
            number(subgoal.probability),
            number(subgoal.value),
            match subgoal.reached {
                Some(true) => "reached",
                Some(false) => "given up",
                None => "-",
            }
            .to_owned(),
            subgoal.steps.to_string(),
        ]
    });
    let header = header.map(str::to_owned).to_vec();
    std::iter::once(header).chain(rows).collect()
}

/// A line for each trace, and what they come to.
fn overview(stories: &[(PathBuf, anyhow::Result<Story>)]) -> String {
    let header = [
        "trace", "purpose", "outcome", "steps", "return", "subgoals", "reached", "given up",
        "falls", "low", "high", "graph",
    ];
    let mut lines = vec![header.map(str::to_owned).to_vec()];
    let mut notes = String::new();
    for (path, story) in stories {
        let name = path.display().to_string();
        match story {
            Ok(s) => lines.push(vec![
                name,
                s.purpose.clone(),
                s.outcome.to_owned(),
                s.steps.to_string(),
                s.episode_return.to_string(),
                s.subgoals.len().to_string(),
                s.reached().to_string(),
                s.given_up().to_string(),
                s.falls.to_string(),
                s.low_version.to_string(),
                s.high_version.to_string(),
                s.graph_version.to_string(),
            ]),
            Err(error) => {
                let _ = writeln!(notes, "unreadable: {error:#}");
            }
        }
    }
    let read: Vec<&Story> = stories
        .iter()
        .filter_map(|(_, s)| s.as_ref().ok())
        .collect();
    let count = |outcome: &str| read.iter().filter(|s| s.outcome == outcome).count();
    let steps: usize = read.iter().map(|story| story.steps).sum();
    let mut text = aligned(&lines);
    let _ = writeln!(
        text,
        "\n{} traces: {} successes, {} failures, {} cut off, {} unreadable; {steps} steps",
        stories.len(),
        count("success"),
        count("failure"),
        count("cut off"),
        stories.len() - read.len()
    );
    text + &notes
}

fn json(stories: &[(PathBuf, anyhow::Result<Story>)]) -> anyhow::Result<serde_json::Value> {
    let of = |(path, story): &(PathBuf, anyhow::Result<Story>)| {
        let mut value = match story {
            Ok(story) => serde_json::to_value(story)?,
            Err(error) => serde_json::json!({ "unreadable": format!("{error:#}") }),
        };
        value["trace"] = path.display().to_string().into();
        anyhow::Ok(value)
    };
    let all: anyhow::Result<Vec<_>> = stories.iter().map(of).collect();
    Ok(all?.into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_is_searched_and_a_run_has_its_traces() {
        let folder = tempfile::tempdir().unwrap();
        let deep = folder.path().join("traces/training");
        fs::create_dir_all(&deep).unwrap();
        for name in [
            "traces/b.mcap",
            "traces/a.mcap.part",
            "traces/training/c.mcap",
            "x.mcap",
        ] {
            fs::write(folder.path().join(name), "").unwrap();
        }
        fs::write(deep.join("notes.txt"), "").unwrap();
        let found = gather(&[folder.path().to_path_buf()]).unwrap();
        let names: Vec<_> = found
            .iter()
            .map(|path| {
                path.strip_prefix(folder.path())
                    .unwrap()
                    .display()
                    .to_string()
            })
            .collect();
        assert_eq!(
            names,
            [
                "traces/a.mcap.part",
                "traces/b.mcap",
                "traces/training/c.mcap"
            ]
        );
        assert!(gather(&[folder.path().join("none")]).is_err());
        let empty = tempfile::tempdir().unwrap();
        let told = gather(&[empty.path().to_path_buf()])
            .unwrap_err()
            .to_string();
        assert!(told.contains("no trace in"), "{told}");
    }
}
