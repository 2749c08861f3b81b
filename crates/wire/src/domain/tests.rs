//! Of whole domains: who sees what, and who clears what.

use std::fs;
use std::path::Path;

use super::leftovers::{clear_in, leftovers_in};
use super::places::tests::places;
use super::*;

fn find(places: &Places, id: &str) -> Option<Leftover> {
    leftovers_in(places)
        .into_iter()
        .find(|found| found.id == id)
}

/// As after kill -9: the locks are free, the files are there.
fn kill(mut domain: RunDomain) {
    let nothing = Hold::Seen(File::open("/dev/null").unwrap());
    drop(std::mem::replace(&mut domain.hold, nothing));
}

fn shared_file(places: &Places, id: &str) {
    fs::write(places.shared.join(places.prefix(id) + "data"), "1234").unwrap();
}

#[test]
fn a_live_domain_is_seen_and_never_cleared_a_dead_one_is() {
    let folder = tempfile::tempdir().unwrap();
    let places = places(folder.path());
    let domain = RunDomain::create_in(places.clone()).unwrap();
    let id = domain.id().to_owned();
    shared_file(&places, &id);
    assert_eq!(find(&places, &id).unwrap().liveness, Liveness::Alive);
    for unseen in [false, true] {
        assert_eq!(clear_in(&places, &id, unseen), Err(Kept::Held));
    }
    let joined = RunDomain::open_in(places.clone(), &id).unwrap();
    assert!(!joined.is_over());
    kill(domain);
    assert!(joined.is_over());
    let dead = find(&places, &id).unwrap();
    assert_eq!(
        (dead.liveness, dead.files, dead.bytes),
        (Liveness::Dead, 2, 4)
    );
    assert!(matches!(
        RunDomain::open_in(places.clone(), &id),
        Err(WireError::NoSuchRun(_))
    ));
    clear_in(&places, &id, false).unwrap();
    assert!(find(&places, &id).is_none());
    assert_eq!(clear_in(&places, &id, true), Err(Kept::Nothing));
}

#[test]
fn a_domain_that_is_dropped_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let places = places(folder.path());
    let domain = RunDomain::create_in(places.clone()).unwrap();
    let id = domain.id().to_owned();
    shared_file(&places, &id);
    fs::create_dir_all(domain.root().join("nodes/deep")).unwrap();
    drop(domain);
    assert_eq!(fs::read_dir(&places.shared).unwrap().count(), 0);
    assert_eq!(fs::read_dir(&places.folder).unwrap().count(), 0);
}

/// The same shared memory, another /tmp: a container with `--ipc=host`, or systemd's PrivateTmp.
fn elsewhere(places: &Places, folder: &Path) -> Places {
    Places {
        folder: folder.join("elsewhere"),
        ..places.clone()
    }
}

#[test]
fn a_live_domain_is_not_cleared_from_a_place_that_sees_one_half_of_it() {
    let folder = tempfile::tempdir().unwrap();
    let places = places(folder.path());
    let other_tmp = elsewhere(&places, folder.path());
    let other_memory = Places {
        shared: folder.path().join("other"),
        ..places.clone()
    };
    fs::create_dir(&other_memory.shared).unwrap();
    let domain = RunDomain::create_in(places.clone()).unwrap();
    let id = domain.id().to_owned();
    shared_file(&places, &id);
    for place in [&other_tmp, &other_memory] {
        assert_eq!(find(place, &id).unwrap().liveness, Liveness::Alive);
        assert_eq!(clear_in(place, &id, true), Err(Kept::Held));
    }
    let path = |place: &Places| match RunDomain::open_in(place.clone(), &id) {
        Err(WireError::Hidden { path, .. }) => path,
        told => panic!("{told:?}"),
    };
    assert_eq!(path(&other_tmp), other_tmp.root(&id));
    assert_eq!(path(&other_memory), other_memory.shared_lock(&id));
    // Whichever half is lost, the other tells that the run is alive.
    fs::remove_file(places.shared_lock(&id)).unwrap();
    assert_eq!(find(&places, &id).unwrap().liveness, Liveness::Alive);
    assert_eq!(clear_in(&places, &id, true), Err(Kept::Held));
    assert!(!places.shared_lock(&id).exists(), "made to clear with");
    // From there only files without a lock are seen.
    let unseen = Liveness::Unknown(Unseen::NoLock);
    assert_eq!(find(&other_tmp, &id).unwrap().liveness, unseen);
    assert_eq!(clear_in(&other_tmp, &id, false), Err(Unseen::NoLock.into()));
    assert!(RunDomain::open_in(places.clone(), &id).is_ok());
}

#[test]
fn files_without_a_lock_are_kept_until_their_user_says_otherwise() {
    let folder = tempfile::tempdir().unwrap();
    let places = places(folder.path());
    shared_file(&places, "0badcafe");
    let found = find(&places, "0badcafe").unwrap();
    assert_eq!(found.liveness, Liveness::Unknown(Unseen::NoLock));
    assert!(matches!(
        RunDomain::open_in(places.clone(), "0badcafe"),
        Err(WireError::Hidden { .. })
    ));
    assert_eq!(
        clear_in(&places, "0badcafe", false),
        Err(Unseen::NoLock.into())
    );
    clear_in(&places, "0badcafe", true).unwrap();
    assert_eq!(fs::read_dir(&places.shared).unwrap().count(), 0);
    assert_eq!(clear_in(&places, "../x", true), Err(Kept::Nothing));
}

#[test]
fn whatever_a_killed_remover_leaves_is_cleared() {
    let folder = tempfile::tempdir().unwrap();
    let places = places(folder.path());
    places.make_folder().unwrap();
    let root = places.root("0badcafe");
    let cases: [&dyn Fn(); 3] = [
        &|| fs::create_dir(&root).unwrap(),
        &|| fs::write(places.shared_lock("0badcafe"), "").unwrap(),
        &|| {
            fs::create_dir(&root).unwrap();
            fs::write(root.join("lock"), "").unwrap();
        },
    ];
    for leave in cases {
        leave();
        let found = find(&places, "0badcafe").unwrap();
        assert_eq!(found.liveness, Liveness::Dead);
        clear_in(&places, "0badcafe", false).unwrap();
        assert!(find(&places, "0badcafe").is_none());
        assert_eq!(fs::read_dir(&places.shared).unwrap().count(), 0);
    }
}

#[test]
fn a_domain_that_is_half_made_is_judged_by_its_lock_and_by_no_clock() {
    let folder = tempfile::tempdir().unwrap();
    let places = places(folder.path());
    places.make_folder().unwrap();
    let old = std::time::SystemTime::UNIX_EPOCH;
    let paths = ["live", "dead", "empty"].map(|name| places.folder.join(format!(".new-{name}")));
    for path in &paths {
        fs::create_dir(path).unwrap();
    }
    let live = Lock::create(&paths[0].join("lock")).unwrap();
    drop(Lock::create(&paths[1].join("lock")).unwrap());
    for path in &paths {
        let opened = File::open(path).unwrap();
        opened.set_modified(old).unwrap();
    }
    assert!(leftovers_in(&places).is_empty());
    assert_eq!(paths.map(|path| path.exists()), [true, false, false]);
    drop(live);
}

#[test]
fn domains_that_are_made_while_others_clear_are_whole() {
    let folder = tempfile::tempdir().unwrap();
    let places = places(folder.path());
    let other = elsewhere(&places, folder.path());
    let end = folder.path().join("end");
    std::thread::scope(|scope| {
        for place in [places.clone(), places.clone(), other.clone()] {
            let end = &end;
            scope.spawn(move || {
                while !end.exists() {
                    for found in leftovers_in(&place) {
                        if found.liveness == Liveness::Dead {
                            let _ = clear_in(&place, &found.id, false);
                        }
                    }
                }
            });
        }
        for place in [&places, &other] {
            for round in 0..100 {
                let domain = RunDomain::create_in(place.clone()).unwrap();
                let id = domain.id().to_owned();
                shared_file(place, &id);
                let joined = RunDomain::open_in(place.clone(), &id).unwrap();
                assert!(!joined.is_over());
                assert_eq!(place.shared_files(&id).len(), 2);
                assert!(place.folder_lock(&id).exists());
                if round % 2 == 0 {
                    kill(domain);
                }
            }
        }
        fs::write(&end, "").unwrap();
    });
    leftovers_in(&places)
        .into_iter()
        .chain(leftovers_in(&other))
        .for_each(|found| {
            let _ = clear_in(&places, &found.id, false).and(clear_in(&other, &found.id, false));
        });
    assert_eq!(fs::read_dir(&places.shared).unwrap().count(), 0);
}

#[test]
fn strange_ids_name_no_run() {
    for id in ["", "../../etc", "zzzzzzzz", "0123456"] {
        assert!(matches!(RunDomain::open(id), Err(WireError::NoSuchRun(_))));
    }
}
