//! `formica dataset`: shows and converts data sets.

use std::fmt::{Display, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use ::dataset::{Dataset, Format, OnFault, Opened};
use clap::{Subcommand, ValueEnum};
use durable::Output;
use maze::{CELL_SIZE, Layout};

use crate::fault::Input;
use crate::output;
use crate::output_files::{self, Force};

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

/// A fault in what the user gave.
fn refused(reason: impl Display) -> anyhow::Error {
    Input(reason.to_string()).into()
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
                    .map_err(output_files::as_input)
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

/// The output of `collect`.
pub(crate) fn output(path: &Path, force: Force, inputs: &[&Path]) -> anyhow::Result<Output> {
    let output = Format::D4rl.output(path, force.existing(), inputs);
    output.map_err(output_files::as_input)
}

/// Reads a data set, and warns about episodes that are left out.
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
    outln!("format        {format}");
    outln!("{}", data.summary());
    output::text(format!("\n{}", visit_map(&data, layout.as_ref())));
    Ok(())
}

/// Writes a data set in another format. The last episodes go to the `validation` file if there is one.
fn convert(
    source: &Opened,
    to: Format,
    val_share: f64,
    training: &Output,
    validation: Option<&Output>,
) -> anyhow::Result<()> {
    output_files::end_at_signals()?;
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
    // All files are written before any is moved to its path.
    let staged: Result<Vec<_>, _> = parts
        .iter()
        .map(|(output, data)| to.stage(output, data).map_err(output_files::as_input))
        .collect();
    for (staged, (output, data)) in staged?.into_iter().zip(&parts) {
        staged
            .place()
            .map_err(|error| output_files::as_input(error.into()))?;
        let (rows, episodes) = (data.len(), data.episodes.len());
        let path = output.path().display();
        outln!("{path}: {rows} rows in {episodes} episodes, {to} from {format}");
    }
    Ok(())
}

/// A map of the rows per cell as shades, and of walls as blocks, with y down. Without a layout it covers the
/// visited cells.
fn visit_map(data: &Dataset, layout: Option<&Layout>) -> String {
    let counts = match layout {
        Some(layout) => visits(data, layout),
        None => {
            let coverage = data.coverage(CELL_SIZE);
            let bound = |axis: usize| {
                let along = || coverage.keys().map(|cell| cell[axis]);
                (along().min().unwrap_or(0), along().max().unwrap_or(0))
            };
            let ((left, right), (top, bottom)) = (bound(0), bound(1));
            // Too large for a terminal.
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
                // Rounded up, so that every visited cell has a shade.
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

/// Maximum cells per side without a layout.
const MOST: i64 = 60;

/// Rows in each cell of a layout, by row and column. The origin is the centre of the start cell (D4RL, OGBench),
/// or the centre of the maze with y up (Gymnasium-Robotics, Minari): the one with more rows in free cells.
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
    use super::*;

    /// One episode through these positions.
    fn along(places: &[[f32; 2]]) -> Dataset {
        let mut data = Dataset::default();
        for [x, y] in places {
            let mut observation = [0.0; ::dataset::OBSERVATION];
            (observation[0], observation[1]) = (*x, *y);
            data.observations.extend(observation);
            data.actions.extend([0.0; ::dataset::ACTION]);
            data.rewards.push(0.0);
            data.terminals.push(false);
        }
        data.episodes = std::iter::once(0..places.len()).collect();
        data
    }

    #[test]
    fn the_map_has_shades_and_walls() {
        let places = [[0.0, 0.0], [0.1, 0.0], [0.0, 0.1], [4.0, 0.0], [0.0, 4.0]];
        let layout = Layout::named("umaze").unwrap();
        let text = visit_map(&along(&places), Some(&layout));
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines[1], "██@@--  ██");
        assert_eq!(lines[3], "██      ██");
        assert_eq!(lines[5], "1 of 5 rows outside of the free cells");
        let text = visit_map(&along(&places), None);
        assert_eq!(text, "@@--\n--  \n");
    }

    #[test]
    fn the_origin_of_positions_is_detected() {
        // In Gymnasium-Robotics, row 1 of five is at y = 4, and column 1 at x = -4.
        let places = [
            [-4.0, 4.0],
            [0.0, 4.0],
            [4.0, 4.0],
            [4.0, 0.0],
            [4.0, -4.0],
            [-4.0, -4.0],
        ];
        let layout = Layout::named("umaze").unwrap();
        let text = visit_map(&along(&places), Some(&layout));
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines[1], "██@@@@@@██");
        assert_eq!(lines[2], "██████@@██");
        assert_eq!(lines[3], "██@@  @@██");
        assert!(lines[5].starts_with("0 of 6"), "{text}");
    }

    #[test]
    fn distant_positions_are_not_drawn() {
        let text = visit_map(&along(&[[-1e30, 0.0], [1e30, 0.0]]), None);
        assert!(text.starts_with("no picture"), "{text}");
    }
}
