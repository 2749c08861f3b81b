//! `metrics.csv`: one row for each value of a metric. The launcher writes it as [`Row`]s, and curves and
//! reports read the same rows back.

use std::collections::BTreeMap;
use std::fmt;
use std::path::Path;

use anyhow::{bail, ensure};

/// The first line.
pub const HEADER: &str = "seconds,role,id,name,step,value";

/// Larger values come from divergence. No axis shows them, and their squares would overflow.
const DRAWABLE: f64 = 1e100;

/// A row; [`Display`](fmt::Display) is its line without the line end.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Row<'t> {
    /// Since the start of the run (s).
    pub seconds: f64,
    /// Role of the process that sent it.
    pub role: &'t str,
    /// Id of that process.
    pub id: u32,
    /// Name of the metric.
    pub name: &'t str,
    /// Step that the value belongs to.
    pub step: u64,
    /// The value.
    pub value: f64,
}

impl fmt::Display for Row<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            seconds,
            role,
            id,
            name,
            step,
            value,
        } = self;
        write!(f, "{seconds:.1},{role},{id},{name},{step},{value}")
    }
}

impl<'t> Row<'t> {
    /// Parses a line; `None` if it is not a complete row.
    pub fn parse(line: &'t str) -> Option<Self> {
        let mut fields = line.split(',');
        let mut next = || fields.next();
        let row = Self {
            seconds: next()?.parse().ok()?,
            role: next()?,
            id: next()?.parse().ok()?,
            name: next()?,
            step: next()?.parse().ok()?,
            value: next()?.parse().ok()?,
        };
        let complete = fields.next().is_none() && !row.role.is_empty() && !row.name.is_empty();
        let in_time = (0.0..=DRAWABLE).contains(&row.seconds);
        (complete && in_time).then_some(row)
    }
}

/// A metric as read.
#[derive(Debug, Default, PartialEq)]
pub struct Metric {
    /// Seconds since the start and value of each row, in the order of time.
    pub rows: Vec<[f64; 2]>,
    /// Rows that are left out: not a number, or too large to be drawn.
    pub left_out: usize,
}

/// All metrics of a run, by name.
pub type Metrics = BTreeMap<String, Metric>;

/// Newest value of each metric, by name.
pub type Newest = BTreeMap<String, f64>;

/// Parses a file. Bytes after the last line end are an incomplete line, being written or cut by a full
/// disk: even if it parses, digits may be missing.
///
/// # Errors
/// Another header, or a line that is not a row.
pub fn parse(bytes: &[u8], path: &Path) -> anyhow::Result<Metrics> {
    let path = path.display();
    let end = bytes.iter().rposition(|byte| *byte == b'\n').unwrap_or(0);
    let mut lines = bytes[..end].split(|byte| *byte == b'\n').enumerate();
    let mut metrics = Metrics::new();
    if let Some((_, header)) = lines.next().filter(|(_, header)| !header.is_empty()) {
        ensure!(
            header == HEADER.as_bytes(),
            "{path}:1: expected the header '{HEADER}'; give the metrics.csv that a run wrote"
        );
    }
    for (i, line) in lines {
        let Some(row) = std::str::from_utf8(line).ok().and_then(Row::parse) else {
            let line = String::from_utf8_lossy(line);
            let shown: String = line.chars().take(80).collect();
            bail!(
                "{path}:{}: expected '{HEADER}', found '{}'; mend the line or take it out",
                i + 1,
                shown.escape_debug()
            );
        };
        if !metrics.contains_key(row.name) {
            metrics.insert(row.name.to_owned(), Metric::default());
        }
        if let Some(metric) = metrics.get_mut(row.name) {
            match row.value.abs() <= DRAWABLE {
                true => metric.rows.push([row.seconds, row.value]),
                false => metric.left_out += 1,
            }
        }
    }
    for metric in metrics.values_mut() {
        metric.rows.sort_by(|a, b| a[0].total_cmp(&b[0]));
    }
    Ok(metrics)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn metrics(lines: &str) -> Result<Metrics, String> {
        let text = format!("{HEADER}\n{lines}");
        let path = Path::new("m.csv");
        parse(text.as_bytes(), path).map_err(|error| error.to_string())
    }

    fn metric(rows: &[[f64; 2]], left_out: usize) -> Metric {
        let rows = rows.to_vec();
        Metric { rows, left_out }
    }

    #[test]
    fn a_row_is_read_back_as_it_was_written() {
        let row = Row {
            seconds: 12.5,
            role: "actor",
            id: 3,
            name: "a/b",
            step: 70,
            value: -1.25e-9,
        };
        assert_eq!(Row::parse(&row.to_string()), Some(row));
        assert_eq!(
            HEADER.split(',').count(),
            row.to_string().split(',').count()
        );
    }

    #[test]
    fn rows_are_sorted_by_time() {
        let lines = "2.0,actor,0,a/b,5,100\n1.5,learner,0,a/c,1,7\n1.0,actor,1,a/b,4,0\n";
        let metrics = metrics(lines).unwrap();
        assert_eq!(metrics["a/b"], metric(&[[1.0, 0.0], [2.0, 100.0]], 0));
        assert_eq!(metrics["a/c"], metric(&[[1.5, 7.0]], 0));
        assert_eq!(metrics.len(), 2);
    }

    #[test]
    fn a_damaged_line_is_an_error_and_an_incomplete_last_line_is_not() {
        let whole = "1.0,actor,0,a/b,1,100\n";
        for damaged in [
            "1.0,actor,0,a/b,1\n",
            "1.0,actor,0,a/b,1,100,2\n",
            "-1,actor,0,a/b,1,100\n",
            "NaN,actor,0,a/b,1,100\n",
            "1.0,actor,x,a/b,1,100\n",
            "1.0,actor,0,a/b,1,1oo\n",
            "1.0,actor,0,,1,100\n",
            "\n",
        ] {
            // Also as the last line: a line with an end is complete.
            for lines in [
                format!("{whole}{damaged}{whole}"),
                format!("{whole}{damaged}"),
            ] {
                let error = metrics(&lines).unwrap_err();
                assert!(error.starts_with("m.csv:3: expected"), "{error}");
            }
        }
        // The last one parses, but the complete line may say 100.
        for cut in ["2.", "2.0,actor,0,a", "2.0,actor,0,a/b,2,10"] {
            let metrics = metrics(&format!("{whole}{cut}")).unwrap();
            assert_eq!(metrics["a/b"], metric(&[[1.0, 100.0]], 0), "{cut}");
        }
        let error = parse(b"x,y\n1,2\n", Path::new("m.csv")).unwrap_err();
        assert!(error.to_string().starts_with("m.csv:1: "), "{error}");
    }

    #[test]
    fn values_that_are_not_finite_are_left_out_and_counted() {
        let lines = "1.0,l,0,a/b,1,NaN\n2.0,l,0,a/b,2,3\n3.0,l,0,a/b,3,-inf\n";
        assert_eq!(metrics(lines).unwrap()["a/b"], metric(&[[2.0, 3.0]], 2));
    }
}
