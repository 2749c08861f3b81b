//! A recorded run, read from its folder: config, metrics, score.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};

use crate::file::{self, reading};
use crate::find::find;
use crate::metrics::{self, Metric, Metrics};

/// A run as read.
pub struct Recorded {
    /// Its folder.
    pub folder: PathBuf,
    /// `run.name`.
    pub name: String,
    /// `run.seed`.
    pub seed: i64,
    /// `maze.layout`.
    pub layout: String,
    /// Values by `table.key`, without the name and the seed of the run.
    pub config: BTreeMap<String, String>,
    /// Text of the config.
    pub toml: String,
    /// Empty if the run has not written any yet.
    pub metrics: Metrics,
    /// Score of the evaluation, once it is complete.
    pub score: Option<f64>,
}

impl Recorded {
    /// Reads a run. Files that it has not written yet count as empty.
    ///
    /// # Errors
    /// No config, or a damaged file.
    pub fn read(folder: PathBuf) -> anyhow::Result<Self> {
        let path = folder.join("config.toml");
        let toml = fs::read_to_string(&path).with_context(|| reading(&path))?;
        let (name, seed, layout, config) = parse_config(&toml, &path)?;
        let path = folder.join("metrics.csv");
        let metrics = match file::read(&path)? {
            Some(bytes) => metrics::parse(&bytes, &path)?,
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

    /// Seconds and value of each row of a metric; empty if there is no such metric.
    pub fn rows(&self, metric: &str) -> &[[f64; 2]] {
        let metric = self.metrics.get(metric);
        metric.map_or(&[], |metric| &metric.rows)
    }

    /// A metric to draw.
    ///
    /// # Errors
    /// The metric has no rows to draw.
    pub fn metric(&self, name: &str) -> anyhow::Result<&Metric> {
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

/// Reads the runs that a user named.
///
/// # Errors
/// An unknown run, one that is named twice, or one that cannot be read.
pub fn all(given: &[PathBuf]) -> anyhow::Result<Vec<Recorded>> {
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

/// Name, seed, maze layout, and the other values by `table.key`.
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

/// The score in a run's folder; `None` before the evaluation is complete.
///
/// # Errors
/// A damaged `score.json`.
pub fn score(folder: &Path) -> anyhow::Result<Option<f64>> {
    let path = folder.join("score.json");
    let score = file::read(&path)?.map(|bytes| parse_score(&bytes, &path));
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

    #[test]
    fn a_metric_without_rows_is_an_error_that_lists_the_others() {
        let folder = tempfile::tempdir().unwrap();
        let config = "[run]\nname = 'n'\nseed = 3\n[maze]\nlayout = 'large'\n";
        fs::write(folder.path().join("config.toml"), config).unwrap();
        let error = |lines: Option<&str>| {
            if let Some(lines) = lines {
                let text = format!("{}\n{lines}", metrics::HEADER);
                fs::write(folder.path().join("metrics.csv"), text).unwrap();
            }
            let run = Recorded::read(folder.path().to_owned()).unwrap();
            assert!(run.rows("a/b").is_empty());
            format!("{:#}", run.metric("a/b").unwrap_err())
        };
        let text = error(None);
        assert!(text.contains("metrics.csv: No such file"), "{text}");
        let text = error(Some("1.0,learner,0,a/c,1,7\n"));
        assert!(
            text.ends_with("metrics.csv has no row of a/b; it has a/c"),
            "{text}"
        );
        let text = error(Some(""));
        assert!(text.contains("no row at all yet"), "{text}");
        let text = error(Some("1.0,learner,0,a/b,1,NaN\n"));
        assert!(text.contains("1 rows of a/b, none"), "{text}");
    }

    #[test]
    fn a_config_is_flat_and_has_no_name_and_seed() {
        let text =
            "[run]\nname = \"n\"\nseed = 3\nkind = \"offline\"\n[maze]\nlayout = \"large\"\n";
        let (name, seed, layout, config) = parse_config(text, Path::new("c.toml")).unwrap();
        assert_eq!((name.as_str(), seed, layout.as_str()), ("n", 3, "large"));
        let keys: Vec<&str> = config.keys().map(String::as_str).collect();
        assert_eq!(keys, ["maze.layout", "run.kind"]);
        for (text, part) in [
            ("[run]\nname = \n", "c.toml:2: "),
            ("[maze]\n", "no [run]"),
            (
                "[run]\nname = 'n'\nseed = 'x'\n[maze]\nlayout = 'a'\n",
                "no number run.seed",
            ),
        ] {
            let error = parse_config(text, Path::new("c.toml")).unwrap_err();
            assert!(error.to_string().contains(part), "{error}");
        }
    }

    #[test]
    fn a_score_that_is_not_a_number_is_an_error_with_its_line() {
        let score = |text: &str| parse_score(text.as_bytes(), Path::new("s.json"));
        assert_eq!(score("{\"score\": 85.5}").unwrap(), 85.5);
        let error = score("{\n\"score\": x}").unwrap_err().to_string();
        assert!(error.starts_with("s.json:2: "), "{error}");
        let error = score("{\"score\": \"85\"}").unwrap_err().to_string();
        assert!(error.contains("no number 'score'"), "{error}");
    }
}
