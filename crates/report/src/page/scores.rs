//! The head of the page, and its table of scores.

use std::collections::BTreeSet;

use plot::clock::date;
use plot::markup::escaped;
use runs::read::Recorded;
use runs::seeds::{SeedGroup, spread};

use super::html::{Column, Row, absent, paragraph, table};
use super::outcome::{Episode, Outcome, episodes};

/// Mean, with the deviation of several values.
fn mean_text(values: &[f64], digits: usize) -> String {
    match spread(values) {
        None => "–".to_owned(),
        Some((mean, None)) => format!("{mean:.digits$}"),
        Some((mean, Some(std))) => format!("{mean:.digits$} ± {std:.digits$}"),
    }
}

/// Distinct texts, sorted.
fn distinct(texts: impl Iterator<Item = String>) -> String {
    let texts: BTreeSet<String> = texts.filter(|text| !text.is_empty()).collect();
    texts.into_iter().collect::<Vec<_>>().join(", ")
}

/// The title of the page: names of the runs, without the numbers of seeds.
pub(super) fn title(groups: &[SeedGroup]) -> String {
    let labels: Vec<&str> = groups.iter().map(|group| group.label.as_str()).collect();
    match groups {
        [SeedGroup { runs, .. }] if runs.len() == 1 => runs[0].name.clone(),
        _ if labels.len() <= 4 => labels.join(", "),
        _ => format!("{} and {} more", labels[..3].join(", "), labels.len() - 3),
    }
}

/// Hash of the config of a run without a score; empty if this version cannot read it.
fn hash(run: &Recorded) -> String {
    let config = agents::CONFIGS.of_run(&run.folder);
    config.map_or(String::new(), |config| config.hash())
}

/// Names, scores in large type, and facts about the runs.
pub(super) fn head(groups: &[SeedGroup]) -> anyhow::Result<String> {
    let runs: Vec<&Recorded> = groups.iter().flat_map(|group| &group.runs).collect();
    let mut outcomes = vec![];
    for run in &runs {
        outcomes.extend(Outcome::read(&run.folder)?);
    }
    let over = match runs.len() {
        1 => "Report of a run".to_owned(),
        count => format!("Report of {count} runs"),
    };
    let mut head = format!(
        "<p class=\"over\">{over}</p>\n<h1>{}</h1>\n<div class=\"tiles\">\n",
        escaped(&title(groups))
    );
    for group in groups {
        let scores = group.scores();
        let big = match spread(&scores) {
            None => "–".to_owned(),
            Some((mean, None)) => format!("{mean:.1}"),
            Some((mean, Some(std))) => format!("{mean:.1} <small>± {std:.1}</small>"),
        };
        let under = match (scores.len(), groups.len()) {
            (0, _) => "no score yet".to_owned(),
            (_, 1) => "score: % of episodes at the goal".to_owned(),
            _ => format!("score of {}", group.label),
        };
        head += &format!(
            "<div class=\"tile\"><p class=\"big\">{big}</p><p class=\"faint\">{}</p></div>\n",
            escaped(&under)
        );
    }
    head += "</div>\n<dl class=\"facts\">\n";
    let seeds: BTreeSet<i64> = runs.iter().map(|run| run.seed).collect();
    let seeds: Vec<String> = seeds.iter().map(i64::to_string).collect();
    let ended = outcomes.iter().filter_map(|outcome| outcome.ended).max();
    let plural = |word: &str, many: bool| format!("{word}{}", if many { "s" } else { "" });
    for (name, value) in [
        (
            "Maze".to_owned(),
            distinct(runs.iter().map(|run| run.layout.clone())),
        ),
        (plural("Seed", seeds.len() > 1), seeds.join(", ")),
        (
            "Episodes of evaluation".to_owned(),
            distinct(outcomes.iter().map(|outcome| outcome.episodes.to_string())),
        ),
        (
            "formica".to_owned(),
            distinct(outcomes.iter().map(|outcome| outcome.version.clone())),
        ),
        (
            "Hash of the config".to_owned(),
            match (runs.as_slice(), outcomes.as_slice()) {
                ([_], [one]) => one.config.clone(),
                ([run], []) => hash(run),
                _ => String::new(),
            },
        ),
        (
            plural("End of the run", runs.len() > 1),
            ended.and_then(date).unwrap_or_default(),
        ),
    ] {
        if !value.is_empty() {
            let (name, value) = (escaped(&name), escaped(&value));
            head += &format!("<div><dt>{name}</dt><dd>{value}</dd></div>\n");
        }
    }
    head += "</dl>\n";
    Ok(head)
}

/// A run that has a score.
struct Scored {
    outcome: Outcome,
    episodes: Vec<Episode>,
}

impl Scored {
    fn read(run: &Recorded) -> anyhow::Result<Option<Self>> {
        let Some(outcome) = Outcome::read(&run.folder)? else {
            return Ok(None);
        };
        let episodes = episodes(&run.folder)?;
        Ok(Some(Self { outcome, episodes }))
    }

    /// Mean steps of the episodes that reached the goal.
    fn steps(&self) -> Option<f64> {
        self.outcome
            .mean_steps
            .filter(|_| self.outcome.successes > 0)
    }

    /// Share of chosen nodes that were reached (%).
    fn reached(&self) -> Option<f64> {
        let chosen: u64 = self.episodes.iter().map(|episode| episode.chosen).sum();
        let reached: u64 = self.episodes.iter().map(|episode| episode.reached).sum();
        (chosen > 0).then(|| 100.0 * reached as f64 / chosen as f64)
    }

    /// Largest of the least distances to the goal of all episodes (m).
    fn farthest(&self) -> Option<f64> {
        let nearest = self.episodes.iter().map(|episode| episode.nearest);
        nearest.reduce(f64::max)
    }
}

/// A row for each run, and one for each group of several runs.
pub(super) fn section(groups: &[SeedGroup]) -> anyhow::Result<String> {
    let (mut rows, mut waiting) = (vec![], vec![]);
    for group in groups {
        let mut all = vec![];
        for run in &group.runs {
            match Scored::read(run)? {
                Some(scored) => {
                    rows.push(row(&run.name, &run.seed.to_string(), &[&scored], false));
                    all.push(scored);
                }
                None => waiting.push(run.name.as_str()),
            }
        }
        if all.len() > 1 {
            let name = format!("{}: mean ± std", group.label);
            let all: Vec<&Scored> = all.iter().collect();
            rows.push(row(&name, &format!("{} seeds", all.len()), &all, true));
        }
    }
    let mut body = String::new();
    if !rows.is_empty() {
        let columns = [
            ("Run", Column::Text),
            ("Score", Column::Number),
            ("Seed", Column::Number),
            ("At the goal", Column::Number),
            ("On the back", Column::Number),
            ("Steps to the goal", Column::Number),
            ("Chosen nodes reached", Column::Number),
            ("Worst episode's nearest", Column::Number),
        ];
        body += &table("Scores", &columns, &rows);
        body += &paragraph(
            "The score is the share of episodes that reached the goal, in %. Steps are those of \
             the episodes that did.",
        );
    }
    if !waiting.is_empty() {
        body += &absent(&format!(
            "Without a score yet, since the evaluation has not ended: {}.",
            waiting.join(", ")
        ));
    }
    Ok(body)
}

fn row(name: &str, seeds: &str, scored: &[&Scored], sums_up: bool) -> Row {
    let sum = |of: &dyn Fn(&Outcome) -> u64| -> u64 {
        scored.iter().map(|scored| of(&scored.outcome)).sum()
    };
    let values = |of: &dyn Fn(&Scored) -> Option<f64>| -> Vec<f64> {
        scored.iter().filter_map(|scored| of(scored)).collect()
    };
    let (successes, episodes) = (sum(&|o| o.successes), sum(&|o| o.episodes));
    Row {
        head: name.to_owned(),
        cells: vec![
            mean_text(&values(&|scored| Some(scored.outcome.score)), 1),
            seeds.to_owned(),
            format!("{successes} of {episodes}"),
            sum(&|o| o.fallen).to_string(),
            mean_text(&values(&Scored::steps), 0),
            match values(&Scored::reached).as_slice() {
                [] => "–".to_owned(),
                values => format!("{} %", mean_text(values, 1)),
            },
            // The worst of all episodes, not a mean over runs.
            values(&Scored::farthest)
                .into_iter()
                .reduce(f64::max)
                .map_or("–".to_owned(), |metres| format!("{metres:.2} m")),
        ],
        sums_up,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_group_has_a_summary_and_unknown_values_are_dashes() {
        let scored = |score: f64, successes, episodes: &[Episode]| Scored {
            outcome: Outcome {
                score,
                successes,
                episodes: 10,
                fallen: 1,
                mean_steps: Some(200.0),
                ..Outcome::default()
            },
            episodes: episodes.to_vec(),
        };
        let episode = Episode {
            chosen: 4,
            reached: 3,
            nearest: 1.5,
        };
        let (one, other) = (scored(80.0, 8, &[episode]), scored(0.0, 0, &[]));
        let row = row("g", "2 seeds", &[&one, &other], true);
        let expected = [
            "40.0 ± 56.6",
            "2 seeds",
            "8 of 20",
            "2",
            "200",
            "75.0 %",
            "1.50 m",
        ];
        assert_eq!(row.cells, expected);
        let bare = super::row("r", "1", &[&other], false);
        assert_eq!(bare.cells, ["0.0", "1", "0 of 10", "1", "–", "–", "–"]);
    }
}
