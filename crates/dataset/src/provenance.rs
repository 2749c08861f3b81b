//! How a data set was collected, as attributes of its HDF5 file's root.

use std::path::Path;

use hdf5_pure::{AttrValue, File, FileBuilder};

use crate::DatasetError;

/// What `collect` made a data set with. In the file each field is an attribute of its name, a text.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Made {
    /// The simulator's name.
    pub simulator: String,
    /// The maze's name.
    pub maze: String,
    /// Its rows, joined by spaces; empty for a maze that has a name.
    pub maze_rows: String,
    /// How goals were drawn.
    pub style: String,
    /// Transitions asked for.
    pub transitions: String,
    /// Control steps of an episode.
    pub episode_steps: String,
    /// Standard deviation of the noise on actions.
    pub noise: String,
    /// The run's seed.
    pub seed: String,
    /// A hash of the walker's weights, or `straight` for a body that needs none.
    pub walker: String,
    /// Version of the program.
    pub formica_version: String,
}

impl Made {
    /// Every attribute's name and value.
    #[must_use]
    pub fn attributes(&self) -> [(&'static str, &str); 10] {
        [
            ("simulator", &self.simulator),
            ("maze", &self.maze),
            ("maze_rows", &self.maze_rows),
            ("style", &self.style),
            ("transitions", &self.transitions),
            ("episode_steps", &self.episode_steps),
            ("noise", &self.noise),
            ("seed", &self.seed),
            ("walker", &self.walker),
            ("formica_version", &self.formica_version),
        ]
    }

    /// Reads the attributes; none of a path that is no HDF5 file, or not one of `collect`.
    ///
    /// # Errors
    /// A file whose attributes are damaged.
    pub fn read(path: &Path) -> Result<Option<Self>, DatasetError> {
        if !path.is_file() {
            return Ok(None);
        }
        let Ok(file) = File::open_streaming(path) else {
            return Ok(None);
        };
        let attributes = file.root().attrs().map_err(|error| DatasetError::Format {
            path: path.to_path_buf(),
            reason: format!("its attributes cannot be read: {error}"),
        })?;
        let text = |name: &str| match attributes.get(name) {
            Some(
                AttrValue::VarLenString(text)
                | AttrValue::String(text)
                | AttrValue::AsciiString(text),
            ) => text.clone(),
            _ => String::new(),
        };
        // Version 0.1 had no other simulator.
        let simulator = Some(text("simulator")).filter(|name| !name.is_empty());
        let made = Self {
            simulator: simulator.unwrap_or_else(|| "ant".to_owned()),
            maze: text("maze"),
            maze_rows: text("maze_rows"),
            style: text("style"),
            transitions: text("transitions"),
            episode_steps: text("episode_steps"),
            noise: text("noise"),
            seed: text("seed"),
            walker: text("walker"),
            formica_version: text("formica_version"),
        };
        Ok((!made.formica_version.is_empty() && !made.maze.is_empty()).then_some(made))
    }

    pub(crate) fn write(&self, builder: &mut FileBuilder) {
        for (name, value) in self.attributes() {
            // Which h5py hands back as a str.
            builder.set_attr(name, AttrValue::VarLenString(value.to_owned()));
        }
    }
}

#[cfg(test)]
mod tests {
    use durable::{Existing, Output};

    use super::*;
    use crate::{d4rl, made, minari};

    #[test]
    fn attributes_come_back_and_other_files_have_none() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("made.hdf5");
        let wanted = Made {
            simulator: "point".to_owned(),
            maze: "custom".to_owned(),
            maze_rows: "111 1rg 111".to_owned(),
            noise: "0.2".to_owned(),
            formica_version: "0.1.0".to_owned(),
            ..Made::default()
        };
        let data = made::varied(&[3, 4]);
        let rows = d4rl::Rows {
            observations: &data.observations,
            actions: &data.actions,
            rewards: &data.rewards,
            terminals: &[0; 7],
            timeouts: &[0, 0, 1, 0, 0, 0, 1],
            goals: &[],
            qpos: &[0.0; 7 * 15],
            qvel: &[0.0; 7 * 14],
        };
        let output = Output::file(&path, Existing::Refuse, &[]).unwrap();
        let staged = d4rl::stage_rows(&output, &rows, Some(&wanted)).unwrap();
        staged.place().unwrap();
        assert_eq!(Made::read(&path).unwrap(), Some(wanted));
        assert_eq!(d4rl::read(&path).unwrap().observations, data.observations);
        let plain = folder.path().join("plain.hdf5");
        d4rl::write(&plain, &data).unwrap();
        assert_eq!(Made::read(&plain).unwrap(), None);
        minari::write(&folder.path().join("m"), &data).unwrap();
        for other in ["m", "none", "text"] {
            let other = folder.path().join(other);
            if other.ends_with("text") {
                std::fs::write(&other, "some text").unwrap();
            }
            assert_eq!(Made::read(&other).unwrap(), None);
        }
    }
}
