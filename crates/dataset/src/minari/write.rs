//! Writes folders that Minari's package opens.

use std::fs;
use std::io::Write;
use std::path::Path;

use hdf5_pure::{AttrValue, Error, FileBuilder, GroupBuilder};
use serde_json::json;

use super::{MAIN, METADATA, PROPRIOCEPTION};
use crate::d4rl::{bools, compress, failed};
use crate::replace::{self, io_error};
use crate::{ACTION, Dataset, DatasetError, OBSERVATION};

/// The oldest version of Minari whose layout this is; what newer ones ask of the metadata.
const VERSION: &str = "0.5.0";

/// Writes the folder `path`, with `data/main_data.hdf5` and `data/metadata.json`, beside it, syncs
/// and renames. Minari finds it as the data set of the folder's name when `MINARI_DATASETS_PATH`
/// names the folder around it.
///
/// An episode of n rows has n - 1 actions here: its last row's action, reward and terminal are
/// dropped, as no state follows them. Terminals become `terminations`; the end is a truncation
/// otherwise. Where there are no goals, `desired_goal` is zero.
///
/// # Errors
/// A path that is there already, and what the system or the format refuses.
pub fn write(path: &Path, data: &Dataset) -> Result<(), DatasetError> {
    if path.exists() {
        return Err(DatasetError::Format {
            path: path.to_path_buf(),
            reason: "is there already; a folder is not overwritten, name another".to_owned(),
        });
    }
    let main = layout(data).map_err(|error| failed(path, error))?;
    let part = replace::part(path);
    let io = |source| io_error(path, source);
    if part.exists() {
        // Of a run that was killed.
        fs::remove_dir_all(&part).map_err(io)?;
    }
    let inside = part.join("data");
    let written = fs::create_dir_all(&inside).map_err(io).and_then(|()| {
        replace::create(&inside.join(MAIN), path, |file| {
            main.finish_to(file).map_err(|error| failed(path, error))
        })?;
        replace::create(&inside.join(METADATA), path, |file| {
            let text = metadata(path, data);
            file.write_all(text.as_bytes()).map_err(io)
        })?;
        replace::sync(&inside)
            .and_then(|()| replace::sync(&part))
            .and_then(|()| fs::rename(&part, path))
            .and_then(|()| replace::sync(replace::folder(path)))
            .map_err(io)
    });
    if written.is_err() {
        // The part is of no use to anyone; that it cannot be removed changes nothing.
        let _ = fs::remove_dir_all(part);
    }
    written
}

fn layout(data: &Dataset) -> Result<FileBuilder, Error> {
    let mut builder = FileBuilder::new();
    for (number, rows) in data.episodes.iter().enumerate() {
        let steps = rows.len() - 1;
        let acted = rows.start..rows.end - 1;
        let mut group = builder.create_group(&format!("episode_{number}"));
        group.set_attr("id", AttrValue::I64(number as i64));
        group.set_attr("total_steps", AttrValue::I64(steps as i64));
        let actions = &data.actions[acted.start * ACTION..acted.end * ACTION];
        array(&mut group, "actions", actions, steps, ACTION);
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
        let states = &data.observations[rows.start * OBSERVATION..rows.end * OBSERVATION];
        let part = |from: usize, to: usize| -> Vec<f32> {
            let states = states.chunks_exact(OBSERVATION);
            states.flat_map(|state| &state[from..to]).copied().collect()
        };
        let goals = match data.goals.get(rows.clone()) {
            Some(goals) => goals.as_flattened().to_vec(),
            None => vec![0.0; 2 * rows.len()],
        };
        for (name, values, width) in [
            ("observation", part(2, OBSERVATION), PROPRIOCEPTION),
            ("achieved_goal", part(0, 2), 2),
            ("desired_goal", goals, 2),
        ] {
            array(&mut observations, name, &values, rows.len(), width);
        }
        group.add_group(observations.finish());
        builder.add_group(group.finish());
    }
    Ok(builder)
}

fn array(group: &mut GroupBuilder, name: &str, values: &[f32], rows: usize, width: usize) {
    let array = group.create_dataset(name);
    compress(array.with_f32_data(values), &[rows as u64, width as u64]);
}

/// What Minari needs to open the folder. Spaces are JSON texts within the JSON, with infinities as
/// Python's `json` has them.
fn metadata(path: &Path, data: &Dataset) -> String {
    let unbounded = |width: usize| {
        let side = |value: &str| vec![value; width].join(", ");
        let (low, high) = (side("-Infinity"), side("Infinity"));
        boxed(width, &low, &high)
    };
    let observation_space = format!(
        r#"{{"type": "Dict", "subspaces": {{"achieved_goal": {}, "desired_goal": {}, "observation": {}}}}}"#,
        unbounded(2),
        unbounded(2),
        unbounded(PROPRIOCEPTION)
    );
    let side = |value: &str| [value; ACTION].join(", ");
    let metadata = json!({
        "dataset_id": id(path),
        "minari_version": VERSION,
        "data_format": "hdf5",
        "total_episodes": data.episodes.len(),
        "total_steps": data.len() - data.episodes.len(),
        "observation_space": observation_space,
        "action_space": boxed(ACTION, &side("-1.0"), &side("1.0")),
    });
    metadata.to_string()
}

/// Minari's JSON of a Gymnasium `Box` of so many f32 values.
fn boxed(width: usize, low: &str, high: &str) -> String {
    format!(
        r#"{{"type": "Box", "dtype": "float32", "shape": [{width}], "low": [{low}], "high": [{high}]}}"#
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
