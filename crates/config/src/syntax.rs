//! What is wrong where a run file is not TOML.

use std::path::Path;

use toml::de::{DeTable, DeValue, Error};

use crate::fault::{Fault, escaped, shown};
use crate::value::flag;

/// Faults of syntax that are told; those after them mostly follow from these.
const MOST: usize = 10;

/// Line of a place in a text, from 1.
pub(crate) fn line(text: &str, offset: usize) -> usize {
    let before = text.as_bytes().get(..offset).unwrap_or(text.as_bytes());
    1 + before.iter().filter(|byte| **byte == b'\n').count()
}

/// What a text is instead of TOML, where that is plain.
pub(crate) fn other_format(text: &str, origin: &str) -> Option<&'static str> {
    let ending = Path::new(origin).extension().unwrap_or_default();
    let lines = || text.lines().map(str::trim);
    let first = lines().find(|line| !line.is_empty() && !line.starts_with('#'))?;
    let is_key = |c: char| c.is_alphanumeric() || c == '_' || c == '-';
    let yaml_key = |line: &str| {
        let split = line.split_once(':');
        split.is_some_and(|(key, rest)| {
            !key.is_empty() && key.chars().all(is_key) && (rest.is_empty() || rest.starts_with(' '))
        })
    };
    if first.starts_with('{') || ending == "json" {
        return Some(
            "is JSON, not TOML: write [maze], and on a line of its own layout = \"large\"",
        );
    }
    let yaml = ending == "yaml" || ending == "yml" || first == "---" || yaml_key(first);
    yaml.then_some("is YAML, not TOML: write [maze], and on a line of its own layout = \"large\"")
}

/// The faults that a parser's errors are: one a line.
pub(crate) fn faults(text: &str, root: &DeTable<'_>, errors: &[Error]) -> Vec<Fault> {
    let mut faults: Vec<Fault> = vec![];
    for error in errors {
        let span = error.span().unwrap_or(0..0);
        let line = line(text, span.start);
        if faults.iter().any(|fault| fault.line == line) {
            continue;
        }
        if faults.len() == MOST {
            faults.push(Fault {
                line,
                key: String::new(),
                message: "and more that is not TOML from here on".to_owned(),
            });
            break;
        }
        let name = text.get(span.clone()).unwrap_or_default();
        let message = match error.message() {
            "duplicate key" => duplicate(text, root, name, span.start),
            told => plainly(told, value_near(text, span.start)),
        };
        faults.push(Fault {
            line,
            key: String::new(),
            message,
        });
    }
    faults
}

/// A key or table that is there twice: both lines.
fn duplicate(text: &str, root: &DeTable<'_>, name: &str, at: usize) -> String {
    let plain = name.trim_matches(['"', '\'']);
    let mut first = None;
    earlier(root, plain, at, &mut first);
    let name = shown(plain);
    let first = first.map(|offset| line(text, offset));
    match first.or_else(|| earlier_line(text, plain, at)) {
        Some(line) => format!("'{name}' is there already, in line {line}"),
        None => format!("'{name}' is there already"),
    }
}

/// The last place before `at` where a key of this name stands.
fn earlier(table: &DeTable<'_>, name: &str, at: usize, found: &mut Option<usize>) {
    for (key, value) in table {
        let start = key.span().start;
        if key.get_ref() == name && start < at {
            *found = (*found).max(Some(start));
        }
        if let DeValue::Table(inner) = value.get_ref() {
            earlier(inner, name, at, found);
        }
    }
}

/// The rest of the line after the last '=' or at the place of a fault.
fn value_near(text: &str, offset: usize) -> &str {
    let before = text.get(..offset).unwrap_or_default();
    let start = before.rfind('\n').map_or(0, |at| at + 1);
    let line = text.get(start..).unwrap_or_default();
    let line = line.lines().next().unwrap_or_default();
    line.split_once('=').map_or(line, |(_, value)| value).trim()
}

/// A parser's message in the words of this program; `value` is what stands after the '='.
fn plainly(told: &str, value: &str) -> String {
    let in_word = |c: char| c.is_alphanumeric() || c == '_' || c == '-' || c == '.';
    let word = value.split(|c| !in_word(c)).next().unwrap_or_default();
    if let Some(flag) = flag(word) {
        return format!("'{word}' is no value; did you mean {flag}?");
    }
    match word {
        "None" | "null" | "Null" | "nil" => {
            return format!("'{word}' is no value; leave the key out for its default");
        }
        "NaN" | "Inf" | "Infinity" => {
            return format!("'{word}' is no value; write a finite number");
        }
        _ => {}
    }
    let told = told.trim_end_matches(", expected nothing");
    match told {
        _ if told.starts_with("string values must be quoted") => match value {
            "" => "there is no value after '='".to_owned(),
            _ => format!("'{}' is no value; a text needs quotes", shown(value)),
        },
        _ if told.starts_with("key with no value") => {
            "expected 'key = value' or '[table]' on a line of its own".to_owned()
        }
        _ if told.starts_with("invalid basic string") || told.starts_with("invalid literal") => {
            "the text has no quote at its end".to_owned()
        }
        "unexpected leading zero" => "a number has no zeros in front".to_owned(),
        "recursion limit" => "brackets or dots are nested too deep".to_owned(),
        _ => escaped(told),
    }
}

/// The last line before a place where a key or table of this name is written.
fn earlier_line(text: &str, name: &str, at: usize) -> Option<usize> {
    let before = text.get(..at)?;
    let mut lines = before.lines().enumerate().collect::<Vec<_>>();
    // The line of the fault itself.
    lines.pop();
    let named = |line: &str| {
        let line = line.trim_start().trim_start_matches('[').trim_start();
        let rest = line.trim_start_matches(['"', '\'']).strip_prefix(name);
        rest.is_some_and(|rest| rest.trim_start().starts_with([']', '=', '.', '"', '\'']))
    };
    let found = lines.into_iter().rev().find(|(_, line)| named(line));
    found.map(|(i, _)| i + 1)
}
