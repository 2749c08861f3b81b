//! Files that h5py wrote (fuzz/seeds.py): links, number types, layouts.

use std::fs;
use std::path::{Path, PathBuf};

use maze::{ACTION, OBSERVATION};

use crate::{Dataset, OnFault, Shape, d4rl, made, minari, open, open_with};

/// The path of a seed.
fn seed(name: &str) -> PathBuf {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fuzz/corpus/d4rl");
    root.join(name)
}

/// The four rows that seeds hold.
fn wanted() -> Dataset {
    let sixteenths = |at: usize| (at % 32) as f32 / 16.0;
    let halves = |at: usize| (at % 16) as f32 / 16.0 - 0.5;
    Dataset {
        observations: (0..4 * OBSERVATION).map(sixteenths).collect(),
        actions: (0..4 * ACTION).map(halves).collect(),
        rewards: vec![0.0, 1.0, 0.0, 1.0].into(),
        terminals: vec![false, true, false, true],
        episodes: vec![0..3, 3..4],
        ..Dataset::new(Shape::ant())
    }
}

#[test]
fn what_h5py_reads_is_read() {
    for name in [
        "h5py-links",
        "h5py-links-dense",
        "h5py-links-compact",
        "h5py-layout-5",
        "h5py-lzf",
        "h5py-wide-fixed",
        "h5py-wide-implicit",
    ] {
        assert_eq!(d4rl::read(&seed(name)).unwrap(), wanted(), "{name}");
    }
}

#[test]
fn numbers_of_all_types_and_orders_are_read() {
    let data = d4rl::read(&seed("h5py-types")).unwrap();
    assert_eq!(data, wanted());
    let data = d4rl::read(&seed("h5py-types-big")).unwrap();
    assert_eq!(data, wanted());
}

#[test]
fn what_is_there_and_cannot_be_read_is_named_and_never_taken_for_missing() {
    for (name, told) in [
        (
            "h5py-dangling",
            "'timeouts': is a link to '/gone', which leads to nothing",
        ),
        (
            "h5py-bfloat16",
            "'observations': holds floats of an unusual layout",
        ),
        ("h5py-virtual", "'observations': is a virtual data set"),
        (
            "h5py-not-arrays",
            "'terminals': holds lists or text, not numbers",
        ),
    ] {
        let error = d4rl::read(&seed(name)).unwrap_err().to_string();
        assert!(error.contains(told), "{name}: {error}");
    }
}

#[test]
fn a_missing_key_is_told_with_those_that_are_there_and_the_layouts() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("x.hdf5");
    let mut builder = hdf5_pure::FileBuilder::new();
    builder.create_dataset("states").with_f32_data(&[0.0; 4]);
    builder.create_dataset("acts").with_f32_data(&[0.0; 4]);
    builder.write(&path).unwrap();
    let error = open(&path).unwrap_err().to_string();
    let told = "x.hdf5: 'observations': is missing among acts, states; D4RL's layout wants \
                observations, actions, rewards and terminals, Minari's the groups";
    assert!(error.contains(told), "{error}");
}

#[test]
fn links_to_other_files_are_followed_from_the_folder_and_named_where_they_fail() {
    let folder = tempfile::tempdir().unwrap();
    let bytes = fs::read(seed("h5py-external")).unwrap();
    let path = folder.path().join("x.hdf5");
    fs::write(&path, &bytes).unwrap();
    let error = open(&path).unwrap_err().to_string();
    assert!(
        error.contains("'observations': is a link into the file good.hdf5: "),
        "{error}"
    );
    fs::copy(seed("h5py-plain-rows"), folder.path().join("good.hdf5")).unwrap();
    assert_eq!(open(&path).unwrap().1, wanted());
    // Bytes alone have no folder.
    let error = d4rl::read_bytes(&path, bytes).unwrap_err().to_string();
    let told = "'observations': is a link to '/observations' in the file good.hdf5, which is not";
    assert!(error.contains(told), "{error}");
}

#[test]
fn a_pipe_behind_a_link_is_refused_and_not_waited_for() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("x.hdf5");
    fs::copy(seed("h5py-external"), &path).unwrap();
    std::os::unix::fs::symlink("/dev/null", folder.path().join("good.hdf5")).unwrap();
    let error = open(&path).unwrap_err().to_string();
    assert!(error.contains("good.hdf5: it is not a file"), "{error}");
}

#[test]
fn faulty_episodes_are_left_out_of_all_formats() {
    let folder = tempfile::tempdir().unwrap();
    let mut data = made::varied(&[3, 4, 2, 5]);
    let rest = data.kept(&[true, false, true, true]);
    data.observations[4 * OBSERVATION + 20] = f32::NAN;
    let drop = |path: &Path| open_with(path, OnFault::DropEpisode).unwrap();
    for (format, name) in [
        (crate::Format::D4rl, "d.hdf5"),
        (crate::Format::Ogbench, "o.npz"),
        (crate::Format::Minari, "m"),
    ] {
        let path = folder.path().join(name);
        format.write(&path, &data).unwrap();
        let error = open(&path).unwrap_err().to_string();
        let remedy = "leaves such episodes out";
        assert!(
            error.contains("not finite") && error.ends_with(remedy),
            "{error}"
        );
        let opened = drop(&path);
        assert_eq!(opened.data.observations, rest.observations, "{name}");
        assert_eq!(opened.data.episodes, rest.episodes, "{name}");
        let told = opened.dropped.to_string();
        assert!(
            told.starts_with("1 of 4 episodes left out; the first: "),
            "{told}"
        );
    }
}

/// Minari#199: an official data set has episodes with as many observations as actions.
#[test]
fn episodes_of_minari_that_are_too_short_or_gone_are_left_out() {
    let data = minari::read_bytes(
        Path::new("m"),
        fs::read(seed("../minari/h5py-short")).unwrap(),
    );
    let error = data.unwrap_err().to_string();
    assert!(error.contains("'episode_2': is missing"), "{error}");
    let opened = open_with(&seed("../minari/h5py-short"), OnFault::DropEpisode).unwrap();
    made::sound(&opened.data);
    assert_eq!(opened.data.episodes, [0..3, 3..6]);
    assert_eq!((opened.dropped.episodes, opened.dropped.of), (2, 4));
    let told = "'episode_1/observations/observation' has shape [3, 27], expected [4, 27]";
    let first = opened.dropped.first.unwrap().to_string();
    assert!(first.contains(told), "{first}");
}
