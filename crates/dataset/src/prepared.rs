//! A run's data as a mapped file in its folder. The launcher reads, checks and converts the data set
//! once; the processes that train on it map the file.

mod stamp;
#[cfg(test)]
mod tests;

use std::fs;
use std::path::{Path, PathBuf};

use config::Config;
use serde::{Deserialize, Serialize};

use crate::mapped::{self, Mapped, Values};
use crate::{Dataset, Element, Loaded, MappedError, Needs, Shape, codes};
pub use stamp::Stamp;

/// Name of the file in a run's folder.
const FILE: &str = "data.mapped";
const KIND: &str = "data set";

/// Metadata of the file.
#[derive(Serialize, Deserialize)]
struct About {
    stamp: Stamp,
    notes: Vec<String>,
    sides: Vec<u64>,
    /// True if observations are images.
    images: bool,
    action: u64,
    rows: u64,
}

/// Path of the file in a run's folder.
fn file(run: &Path) -> PathBuf {
    run.join(FILE)
}

/// Atomically writes the data to a run's folder, and removes [`crate::Codes`] of earlier data.
///
/// # Errors
/// The file cannot be written, for example because the disk is full.
pub fn save(run: &Path, loaded: &Loaded) -> Result<(), MappedError> {
    codes::remove(run);
    let data = &loaded.data;
    let shape = data.shape();
    let about = About {
        stamp: loaded.stamp.clone(),
        notes: loaded.notes.clone(),
        sides: shape.sides().iter().map(|side| *side as u64).collect(),
        images: shape.element() == Element::U8,
        action: shape.action() as u64,
        rows: data.len() as u64,
    };
    let terminals: Vec<u8> = data.terminals.iter().map(|flag| u8::from(*flag)).collect();
    let ends: Vec<u64> = data.episodes.iter().map(|rows| rows.end as u64).collect();
    let arrays = [
        Values::new("observations", &data.observations),
        Values::new("images", &data.images),
        Values::new("image_places", &data.image_places),
        Values::new("actions", &data.actions),
        Values::new("rewards", &data.rewards),
        Values::new("terminals", &terminals),
        Values::new("goals", &data.goals),
        Values::new("episode_ends", &ends),
    ];
    mapped::write(&file(run), KIND, &about, &arrays)
}

/// Maps the data in a run's folder.
///
/// # Errors
/// The file is missing, truncated, corrupt, or of another version.
pub fn open(run: &Path) -> Result<Loaded, MappedError> {
    let file = Mapped::open(&file(run), KIND)?;
    let about: About = file.about()?;
    let wrong = || file.damaged("its arrays differ in length");
    let count = |value: u64| usize::try_from(value).map_err(|_| wrong());
    let sides = about.sides.iter().map(|side| count(*side));
    let sides: Vec<usize> = sides.collect::<Result<_, _>>()?;
    let (rows, action) = (count(about.rows)?, count(about.action)?);
    let least = if about.images { 1 } else { 2 };
    let width = sides
        .iter()
        .try_fold(1_usize, |all, side| all.checked_mul(*side));
    let width = width.filter(|width| *width >= least).ok_or_else(wrong)?;
    let shape = match (about.images, sides.as_slice()) {
        (true, sides) => Shape::images(sides, action),
        (false, [side]) => Shape::vectors(*side, action),
        (false, _) => return Err(wrong()),
    };
    let mut data = Dataset::new(shape);
    data.observations = file.array("observations")?;
    data.images = file.array("images")?;
    data.image_places = file.array("image_places")?;
    data.actions = file.array("actions")?;
    data.rewards = file.array("rewards")?;
    data.goals = file.array("goals")?;
    let terminals = file.array::<u8>("terminals")?;
    data.terminals = terminals.iter().map(|flag| *flag != 0).collect();
    let [vectors, images] = if about.images { [0, rows] } else { [rows, 0] };
    let lengths = [
        (data.observations.len(), vectors, width),
        (data.images.len(), images, width),
        (data.image_places.len(), images, 1),
        (data.actions.len(), rows, action),
        (data.rewards.len(), rows, 1),
        (data.terminals.len(), rows, 1),
    ];
    let right =
        |(length, rows, width): (usize, usize, usize)| rows.checked_mul(width) == Some(length);
    let goals = data.goals.is_empty() || data.goals.len() == rows;
    if action == 0 || !goals || !lengths.into_iter().all(right) {
        return Err(wrong());
    }
    let mut start = 0;
    for end in &file.array::<u64>("episode_ends")? {
        let end = count(*end)?;
        if end <= start || end > rows {
            return Err(file.damaged("its episodes do not cover its rows"));
        }
        data.episodes.push(start..end);
        start = end;
    }
    if start != rows {
        return Err(file.damaged("its episodes do not cover its rows"));
    }
    Ok(Loaded {
        data,
        notes: about.notes,
        stamp: about.stamp,
    })
}

/// Returns true if a run's folder has valid data made from the config's data set as it is now.
#[must_use]
pub fn is_fresh(run: &Path, config: &Config, needs: &Needs) -> bool {
    match (open(run), Stamp::of(config, needs)) {
        (Ok(loaded), Ok(stamp)) => loaded.stamp == stamp,
        _ => false,
    }
}

/// Removes the data and their [`crate::Codes`] from a run's folder. Both can be recreated.
pub fn remove(run: &Path) {
    codes::remove(run);
    // A file that stays does no harm.
    let _ = fs::remove_file(file(run));
}
