//! `[dataset]` and `[collect]`.

use std::path::Path;

use crate::key::OnResume;
use crate::reader::Document;
use crate::sections::{Collect, Dataset, Misfit, OnFault};
use crate::value::Whole;

pub(super) fn dataset(d: &mut Document<'_>, has_collect: bool) -> Dataset {
    d.table("dataset", |t| {
        let path = t.on_resume(OnResume::Input).path("path");
        match &path {
            None => t.absent(
                "path",
                "missing; name a D4RL HDF5 file, a Minari folder or an OGBench npz",
            ),
            Some(given) if !has_collect && !Path::new(&given.path).exists() => {
                let message = format!(
                    "no file '{}', and no [collect] table that would make it",
                    given.shown()
                );
                t.missing("path", message);
            }
            Some(_) => {}
        }
        let cells = t.value("leave_out", vec![], |cells: &Vec<Vec<Whole>>| {
            let sound =
                |cell: &Vec<Whole>| cell.len() == 2 && cell.iter().all(|at| index(*at).is_some());
            match cells.iter().find(|cell| !sound(cell)) {
                Some(cell) => {
                    let cell: Vec<i128> = cell.iter().map(|at| at.0).collect();
                    Err(format!("{cell:?} is no cell; cells are [row, column]"))
                }
                None => Ok(()),
            }
        });
        let cell = |cell: Vec<Whole>| Some([index(*cell.first()?)?, index(*cell.get(1)?)?]);
        Dataset {
            path: path.map(|given| given.path).unwrap_or_default(),
            leave_out: cells.into_iter().filter_map(cell).collect(),
            fit: match t.word("fit", "refuse", &["refuse", "warn"]).as_str() {
                "warn" => Misfit::Warn,
                _ => Misfit::Refuse,
            },
            on_fault: match t
                .word("on_fault", "refuse", &["refuse", "drop-episode"])
                .as_str()
            {
                "drop-episode" => OnFault::DropEpisode,
                _ => OnFault::Refuse,
            },
        }
    })
}

fn index(at: Whole) -> Option<usize> {
    usize::try_from(at.0).ok()
}

pub(super) fn collect(d: &mut Document<'_>, layout: &str) -> Collect {
    d.table("collect", |t| {
        let style = t.word("style", "diverse", &["diverse", "play"]);
        let transitions = t.count("transitions", 1_000_000, [1000, 100_000_000]);
        let steps = if layout == "umaze" { 700 } else { 1000 };
        let episode_steps = t.count("episode_steps", steps, [50, 100_000]);
        if transitions < episode_steps {
            t.fault(
                "transitions",
                format!("fewer than the {episode_steps} of one episode"),
            );
        }
        let walker = t.file("walker");
        Collect {
            style,
            transitions,
            episode_steps,
            noise: t.number("noise", 0.2, [0.0, 2.0]),
            walker,
            threads: t.on_resume(OnResume::Free).count("threads", 2, [1, 256]),
        }
    })
}
