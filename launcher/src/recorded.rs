//! What a run has left in its folder, read back: config, metrics, score.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail, ensure};

use crate::metrics::METRICS_HEADER;
pub(crate) use crate::runs::find;

/// Values beyond it are a divergence that no axis shows; their squares would overflow.
const DRAWABLE: f64 = 1e100;

/// A metric as read.
#[derive(Debug, Default, PartialEq)]
pub(crate) struct Metric {
    /// Seconds since the start and value of each row, in the order of time.
    pub(crate) rows: Vec<[f64; 2]>,
    /// Rows that are left out: not a number, or beyond what can be drawn.
    pub(crate) left_out: usize,
}

/// All of a run, by name.
pub(crate) type Metrics = BTreeMap<String, Metric>;

/// A run as read.
pub(crate) struct Recorded {
    pub(crate) folder: PathBuf,
    pub(crate) name: String,
    pub(crate) seed: i64,
    pub(crate) layout: String,
    /// `table.key` and value, but for the run's name and seed.
    pub(crate) config: BTreeMap<String, String>,
    /// The config's text.
    pub(crate) toml: String,
    /// None where the run has told nothing yet.
    pub(crate) metrics: Metrics,
    /// Of the evaluation, once it is over.
    pub(crate) score: Option<f64>,
}

impl Recorded {
    /// Reads a run. What it has not written yet is empty, what is damaged an error.
    pub(crate) fn read(folder: PathBuf) -> anyhow::Result<Self> {
        let path = folder.join("config.toml");
        let toml = fs::read_to_string(&path).with_context(|| reading(&path))?;
        let (name, seed, layout, config) = parse_config(&toml, &path)?;
        let path = folder.join("metrics.csv");
        let metrics = match if_there(&path)? {
            Some(bytes) => parse_metrics(&bytes, &path)?,
            None => Metrics::new(),
        };
        Ok(Self {
            score: score(&folder)?,
            folder,
            name,
            seed,
            layout,
            config,
            toml,
            metrics,
        })
    }

    /// The rows of a metric; none where it has none.
    pub(crate) fn rows(&self, metric: &str) -> &[[f64; 2]] {
        let metric = self.metrics.get(metric);
        metric.map_or(&[], |metric| &metric.rows)
    }

    /// The metric, or why it cannot be drawn.
    pub(crate) fn metric(&self, name: &str) -> anyhow::Result<&Metric> {
        let path = self.folder.join("metrics.csv");
        fs::metadata(&path).with_context(|| reading(&path))?;
        let path = path.display();
        match self.metrics.get(name) {
            Some(metric) if !metric.rows.is_empty() => Ok(metric),
            Some(metric) => {
                let count = metric.left_out;
                bail!("{path} has {count} rows of {name}, none of which is a number to draw")
            }
            None if self.metrics.is_empty() => {
                bail!("{path} has no row at all yet; wait until the run has told something")
            }
            None => {
                let others: Vec<&str> = self.metrics.keys().map(String::as_str).collect();
                bail!("{path} has no row of {name}; it has {}", others.join(", "))
            }
        }
    }
}

/// A file's bytes; none where there is no such file.
pub(crate) fn if_there(path: &Path) -> anyhow::Result<Option<Vec<u8>>> {
    match fs::read(path) {
        Ok(bytes) => Ok(Some(bytes)),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(None),
        Err(error) => Err(error).with_context(|| reading(path)),
    }
}

fn reading(path: &Path) -> String {
    format!("reading {}", path.display())
}

/// The runs that were given, each once.
pub(crate) fn all(given: &[PathBuf]) -> anyhow::Result<Vec<Recorded>> {
    let (mut runs, mut seen): (Vec<Recorded>, Vec<PathBuf>) = (vec![], vec![]);
    for name in given {
        let folder = find(name)?;
        let real = folder.canonicalize().with_context(|| reading(&folder))?;
        if let Some(i) = seen.iter().position(|other| *other == real) {
            bail!(
                "the runs {} and {} are the same folder; give it once",
                given[i].display(),
                name.display()
            );
        }
        seen.push(real);
        runs.push(Recorded::read(folder)?);
    }
    Ok(runs)
}

/// Name, seed, layout of the maze, and all but name and seed.
fn parse_config(
    text: &str,
    path: &Path,
) -> anyhow::Result<(String, i64, String, BTreeMap<String, String>)> {
    let path = path.display();
    let mut tables: toml::Table = toml::from_str(text).map_err(|error| {
        let before = error.span().and_then(|span| text.get(..span.start));
        let line = 1 + before.map_or(0, |before| before.matches('\n').count());
        anyhow::anyhow!("{path}:{line}: {}", error.message())
    })?;
    let missing = |key| format!("{path} has no {key}; give the config.toml that a run wrote");
    let run = tables.get_mut("run").and_then(toml::Value::as_table_mut);
    let run = run.with_context(|| missing("[run]"))?;
    let name = run.remove("name");
    let name = name.as_ref().and_then(toml::Value::as_str);
    let seed = run.remove("seed").and_then(|seed| seed.as_integer());
    let layout = tables.get("maze").and_then(|maze| maze.get("layout"));
    let layout = layout.and_then(toml::Value::as_str);
    let (name, seed, layout) = (
        name.with_context(|| missing("text run.name"))?.to_owned(),
        seed.with_context(|| missing("number run.seed"))?,
        layout.with_context(|| missing("text maze.layout"))?,
    );
    let mut config = BTreeMap::new();
    for (table, value) in &tables {
        match value.as_table() {
            Some(keys) => config.extend(
                keys.iter()
                    .map(|(key, value)| (format!("{table}.{key}"), value.to_string())),
            ),
            None => drop(config.insert(table.clone(), value.to_string())),
        }
    }
    Ok((name, seed, layout.to_owned(), config))
}

/// Every metric. What follows the last line's end is a line that is being written, or that a full
/// disk cut: even where it parses it may lack digits.
fn parse_metrics(bytes: &[u8], path: &Path) -> anyhow::Result<Metrics> {
    let path = path.display();
    let end = bytes.iter().rposition(|byte| *byte == b'\n').unwrap_or(0);
    let mut lines = bytes[..end].split(|byte| *byte == b'\n').enumerate();
    let mut metrics = Metrics::new();
    if let Some((_, header)) = lines.next().filter(|(_, header)| !header.is_empty()) {
        ensure!(
            header == METRICS_HEADER.as_bytes(),
            "{path}:1: expected the header '{METRICS_HEADER}'; give the metrics.csv that a run wrote"
        );
    }
    for (i, line) in lines {
        let row = std::str::from_utf8(line).ok().and_then(parse_row);
        let Some((seconds, name, value)) = row else {
            let line = String::from_utf8_lossy(line);
            let shown: String = line.chars().take(80).collect();
            bail!(
                "{path}:{}: expected '{METRICS_HEADER}', found '{}'; mend the line or take it out",
                i + 1,
                shown.escape_debug()
            );
        };
        if !metrics.contains_key(name) {
            metrics.insert(name.to_owned(), Metric::default());
        }
        if let Some(metric) = metrics.get_mut(name) {
            match value.abs() <= DRAWABLE {
                true => metric.rows.push([seconds, value]),
                false => metric.left_out += 1,
            }
        }
    }
    for metric in metrics.values_mut() {
        metric.rows.sort_by(|a, b| a[0].total_cmp(&b[0]));
    }
    Ok(metrics)
}

/// Seconds, name and value of a line.
pub(crate) fn parse_row(line: &str) -> Option<(f64, &str, f64)> {
    let mut fields = line.split(',');
    let mut next = || fields.next();
    let (seconds, role, id) = (next()?, next()?, next()?);
    let (name, step, value) = (next()?, next()?, next()?);
    let seconds: f64 = seconds.parse().ok()?;
    let (_, _): (u32, u64) = (id.parse().ok()?, step.parse().ok()?);
    let value = value.parse().ok()?;
    let whole = fields.next().is_none() && !role.is_empty() && !name.is_empty();
    let in_time = (0.0..=DRAWABLE).contains(&seconds);
    (whole && in_time).then_some((seconds, name, value))
}

/// The score in a run's folder, once there is one.
pub(crate) fn score(folder: &Path) -> anyhow::Result<Option<f64>> {
    let path = folder.join("score.json");
    let score = if_there(&path)?.map(|bytes| parse_score(&bytes, &path));
    score.transpose()
}

fn parse_score(bytes: &[u8], path: &Path) -> anyhow::Result<f64> {
    let path = path.display();
    let json: serde_json::Value = serde_json::from_slice(bytes)
        .map_err(|error| anyhow::anyhow!("{path}:{}: {error}", error.line()))?;
    let score = json.get("score").and_then(serde_json::Value::as_f64);
    score.with_context(|| format!("{path} has no number 'score'; give the one that a run wrote"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn metrics(lines: &str) -> Result<Metrics, String> {
        let text = format!("{METRICS_HEADER}\n{lines}");
        let path = Path::new("m.csv");
        parse_metrics(text.as_bytes(), path).map_err(|error| error.to_string())
    }

    fn metric(rows: &[[f64; 2]], left_out: usize) -> Metric {
        let rows = rows.to_vec();
        Metric { rows, left_out }
    }

    #[test]
    fn rows_of_every_metric_are_read_in_the_order_of_time() {
        let lines = "2.0,actor,0,a/b,5,100\n1.5,learner,0,a/c,1,7\n1.0,actor,1,a/b,4,0\n";
        let metrics = metrics(lines).unwrap();
        assert_eq!(metrics["a/b"], metric(&[[1.0, 0.0], [2.0, 100.0]], 0));
        assert_eq!(metrics["a/c"], metric(&[[1.5, 7.0]], 0));
        assert_eq!(metrics.len(), 2);
    }

    #[test]
    fn a_damaged_line_is_an_error_and_a_cut_off_last_line_is_not() {
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
            // The last one too: a line that ends is whole.
            for lines in [
                format!("{whole}{damaged}{whole}"),
                format!("{whole}{damaged}"),
            ] {
                let error = metrics(&lines).unwrap_err();
                assert!(error.starts_with("m.csv:3: expected"), "{error}");
            }
        }
        // The last one parses, but the file may hold 100 when it is written to its end.
        for cut in ["2.", "2.0,actor,0,a", "2.0,actor,0,a/b,2,10"] {
            let metrics = metrics(&format!("{whole}{cut}")).unwrap();
            assert_eq!(metrics["a/b"], metric(&[[1.0, 100.0]], 0), "{cut}");
        }
        let error = parse_metrics(b"x,y\n1,2\n", Path::new("m.csv")).unwrap_err();
        assert!(error.to_string().starts_with("m.csv:1: "), "{error}");
    }

    #[test]
    fn a_metric_without_a_row_is_named_with_those_that_have_some() {
        let folder = tempfile::tempdir().unwrap();
        let config = "[run]\nname = 'n'\nseed = 3\n[maze]\nlayout = 'large'\n";
        fs::write(folder.path().join("config.toml"), config).unwrap();
        let error = |lines: Option<&str>| {
            if let Some(lines) = lines {
                let text = format!("{METRICS_HEADER}\n{lines}");
                fs::write(folder.path().join("metrics.csv"), text).unwrap();
            }
            let run = Recorded::read(folder.path().to_owned()).unwrap();
            assert!(run.rows("a/b").is_empty());
            format!("{:#}", run.metric("a/b").unwrap_err())
        };
        let told = error(None);
        assert!(told.contains("metrics.csv: No such file"), "{told}");
        let told = error(Some("1.0,learner,0,a/c,1,7\n"));
        assert!(
            told.ends_with("metrics.csv has no row of a/b; it has a/c"),
            "{told}"
        );
        let told = error(Some(""));
        assert!(told.contains("no row at all yet"), "{told}");
        let told = error(Some("1.0,learner,0,a/b,1,NaN\n"));
        assert!(told.contains("1 rows of a/b, none"), "{told}");
    }

    #[test]
    fn what_is_no_number_is_left_out_and_counted() {
        let lines = "1.0,l,0,a/b,1,NaN\n2.0,l,0,a/b,2,3\n3.0,l,0,a/b,3,-inf\n";
        assert_eq!(metrics(lines).unwrap()["a/b"], metric(&[[2.0, 3.0]], 2));
    }

    #[test]
    fn a_config_is_flat_and_without_name_and_seed() {
        let text =
            "[run]\nname = \"n\"\nseed = 3\nkind = \"offline\"\n[maze]\nlayout = \"large\"\n";
        let (name, seed, layout, config) = parse_config(text, Path::new("c.toml")).unwrap();
        assert_eq!((name.as_str(), seed, layout.as_str()), ("n", 3, "large"));
        let keys: Vec<&str> = config.keys().map(String::as_str).collect();
        assert_eq!(keys, ["maze.layout", "run.kind"]);
        for (text, told) in [
            ("[run]\nname = \n", "c.toml:2: "),
            ("[maze]\n", "no [run]"),
            (
                "[run]\nname = 'n'\nseed = 'x'\n[maze]\nlayout = 'a'\n",
                "no number run.seed",
            ),
        ] {
            let error = parse_config(text, Path::new("c.toml")).unwrap_err();
            assert!(error.to_string().contains(told), "{error}");
        }
    }

    #[test]
    fn a_score_is_a_number_or_an_error_with_its_line() {
        let score = |text: &str| parse_score(text.as_bytes(), Path::new("s.json"));
        assert_eq!(score("{\"score\": 85.5}").unwrap(), 85.5);
        let error = score("{\n\"score\": x}").unwrap_err().to_string();
        assert!(error.starts_with("s.json:2: "), "{error}");
        let error = score("{\"score\": \"85\"}").unwrap_err().to_string();
        assert!(error.contains("no number 'score'"), "{error}");
    }
}
