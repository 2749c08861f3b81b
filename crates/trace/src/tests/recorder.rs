//! The recorder's thread.

use std::fs;
use std::path::PathBuf;

use maze::AntBody;
use simulator::Body;

use super::made::*;
use crate::{Behind, Episode, EpisodeWriter, Recorder, read_whole};

fn episode(path: PathBuf) -> Episode {
    Episode {
        part: part_of(&path),
        path,
        meta: meta(),
        still: still(),
        state: start(),
    }
}

#[test]
fn a_recorder_writes_what_a_writer_does() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let mut recorder = Recorder::new(&AntBody.spaces(), |text| panic!("{text}")).unwrap();
    for name in ["a.mcap", "given-up.mcap", "b.mcap", "broken.mcap"] {
        recorder.begin(episode(path(name)), Behind::Wait);
        assert!(recorder.is_open());
        for step in 0..20 {
            if step == 0 {
                recorder.choice(choice(step));
            }
            recorder.step(record(step));
        }
        match name {
            "given-up.mcap" => recorder.discard(),
            "broken.mcap" => {}
            _ => recorder.end(end(20)),
        }
    }
    drop(recorder);
    let names = fs::read_dir(folder.path()).unwrap();
    let mut names: Vec<_> = names.map(|entry| entry.unwrap().file_name()).collect();
    names.sort();
    assert_eq!(names, ["a.mcap", "b.mcap"]);
    for name in ["a.mcap", "b.mcap"] {
        let trace = read_whole(&path(name)).unwrap();
        assert_eq!((trace.steps.len(), trace.choices.len()), (20, 1));
    }
}

/// A disk that takes nothing for as long as it is looked at.
#[test]
fn a_recorder_never_waits_for_a_disk() {
    let folder = tempfile::tempdir().unwrap();
    let pipe = folder.path().join("slow.mcap.part");
    let made = std::process::Command::new("mkfifo").arg(&pipe).status();
    assert!(made.unwrap().success());
    let mut recorder = Recorder::new(&AntBody.spaces(), |_| {}).unwrap();
    // Nobody reads: to open it blocks the thread.
    recorder.begin(episode(folder.path().join("slow.mcap")), Behind::Skip);
    let mut told = 0;
    while recorder.is_open() {
        recorder.step(record(told % 1000));
        told += 1;
        assert!(told < 10_000, "the queue has no end");
    }
    // The next one waits for a moment only.
    for behind in [Behind::Wait, Behind::Skip] {
        recorder.begin(episode(folder.path().join("next.mcap")), behind);
        assert!(!recorder.is_open());
    }
    // The other end opens and closes; the thread goes on, and the trace is given up.
    let reader = std::thread::spawn(move || fs::read(&pipe));
    let _ = reader.join().unwrap();
    let last = folder.path().join("last.mcap");
    recorder.begin(episode(last.clone()), Behind::Wait);
    recorder.step(record(0));
    recorder.end(end(1));
    drop(recorder);
    assert!(!folder.path().join("slow.mcap").exists());
    assert_eq!(read_whole(&last).unwrap().steps.len(), 1);
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_ends_the_trace_without_a_panic() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("episode.mcap");
    std::os::unix::fs::symlink("/dev/full", part_of(&path)).unwrap();
    let begun = EpisodeWriter::begin(&path, part_of(&path), &meta(), still(), start());
    assert!(begun.is_err());
    assert!(!path.exists());
}
