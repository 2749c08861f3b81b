//! Sound run files, changed at random, through the whole of a check: keys, values, tables and
//! bytes. `just fuzz-config` runs more cases than a test does.

use std::time::{Duration, Instant};

use config::{Config, Faults, Paths};
use rand::seq::IndexedRandom;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use super::further;

/// Cases of a test; the variable FORMICA_FUZZ_CASES says another number.
const CASES: u64 = 2_000;
/// A case that takes longer hangs.
const PATIENCE: Duration = Duration::from_secs(2);
/// The longest message.
const LONGEST: usize = 1_000;

const QUICKSTART: &str = include_str!("../../../configs/quickstart.toml");
const WALKER: &str = include_str!("../../../configs/walker.toml");
const LARGE: &str = include_str!("../../../configs/antmaze-large-diverse.toml");
const DRAWN: &str = "[maze]\nlayout = \"custom\"\nrows = [\"11111\", \"1r0g1\", \"11111\"]\n\
                     [dataset]\npath = \"x.hdf5\"\n[collect]\n";

const VALUES: [&str; 40] = [
    "0",
    "-1",
    "1",
    "64",
    "65",
    "4096",
    "4294967295",
    "4294967296",
    "9223372036854775807",
    "-9223372036854775808",
    "99999999999999999999999999",
    "0x7fffffff",
    "1e6",
    "1e-9",
    "-0.0",
    "1e308",
    "1e999",
    "nan",
    "-inf",
    "true",
    "True",
    "None",
    "\"\"",
    "\"large\"",
    "'custom'",
    "\"walker\"",
    "\"~\"",
    "\"$HOME/x\"",
    "\"$\"",
    "\"a\\u0000b\"",
    "\"\\u001b[31m\"",
    "[]",
    "[1]",
    "[[1, 2]]",
    "[1, \"a\"]",
    "[[[[]]]]",
    "{}",
    "{ a = 1 }",
    "2024-05-01",
    "\"\"\"\n\n\"\"\"",
];

const BYTES: [&str; 16] = [
    "[", "]", "=", "\"", "'", "#", ".", ",", "{", "}", "\n", "\r", "\u{0}", "\u{feff}", "é", "\\",
];

/// A check, but for files that are not there.
fn load(text: &str, sets: &[(String, String)]) -> Result<Config, Faults> {
    let paths = Paths {
        lenient: true,
        ..Paths::default()
    };
    let further = |config: &Config| further(config, 1 << 40);
    agents::CONFIGS.parse_with(text, "x.toml", "x", sets, paths, further)
}

/// Keys that there are, as `table.key`.
fn keys() -> Vec<(String, String)> {
    let mut keys = vec![];
    for text in [QUICKSTART, WALKER] {
        let config = load(text, &[]).unwrap();
        for (table, values) in toml::from_str::<toml::Table>(config.resolved()).unwrap() {
            let values = values.as_table().unwrap().keys();
            keys.extend(values.map(|key| (table.clone(), key.clone())));
        }
    }
    keys
}

/// One change of a text: of a key, of a line, or of bytes.
fn change(text: &mut String, keys: &[(String, String)], rng: &mut Pcg64Mcg) {
    let mut lines: Vec<String> = text.split_inclusive('\n').map(str::to_owned).collect();
    let line = rng.random_range(0..lines.len().max(1));
    let (table, key) = keys.choose(rng).unwrap();
    let value = VALUES.choose(rng).unwrap();
    match rng.random_range(0..10) {
        // A key in its table, where the file has none of that name so far, or twice.
        0..4 => match lines.iter().position(|l| l.trim() == format!("[{table}]")) {
            Some(at) => {
                lines.retain(|l| !l.starts_with(&format!("{key} =")) || rng.random_bool(0.1));
                lines.insert((at + 1).min(lines.len()), format!("{key} = {value}\n"));
            }
            None => lines.insert(0, format!("{table}.{key} = {value}\n")),
        },
        4 if !lines.is_empty() => drop(lines.remove(line)),
        5 if !lines.is_empty() => lines.insert(line, lines[line].clone()),
        6 => lines.insert(line.min(lines.len()), format!("[{table}]\n")),
        7 if !lines.is_empty() => {
            let other = rng.random_range(0..lines.len());
            lines.swap(line, other);
        }
        _ => {
            let mut whole = lines.concat();
            let mut at = rng.random_range(0..=whole.len());
            while !whole.is_char_boundary(at) {
                at -= 1;
            }
            let end = (at + rng.random_range(0..3)).min(whole.len());
            let byte = BYTES.choose(rng).unwrap();
            if whole.is_char_boundary(end) {
                whole.replace_range(at..end, byte);
            }
            lines = vec![whole];
        }
    }
    *text = lines.concat();
}

/// Says the case that a panic is of.
struct Case<'t>(u64, &'t str);

impl Drop for Case<'_> {
    fn drop(&mut self) {
        if std::thread::panicking() {
            eprintln!("case {}:\n{}", self.0, self.1);
        }
    }
}

#[test]
fn no_config_makes_a_check_panic_hang_or_pass_what_does_not_read_back() {
    let cases = std::env::var("FORMICA_FUZZ_CASES").ok();
    let cases = cases.map_or(CASES, |cases| cases.parse().unwrap());
    let keys = keys();
    let seeds: Vec<String> = [QUICKSTART, WALKER, LARGE, DRAWN]
        .into_iter()
        .flat_map(|text| {
            let config = load(text, &[]).unwrap();
            [text.to_owned(), config.resolved().to_owned()]
        })
        .collect();
    let mut passed = 0;
    for case in 0..cases {
        let mut rng = Pcg64Mcg::seed_from_u64(case);
        let mut text = seeds.choose(&mut rng).unwrap().clone();
        for _ in 0..rng.random_range(1..=6) {
            change(&mut text, &keys, &mut rng);
        }
        let sets: Vec<(String, String)> = (0..rng.random_range(0..3))
            .map(|_| {
                let (table, key) = keys.choose(&mut rng).unwrap();
                let value = VALUES.choose(&mut rng).unwrap();
                (format!("{table}.{key}"), (*value).to_owned())
            })
            .collect();
        let told = format!("{text}\n{sets:?}");
        let _case = Case(case, &told);
        let begun = Instant::now();
        passed += u64::from(is_sound(&text, &sets));
        assert!(begun.elapsed() < PATIENCE, "{:?}", begun.elapsed());
    }
    assert!(passed > cases / 100, "{passed} of {cases} configs pass");
}

/// Whether a config passes; what it or its faults may not be is a panic.
fn is_sound(text: &str, sets: &[(String, String)]) -> bool {
    match load(text, sets) {
        Ok(config) => {
            let again = load(config.resolved(), &[]).unwrap_or_else(|told| panic!("{told}"));
            assert_eq!(again.resolved(), config.resolved());
            assert_eq!(again, config);
            assert_eq!(again.changes(&config), []);
            true
        }
        Err(faults) => {
            assert!(!faults.faults.is_empty());
            let lines = text.split('\n').count();
            for fault in &faults.faults {
                assert!(fault.line <= lines, "{fault:?}");
                assert!(fault.message.len() <= LONGEST, "{fault:?}");
                let control = |text: &str| text.contains(char::is_control);
                assert!(
                    !control(&fault.message) && !control(&fault.key),
                    "{fault:?}"
                );
            }
            false
        }
    }
}
