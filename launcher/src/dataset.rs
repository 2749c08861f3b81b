//! `formica dataset`: what a data set holds, and other formats of it.

use std::fmt::{self, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use ::dataset::{Dataset, Format, OnFault, Opened};
use clap::{Subcommand, ValueEnum};
use durable::Output;
use maze::{CELL_SIZE, Layout};

use crate::outputs::{self, Force};

/// Shades of a cell, from never visited to the most visited.
const SHADES: &[u8] = b" .:-=+*#%@";

#[derive(Subcommand)]
pub(crate) enum Action {
    /// Print what a data set of any format is: episodes, lengths, returns, coverage of the maze
    Info {
        /// A D4RL HDF5 file, a Minari folder or main_data.hdf5, or an OGBench npz
        file: PathBuf,
        /// The maze to draw the walls of: umaze, medium, large, giant or teleport
        #[arg(long)]
        maze: Option<String>,
        /// What becomes of episodes that break the format's rules
        #[arg(long, default_value = "refuse")]
        on_fault: Faulty,
    },
    /// Write a data set in another format
    Convert {
        /// A data set of any format
        input: PathBuf,
        /// Where to: a file, or for Minari a folder
        output: PathBuf,
        /// The format to write
        #[arg(long)]
        to: Target,
        /// Share of the episodes, the last ones, that go to OUTPUT-val.npz (OGBench only)
        #[arg(long, default_value_t = 0.0)]
        val_share: f64,
        /// What becomes of episodes that break the format's rules
        #[arg(long, default_value = "refuse")]
        on_fault: Faulty,
        #[command(flatten)]
        force: Force,
    },
}

/// `dataset.on_fault`, as an argument.
#[derive(Clone, Copy, PartialEq, ValueEnum)]
pub(crate) enum Faulty {
    /// The data set is refused
    Refuse,
    /// They are left out whole, unless they are more than half
    DropEpisode,
}

impl From<Faulty> for OnFault {
    fn from(faulty: Faulty) -> Self {
        match faulty {
            Faulty::Refuse => Self::Refuse,
            Faulty::DropEpisode => Self::DropEpisode,
        }
    }
}

#[derive(Clone, Copy, PartialEq, ValueEnum)]
pub(crate) enum Target {
    D4rl,
    Minari,
    Ogbench,
}

impl Target {
    fn format(self) -> Format {
        match self {
            Self::D4rl => Format::D4rl,
            Self::Minari => Format::Minari,
            Self::Ogbench => Format::Ogbench,
        }
    }
}

/// What the user gave is of no use: exit code 2.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub(crate) struct Refused(pub(crate) String);

fn refused(reason: impl fmt::Display) -> anyhow::Error {
    Refused(reason.to_string()).into()
}

pub(crate) fn run(action: &Action) -> anyhow::Result<ExitCode> {
    match action {
        Action::Info {
            file,
            maze,
            on_fault,
        } => info(file, maze.as_deref(), *on_fault)?,
        Action::Convert {
            input,
            output: output_path,
            to,
            val_share,
            on_fault,
            force,
        } => {
            if !(0.0..1.0).contains(val_share) {
                return Err(refused("--val-share is not in 0 to 1, 1 excluded"));
            }
            if *val_share > 0.0 && *to != Target::Ogbench {
                return Err(refused("--val-share is for --to ogbench alone"));
            }
            let output = |path: &Path| {
                let format = to.format();
                let existing = force.existing();
                format
                    .output(path, existing, &[input])
                    .map_err(outputs::given)
            };
            let training = output(output_path)?;
            let validation = (*val_share > 0.0)
                .then(|| output(&::dataset::ogbench::validation_path(training.path())))
                .transpose()?;
            let source = open(input, *on_fault)?;
            convert(
                &source,
                to.format(),
                *val_share,
                &training,
                validation.as_ref(),
            )?;
        }
    }
    Ok(ExitCode::SUCCESS)
}

/// Where `collect` writes.
pub(crate) fn output(path: &Path, force: Force, inputs: &[&Path]) -> anyhow::Result<Output> {
    let output = Format::D4rl.output(path, force.existing(), inputs);
    output.map_err(outputs::given)
}

/// Reads a data set, and tells of episodes that are left out.
fn open(path: &Path, on_fault: Faulty) -> anyhow::Result<Opened> {
    let opened = ::dataset::open_with(path, on_fault.into()).map_err(refused)?;
    if opened.dropped.episodes > 0 {
        log::warn!("{}", opened.dropped);
    }
    Ok(opened)
}

fn info(file: &Path, maze: Option<&str>, on_fault: Faulty) -> anyhow::Result<()> {
    let layout = maze.map(Layout::named).transpose().map_err(refused)?;
    let Opened { format, data, .. } = open(file, on_fault)?;
    say!("format        {format}");
    say!("{}", data.summary());
    crate::output::text(format!("\n{}", picture(&data, layout.as_ref())));
    Ok(())
}

/// Writes a data set in another format, the last episodes to a file of their own if that is named.
fn convert(
    source: &Opened,
    to: Format,
    val_share: f64,
    training: &Output,
    validation: Option<&Output>,
) -> anyhow::Result<()> {
    outputs::end_at_signals()?;
    let Opened { format, data, .. } = source;
    let total = data.episodes.len();
    let kept = total - (val_share * total as f64).ceil() as usize;
    if kept == 0 {
        return Err(refused(format!(
            "--val-share {val_share} of {total} episodes leaves none for training"
        )));
    }
    let parts: Vec<(&Output, Dataset)> = match validation {
        Some(validation) => vec![
            (training, data.select(0..kept)),
            (validation, data.select(kept..total)),
        ],
        None => vec![(training, data.clone())],
    };
    // Nothing is put in its place before all is written.
    let staged: Result<Vec<_>, _> = parts
        .iter()
        .map(|(output, data)| to.stage(output, data).map_err(outputs::given))
        .collect();
    for (staged, (output, data)) in staged?.into_iter().zip(&parts) {
        staged
            .place()
            .map_err(|error| outputs::given(error.into()))?;
        let (rows, episodes) = (data.len(), data.episodes.len());
        let path = output.path().display();
        say!("{path}: {rows} rows in {episodes} episodes, {to} from {format}");
    }
    Ok(())
}

/// Rows in each cell of 4 m as shades, walls as blocks; y grows downwards, as rows of a map do.
/// Without a layout, the cells around those that were visited.
fn picture(data: &Dataset, layout: Option<&Layout>) -> String {
    let counts = match layout {
        Some(layout) => visits(data, layout),
        None => {
            let coverage = data.coverage(CELL_SIZE);
            let bound = |axis: usize| {
                let along = || coverage.keys().map(|cell| cell[axis]);
                (along().min().unwrap_or(0), along().max().unwrap_or(0))
            };
            let ((left, right), (top, bottom)) = (bound(0), bound(1));
            // What is far out is no maze; a picture of it would be longer than any terminal.
            if i64::from(right) - i64::from(left) > MOST
                || i64::from(bottom) - i64::from(top) > MOST
            {
                return format!("no picture: it would be of more than {MOST} cells a side\n");
            }
            let count = |x, y| coverage.get(&[x, y]).copied().unwrap_or(0);
            (top..=bottom)
                .map(|y| (left..=right).map(|x| count(x, y)).collect())
                .collect()
        }
    };
    let most = counts.iter().flatten().max().copied().unwrap_or(0).max(1);
    let mut text = String::new();
    for (row, counts) in counts.iter().enumerate() {
        for (column, count) in counts.iter().enumerate() {
            let wall = layout.is_some_and(|layout| layout.is_wall((row, column)));
            if wall {
                text.push_str("██");
            } else {
                // The least visited cell differs from one that never was.
                let shade = char::from(SHADES[(count * (SHADES.len() - 1)).div_ceil(most)]);
                text.extend([shade, shade]);
            }
        }
        text.push('\n');
    }
    if let Some(layout) = layout {
        let inside = |(row, column)| !layout.is_wall((row, column));
        let cells = (0..counts.len()).flat_map(|row| (0..counts[row].len()).map(move |c| (row, c)));
        let free: usize = cells
            .filter(|cell| inside(*cell))
            .map(|(r, c)| counts[r][c])
            .sum();
        let outside = data.len() - free;
        let _ = writeln!(
            text,
            "{outside} of {} rows outside of the free cells",
            data.len()
        );
    }
    text
}

/// Cells a side that are drawn without a layout.
const MOST: i64 = 60;

/// Rows in each cell of a layout, by row and column. Places are taken from the start cell's centre
/// (D4RL, OGBench) or from the maze's, with y upwards (Gymnasium-Robotics, so Minari), whichever
/// puts more rows into free cells.
fn visits(data: &Dataset, layout: &Layout) -> Vec<Vec<usize>> {
    let (rows, columns) = layout.shape();
    let corner = layout.centre((0, 0));
    let from_centre = |[x, y]: [f32; 2]| {
        [
            x + corner[0] + (columns as f32 - 1.0) * CELL_SIZE / 2.0,
            -y + corner[1] + (rows as f32 - 1.0) * CELL_SIZE / 2.0,
        ]
    };
    let count = |place: &dyn Fn(usize) -> [f32; 2]| {
        let mut counts = vec![vec![0; columns]; rows];
        let mut free = 0_usize;
        for row in 0..data.len() {
            if let Some(cell) = layout.cell_at(place(row)) {
                counts[cell.0][cell.1] += 1;
                free += usize::from(!layout.is_wall(cell));
            }
        }
        (free, counts)
    };
    let (in_start, start) = count(&|row| data.place(row));
    let (in_centre, centre) = count(&|row| from_centre(data.place(row)));
    if in_centre > in_start { centre } else { start }
}

#[cfg(test)]
mod tests {
    use ::dataset::Shape;

    use super::*;

    /// One episode along places.
    fn along(places: &[[f32; 2]]) -> Dataset {
        let mut data = Dataset::new(Shape::vectors(2, 1));
        for place in places {
            data.observations.extend_from_slice(place);
            data.actions.push(0.0);
            data.rewards.push(0.0);
            data.terminals.push(false);
        }
        data.end_episode();
        data
    }

    #[test]
    fn the_picture_shades_cells_and_draws_walls() {
        let places = [[0.0, 0.0], [0.1, 0.0], [0.0, 0.1], [4.0, 0.0], [0.0, 4.0]];
        let layout = Layout::named("umaze").unwrap();
        let text = picture(&along(&places), Some(&layout));
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines[1], "██@@--  ██");
        assert_eq!(lines[3], "██      ██");
        assert_eq!(lines[5], "1 of 5 rows outside of the free cells");
        let text = picture(&along(&places), None);
        assert_eq!(text, "@@--\n--  \n");
    }

    #[test]
    fn places_from_the_centre_of_the_maze_are_told_from_those_of_the_start() {
        // Gymnasium-Robotics' frame: row 1 of five lies at y = 4, column 1 at x = -4.
        let places = [
            [-4.0, 4.0],
            [0.0, 4.0],
            [4.0, 4.0],
            [4.0, 0.0],
            [4.0, -4.0],
            [-4.0, -4.0],
        ];
        let layout = Layout::named("umaze").unwrap();
        let text = picture(&along(&places), Some(&layout));
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines[1], "██@@@@@@██");
        assert_eq!(lines[2], "██████@@██");
        assert_eq!(lines[3], "██@@  @@██");
        assert!(lines[5].starts_with("0 of 6"), "{text}");
    }

    #[test]
    fn places_far_out_are_not_drawn() {
        let text = picture(&along(&[[-1e30, 0.0], [1e30, 0.0]]), None);
        assert!(text.starts_with("no picture"), "{text}");
    }
}
