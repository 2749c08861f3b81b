//! Whether data that are whole fit a run: its body, its maze, its lags.
//!
//! What is looked at is what the body's physics and the maze leave no doubt about: no body is in a
//! wall, none jumps, actions have bounds; an ant's quaternion has norm 1, and its places change as
//! its velocities say. Frames of reference of other public data sets are recognised and converted.

mod columns;
mod frame;
mod load;
mod motion;
mod needs;
mod places;
mod sample;
mod unfit;

use maze::Layout;
use simulator::{Body, Columns};

use crate::{Dataset, Shape};
pub use frame::{Conversion, Frame};
pub use load::{LoadError, Loaded, load_for};
pub use needs::{Expect, Needs};
pub use unfit::{Number, Share, Unfit};

/// What was found.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Fit {
    /// How the data come into the project's frame.
    pub conversion: Conversion,
    /// Rows before a jump of the torso: episodes end there, too.
    pub cuts: Vec<usize>,
    /// What is to be said, a sentence each.
    pub notes: Vec<String>,
    /// What does not fit, the most telling first.
    pub faults: Vec<Unfit>,
}

/// Looks at whether data fit. Sizes grow with the rows but for a few passes over places and
/// actions: a million rows take a fraction of a second.
#[must_use]
pub fn check(data: &Dataset, expect: &Expect<'_>) -> Fit {
    let mut fit = Fit::default();
    // Rows of another width have other columns, and columns in another order make all else
    // meaningless.
    if let Err(fault) = shape(data, expect.body) {
        fit.faults.push(fault);
        return fit;
    }
    let joints = match expect.body.columns() {
        Columns::Free { joints } => Some(joints),
        Columns::Plain => None,
    };
    if let Some(joints) = joints
        && let Err(fault) = columns::observations(data, joints)
    {
        fit.faults.push(fault);
    }
    match places::judge(data, expect.maze, expect.layout) {
        Ok((frame, notes)) => {
            fit.conversion.frame = frame;
            fit.notes.extend(notes);
        }
        Err(fault) => fit.faults.push(fault),
    }
    if let Err(fault) = columns::values(data) {
        fit.faults.push(fault);
    }
    if let Err(fault) = columns::actions(data) {
        fit.faults.push(fault);
    }
    match motion::jumps(data, expect, fit.conversion.frame) {
        Ok(jumps) => {
            if let Some(first) = jumps.first() {
                fit.notes.push(format!(
                    "the {} jumps by more than {} m in {} steps that end no episode (first after row \
                     {first}); episodes are cut there",
                    expect.body.name(),
                    Number(motion::MOST_STEP),
                    jumps.len(),
                ));
            }
            fit.cuts = jumps;
        }
        Err(fault) => fit.faults.push(fault),
    }
    let Some(joints) = joints else { return fit };
    match motion::velocities(data, 7 + joints.len(), fit.conversion.frame) {
        Ok(velocities) => {
            fit.conversion.places_alone = velocities.places_alone;
            if velocities.places_alone {
                fit.notes.push(
                    "the velocities are those of y downwards: the places alone were converted"
                        .to_owned(),
                );
            }
            fit.notes.extend(velocities.note);
        }
        Err(fault) => fit.faults.push(fault),
    }
    fit
}

/// Checks that rows have the shape of a body's.
fn shape(data: &Dataset, body: &dyn Body) -> Result<(), Unfit> {
    let wanted = Shape::of(body);
    if *data.shape() == wanted {
        return Ok(());
    }
    Err(Unfit::Shape {
        found: data.shape().clone(),
        wanted,
        body: body.name(),
        instead: match data.shape().bodies().next() {
            Some(other) => format!("the file's widths are those of '{}'", other.name()),
            None => "no simulator has the file's widths".to_owned(),
        },
    })
}

impl Fit {
    /// Data as the run has them: converted, and cut at jumps.
    #[must_use]
    pub fn apply(&self, body: &dyn Body, layout: &Layout, mut data: Dataset) -> Dataset {
        self.conversion.apply(body, layout, &mut data);
        if self.cuts.is_empty() {
            return data;
        }
        let mut cuts = self.cuts.iter().copied().peekable();
        let mut episodes = Vec::with_capacity(data.episodes.len() + self.cuts.len());
        for episode in data.episodes {
            let mut start = episode.start;
            while let Some(row) = cuts.next_if(|row| *row < episode.end) {
                episodes.push(start..row + 1);
                start = row + 1;
            }
            episodes.push(start..episode.end);
        }
        data.episodes = episodes;
        data
    }
}

/// Whether there is anything to learn from: to be asked of data as the run has them.
///
/// # Errors
/// Episodes that are all too short, or a body that is under way in too few rows.
pub fn suffices(data: &Dataset, expect: &Expect<'_>) -> Result<(), Unfit> {
    let longest = data.episodes.iter().map(ExactSizeIterator::len).max();
    let longest = longest.unwrap_or(0);
    if let Some(&(key, lag)) = expect.lags.iter().find(|(_, lag)| longest <= *lag) {
        let why = if longest <= 1 && data.len() > 1 {
            " row ('timeouts' mark every row as an end)"
        } else {
            " rows"
        };
        return Err(Unfit::TooShort {
            key,
            lag,
            episodes: data.episodes.len(),
            longest,
            why,
        });
    }
    let moving = motion::moving(data, expect.body, expect.nodes);
    if moving < expect.nodes {
        return Err(Unfit::Still {
            body: expect.body.name(),
            standing: matches!(expect.body.columns(), Columns::Free { .. }),
            moving,
            rows: data.len(),
            nodes: expect.nodes,
        });
    }
    Ok(())
}

#[cfg(test)]
mod tests;
