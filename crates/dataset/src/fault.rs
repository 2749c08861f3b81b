//! Episodes that break their format's rules: refused, or left out whole.

use std::fmt;
use std::ops::Range;
use std::path::Path;
use std::sync::{Mutex, PoisonError};

use config::OnFault;

use crate::{Dataset, DatasetError};

/// Episodes that were left out. `Display` gives a sentence.
#[derive(Debug, Default)]
pub struct Dropped {
    /// How many.
    pub episodes: usize,
    /// Of how many in all.
    pub of: usize,
    /// What is wrong with the first of them; none where none was left out.
    pub first: Option<DatasetError>,
}

impl fmt::Display for Dropped {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { episodes, of, .. } = self;
        match &self.first {
            None => write!(f, "no episode is left out"),
            Some(first) => write!(
                f,
                "{episodes} of {of} episodes left out; the first: {first}"
            ),
        }
    }
}

/// Faults found so far, by row of the flat arrays or by number of the episode.
pub(crate) struct Faults {
    on_fault: OnFault,
    found: Mutex<Found>,
}

#[derive(Default)]
struct Found {
    places: Vec<Range<usize>>,
    /// The one of the least place, and among those the least key, whatever the order of threads.
    first: Option<(usize, DatasetError)>,
}

impl Faults {
    pub(crate) fn new(on_fault: OnFault) -> Self {
        Self {
            on_fault,
            found: Mutex::default(),
        }
    }

    /// Notes a fault, or returns it where faults are refused.
    pub(crate) fn note(
        &self,
        places: Range<usize>,
        error: DatasetError,
    ) -> Result<(), DatasetError> {
        if self.on_fault == OnFault::Refuse {
            return Err(error);
        }
        let mut found = self.found.lock().unwrap_or_else(PoisonError::into_inner);
        let earlier = |(place, first): &(usize, DatasetError)| {
            (*place, first.to_string()) <= (places.start, error.to_string())
        };
        if !found.first.as_ref().is_some_and(earlier) {
            found.first = Some((places.start, error));
        }
        found.places.push(places);
        Ok(())
    }

    /// The data set without the episodes in whose rows a fault lies.
    ///
    /// # Errors
    /// More than half of the episodes would go.
    pub(crate) fn drop_rows(
        self,
        path: &Path,
        data: Dataset,
    ) -> Result<(Dataset, Dropped), DatasetError> {
        let bad = self.marks(data.len());
        let sound = |episode: &Range<usize>| !bad[episode.clone()].contains(&true);
        let keep: Vec<bool> = data.episodes.iter().map(sound).collect();
        let of = keep.len();
        self.finish(path, data, &keep, of)
    }

    /// The data set without the episodes that faults were noted of by number; `numbers` are those
    /// of the data set's episodes, out of `of` in all.
    ///
    /// # Errors
    /// More than half of the episodes would go.
    pub(crate) fn drop_numbers(
        self,
        path: &Path,
        data: Dataset,
        numbers: &[usize],
        of: usize,
    ) -> Result<(Dataset, Dropped), DatasetError> {
        let bad = self.marks(of);
        let keep: Vec<bool> = numbers.iter().map(|number| !bad[*number]).collect();
        self.finish(path, data, &keep, of)
    }

    /// The error where `episodes` of `of` have faults, which is more than half.
    pub(crate) fn too_many(
        &self,
        path: &Path,
        episodes: usize,
        of: usize,
        first: DatasetError,
    ) -> DatasetError {
        if self.on_fault == OnFault::Refuse {
            return first;
        }
        DatasetError::Faulty {
            path: path.to_path_buf(),
            episodes,
            of,
            first: first.reason(),
        }
    }

    /// Which of `count` places have a fault.
    fn marks(&self, count: usize) -> Vec<bool> {
        let mut bad = vec![false; count];
        let found = self.found.lock().unwrap_or_else(PoisonError::into_inner);
        for places in &found.places {
            bad[places.start.min(count)..places.end.min(count)].fill(true);
        }
        bad
    }

    fn finish(
        self,
        path: &Path,
        data: Dataset,
        keep: &[bool],
        of: usize,
    ) -> Result<(Dataset, Dropped), DatasetError> {
        let found = self.found.into_inner();
        let Some((_, first)) = found.unwrap_or_else(PoisonError::into_inner).first else {
            let none = Dropped {
                of,
                ..Dropped::default()
            };
            return Ok((data, none));
        };
        let left = keep.iter().filter(|keep| **keep).count();
        let episodes = of - left;
        if left == 0 || 2 * episodes > of {
            return Err(DatasetError::Faulty {
                path: path.to_path_buf(),
                episodes,
                of,
                first: first.reason(),
            });
        }
        let dropped = Dropped {
            episodes,
            of,
            first: Some(first),
        };
        Ok((data.kept(keep), dropped))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::made;

    fn fault(row: usize) -> DatasetError {
        DatasetError::NotFinite {
            path: "x.hdf5".into(),
            key: "actions".to_owned(),
            row,
        }
    }

    #[test]
    fn episodes_with_a_fault_are_left_out_whole_and_the_first_one_is_told() {
        let data = made::varied(&[2, 3, 1, 2]);
        let faults = Faults::new(OnFault::DropEpisode);
        faults.note(5..6, fault(5)).unwrap();
        faults.note(4..5, fault(4)).unwrap();
        let (kept, dropped) = faults.drop_rows(Path::new("x.hdf5"), data.clone()).unwrap();
        made::sound(&kept);
        assert_eq!(kept.episodes, [0..2, 2..4]);
        assert_eq!(kept.observation(2), data.observation(6));
        assert_eq!(kept.goals[2..], data.goals[6..]);
        let told = dropped.to_string();
        assert!(
            told.starts_with("2 of 4 episodes left out; the first: x.hdf5: 'actions'"),
            "{told}"
        );
        assert!(told.ends_with("row 4"), "{told}");

        let faults = Faults::new(OnFault::DropEpisode);
        faults.note(0..6, fault(0)).unwrap();
        let error = faults
            .drop_rows(Path::new("x.hdf5"), data.clone())
            .unwrap_err();
        assert!(
            error.to_string().contains("3 of 4 episodes are faulty"),
            "{error}"
        );

        let none = Faults::new(OnFault::DropEpisode).drop_rows(Path::new("x"), data.clone());
        assert_eq!(none.unwrap().0, data);
        assert!(Faults::new(OnFault::Refuse).note(1..2, fault(1)).is_err());
    }

    #[test]
    fn episodes_that_are_missing_count_as_left_out() {
        let faults = Faults::new(OnFault::DropEpisode);
        faults.note(1..2, fault(0)).unwrap();
        let data = made::varied(&[2, 3]);
        let (kept, dropped) = faults
            .drop_numbers(Path::new("x"), data.clone(), &[0, 2], 3)
            .unwrap();
        assert_eq!((kept, dropped.episodes, dropped.of), (data, 1, 3));
    }
}
