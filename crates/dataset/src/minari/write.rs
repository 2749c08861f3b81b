//! Writes folders that Minari's package opens.

use std::fs::{self, File};
use std::io::{BufWriter, Write};
use std::ops::Range;
use std::path::Path;

use durable::{Existing, Output, Staged};
use hdf5_pure::{AttrValue, Error, FileBuilder, GroupBuilder};
use serde_json::json;

use super::{HOLDS, MAIN, METADATA};
use crate::d4rl::{bools, compress, failed};
use crate::error::io_error;
use crate::{Dataset, DatasetError, Element, Shape};

/// The oldest version of Minari whose layout this is; what newer ones ask of the metadata.
const VERSION: &str = "0.5.0";

/// Writes the folder `path`, where nothing is, with `data/main_data.hdf5` and `data/metadata.json`:
/// it is whole, or nothing. Minari finds it as the data set of the folder's name when
/// `MINARI_DATASETS_PATH` names the folder around it.
///
/// An episode of n rows has n - 1 actions here: its last row's action, reward and terminal are
/// dropped, as no state follows them. Terminals become `terminations`; the end is a truncation
/// otherwise. Where there are no goals, `desired_goal` is zero. An ant's place is in `achieved_goal`
/// alone, as in AntMaze; other observations are whole in `observation`.
///
/// # Errors
/// A path that is there already, and what the system or the format refuses.
pub fn write(path: &Path, data: &Dataset) -> Result<(), DatasetError> {
    let output = Output::folder(path, Existing::Refuse, &[], HOLDS)?;
    Ok(stage(&output, data)?.place()?)
}

/// [`write()`], up to the point where the folder is put in its place.
pub(crate) fn stage(output: &Output, data: &Dataset) -> Result<Staged, DatasetError> {
    let path = output.path();
    let main = layout(data).map_err(|error| failed(path, error))?;
    let io = |source| io_error(path, source);
    output.stage_folder(|folder| {
        let inside = folder.join("data");
        fs::create_dir(&inside).map_err(io)?;
        let mut file = BufWriter::new(File::create(inside.join(MAIN)).map_err(io)?);
        main.finish_to(&mut file)
            .map_err(|error| failed(path, error))?;
        file.flush()
            .and_then(|()| file.get_ref().sync_all())
            .map_err(io)?;
        let mut file = File::create(inside.join(METADATA)).map_err(io)?;
        file.write_all(metadata(path, data).as_bytes())
            .and_then(|()| file.sync_all())
            .map_err(io)?;
        File::open(&inside)
            .and_then(|inside| inside.sync_all())
            .map_err(io)
    })
}

fn layout(data: &Dataset) -> Result<FileBuilder, Error> {
    let mut builder = FileBuilder::new();
    let width = data.shape().action();
    for (number, rows) in data.episodes.iter().enumerate() {
        let steps = rows.len() - 1;
        let acted = rows.start..rows.end - 1;
        let mut group = builder.create_group(&format!("episode_{number}"));
        group.set_attr("id", AttrValue::I64(number as i64));
        group.set_attr("total_steps", AttrValue::I64(steps as i64));
        let actions = &data.actions[acted.start * width..acted.end * width];
        array(&mut group, "actions", actions, steps, width);
        let rewards = group.create_dataset("rewards");
        compress(
            rewards.with_f32_data(&data.rewards[acted.clone()]),
            &[steps as u64],
        );
        let terminations: Vec<u8> = data.terminals[acted].iter().map(|f| u8::from(*f)).collect();
        let mut truncations = vec![0; steps];
        if let (Some(end), Some(0)) = (truncations.last_mut(), terminations.last()) {
            *end = 1;
        }
        for (name, flags) in [("terminations", terminations), ("truncations", truncations)] {
            let array = group.create_dataset(name);
            compress(array.with_enum_u8_data(bools()?, &flags), &[steps as u64]);
        }
        let mut observations = group.create_group("observations");
        states(&mut observations, data, rows.clone());
        group.add_group(observations.finish());
        builder.add_group(group.finish());
    }
    Ok(builder)
}

/// The arrays of a row for each state.
fn states(group: &mut GroupBuilder, data: &Dataset, rows: Range<usize>) {
    let shape = data.shape();
    let width = shape.observation();
    let n = rows.len();
    match shape.element() {
        Element::F32 => {
            let left_out = if is_apart(shape) { 2 } else { 0 };
            let states: Vec<f32> = rows
                .clone()
                .flat_map(|row| &data.observation(row)[left_out..])
                .copied()
                .collect();
            array(group, "observation", &states, n, width - left_out);
        }
        Element::U8 => {
            let sides = shape.sides().iter().map(|side| *side as u64);
            let sides: Vec<u64> = std::iter::once(n as u64).chain(sides).collect();
            let bytes = &data.images[rows.start * width..rows.end * width];
            let array = group.create_dataset("observation");
            compress(array.with_u8_data(bytes), &sides);
        }
    }
    let places: Vec<f32> = rows.clone().flat_map(|row| data.place(row)).collect();
    array(group, "achieved_goal", &places, n, 2);
    let goals = match data.goals.get(rows) {
        Some(goals) => goals.as_flattened().to_vec(),
        None => vec![0.0; 2 * n],
    };
    array(group, "desired_goal", &goals, n, 2);
}

/// Whether `observation` lacks the place.
fn is_apart(shape: &Shape) -> bool {
    shape.element() == Element::F32 && shape.observation() == maze::OBSERVATION
}

fn array(group: &mut GroupBuilder, name: &str, values: &[f32], rows: usize, width: usize) {
    let array = group.create_dataset(name);
    compress(array.with_f32_data(values), &[rows as u64, width as u64]);
}

/// What Minari needs to open the folder. Spaces are JSON texts within the JSON, with infinities as
/// Python's `json` has them.
fn metadata(path: &Path, data: &Dataset) -> String {
    let unbounded = |width: usize| boxed("float32", &[width], ["-Infinity", "Infinity"]);
    let shape = data.shape();
    let observation = match shape.element() {
        Element::F32 if is_apart(shape) => unbounded(shape.observation() - 2),
        Element::F32 => unbounded(shape.observation()),
        Element::U8 => boxed("uint8", shape.sides(), ["0", "255"]),
    };
    let observation_space = format!(
        r#"{{"type": "Dict", "subspaces": {{"achieved_goal": {}, "desired_goal": {}, "observation": {observation}}}}}"#,
        unbounded(2),
        unbounded(2),
    );
    let metadata = json!({
        "dataset_id": id(path),
        "minari_version": VERSION,
        "data_format": "hdf5",
        // Without the key newer versions take bytes of images for JPEG files.
        "jpeg_encoding": false,
        "total_episodes": data.episodes.len(),
        "total_steps": data.len() - data.episodes.len(),
        "observation_space": observation_space,
        "action_space": boxed("float32", &[shape.action()], ["-1.0", "1.0"]),
    });
    metadata.to_string()
}

/// Minari's JSON of a Gymnasium `Box` whose values all have the same bounds.
fn boxed(kind: &str, sides: &[usize], bounds: [&str; 2]) -> String {
    let [low, high] = bounds.map(|bound| {
        let lists = sides.iter().rev();
        lists.fold(bound.to_owned(), |inner, side| {
            format!("[{}]", vec![inner; *side].join(", "))
        })
    });
    let sides: Vec<String> = sides.iter().map(usize::to_string).collect();
    let sides = sides.join(", ");
    format!(
        r#"{{"type": "Box", "dtype": "{kind}", "shape": [{sides}], "low": {low}, "high": {high}}}"#
    )
}

/// The folder's name as Minari takes it: letters, digits, `-`, `_` and a version.
fn id(path: &Path) -> String {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let word = |letter: char| {
        if letter.is_alphanumeric() || letter == '_' {
            letter
        } else {
            '-'
        }
    };
    let name: String = name.chars().map(word).collect();
    let version = name.rsplit_once("-v").map(|(_, version)| version);
    let numbered = version.is_some_and(|v| !v.is_empty() && v.bytes().all(|b| b.is_ascii_digit()));
    if numbered { name } else { format!("{name}-v0") }
}
