//! Prepared data round trip; corrupt files are refused.

use std::sync::LazyLock;

use proptest::prelude::*;

use super::*;
use crate::{Needs, d4rl, load_for, made};

fn loaded(data: Dataset) -> Loaded {
    Loaded {
        data,
        notes: vec!["a note".to_owned()],
        stamp: Stamp::default(),
    }
}

#[test]
fn rows_of_any_shape_round_trip() {
    let folder = tempfile::tempdir().unwrap();
    for shape in [
        Shape::ant(),
        Shape::vectors(4, 2),
        Shape::images(&[64, 64, 3], 8),
    ] {
        let mut made = loaded(made::of(&shape, &[3, 1, 7]));
        save(folder.path(), &made).unwrap();
        let found = open(folder.path()).unwrap();
        assert_eq!(found, made);
        let data = found.data;
        made::sound(&data);
        let mapped = match shape.element() {
            Element::F32 => data.observations.is_mapped(),
            Element::U8 => data.images.is_mapped() && data.image_places.is_mapped(),
        };
        assert!(mapped && data.actions.is_mapped() && data.goals.is_mapped());
        made.data.goals = crate::Array::default();
        save(folder.path(), &made).unwrap();
        assert_eq!(open(folder.path()).unwrap(), made);
        // A mapping outlives its file.
        assert_eq!(data.goals.len(), 11);
    }
    remove(folder.path());
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
    remove(folder.path());
}

/// A valid file of a hundred rows.
static WHOLE: LazyLock<Vec<u8>> = LazyLock::new(|| {
    let folder = tempfile::tempdir().unwrap();
    let made = made::of(&Shape::vectors(4, 2), &[9, 60, 31]);
    save(folder.path(), &loaded(made)).unwrap();
    fs::read(file(folder.path())).unwrap()
});

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]
    /// Truncated or modified files give an error, or all of the rows.
    #[test]
    fn no_change_of_the_file_makes_it_panic(
        cut in prop::option::weighted(0.2, 0_usize..6000),
        changes in prop::collection::vec((0_usize..6000, any::<u8>()), 0..4),
    ) {
        let folder = tempfile::tempdir().unwrap();
        let mut bytes = WHOLE.clone();
        for (at, mask) in changes {
            let at = at % bytes.len();
            bytes[at] ^= mask;
        }
        bytes.truncate(cut.unwrap_or(usize::MAX));
        fs::write(file(folder.path()), bytes).unwrap();
        if let Ok(Loaded { data, .. }) = open(folder.path()) {
            made::sound(&data);
            prop_assert_eq!(data.len(), 100);
            // Read every element: no page is missing.
            let values = data.observations.iter().chain(&data.actions).chain(&data.rewards);
            prop_assert!(values.map(|value| value.to_bits() & 1).sum::<u32>() <= 700);
        }
    }
}

#[test]
fn inconsistent_arrays_and_episodes_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let refused = |change: &dyn Fn(&mut Dataset)| {
        let mut made = loaded(made::varied(&[3, 4]));
        change(&mut made.data);
        save(folder.path(), &made).unwrap();
        open(folder.path()).unwrap_err().to_string()
    };
    for change in [
        &(|data: &mut Dataset| data.observations.push(0.0)) as &dyn Fn(&mut Dataset),
        &|data| data.actions.push(0.0),
        &|data| data.terminals.push(true),
        &|data| data.goals.push([0.0; 2]),
        &|data| data.images.push(0),
    ] {
        let told = refused(change);
        assert!(told.contains("arrays differ in length"), "{told}");
    }
    for episodes in [vec![0..3], vec![0..3, 3..8], vec![0..4, 4..4, 4..7]] {
        let told = refused(&|data| data.episodes.clone_from(&episodes));
        assert!(
            told.contains("its episodes do not cover its rows"),
            "{told}"
        );
    }
}

/// A config and a valid data set of the umaze.
fn source(folder: &Path) -> Config {
    let way: Vec<[f32; 2]> = (0..40).map(|i| [0.2 * i as f32, 0.0]).collect();
    let back: Vec<[f32; 2]> = way.iter().rev().copied().collect();
    let mut data = made::along(&[&way, &back]);
    for (row, o) in data.observations.chunks_exact_mut(29).enumerate() {
        o[2] = 0.5;
        (o[8], o[10], o[12], o[14]) = (0.9, -0.9, -0.9, 0.9);
        o[15] = if row < 40 { 2.0 } else { -2.0 };
    }
    let actions = data.actions.iter_mut().enumerate();
    actions.for_each(|(at, value)| *value = (at % 11) as f32 / 10.0 - 0.5);
    let path = folder.join("d.hdf5");
    d4rl::write(&path, &data).unwrap();
    config(&path, &[])
}

fn config(path: &Path, sets: &[(&str, &str)]) -> Config {
    let text = format!(
        "[maze]\nlayout = \"umaze\"\n[dataset]\npath = \"{}\"\n[collect]\n",
        path.display()
    );
    let sets: Vec<(String, String)> = sets
        .iter()
        .map(|(key, value)| ((*key).to_owned(), (*value).to_owned()))
        .collect();
    let reader = config::Reader::new(&Bare);
    reader.parse(&text, "x.toml", "x", &sets).unwrap()
}

/// An algorithm without tables.
struct Bare;

impl config::Registry for Bare {
    fn algorithms(&self) -> Vec<&'static str> {
        vec!["bare"]
    }

    fn simulators(&self) -> Vec<&'static str> {
        vec!["ant", "point"]
    }

    fn is_offline(&self, _: &str) -> bool {
        true
    }

    fn read(&self, _: &str, _: &mut config::Document<'_>) -> config::Settings {
        config::Settings::new(())
    }
}

fn needs(lag: usize) -> Needs {
    Needs {
        lags: vec![("graph.lag", lag)],
        nodes: 20,
    }
}

#[test]
fn data_are_fresh_until_their_source_or_settings_change() {
    let folder = tempfile::tempdir().unwrap();
    let run = tempfile::tempdir().unwrap();
    let first = source(folder.path());
    let is_fresh = |config: &Config| is_fresh(run.path(), config, &needs(15));
    assert!(!is_fresh(&first));
    let made = load_for(&first, &needs(15)).unwrap();
    save(run.path(), &made).unwrap();
    assert!(is_fresh(&first));
    assert_eq!(open(run.path()).unwrap(), made);
    let path = folder.path().join("d.hdf5");
    for set in [
        ("dataset.leave_out", "[[1, 3]]"),
        ("dataset.fit", "warn"),
        ("maze.layout", "medium"),
    ] {
        assert!(!is_fresh(&config(&path, &[set])), "{set:?}");
    }
    assert!(is_fresh(&config(&path, &[("run.seed", "5")])));
    assert!(!super::is_fresh(run.path(), &first, &needs(20)));
    // Same content, later modification time.
    let bytes = fs::read(&path).unwrap();
    let later = std::time::SystemTime::now() + std::time::Duration::from_secs(5);
    fs::write(&path, bytes).unwrap();
    fs::File::options()
        .write(true)
        .open(&path)
        .unwrap()
        .set_modified(later)
        .unwrap();
    assert!(!is_fresh(&first));
    save(run.path(), &load_for(&first, &needs(15)).unwrap()).unwrap();
    assert!(is_fresh(&first));
    let prepared = file(run.path());
    let whole = fs::read(&prepared).unwrap();
    fs::write(&prepared, &whole[..whole.len() - 1]).unwrap();
    assert!(!is_fresh(&first));
    fs::remove_file(&path).unwrap();
    fs::write(&prepared, &whole).unwrap();
    assert!(!is_fresh(&first));
}
