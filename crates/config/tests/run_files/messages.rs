//! What the user reads of a file with a fault: each fault once, with its line.

use agents::CONFIGS;
use config::{Config, Paths};

use super::{GOOD, parse, settings};

/// What makes the rest of a file sound.
const REST: &str = "[dataset]\npath = \"x\"\n[collect]\n";

fn told(text: &str) -> String {
    match parse(text) {
        Ok(_) => "no fault".to_owned(),
        Err(faults) => faults.to_string(),
    }
}

fn told_of_set(key: &str, value: &str) -> String {
    let sets = [(key.to_owned(), value.to_owned())];
    match CONFIGS.parse(GOOD, "x.toml", "x", &sets) {
        Ok(_) => "no fault".to_owned(),
        Err(faults) => faults.to_string(),
    }
}

#[test]
fn a_number_that_does_not_fit_is_told_plainly() {
    for (line, message) in [
        (
            "run.seed = -1",
            "run.seed: -1 is out of range; 0 to 4294967295 are possible",
        ),
        (
            "run.seed = 1.5",
            "run.seed: expected a whole number, found the number 1.5",
        ),
        (
            "run.seed = nan",
            "run.seed: expected a whole number, found nan",
        ),
        (
            "low.updates = 1e400",
            "low.updates: 1e400 is too large a number",
        ),
        (
            "low.snap = nan",
            "low.snap: expected a finite number, found nan",
        ),
        (
            "low.snap = -inf",
            "low.snap: expected a finite number, found -inf",
        ),
        (
            "low.snap = 1e300",
            "low.snap: 1e300 is out of range; 0 to 1 are possible",
        ),
        ("low.snap = 1e999", "low.snap: 1e999 is too large a number"),
        (
            "run.seed = 99999999999999999999999999999999999999999999",
            "run.seed: 99999999999999999999999999999999999999999999 is too large a number",
        ),
        (
            "low.hidden = [-1]",
            "low.hidden: -1 is out of range; 1 to 4096 are possible",
        ),
    ] {
        assert_eq!(
            told(&format!("{line}\n{REST}")),
            format!("x.toml:1: {message}")
        );
    }
}

#[test]
fn an_encoder_without_its_null_token_is_refused() {
    let message = "x.toml:1: encoder.null_condition: 0 leaves the null token untrained, and all \
                   codes are taken with it; set it above 0, as to the default 0.5";
    assert_eq!(
        told(&format!("encoder.null_condition = 0\n{REST}")),
        message
    );
    // The place itself is encoded by no network.
    let place = "encoder = { kind = \"place\", null_condition = 0 }";
    for line in ["encoder.null_condition = 1e-3", place] {
        assert_eq!(told(&format!("{line}\n{REST}")), "no fault");
    }
}

#[test]
fn the_key_of_an_earlier_version_says_what_to_write() {
    let message = told(&format!("run.kind = \"offline\"\n{REST}"));
    assert!(
        message.starts_with("x.toml:1: run.kind: was replaced in version 0.2: write algorithm"),
        "{message}"
    );
    assert_eq!(message.lines().count(), 1);
}

#[test]
fn each_algorithm_has_tables_of_its_own() {
    let of = |lines: &str| told(&format!("[run]\nalgorithm = \"gcbc\"\n{lines}{REST}"));
    assert_eq!(of("[gcbc]\nupdates = 5\n"), "no fault");
    assert_eq!(
        of("[low]\nupdates = 5\n"),
        "no fault",
        "of another algorithm"
    );
    let message = of("[gcbc]\nupdate = 5\n");
    assert!(message.contains("gcbc.update: unknown key"), "{message}");
}

#[test]
fn a_whole_number_may_be_written_with_an_exponent() {
    for line in [
        "low.updates = 1e4",
        "low.updates = 1e+4",
        "low.updates = 10000.0",
    ] {
        let config = parse(&format!("{line}\n{REST}")).unwrap();
        assert_eq!(settings(&config).low.updates, 10_000, "{line}");
        assert!(config.resolved().contains("updates = 10000\n"));
    }
    assert_eq!(told_of_set("low.updates", "1e4"), "no fault");
}

#[test]
fn an_item_of_a_list_that_does_not_fit_is_named() {
    for (line, message) in [
        (
            "low.hidden = [32, \"a\"]",
            "low.hidden: item 2 of the list: expected a whole number, found the text \"a\"",
        ),
        (
            "low.hidden = [[3]]",
            "low.hidden: item 1 of the list: expected a whole number, found a list",
        ),
        (
            "low.hidden = 32",
            "low.hidden: expected a list, found the whole number 32",
        ),
        (
            "maze = { layout = \"custom\", rows = [111] }",
            "maze.rows: item 1 of the list: expected a text in quotes, found the whole number 111",
        ),
    ] {
        assert_eq!(
            told(&format!("{line}\n{REST}")),
            format!("x.toml:1: {message}")
        );
    }
}

#[test]
fn rows_and_layout_go_together() {
    let missing = told(&format!("[maze]\nlayout = \"custom\"\n{REST}"));
    assert!(
        missing.starts_with("x.toml:1: maze.rows: missing;"),
        "{missing}"
    );
    let besides = told(&format!("[maze]\nrows = [\"111\"]\n{REST}"));
    assert_eq!(
        besides,
        "x.toml:2: maze.rows: the layout 'medium' has rows of its own; use layout = \"custom\""
    );
}

#[test]
fn words_of_other_languages_are_translated() {
    for (line, message) in [
        (
            "run.deterministic = True",
            "'True' is no value; did you mean true?",
        ),
        (
            "run.deterministic = yes",
            "'yes' is no value; did you mean true?",
        ),
        (
            "encoder.from = None",
            "'None' is no value; leave the key out for its default",
        ),
        ("low.snap = NaN", "'NaN' is no value; write a finite number"),
        (
            "maze.layout = large",
            "'large' is no value; a text needs quotes",
        ),
        ("run.seed =", "there is no value after '='"),
        ("run.seed = 010", "a number has no zeros in front"),
        ("run.name = \"a", "the text has no quote at its end"),
        (
            "import os",
            "expected 'key = value' or '[table]' on a line of its own",
        ),
    ] {
        assert_eq!(
            told(&format!("{line}\n{REST}")),
            format!("x.toml:1: {message}")
        );
    }
    let text = told(&format!("run.deterministic = \"False\"\n{REST}"));
    assert!(
        text.ends_with("found the text \"False\"; did you mean false?"),
        "{text}"
    );
}

#[test]
fn what_stands_twice_is_told_with_both_lines() {
    for (text, message) in [
        (
            "[run]\nseed = 1\nseed = 2\n",
            "x.toml:3: 'seed' is there already, in line 2",
        ),
        (
            "[run]\nseed = 1\n[low]\n[run]\nname = \"x\"\n",
            "x.toml:4: 'run' is there already, in line 1",
        ),
        (
            "run.seed = 1\nrun.seed = 2\n",
            "x.toml:2: 'seed' is there already, in line 1",
        ),
        (
            "run = { seed = 1, seed = 2 }\n",
            "x.toml:1: 'seed' is there already, in line 1",
        ),
    ] {
        assert_eq!(told(&format!("{text}{REST}")), message);
    }
}

#[test]
fn a_key_in_the_wrong_place_is_told_where_it_belongs() {
    for (text, message) in [
        (
            "seed = 1\n",
            "seed: this key stands above all tables; write it below [run]",
        ),
        (
            "[[run]]\n",
            "run: expected one table, [run], found a list of them, [[run]]",
        ),
        ("[Run]\n", "Run: unknown table; did you mean 'run'?"),
        ("[MAZE]\n", "MAZE: unknown table; did you mean 'maze'?"),
        (
            "run = 3\n",
            "run: expected a table: [run] on a line of its own",
        ),
        (
            "run.layout = \"large\"\n",
            "run.layout: unknown key; it belongs to [maze]",
        ),
        (
            "graph.Max-Nodes = 3\n",
            "graph.Max-Nodes: unknown key; did you mean 'max_nodes'?",
        ),
        (
            "run.seed.x = 3\n",
            "run.seed: expected a whole number, found a table",
        ),
    ] {
        assert_eq!(
            told(&format!("{text}{REST}")),
            format!("x.toml:1: {message}")
        );
    }
    assert_eq!(
        told_of_set("seed", "3"),
        "--set seed: keys are written table.key, as in run.seed"
    );
    assert_eq!(told_of_set("", "3"), "--set '': keys are written table.key");
}

#[test]
fn other_formats_are_called_by_their_names() {
    for (text, name) in [
        ("{\"maze\": {\"layout\": \"large\"}}\n", "JSON"),
        ("# A maze.\nmaze:\n  layout: large\n", "YAML"),
        ("---\nmaze: {}\n", "YAML"),
    ] {
        let told = told(text);
        assert!(
            told.starts_with(&format!("x.toml: is {name}, not TOML")),
            "{told}"
        );
        assert_eq!(told.lines().count(), 1);
    }
}

#[test]
fn a_text_key_takes_what_is_given_on_the_command_line() {
    for name in ["2024-05-01", "true", "1.10", "1e6", "07", "12"] {
        let sets = [("run.name".to_owned(), name.to_owned())];
        let config = CONFIGS.parse(GOOD, "x.toml", "x", &sets).unwrap();
        assert_eq!(config.run.name, name);
    }
    for (key, value, message) in [
        (
            "low.updates",
            "10k",
            "expected a whole number, found the text \"10k\"",
        ),
        (
            "run.seed",
            "1\n[maze]",
            "expected a whole number, found the text \"1\\n[maze]\"",
        ),
        (
            "run.seed",
            "-1",
            "-1 is out of range; 0 to 4294967295 are possible",
        ),
    ] {
        assert_eq!(told_of_set(key, value), format!("--set {key}: {message}"));
    }
}

#[test]
fn a_name_is_the_file_s_or_a_fault() {
    let of_file = |stem: &str| CONFIGS.parse(GOOD, "x.toml", stem, &[]);
    assert_eq!(of_file("my config (1)").unwrap().run.name, "my-config-1");
    for stem in ["latest", "---", ""] {
        let told = of_file(stem).unwrap_err().to_string();
        assert!(
            told.starts_with("x.toml:1: run.name: the file's name"),
            "{told}"
        );
    }
    // One that was given is never changed.
    let given = told_of_set("run.name", "my config");
    assert!(given.ends_with("'my-config' is one"), "{given}");
}

#[test]
fn nesting_and_length_have_bounds() {
    for text in [
        "run = ".to_owned() + &"[".repeat(10_000),
        "[".repeat(10_000),
        "a.".repeat(10_000) + "b = 1",
    ] {
        assert!(told(&text).len() < 10_000);
    }
    let many: String = (0..5_000).map(|i| format!("k{i} = = 1\n")).collect();
    assert!(told(&many).lines().count() < 100);
}

#[test]
fn what_further_checks_say_of_a_value_is_shown_harmless() {
    let further = |_: &Config| vec![("maze.rows", "the cell '\r\u{1b}'".to_owned())];
    let paths = Paths::default();
    let faults = CONFIGS
        .parse_with(GOOD, "x.toml", "x", &[], paths, further)
        .unwrap_err();
    assert_eq!(
        faults.to_string(),
        "x.toml:1: maze.rows: the cell '\\r\\u{1b}'"
    );
}
