//! What each stage achieved, in a sentence. What was not measured is left out.

use plot::number::{fixed, listed};
use runs::metrics::Newest;
use runs::times::Times;

use super::{Settings, summary};

/// A stage of a run.
pub struct Stage {
    /// Its name.
    pub name: &'static str,
    /// Its name in text.
    pub title: &'static str,
    /// Whether it is the algorithm's.
    pub own: bool,
    /// Time that it took, if known (s).
    pub seconds: Option<f64>,
    /// What it achieved.
    pub text: String,
}

/// Newest values of metrics, as parts of a sentence.
struct Phrases<'n>(&'n Newest);

impl Phrases<'_> {
    /// A phrase with the value of a metric in place of `{}`; `None` if it was not measured.
    fn part(&self, phrase: &str, name: &str, decimals: usize) -> Option<String> {
        self.scaled(phrase, name, 1.0, decimals)
    }

    /// The same for a share, in percent.
    fn percent(&self, phrase: &str, name: &str, decimals: usize) -> Option<String> {
        self.scaled(phrase, name, 100.0, decimals)
    }

    fn scaled(&self, phrase: &str, name: &str, scale: f64, decimals: usize) -> Option<String> {
        let value = self.0.get(name)?;
        Some(phrase.replace("{}", &fixed(scale * value, decimals)?))
    }
}

/// All stages, and the whole run as the last one.
pub fn stages(settings: &Settings, newest: &Newest, times: &Times) -> Vec<Stage> {
    let collect = times.collect.as_secs_f64();
    let all = times.collect + times.train + times.rollouts + times.evaluate;
    let first = ("data", "data", Some(collect), data(&Phrases(newest)));
    let own = summary(settings, newest).into_iter();
    let own = own.map(|stage| (stage.name, stage.title, stage.seconds, stage.text));
    let last = ("time", "time", Some(all.as_secs_f64()), time(times));
    let stages = std::iter::once(first).chain(own).chain([last]);
    stages
        .map(|(name, title, seconds, text)| Stage {
            own: !matches!(name, "data" | "time"),
            name,
            title,
            seconds: seconds.filter(|seconds| seconds.is_finite()),
            text: match text.is_empty() {
                true => "not measured".to_owned(),
                false => text,
            },
        })
        .collect()
}

fn data(phrases: &Phrases) -> String {
    let rows = phrases.part("{} rows", "data/rows", 0);
    let episodes = phrases.part(" in {} episodes", "data/episodes", 0);
    let rows = rows.map(|rows| rows + &episodes.unwrap_or_default());
    let phrase = "{}% of the episodes go from the start's cell to the goal's";
    listed([rows, phrases.percent(phrase, "data/start_to_goal", 1)])
}

fn time(times: &Times) -> String {
    format!(
        "{:.0} s until trained, {:.0} s of rollouts, {:.0} s of evaluation",
        times.train.as_secs_f64(),
        times.rollouts.as_secs_f64(),
        times.evaluate.as_secs_f64()
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stages_are_those_of_the_algorithm_of_the_run() {
        let mut settings = Settings::new();
        let names = |settings: &Settings| {
            let stages = stages(settings, &Newest::new(), &Times::default());
            stages.iter().map(|stage| stage.name).collect::<Vec<_>>()
        };
        let of_earlier = ["data", "encoder", "graph", "low", "high", "time"];
        assert_eq!(names(&settings), of_earlier);
        settings.insert("run.algorithm".to_owned(), "\"gcbc\"".to_owned());
        assert_eq!(names(&settings), ["data", "gcbc", "time"]);
        settings.insert("run.algorithm".to_owned(), "\"of tomorrow\"".to_owned());
        assert_eq!(names(&settings), ["data", "time"]);
        let stages = stages(&settings, &Newest::new(), &Times::default());
        assert_eq!(stages[0].text, "not measured");
    }
}
