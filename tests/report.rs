//! The report of a run: all of its parts are there, it needs no other file, and a browser shows
//! every figure on a phone and on a screen, light and dark.

// Helpers of tests are tests too.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use std::fmt::Write;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

use system_tests::{finished, formica, one_at_a_time, start, text};

const SECTIONS: [&str; 8] = [
    "scores",
    "learning",
    "latent-graph",
    "walks",
    "stages",
    "machinery",
    "training",
    "config",
];
/// Figures of a run that is over.
const FIGURES: [&str; 7] = [
    "curves",
    "graph",
    "paths",
    "times",
    "throughput",
    "lag",
    "losses",
];

/// A run's folder under runs/: an episode every ten seconds, the last half of them at the goal.
fn run(folder: &Path, name: &str, seed: u32, score: Option<f64>) {
    let run = folder.join("runs").join(name);
    std::fs::create_dir_all(&run).unwrap();
    let config = format!("[run]\nname = \"{name}\"\nseed = {seed}\n\n[maze]\nlayout = \"large\"\n");
    std::fs::write(run.join("config.toml"), config).unwrap();
    let mut metrics = String::from("seconds,role,id,name,step,value\n");
    for i in 0..100 {
        let value = if i < 50 { 0 } else { 100 };
        let _ = writeln!(metrics, "{}.0,actor,0,rollout/score,{i},{value}", i * 10);
        let seconds = i * 10;
        let _ = writeln!(metrics, "{seconds}.5,learner,0,low/policy_loss,{i},-0.25");
        let _ = writeln!(
            metrics,
            "{seconds}.5,launcher,0,throughput/steps_per_s,{i},2000"
        );
    }
    std::fs::write(run.join("metrics.csv"), metrics).unwrap();
    if let Some(score) = score {
        let json = format!("{{\"score\": {score}, \"episodes\": 100, \"successes\": {score:.0}}}");
        std::fs::write(run.join("score.json"), json).unwrap();
    }
}

/// The report of runs, and what was said.
fn report(folder: &Path, arguments: &[&str]) -> (Option<i32>, String) {
    let arguments: Vec<&str> = [&["report"], arguments].concat();
    let output = formica(folder, &arguments).output().unwrap();
    (output.status.code(), text(&output))
}

/// What a page asks of the world: links to anything but its own parts, and programs.
fn foreign(page: &str) -> Vec<String> {
    let page = page.replace("xmlns=\"http://www.w3.org/2000/svg\"", "");
    let marks = [
        "http:",
        "https:",
        "//",
        "src=",
        "url(",
        "@import",
        "<script",
        "<link rel=\"style",
    ];
    // A text may hold two slashes; an attribute that points out of the page may not.
    let found = marks.iter().filter(|mark| match **mark {
        "//" => page.contains("=\"//"),
        mark => page.contains(mark),
    });
    found.map(|mark| (*mark).to_owned()).collect()
}

fn has(page: &str, element: &str, id: &str) -> bool {
    page.contains(&format!("<{element} id=\"{id}\""))
}

#[test]
fn the_report_of_a_run_has_every_part_and_needs_no_other_file() {
    let _one = one_at_a_time();
    let folder = tempfile::tempdir().unwrap();
    let launched = start(folder.path(), &[]);
    let (code, told) = finished(launched, Duration::from_secs(300));
    assert_eq!(code, Some(0), "{told}");
    let (code, told) = report(folder.path(), &["latest"]);
    assert_eq!(code, Some(0), "{told}");
    let path = folder.path().join("runs/small/report.html");
    let page = std::fs::read_to_string(&path).unwrap();
    for id in SECTIONS {
        assert!(has(&page, "section", id), "no section {id}");
    }
    for id in FIGURES {
        assert!(has(&page, "figure", id), "no figure {id}");
    }
    assert_eq!(foreign(&page), Vec::<String>::new());
    for part in [
        "<html lang=\"en\">",
        "name=\"viewport\"",
        "layout = &quot;umaze&quot;",
    ] {
        assert!(page.contains(part), "{part}");
    }
    let mut ids: Vec<&str> = page.split(" id=\"").skip(1).collect();
    ids.iter_mut()
        .for_each(|id| *id = id.split('"').next().unwrap());
    ids.sort_unstable();
    assert!(ids.windows(2).all(|pair| pair[0] != pair[1]), "{ids:?}");
    let score = std::fs::read_to_string(folder.path().join("runs/small/score.json")).unwrap();
    let hash = score.split("\"config\": \"").nth(1).unwrap();
    let hash = format!("<dd>{}</dd>", hash.split('"').next().unwrap());
    assert!(page.contains(&hash), "{hash}");
    let successes = score.split("\"successes\": ").nth(1).unwrap();
    let successes = successes.split([',', '\n']).next().unwrap();
    assert!(
        page.contains(&format!("<td class=\"number\">{successes} of 8</td>")),
        "{score}"
    );

    damaged_files_are_named(folder.path());
    missing_files_are_named(folder.path(), &hash);
}

/// A damaged graph or trace is replaced by a message.
fn damaged_files_are_named(folder: &Path) {
    let run = folder.join("runs/small");
    std::fs::write(run.join("graph.bin"), "no graph").unwrap();
    let trace = run.join("traces/episode-0000.mcap");
    let whole = std::fs::read(&trace).unwrap();
    std::fs::write(&trace, &whole[..whole.len() / 2]).unwrap();
    let (code, told) = report(folder, &["small", "--out", "half.html"]);
    assert_eq!(code, Some(0), "{told}");
    let half = std::fs::read_to_string(folder.join("half.html")).unwrap();
    assert!(
        half.contains("graph.bin cannot be read: not a graph file"),
        "no word of the graph"
    );
    assert!(
        half.contains("a trace is left out: "),
        "no word of the trace"
    );
    assert!(!has(&half, "figure", "graph") && has(&half, "figure", "curves"));
}

/// Without its files a run has a report of messages.
fn missing_files_are_named(folder: &Path, hash: &str) {
    let run = folder.join("runs/small");
    std::fs::remove_dir_all(run.join("traces")).unwrap();
    for name in [
        "graph.bin",
        "score.json",
        "stages.json",
        "episodes.csv",
        "metrics.csv",
    ] {
        std::fs::remove_file(run.join(name)).unwrap();
    }
    let (code, told) = report(folder, &["small", "--out", "bare.html"]);
    assert_eq!(code, Some(0), "{told}");
    let bare = std::fs::read_to_string(folder.join("bare.html")).unwrap();
    for id in SECTIONS {
        assert!(has(&bare, "section", id), "no section {id}");
    }
    for told in [
        "no score yet",
        "Without a score yet",
        "no row of rollout/score",
        "no graph was built yet",
        "There is no trace to draw",
        "there is none yet of small",
        "no row of rollout/policy_lag",
        "Nothing was trained yet",
    ] {
        assert!(bare.contains(told), "{told}");
    }
    assert!(!bare.contains("<figure"), "an empty figure");
    assert!(bare.contains(hash), "{hash}");
}

#[test]
fn several_runs_are_grouped_with_their_spread_and_differences() {
    let folder = tempfile::tempdir().unwrap();
    run(folder.path(), "a-1", 1, Some(80.0));
    run(folder.path(), "a-2", 2, Some(90.0));
    run(folder.path(), "b<i>", 1, None);
    let config = folder.path().join("runs/b<i>/config.toml");
    let mut other = std::fs::read_to_string(&config).unwrap();
    other.push_str("[low]\nsnap = 0.25\n");
    std::fs::write(&config, other).unwrap();
    let (code, told) = report(folder.path(), &["a-1", "a-2", "b<i>", "--out", "r.html"]);
    assert_eq!(code, Some(0), "{told}");
    let page = std::fs::read_to_string(folder.path().join("r.html")).unwrap();
    for told in [
        "a: mean ± std",
        "<td class=\"number\">85.0 ± 7.1</td>",
        "Without a score yet, since the evaluation has not ended: b&lt;i&gt;.",
        "<th scope=\"row\">low.snap</th><td>–</td><td>0.25</td>",
        "class=\"band\"",
    ] {
        assert!(page.contains(told), "{told}");
    }
    assert!(!page.contains("<i>"), "a name is markup");
    assert!(has(&page, "figure", "throughput") && !has(&page, "figure", "lag"));
    assert_eq!(foreign(&page), Vec::<String>::new());
}

#[test]
fn what_cannot_be_reported_is_named_and_no_page_is_left() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["whole", "metrics", "score", "stages", "episodes", "config"] {
        run(folder.path(), name, 1, Some(80.0));
    }
    let path = |name: &str| folder.path().join("runs").join(name);
    let metrics = std::fs::read_to_string(path("metrics/metrics.csv")).unwrap();
    let damaged = metrics.replace("rollout/score,7,0", "rollout/score,7");
    std::fs::write(path("metrics/metrics.csv"), damaged).unwrap();
    std::fs::write(path("score/score.json"), "{\n\"score\": x}").unwrap();
    std::fs::write(path("stages/stages.json"), "[]").unwrap();
    let episodes = "episode,success,steps,fell,nearest_m,edges,reached\n0,1,2\n";
    std::fs::write(path("episodes/episodes.csv"), episodes).unwrap();
    std::fs::write(path("config/config.toml"), "[run]\nname = \n").unwrap();
    std::os::unix::fs::symlink("whole", path("latest")).unwrap();
    for (arguments, told) in [
        (&["nowhere"][..], "there is no run nowhere: neither it nor"),
        (&["metrics"], "runs/metrics/metrics.csv:23: expected"),
        (&["score"], "runs/score/score.json:2: "),
        (&["stages"], "runs/stages/stages.json:1: "),
        (&["episodes"], "runs/episodes/episodes.csv:2: expected"),
        (&["config"], "runs/config/config.toml:2: "),
        (
            &["whole", "latest"],
            "the runs whole and latest are the same",
        ),
        (&["whole", "--out", "runs"], "--out runs is a folder"),
        (
            &["whole", "--out", "none/r.html"],
            "writing none/r.html: No such file",
        ),
    ] {
        let (code, said) = report(folder.path(), arguments);
        assert_eq!(code, Some(1), "{said}");
        assert!(said.contains(told), "{told} in {said}");
        let lines = said.lines().count();
        assert_eq!(lines, 1, "{said}");
    }
    for name in ["whole", "metrics", "score", "stages", "episodes", "config"] {
        assert!(!path(name).join("report.html").exists(), "{name}");
    }
}

/// Loads a report in a frame as wide as a phone or a screen and tells what it looks like there,
/// a line each: the frame keeps the report as it is, and is narrower than a window can be.
const LOOK: &str = r##"<!DOCTYPE html>
<meta charset="utf-8"><title>look</title>
<iframe id="frame" src="REPORT" width="WIDTH" height="900" style="border:0"></iframe>
<pre id="told"></pre>
<script>
addEventListener("load", () => {
  const window = frame.contentWindow, page = frame.contentDocument, lines = [];
  lines.push("overflow " + (page.scrollingElement.scrollWidth - window.innerWidth));
  lines.push("ground " + window.getComputedStyle(page.body).backgroundColor);
  lines.push("ink " + window.getComputedStyle(page.body).color);
  for (const link of page.querySelectorAll("nav a")) {
    const target = page.querySelector(link.getAttribute("href"));
    lines.push("link " + link.hash + " " + (target && target.offsetHeight > 0));
  }
  for (const figure of page.querySelectorAll("figure")) {
    for (const svg of figure.querySelectorAll("svg")) {
      const box = svg.getBoundingClientRect();
      if (box.width === 0 && !svg.checkVisibility()) continue;
      const view = svg.viewBox.baseVal, drawn = svg.querySelectorAll("path,circle,rect").length;
      let outside = 0, letters = Infinity;
      for (const text of svg.querySelectorAll("text")) {
        const place = text.getBoundingClientRect();
        if (place.left < box.left - 1 || place.right > box.right + 1
          || place.top < box.top - 1 || place.bottom > box.bottom + 1) outside += 1;
        const size = parseFloat(window.getComputedStyle(text).fontSize);
        letters = Math.min(letters, size * box.width / view.width);
      }
      const paper = window.getComputedStyle(svg.querySelector(".paper")).fill;
      lines.push(["figure", figure.id, Math.round(box.width), Math.round(box.height), drawn,
        outside, letters.toFixed(1), paper.replaceAll(" ", "")].join(" "));
    }
  }
  told.textContent = "begin\n" + lines.join("\n") + "\nend";
});
</script>
"##;

/// What a browser tells of a page, and what stands on its console.
fn look(folder: &Path, page: &str, width: u32, dark: bool) -> (String, Vec<String>) {
    let look = LOOK
        .replace("REPORT", page)
        .replace("WIDTH", &width.to_string());
    let path = folder.join("look.html");
    std::fs::write(&path, look).unwrap();
    let profile = tempfile::tempdir().unwrap();
    let scheme = if dark { 0 } else { 1 };
    let output = Command::new("chromium")
        .args(["--headless", "--no-sandbox", "--disable-gpu"])
        .args([
            "--enable-logging=stderr",
            "--v=0",
            "--virtual-time-budget=10000",
        ])
        // The frame's file is another's to its page otherwise.
        .arg("--allow-file-access-from-files")
        .arg(format!("--blink-settings=preferredColorScheme={scheme}"))
        .arg(format!("--user-data-dir={}", profile.path().display()))
        .args(["--window-size=1400,1000", "--dump-dom"])
        .arg(format!("file://{}", path.display()))
        .stdin(Stdio::null())
        .output()
        .expect("Chromium: apt-get install chromium");
    let (page, log) = (
        String::from_utf8_lossy(&output.stdout).into_owned(),
        String::from_utf8_lossy(&output.stderr).into_owned(),
    );
    let told = page
        .split("begin\n")
        .nth(1)
        .and_then(|rest| rest.split("\nend").next());
    let told = told.unwrap_or_else(|| panic!("the page was not looked at:\n{page}\n{log}"));
    let console = log.lines().filter(|line| line.contains("CONSOLE"));
    (told.to_owned(), console.map(str::to_owned).collect())
}

/// The faults of a page as it is shown.
fn faults(told: &str, figures: &[&str], dark: bool) -> Vec<String> {
    let mut faults = vec![];
    let mut seen = vec![];
    for line in told.lines() {
        let words: Vec<&str> = line.split(' ').collect();
        let number = |i: usize| words[i].parse::<f64>().unwrap();
        let sound = match words[0] {
            "overflow" => number(1) <= 0.0,
            "link" => words[2] == "true",
            "ground" => (brightness(line) < 100) == dark,
            "ink" => (brightness(line) > 150) == dark,
            "figure" => {
                seen.push(words[1]);
                let paper = (brightness(words[7]) < 100) == dark;
                let drawn = number(4) > 2.0 && number(5) == 0.0 && number(6) >= 9.0;
                number(2) >= 200.0 && number(3) >= 60.0 && drawn && paper
            }
            _ => false,
        };
        if !sound {
            faults.push(line.to_owned());
        }
    }
    let missing = figures.iter().filter(|figure| !seen.contains(figure));
    faults.extend(missing.map(|figure| format!("figure {figure} is not shown")));
    faults
}

/// Of a colour as CSS tells it, from 0 to 255.
fn brightness(colour: &str) -> u32 {
    let digits = colour.split(|c: char| !c.is_ascii_digit());
    let parts: Vec<u32> = digits.filter_map(|part| part.parse().ok()).collect();
    parts[..3].iter().sum::<u32>() / 3
}

#[test]
#[ignore = "needs Chromium; .ci/run runs it"]
fn a_browser_shows_every_figure_and_has_nothing_to_complain_of() {
    let _one = one_at_a_time();
    let folder = tempfile::tempdir().unwrap();
    let launched = start(folder.path(), &[]);
    let (code, told) = finished(launched, Duration::from_secs(300));
    assert_eq!(code, Some(0), "{told}");
    for name in ["a-1", "a-2", "b-1"] {
        run(folder.path(), name, 1, Some(80.0));
    }
    let config = folder.path().join("runs/b-1/config.toml");
    let mut other = std::fs::read_to_string(&config).unwrap();
    other.push_str("[low]\nsnap = 0.25\n");
    std::fs::write(&config, other).unwrap();
    let all = [&FIGURES[..], &["throughput"]].concat();
    for (runs, page, figures) in [
        (&["small"][..], "one.html", &FIGURES[..]),
        (&["a-1", "a-2", "b-1", "small"], "four.html", &all),
    ] {
        let arguments = [runs, &["--out", page]].concat();
        let (code, told) = report(folder.path(), &arguments);
        assert_eq!(code, Some(0), "{told}");
        for (width, dark) in [(360, false), (360, true), (1200, false), (1200, true)] {
            let (told, console) = look(folder.path(), page, width, dark);
            let found = faults(&told, figures, dark);
            assert_eq!(
                found,
                Vec::<String>::new(),
                "{page} {width} {dark}:\n{told}"
            );
            assert_eq!(console, Vec::<String>::new(), "{page} {width} {dark}");
        }
    }

    // What is wrong is seen: a figure that is hidden, a part too wide, a picture from elsewhere.
    let page = std::fs::read_to_string(folder.path().join("one.html")).unwrap();
    let wrong = page
        .replace(
            "<figure id=\"graph\"",
            "<figure style=\"display:none\" id=\"graph\"",
        )
        .replace(
            "</main>",
            "<div style=\"width:500px\">wide</div><img src=\"http://x.invalid/a.png\"></main>",
        );
    std::fs::write(folder.path().join("wrong.html"), wrong).unwrap();
    let (told, console) = look(folder.path(), "wrong.html", 360, false);
    let found = faults(&told, &FIGURES, true);
    for part in ["overflow ", "figure graph is not shown", "ground ", "ink "] {
        assert!(
            found.iter().any(|fault| fault.starts_with(part)),
            "{part} in {found:?}"
        );
    }
    assert!(
        console.iter().any(|line| line.contains("x.invalid")),
        "{console:?}"
    );
}
