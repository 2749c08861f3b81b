//! Data sets with one fault each, of which only that is told.

use maze::{ACTION, Action, AntBody, Layout, OBSERVATION, Observation, mirrored, mirrored_action};

use super::*;
use crate::{Dataset, Shape, made};

mod point;

const LAGS: [(&str, usize); 2] = [("graph.lag", 15), ("encoder.lag", 15)];

/// Ways from the start to the goal and back, along corridors, 0.2 m a step, by an ant of sound
/// joints and velocities; rows of noise would hide nothing here.
fn walks(layout: &Layout) -> Dataset {
    let goal = layout.goals()[0];
    let distances = layout.distances(goal);
    let mut cells = vec![layout.start()];
    while cells[cells.len() - 1] != goal {
        cells.push(layout.next_cell(&distances, cells[cells.len() - 1]));
    }
    let way: Vec<[f32; 2]> = cells
        .windows(2)
        .flat_map(|pair| {
            let [a, b] = [layout.centre(pair[0]), layout.centre(pair[1])];
            (0..20).map(move |i| {
                let share = i as f32 / 20.0;
                [0, 1].map(|axis| a[axis] + share * (b[axis] - a[axis]))
            })
        })
        .collect();
    let back: Vec<[f32; 2]> = way.iter().rev().copied().collect();
    let mut data = made::along(&[&way, &back]);
    for episode in data.episodes.clone() {
        for row in episode.clone() {
            let ([x, y], [u, v]) = (
                data.place(row.max(episode.start + 1) - 1),
                data.place((row + 1).min(episode.end - 1)),
            );
            let steps = (row + 1).min(episode.end - 1) - (row.max(episode.start + 1) - 1);
            let speed = [u - x, v - y].map(|way| way / (0.1 * steps as f32));
            let half = row as f32 * 0.05;
            let o = &mut data.observations[row * OBSERVATION..(row + 1) * OBSERVATION];
            o[2] = 0.5 + 0.1 * (row as f32).sin();
            (o[3], o[6]) = (half.cos(), half.sin());
            for (joint, [least, most]) in maze::JOINT_RANGES.iter().enumerate() {
                o[7 + joint] = (least + most) / 2.0 + 0.01 * joint as f32;
                o[21 + joint] = 0.1 * joint as f32 - 0.3;
            }
            o[15..17].copy_from_slice(&speed);
            o[18..21].copy_from_slice(&[0.1, 0.2, 0.3]);
            for (i, value) in data.actions[row * ACTION..(row + 1) * ACTION]
                .iter_mut()
                .enumerate()
            {
                *value = ((row * 7 + i * 3) % 21) as f32 / 10.0 - 1.0;
            }
        }
    }
    data.goals = (0..data.len()).map(|_| layout.centre(goal)).collect();
    data
}

fn medium() -> (Layout, Dataset) {
    let layout = Layout::named("medium").unwrap();
    let data = walks(&layout);
    (layout, data)
}

fn look(layout: &Layout, maze: &str, data: &Dataset) -> Fit {
    look_for(&AntBody, layout, maze, data)
}

fn look_for(body: &'static dyn Body, layout: &Layout, maze: &str, data: &Dataset) -> Fit {
    let expect = Expect {
        body,
        maze,
        layout,
        lags: &LAGS,
        nodes: 20,
    };
    check(data, &expect)
}

/// What is told of the medium maze's data after a change of every observation.
fn told(change: impl Fn(&mut [f32])) -> String {
    let (layout, mut data) = medium();
    data.observations
        .chunks_exact_mut(OBSERVATION)
        .for_each(change);
    let fit = look(&layout, "medium", &data);
    fit.faults
        .first()
        .map_or(String::new(), ToString::to_string)
}

#[test]
fn sound_data_of_every_maze_fit_and_nothing_is_said_of_them() {
    for name in Layout::NAMES {
        let layout = Layout::named(name).unwrap();
        let data = walks(&layout);
        let fit = look(&layout, name, &data);
        assert_eq!(fit, Fit::default(), "{name}");
        assert_eq!(fit.apply(&AntBody, &layout, data.clone()), data);
    }
}

#[test]
fn columns_in_another_order_or_unit_are_named() {
    for (change, wanted) in [
        (
            (&|o: &mut [f32]| o[3..7].rotate_left(1)) as &dyn Fn(&mut [f32]),
            "the quaternion stands as x, y, z, w in columns 3 to 6",
        ),
        (&|o| o[2..].rotate_left(1), "columns 2 to 5 hold one"),
        (
            &|o| o.rotate_left(15),
            "no unit quaternion in 100.0% of the rows",
        ),
        (
            &|o| o[2] = 550.0,
            "the torso's height, is not within 0 to 2.5 m in 100.0% of the rows",
        ),
        (
            &|o| o[7..15].iter_mut().for_each(|a| *a *= 57.3),
            "the joint angles, are farther than",
        ),
        (
            &|o| o[15..17].iter_mut().for_each(|v| *v = -*v),
            "x and y, or the order of time, reversed?",
        ),
        (
            &|o| o[16] = -o[16],
            "the velocity in y has the opposite sign",
        ),
        (&|o| o[15..21].rotate_left(3), "they explain "),
        (
            &|o| o[15..17].iter_mut().for_each(|v| *v *= 100.0),
            "times it; are the places in a greater unit than metres",
        ),
    ] {
        let told = told(change);
        assert!(told.contains(wanted), "{wanted}: {told}");
    }
}

#[test]
fn another_maze_unit_or_axis_is_named_with_its_share() {
    let (layout, data) = medium();
    let umaze = Layout::named("umaze").unwrap();
    let of_umaze = walks(&umaze);
    let wrong = look(&layout, "medium", &of_umaze).faults[0].to_string();
    assert!(
        wrong.contains("% of the rows lie inside walls of 'medium'"),
        "{wrong}"
    );
    assert!(
        wrong.contains("they fit 'umaze' (0.0%); set maze.layout = \"umaze\""),
        "{wrong}"
    );
    let back = look(&umaze, "umaze", &data).faults[0].to_string();
    assert!(back.contains("they fit 'medium' (0.0%)"), "{back}");
    for (factor, wanted) in [
        (1000.0, "millimetres (0.0%)"),
        (100.0, "centimetres (0.0%)"),
    ] {
        let told = told(|o| o[..2].iter_mut().for_each(|axis| *axis *= factor));
        assert!(told.contains(wanted), "{told}");
    }
    let cells = told(|o| o[..2].iter_mut().for_each(|axis| *axis /= 4.0));
    assert!(cells.contains("cells of 4 m"), "{cells}");
    let nowhere = told(|o| o[0] += 7.0 * o[1] + 50.0);
    assert!(
        nowhere.contains("far beyond the map of 'medium' (x -6.00 to 26.00, y"),
        "{nowhere}"
    );
}

#[test]
fn one_far_row_is_named() {
    let (layout, mut data) = medium();
    data.observations[77 * OBSERVATION + 1] = -1e9;
    let fit = look(&layout, "medium", &data);
    let told = fit.faults[0].to_string();
    assert!(told.starts_with("row 77 lies at ("), "{told}");
    assert!(
        told.contains("-1.00e9) m") && told.contains("and 1 of 400 rows do"),
        "{told}"
    );
}

#[test]
fn one_huge_value_is_named() {
    let (layout, mut data) = medium();
    data.observations[123 * OBSERVATION + 20] = 3e12;
    let told = look(&layout, "medium", &data).faults[0].to_string();
    assert!(
        told.starts_with("row 123 holds 3.00e12 in column 20"),
        "{told}"
    );
}

/// The same walks as Gymnasium-Robotics records them.
fn as_gymnasium(layout: &Layout, data: &Dataset, body: bool) -> Dataset {
    let (rows, columns) = layout.shape();
    let centre = layout.centre((0, 0));
    let place = |[x, y]: [f32; 2]| {
        [
            x - centre[0] - (columns as f32 - 1.0) * 2.0,
            -(y - centre[1]) + (rows as f32 - 1.0) * 2.0,
        ]
    };
    let mut data = data.clone();
    for row in 0..data.len() {
        let to = place(data.place(row));
        let o: &mut Observation = data.observations.as_chunks_mut().0.get_mut(row).unwrap();
        if body {
            *o = mirrored(o);
        }
        o[..2].copy_from_slice(&to);
        let a: &mut Action = data.actions.as_chunks_mut().0.get_mut(row).unwrap();
        if body {
            *a = mirrored_action(a);
        }
    }
    data.goals.iter_mut().for_each(|goal| *goal = place(*goal));
    data
}

fn assert_close(a: &Dataset, b: &Dataset) {
    let near = |a: &[f32], b: &[f32]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-4);
    assert!(near(&a.observations, &b.observations) && near(&a.actions, &b.actions));
    assert!(near(a.goals.as_flattened(), b.goals.as_flattened()));
}

#[test]
fn gymnasium_robotics_frame_is_recognised_and_comes_back_whole() {
    for name in ["umaze", "medium", "large"] {
        let layout = Layout::named(name).unwrap();
        let data = walks(&layout);
        let fit = look(&layout, name, &as_gymnasium(&layout, &data, true));
        assert_eq!(
            (fit.conversion.frame, fit.faults.len()),
            (Frame::GymnasiumRobotics, 0)
        );
        assert!(!fit.conversion.places_alone);
        assert!(
            fit.notes[0].starts_with("recognised Gymnasium-Robotics' frame"),
            "{:?}",
            fit.notes
        );
        let own = fit.apply(&AntBody, &layout, as_gymnasium(&layout, &data, true));
        assert_close(&own, &data);
        assert_eq!(look(&layout, name, &own), Fit::default());
    }
}

#[test]
fn places_that_alone_were_mirrored_are_alone_mirrored_back() {
    let (layout, data) = medium();
    let fit = look(&layout, "medium", &as_gymnasium(&layout, &data, false));
    assert!(
        fit.conversion.places_alone && fit.faults.is_empty(),
        "{fit:?}"
    );
    assert_close(
        &fit.apply(&AntBody, &layout, as_gymnasium(&layout, &data, false)),
        &data,
    );
}

#[test]
fn ogbenchs_frame_is_recognised_where_the_start_is_elsewhere() {
    let layout = Layout::from_rows(&["111111", "1g0001", "111101", "1r0001", "111111"]).unwrap();
    let data = walks(&layout);
    let mut moved = data.clone();
    moved
        .observations
        .chunks_exact_mut(OBSERVATION)
        .for_each(|o| o[1] += 8.0);
    moved.goals.iter_mut().for_each(|goal| goal[1] += 8.0);
    let fit = look(&layout, "custom", &moved);
    assert_eq!(
        (fit.conversion.frame, fit.faults.len()),
        (Frame::Ogbench, 0)
    );
    assert_close(&fit.apply(&AntBody, &layout, moved), &data);
}

#[test]
fn half_steps_are_told_and_taken() {
    let (layout, mut data) = medium();
    data.observations
        .chunks_exact_mut(OBSERVATION)
        .for_each(|o| {
            o[15] *= 2.0;
            o[16] *= 2.0;
        });
    let fit = look(&layout, "medium", &data);
    assert!(fit.faults.is_empty(), "{fit:?}");
    assert!(
        fit.notes[0].contains("rows lie 0.05 s apart"),
        "{:?}",
        fit.notes
    );
}

#[test]
fn actions_out_of_range_or_all_one_are_named() {
    let (layout, mut data) = medium();
    data.actions.iter_mut().for_each(|value| *value *= 30.0);
    let told = look(&layout, "medium", &data).faults[0].to_string();
    assert!(
        told.starts_with("actions are not within -1 to 1 in "),
        "{told}"
    );
    assert!(told.contains("the largest is 30.00"), "{told}");
    data.actions.fill(0.0);
    let told = look(&layout, "medium", &data).faults[0].to_string();
    assert!(
        told.starts_with("every row has the same action, 0.00"),
        "{told}"
    );
}

#[test]
fn unmarked_ends_are_cut_and_shuffled_rows_refused() {
    let (layout, data) = medium();
    let mut merged = data.clone();
    merged.episodes = vec![0..data.len()];
    // A reset from the goal to the start that nothing marks.
    let half = data.len() / 2 * OBSERVATION;
    merged.observations.copy_within(..half, half);
    let fit = look(&layout, "medium", &merged);
    assert!(fit.faults.is_empty() && fit.cuts.len() == 1, "{fit:?}");
    assert!(
        fit.notes[0].contains("episodes are cut there"),
        "{:?}",
        fit.notes
    );
    let cut = fit.apply(&AntBody, &layout, merged);
    assert_eq!(cut.episodes.len(), 2);
    made::sound(&cut);

    let mut shuffled = data;
    let rows = shuffled.len();
    let old = shuffled.observations.clone();
    for row in 0..rows {
        let from = row * 137 % rows;
        shuffled.observations[row * OBSERVATION..(row + 1) * OBSERVATION]
            .copy_from_slice(&old[from * OBSERVATION..(from + 1) * OBSERVATION]);
    }
    let told = look(&layout, "medium", &shuffled).faults[0].to_string();
    assert!(told.contains("are the rows shuffled?"), "{told}");
}

#[test]
fn teleports_are_no_ends() {
    let layout = Layout::named("teleport").unwrap();
    let [inlet, outlet] = [layout.inlets()[0], layout.outlets()[1]].map(|cell| layout.centre(cell));
    let way: Vec<[f32; 2]> = (0..30)
        .map(|t| {
            if t < 15 {
                [inlet[0], inlet[1] - 3.0 + 0.2 * t as f32]
            } else {
                [outlet[0], outlet[1] + 0.1 * (t - 15) as f32]
            }
        })
        .collect();
    let mut data = made::along(&[&way]);
    data.observations
        .chunks_exact_mut(OBSERVATION)
        .for_each(|o| o[2] = 0.5);
    let fit = look(&layout, "teleport", &data);
    assert!(fit.cuts.is_empty(), "{fit:?}");
}

#[test]
fn too_short_and_still_data_are_refused() {
    let (layout, data) = medium();
    let expect = Expect {
        body: &AntBody,
        maze: "medium",
        layout: &layout,
        lags: &LAGS,
        nodes: 20,
    };
    assert_eq!(suffices(&data, &expect), Ok(()));
    let told = |data: &Dataset| suffices(data, &expect).unwrap_err().to_string();
    let mut short = data.clone();
    short.episodes = (0..40).map(|at| at * 10..at * 10 + 10).collect();
    let why = told(&short);
    let wanted = "no episode has more rows than graph.lag = 15: the longest of 40 has 10 rows";
    assert!(why.starts_with(wanted), "{why}");
    short.episodes = (0..400).map(|row| row..row + 1).collect();
    assert!(told(&short).contains("('timeouts' mark every row as an end)"));
    let mut still = data;
    let first = still.observations[..OBSERVATION].to_vec();
    still
        .observations
        .chunks_exact_mut(OBSERVATION)
        .for_each(|o| o.copy_from_slice(&first));
    assert!(told(&still).contains("under way in 0 of 400 rows"));
    assert!(told(&Dataset::new(Shape::ant())).contains("the longest of 0 has 0"));
}

#[test]
fn no_data_panic() {
    let layout = Layout::named("umaze").unwrap();
    for data in [
        Dataset::new(Shape::ant()),
        made::along(&[&[[0.0; 2]]]),
        made::along(&[&[[f32::MAX, f32::MIN]; 40]]),
        made::varied(&[1, 1, 30]),
    ] {
        let fit = look(&layout, "umaze", &data);
        let text: Vec<String> = fit.faults.iter().map(ToString::to_string).collect();
        assert!(!text.join(" ").contains("NaN"), "{text:?}");
        let _ = fit.apply(&AntBody, &layout, data);
    }
}
