//! A run's data, as every process of it has them.

use std::path::{Path, PathBuf};

use config::{Config, Misfit};
use maze::{CELL_SIZE, Layout, LayoutError};

use super::{Expect, Needs, Number, Share, Unfit, check, suffices};
use crate::error::io_error;
use crate::prepared::Stamp;
use crate::{Dataset, DatasetError, Opened, open_with};

/// Data, and what there is to say of them.
#[derive(Debug, Clone, PartialEq)]
pub struct Loaded {
    /// In the project's frame, episodes cut at jumps, cells left out as the config says.
    pub data: Dataset,
    /// A sentence each, with the path.
    pub notes: Vec<String>,
    /// What they were made from.
    pub stamp: Stamp,
}

/// Why a run has no data.
#[derive(Debug, thiserror::Error)]
pub enum LoadError {
    /// The file.
    #[error(transparent)]
    Dataset(#[from] DatasetError),
    /// The maze.
    #[error("maze: {0}")]
    Layout(#[from] LayoutError),
    /// The simulator.
    #[error("there is no simulator '{0}'")]
    Simulator(String),
    /// Data that are whole and do not fit.
    #[error("{path}: {unfit}{waiver}", path = .path.display())]
    Unfit {
        /// The file.
        path: PathBuf,
        /// What does not fit.
        unfit: Box<Unfit>,
        /// How to go on regardless, as a remark.
        waiver: &'static str,
    },
}

/// Reads the data set of a config and has it checked, converted and cut. [`crate::prepared::save`]
/// puts the data where all processes of a run find them.
///
/// # Errors
/// A file that cannot be read, and data that do not fit the run; with `dataset.fit = "warn"` only
/// those that nothing can be learnt from.
pub fn load_for(config: &Config, needs: &Needs) -> Result<Loaded, LoadError> {
    let path = Path::new(&config.dataset.path);
    // Before the file is read: what changes meanwhile is seen.
    let stamp = Stamp::of(config, needs).map_err(|error| io_error(path, error))?;
    let layout = Layout::of(&config.maze.layout, &config.maze.rows)?;
    let Opened { data, dropped, .. } = open_with(path, config.dataset.on_fault)?;
    let (data, mut notes) = prepare(config, needs, path, &layout, data)?;
    if dropped.episodes > 0 {
        notes.insert(0, dropped.to_string());
    }
    Ok(Loaded { data, notes, stamp })
}

fn prepare(
    config: &Config,
    needs: &Needs,
    path: &Path,
    layout: &Layout,
    data: Dataset,
) -> Result<(Dataset, Vec<String>), LoadError> {
    let name = &config.run.simulator;
    let expect = Expect {
        body: simulators::body(name).ok_or_else(|| LoadError::Simulator(name.clone()))?,
        maze: &config.maze.layout,
        layout,
        lags: &needs.lags,
        nodes: needs.nodes,
    };
    let refuse = |unfit: Unfit| LoadError::Unfit {
        path: path.to_path_buf(),
        waiver: if unfit.can_be_waived() {
            " (dataset.fit = \"warn\" takes them as they are)"
        } else {
            ""
        },
        unfit: Box::new(unfit),
    };
    let mut fit = check(&data, &expect);
    let mut notes = std::mem::take(&mut fit.notes);
    let refused = |unfit: &Unfit| config.dataset.fit == Misfit::Refuse || !unfit.can_be_waived();
    if let Some(at) = fit.faults.iter().position(refused) {
        return Err(refuse(fit.faults.swap_remove(at)));
    }
    notes.extend(fit.faults.iter().map(ToString::to_string));
    let whole = fit.apply(expect.body, layout, data);
    suffices(&whole, &expect).map_err(refuse)?;
    let left_out = |place| config.dataset.leaves_out(layout.cell_at(place));
    let data = if config.dataset.leave_out.is_empty() {
        whole
    } else {
        let data = whole.without(left_out);
        suffices(&data, &expect).map_err(refuse)?;
        data
    };
    notes.extend(short(&data, &needs.lags));
    notes.extend(uncovered(&data, layout));
    let notes = notes
        .into_iter()
        .map(|note| format!("{}: {note}", path.display()))
        .collect();
    Ok((data, notes))
}

/// A word on rows that are in no episode long enough, where they are many.
fn short(data: &Dataset, lags: &[(&'static str, usize)]) -> Option<String> {
    let (key, lag) = lags.iter().max_by_key(|(_, lag)| *lag)?;
    let short = data.episodes.iter().map(ExactSizeIterator::len);
    let rows: usize = short.filter(|length| length <= lag).sum();
    let share = Share::of(rows, data.len());
    (share.0 > 0.1).then(|| {
        format!("{share} of the rows are in episodes of no more than {key} = {lag} rows and make no edge")
    })
}

/// A word on the start or a goal of the evaluation that the data never come near.
fn uncovered(data: &Dataset, layout: &Layout) -> Option<String> {
    let goals = layout.goals().iter().map(|cell| ("goal", *cell));
    let tasks = layout.tasks().iter();
    let tasks = tasks.flat_map(|(start, goal)| [("start", *start), ("goal", *goal)]);
    let own = std::iter::once(("start", layout.start())).chain(goals);
    let ends: Vec<_> = match layout.tasks() {
        [] => own.collect(),
        _ => tasks.collect(),
    };
    let nearest = |cell| {
        let [x, y] = layout.centre(cell);
        let distance = |[u, v]: [f32; 2]| (x - u).hypot(y - v);
        let places = (0..data.len()).map(|row| distance(data.place(row)));
        places.fold(f32::INFINITY, f32::min)
    };
    let far = ends.into_iter().find_map(|(end, cell)| {
        let distance = nearest(cell);
        (distance > CELL_SIZE / 2.0).then_some((end, cell, distance))
    });
    far.map(|(end, (row, column), distance)| {
        format!(
            "no row comes nearer than {} m to the {end} of the evaluation in row {row}, column \
             {column}; episodes there will hardly succeed",
            Number(distance)
        )
    })
}
