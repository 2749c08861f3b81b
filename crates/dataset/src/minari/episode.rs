//! Reads an episode of Minari's layout.

use super::{PLACE_APART, WITH_FORCES};
use crate::fault::Faults;
use crate::hdf5::{Folder, Key, Reader, Value, Width, zeros};
use crate::{Dataset, DatasetError, Element, OnFault, Shape};

/// Hint for a missing key.
pub(super) const LAYOUT: &str = "Minari's layout wants actions, rewards, terminations and \
                                 truncations in each episode, and observations with observation, \
                                 achieved_goal and desired_goal";
/// Keys of an episode's observations.
const OBSERVATION: &str = "observations/observation";
const PLACE: &str = "observations/achieved_goal";
const GOAL: &str = "observations/desired_goal";

/// First bytes of a JPEG file.
const JPEG: [f32; 3] = [255.0, 216.0, 255.0];

/// An episode of known length.
pub(super) struct Found {
    pub(super) number: usize,
    pub(super) folder: Folder,
    pub(super) actions: Key,
}

impl Found {
    /// Looks up a key with one row per state.
    fn states(&self, reader: &Reader<'_>, name: &str, width: Width) -> Result<Key, DatasetError> {
        let rows = Some(self.actions.rows + 1);
        reader.key(&self.folder, name, rows, width, LAYOUT)
    }
}

/// How an episode's observations are converted to rows.
pub(super) enum Layout {
    /// `achieved_goal`, then the first `taken` of the `width` values of `observation`.
    Apart { width: usize, taken: usize },
    /// `observation`, which starts with the position.
    Whole { width: usize },
    /// `observation` is an image with these dimensions, taken at `achieved_goal`.
    Image { sides: Vec<usize> },
}

impl Layout {
    /// Detects the layout from an episode's shapes and values.
    pub(super) fn of(reader: &Reader<'_>, found: &Found) -> Result<Self, DatasetError> {
        let rest = found.states(reader, OBSERVATION, Width::AtLeast(1))?;
        if let Some(sides) = rest.image() {
            return Ok(Self::Image { sides });
        }
        let places = found.states(reader, PLACE, Width::Exactly(2))?;
        let faults = Faults::new(OnFault::Refuse);
        let [values, places] = reader.values::<f32, 2>([&rest, &places], &faults)?;
        if rest.is_bytes() && values.starts_with(&JPEG) {
            return Err(reader.error(
                &format!("{}{OBSERVATION}", found.folder.prefix),
                "holds JPEG files, which are not read; make the data set with jpeg_encoding=False",
            ));
        }
        let width = rest.width;
        let mut rows = values.chunks_exact(width).zip(places.chunks_exact(2));
        Ok(if rows.all(|(row, place)| row.starts_with(place)) {
            Self::Whole { width }
        } else {
            let taken = if WITH_FORCES.contains(&width) {
                PLACE_APART
            } else {
                width
            };
            Self::Apart { width, taken }
        })
    }

    /// Shape of the rows, given the width of an action.
    pub(super) fn shape(&self, action: usize) -> Shape {
        match self {
            Self::Apart { taken, .. } => Shape::vectors(2 + taken, action),
            Self::Whole { width } => Shape::vectors(*width, action),
            Self::Image { sides } => Shape::images(sides, action),
        }
    }
}

/// Slices of the flat arrays to read episodes into.
pub(super) struct Flat<'a> {
    widths: [usize; 2],
    observations: &'a mut [f32],
    images: &'a mut [u8],
    places: &'a mut [[f32; 2]],
    actions: &'a mut [f32],
    rewards: &'a mut [f32],
    terminals: &'a mut [bool],
    goals: &'a mut [[f32; 2]],
}

/// Allocates rows in an empty data set.
pub(super) fn room(
    data: &mut Dataset,
    rows: usize,
) -> Result<Flat<'_>, std::collections::TryReserveError> {
    let [observation, action] = [data.shape().observation(), data.shape().action()];
    match data.shape().element() {
        Element::F32 => data.observations = zeros(rows * observation)?.into(),
        Element::U8 => {
            data.images = zeros(rows * observation)?.into();
            data.image_places = zeros(rows)?.into();
        }
    }
    data.actions = zeros(rows * action)?.into();
    data.rewards = zeros(rows)?.into();
    data.terminals = zeros(rows)?;
    data.goals = zeros(rows)?.into();
    Ok(Flat {
        widths: [observation, action],
        observations: &mut data.observations,
        images: &mut data.images,
        places: &mut data.image_places,
        actions: &mut data.actions,
        rewards: &mut data.rewards,
        terminals: &mut data.terminals,
        goals: &mut data.goals,
    })
}

impl<'a> Flat<'a> {
    /// Splits off the first rows.
    pub(super) fn take(&mut self, rows: usize) -> Self {
        // An empty array stays empty.
        fn cut<'a, T>(slice: &mut &'a mut [T], count: usize) -> &'a mut [T] {
            slice.split_off_mut(..count).unwrap_or_default()
        }
        let [observation, action] = self.widths;
        Flat::<'a> {
            widths: self.widths,
            observations: cut(&mut self.observations, rows * observation),
            images: cut(&mut self.images, rows * observation),
            places: cut(&mut self.places, rows),
            actions: cut(&mut self.actions, rows * action),
            rewards: cut(&mut self.rewards, rows),
            terminals: cut(&mut self.terminals, rows),
            goals: cut(&mut self.goals, rows),
        }
    }
}

/// Reads one episode.
pub(super) fn episode(
    reader: &Reader<'_>,
    layout: &Layout,
    found: &Found,
    into: &mut Flat<'_>,
) -> Result<(), DatasetError> {
    let Flat {
        widths: [_, action],
        observations,
        images,
        places: image_places,
        actions,
        rewards: gains,
        terminals,
        goals: aims,
    } = into;
    let steps = found.actions.rows;
    let acted = |name| {
        let width = Width::Exactly(1);
        reader.key(&found.folder, name, Some(steps), width, LAYOUT)
    };
    let rewards = acted("rewards")?;
    let terminations = acted("terminations")?;
    acted("truncations")?;
    let width = match layout {
        Layout::Apart { width, .. } | Layout::Whole { width } => *width,
        Layout::Image { sides } => sides.iter().product(),
    };
    let states = found.states(reader, OBSERVATION, Width::Exactly(width))?;
    let places = found.states(reader, PLACE, Width::Exactly(2))?;
    let goals = found.states(reader, GOAL, Width::Exactly(2))?;

    rows(reader, &found.actions, &mut actions[..steps * *action])?;
    rows(reader, &rewards, &mut gains[..steps])?;
    rows(reader, &goals, aims.as_flattened_mut())?;
    for (flag, value) in terminals.iter_mut().zip(all(reader, &terminations)?) {
        *flag = value > 0.0;
    }
    match layout {
        Layout::Apart { width, taken } => {
            let (places, states) = (all(reader, &places)?, all(reader, &states)?);
            let parts = places.chunks_exact(2).zip(states.chunks_exact(*width));
            for (into, (place, state)) in observations.chunks_exact_mut(2 + taken).zip(parts) {
                into[..2].copy_from_slice(place);
                into[2..].copy_from_slice(&state[..*taken]);
            }
            Ok(())
        }
        Layout::Whole { .. } => rows(reader, &states, observations),
        Layout::Image { .. } => {
            rows(reader, &places, image_places.as_flattened_mut())?;
            rows(reader, &states, images)
        }
    }
}

/// Reads the first rows of a key. Any fault makes the whole episode faulty.
fn rows<T: Value>(reader: &Reader<'_>, key: &Key, into: &mut [T]) -> Result<(), DatasetError> {
    reader.rows(key, 0, into, &Faults::new(OnFault::Refuse))
}

/// Reads all values of a key.
fn all(reader: &Reader<'_>, key: &Key) -> Result<Vec<f32>, DatasetError> {
    let values = zeros(key.rows * key.width);
    let mut values = values.map_err(|error| reader.refuse(error))?;
    rows(reader, key, &mut values)?;
    Ok(values)
}
