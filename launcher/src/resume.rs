//! A run that was stopped, found again: whether something is left to do, and with which config.

use std::fs;
use std::os::unix::fs::MetadataExt;
use std::path::Path;

use anyhow::{Context, bail, ensure};
use config::{Change, Config, Faults, Kind, OnResume};

use crate::folder::{self, RunFolder};
use crate::inputs::{self, Inputs};
use crate::saved::{Saved, Saver};
use crate::{check, recorded, runs};

type Sets = [(String, String)];

/// What there is to do with a run.
pub(crate) enum Reopened {
    /// Nothing, and why. Nothing in the run's folder was touched.
    Finished(String),
    /// To go on.
    Open(Box<Resumed>),
}

/// A run to go on with.
pub(crate) struct Resumed {
    pub(crate) folder: RunFolder,
    pub(crate) config: Config,
    pub(crate) saved: Saved,
    /// What the user may want to know: changed keys, and what was mended.
    pub(crate) notes: Vec<String>,
}

/// Opens the run of a name, folder or link, with `table.key` and value pairs laid over its config.
///
/// # Errors
/// No such run, one that is alive or another user's, and every fault of its config at once: keys
/// that may not change in a run that has begun among them.
pub(crate) fn open(given: &str, sets: &Sets) -> anyhow::Result<Reopened> {
    let found = runs::find(Path::new(given))?;
    let path = runs::settled(&found);
    let (owner, own) = (
        fs::metadata(&path)?.uid(),
        rustix::process::getuid().as_raw(),
    );
    ensure!(
        owner == own,
        "the run in {} belongs to the user with number {owner}, this is number {own}",
        path.display()
    );
    let lock = folder::lock(&path)?;
    let made = made_with(&path)?;
    let config = load(&path, sets, &made, |_| vec![])?;
    let changes = config.changes(&made);
    let lost = !path.join("checkpoints").is_dir();
    let mut saved = Saver::new(&path).load().unwrap_or_default();
    if saved.finished && !asks_for_more(&config, &changes, &saved) {
        let score = path.join("score.json");
        if config.run.kind == Kind::Walker || score.is_file() {
            return Ok(Reopened::Finished(finished(&path, &changes)?));
        }
    }
    let known = Inputs::read(&path);
    let (sets, mut notes) = with_moved(&path, &config, sets, &known);
    let available = wire::shared_memory_available()?;
    let config = load(&path, &sets, &made, |config| {
        let mut faults = inputs_faults(config, &known);
        let machine = check::further(config, available).into_iter();
        faults.extend(machine.map(|(key, told)| (key.to_owned(), told)));
        faults
    })?;
    let changes = config.changes(&made);
    folder::make_parts(&path)?;
    if lost {
        notes.push(format!(
            "{} was gone: training begins anew",
            path.join("checkpoints").display()
        ));
        saved = anew(saved);
    }
    if changes
        .iter()
        .any(|change| change.on_resume == OnResume::Protocol)
    {
        saved.results.clear();
    }
    saved.finished = false;
    notes.extend(changes.iter().map(|change| format!("config: {change}")));
    folder::write_config(&config, &path)?;
    known.renew(&config, &path)?;
    notes.extend(runs::point(&found));
    let folder = RunFolder { path, _lock: lock };
    Ok(Reopened::Open(Box::new(Resumed {
        folder,
        config,
        saved,
        notes,
    })))
}

/// What is left of a run's progress without its states.
fn anew(saved: Saved) -> Saved {
    Saved {
        seconds: saved.seconds,
        restarts: saved.restarts,
        accounts: saved.accounts,
        ..Saved::default()
    }
}

/// Whether a finished run has something to do.
fn asks_for_more(config: &Config, changes: &[Change], saved: &Saved) -> bool {
    let anew = changes
        .iter()
        .any(|change| change.on_resume == OnResume::Protocol);
    config.run.kind == Kind::Offline && (anew || config.evaluation.episodes > saved.results.len())
}

/// That a run is finished, with its score.
fn finished(path: &Path, changes: &[Change]) -> anyhow::Result<String> {
    let score = match recorded::score(path)? {
        Some(score) => format!(" with the normalized score {score:.1}"),
        None => String::new(),
    };
    let keys: Vec<&str> = changes.iter().map(|change| change.key.as_str()).collect();
    let changes = match keys.as_slice() {
        [] => String::new(),
        keys => format!("; a change of {} changes nothing any more", keys.join(", ")),
    };
    Ok(format!(
        "run {} is finished{score}; nothing was left to do{changes}",
        path.display()
    ))
}

/// The config that the run's states were made with.
fn made_with(path: &Path) -> anyhow::Result<Config> {
    let (present, made) = (path.join("config.toml"), folder::made(path));
    if !present.is_file() {
        let (present, made_at) = (present.display(), made.display());
        match made.is_file() {
            true => bail!(
                "{present} is missing; its states were made with {made_at}: `cp {made_at} {present}`"
            ),
            false => bail!(
                "{present} is missing, and so is {made_at}; without a config the run cannot go on"
            ),
        }
    }
    if !made.is_file() {
        // The run of an earlier version, or one whose states are gone.
        return Ok(read(&present, path)?);
    }
    read(&made, path).with_context(|| {
        format!(
            "{} is damaged; take it out to go on with config.toml as it is",
            made.display()
        )
    })
}

/// A config of the run, with nothing that it names looked for.
fn read(file: &Path, run: &Path) -> Result<Config, Faults> {
    Config::load_of_run(file, run, &[], |_| Vec::<(String, String)>::new())
}

/// The pairs to lay over the config, with those for inputs that were moved together with the run,
/// and words for the user about them.
fn with_moved(
    path: &Path,
    config: &Config,
    sets: &Sets,
    known: &Inputs,
) -> (Vec<(String, String)>, Vec<String>) {
    let (mut sets, mut notes) = (sets.to_vec(), vec![]);
    for (key, input) in inputs::paths(config) {
        let given = sets.iter().any(|(set, _)| set == key);
        if given || input.exists() {
            continue;
        }
        if let Some(there) = known.moved(key, input, path) {
            let there = there.display().to_string();
            notes.push(format!("{key} moved with the run to {there}"));
            sets.push((key.to_owned(), there.replace('$', "$$")));
        }
    }
    (sets, notes)
}

/// The config to go on with; every fault of it at once, `further` ones included.
fn load(
    path: &Path,
    sets: &Sets,
    made: &Config,
    further: impl FnOnce(&Config) -> Vec<(String, String)>,
) -> Result<Config, Faults> {
    let file = path.join("config.toml");
    let loaded = Config::load_of_run(&file, path, sets, |config| {
        let changes = config.changes(made).into_iter();
        let fixed = changes.filter(|change| change.on_resume == OnResume::Fixed);
        let mut faults: Vec<(String, String)> = fixed
            .map(|change| (change.key.clone(), refused(&change)))
            .collect();
        faults.extend(further(config));
        faults
    });
    loaded.map_err(|mut faults| {
        let damaged = faults.faults.iter().any(|fault| fault.key.is_empty());
        let made = folder::made(path);
        if damaged && made.is_file() {
            faults.note(format!(
                "the run's states were made with {}",
                made.display()
            ));
        }
        faults
    })
}

fn refused(change: &Change) -> String {
    let value = |value: &Option<String>| value.clone().unwrap_or_else(|| "nothing".to_owned());
    format!(
        "cannot change from {} to {} in a run that has begun, whose data, weights or graph it shapes; \
         `formica launch` begins a new run with it",
        value(&change.old),
        value(&change.new)
    )
}

/// What is wrong with the files that the run reads.
fn inputs_faults(config: &Config, known: &Inputs) -> Vec<(String, String)> {
    let mut faults = vec![];
    for (key, input) in inputs::paths(config) {
        let told = match input.exists() {
            true => known.compare(key, input).err(),
            false => Some(format!(
                "there is no '{}' any more; name where it is now, `--set {key}=PATH`",
                input.display()
            )),
        };
        faults.extend(told.map(|told| (key.to_owned(), told)));
    }
    faults
}
