//! Opens a stopped run: whether anything is left to do, and with which config.

use std::fs;
use std::os::unix::fs::MetadataExt;
use std::path::Path;

use anyhow::{bail, ensure};
use config::{Change, Config, Faults, OnResume};
use runs::folder::{self, RunFolder};
use runs::inputs::Inputs;
use runs::{find, latest, read as recorded};

use super::progress_file::{ProgressFile, RunProgress};
use crate::check;
use crate::fault::Input;

type Sets = [(String, String)];

/// What is left to do in a run.
pub(crate) enum Reopened {
    /// Nothing, with a message. The run's folder was not changed.
    Finished(String),
    /// The run continues.
    Open(Box<Resumed>),
}

/// A run to continue.
pub(crate) struct Resumed {
    pub(crate) folder: RunFolder,
    pub(crate) config: Config,
    pub(crate) progress: RunProgress,
    /// Messages about changed keys and repairs.
    pub(crate) notes: Vec<String>,
}

/// Opens a run by name, folder or link, with `table.key` and value pairs that override its config.
///
/// # Errors
/// No such run, a run that is alive or another user's, or all faults of its config at once, including keys that
/// must not change on resume.
pub(crate) fn open(given: &str, sets: &Sets) -> anyhow::Result<Reopened> {
    let found = find::find(Path::new(given))?;
    let path = find::resolved(&found);
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
    let mut progress = ProgressFile::new(&path).load().unwrap_or_default();
    if progress.finished && !asks_for_more(&config, &changes, &progress) {
        let score = path.join("score.json");
        if !config.offline || score.is_file() {
            return Ok(Reopened::Finished(finished(&path, &changes)?));
        }
    }
    let known = Inputs::read(&path);
    let (sets, mut notes) = with_moved(&path, &config, sets, &known);
    let available = wire::shared_memory_available()?;
    let config = load(&path, &sets, &made, |config| {
        let mut faults = inputs_faults(config, &known);
        let machine = check::further(config, available).into_iter();
        faults.extend(machine.map(|(key, message)| (key.to_owned(), message)));
        faults
    })?;
    let changes = config.changes(&made);
    folder::make_parts(&path)?;
    if lost {
        notes.push(format!(
            "{} was gone: training begins anew",
            path.join("checkpoints").display()
        ));
        progress = without_checkpoints(progress);
    }
    if changes
        .iter()
        .any(|change| change.on_resume == OnResume::Protocol)
    {
        progress.results.clear();
    }
    progress.finished = false;
    notes.extend(changes.iter().map(|change| format!("config: {change}")));
    folder::write_config(&config, &path)?;
    known.renew(&config, &path)?;
    notes.extend(latest::point(&found));
    let folder = RunFolder::new(path, lock);
    Ok(Reopened::Open(Box::new(Resumed {
        folder,
        config,
        progress,
        notes,
    })))
}

/// The progress of a run whose checkpoints are gone.
fn without_checkpoints(progress: RunProgress) -> RunProgress {
    RunProgress {
        seconds: progress.seconds,
        restarts: progress.restarts,
        audit: progress.audit,
        ..RunProgress::default()
    }
}

/// Whether the config of a finished run asks for more.
fn asks_for_more(config: &Config, changes: &[Change], progress: &RunProgress) -> bool {
    let anew = changes
        .iter()
        .any(|change| change.on_resume == OnResume::Protocol);
    config.offline && (anew || config.evaluation.episodes > progress.results.len())
}

/// The message that a run is finished, with its score.
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

/// The config that the checkpoints of the run belong to.
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
        // A run of an earlier version, or without checkpoints.
        return read(&present, path).map_err(|faults| of_an_earlier_version(faults, path));
    }
    read(&made, path).map_err(|faults| {
        let damaged = format!(
            "{} is damaged; take it out to go on with config.toml as it is",
            made.display()
        );
        match is_of_an_earlier_version(&faults) {
            true => of_an_earlier_version(faults, path),
            false => anyhow::Error::new(faults).context(damaged),
        }
    })
}

/// Whether a run's config has the key that version 0.2 replaced.
fn is_of_an_earlier_version(faults: &Faults) -> bool {
    faults.faults.iter().any(|fault| fault.key == "run.kind")
}

/// Refuses a run whose config and states have the format of version 0.1; other faults stay as they are.
fn of_an_earlier_version(faults: Faults, path: &Path) -> anyhow::Error {
    if !is_of_an_earlier_version(&faults) {
        return faults.into();
    }
    let path = path.display();
    Input(format!(
        "the run in {path} was made by formica 0.1, whose states this version cannot continue; resume it with \
         formica 0.1, or begin a new run with `formica launch`"
    ))
    .into()
}

/// A config of the run, without checking the files that it names.
fn read(file: &Path, run: &Path) -> Result<Config, Faults> {
    agents::CONFIGS.load_of_run(file, run, &[], |_| Vec::<(String, String)>::new())
}

/// The pairs that override the config, with those for inputs that were moved together with the run, and
/// messages about them.
fn with_moved(
    path: &Path,
    config: &Config,
    sets: &Sets,
    known: &Inputs,
) -> (Vec<(String, String)>, Vec<String>) {
    let (mut sets, mut notes) = (sets.to_vec(), vec![]);
    for (key, input) in config.inputs() {
        let given = sets.iter().any(|(set, _)| *set == key);
        if given || input.exists() {
            continue;
        }
        if let Some(there) = known.moved(&key, &input, path) {
            let there = there.display().to_string();
            notes.push(format!("{key} moved with the run to {there}"));
            sets.push((key, there.replace('$', "$$")));
        }
    }
    (sets, notes)
}

/// The config to continue with, or all its faults, including `further` ones.
fn load(
    path: &Path,
    sets: &Sets,
    made: &Config,
    further: impl FnOnce(&Config) -> Vec<(String, String)>,
) -> Result<Config, Faults> {
    let file = path.join("config.toml");
    let loaded = agents::CONFIGS.load_of_run(&file, path, sets, |config| {
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

/// Faults of the files that the run reads.
fn inputs_faults(config: &Config, known: &Inputs) -> Vec<(String, String)> {
    let mut faults = vec![];
    for (key, input) in config.inputs() {
        let message = match input.exists() {
            true => known.compare(&key, &input).err(),
            false => Some(format!(
                "there is no '{}' any more; name where it is now, `--set {key}=PATH`",
                input.display()
            )),
        };
        faults.extend(message.map(|message| (key, message)));
    }
    faults
}
