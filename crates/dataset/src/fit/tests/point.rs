//! Data sets of a point, and of the ant where a point is expected.

use maze::PointBody;

use super::*;

/// The same walks by a point.
fn by_a_point(ants: &Dataset) -> Dataset {
    let mut data = Dataset::new(Shape::of(&PointBody));
    for row in 0..ants.len() {
        let [x, y] = ants.place(row);
        let o = ants.observation(row);
        data.observations.extend([x, y, o[15], o[16]]);
        data.actions.extend_from_slice(&ants.action(row)[..2]);
        data.rewards.push(0.0);
        data.terminals.push(false);
    }
    data.episodes.clone_from(&ants.episodes);
    data.goals.clone_from(&ants.goals);
    data
}

#[test]
fn rows_of_another_body_are_named_and_never_taken() {
    let (layout, ants) = medium();
    let points = by_a_point(&ants);
    let fault = look(&layout, "medium", &points).faults.remove(0);
    assert_eq!(
        fault.to_string(),
        "the file has observations of 4 values and actions of 2, the simulator 'ant' expects \
         observations of 29 values and actions of 8 (the file's widths are those of 'point'); use data \
         recorded with 'ant'"
    );
    assert!(!fault.can_be_waived());
    let images = made::of(&Shape::images(&[8, 8, 3], 8), &[20]);
    for body in simulators::names().filter_map(simulators::body) {
        let fit = look_for(body, &layout, "medium", &images);
        let told = fit.faults[0].to_string();
        assert!(told.contains("images of 8 x 8 x 3 bytes"), "{told}");
        assert!(
            told.contains("no simulator has the file's widths"),
            "{told}"
        );
    }
}

#[test]
fn of_a_point_places_jumps_and_actions_are_looked_at() {
    let (layout, ants) = medium();
    let data = by_a_point(&ants);
    let look =
        |maze, data: &Dataset| look_for(&PointBody, &Layout::named(maze).unwrap(), maze, data);
    assert_eq!(look("medium", &data), Fit::default());
    let told = look("umaze", &data).faults[0].to_string();
    assert!(told.contains("they fit 'medium'"), "{told}");
    let mut strong = data.clone();
    strong.actions.iter_mut().for_each(|value| *value *= 30.0);
    let told = look("medium", &strong).faults[0].to_string();
    assert!(told.contains("the largest is 30.00"), "{told}");
    let mut merged = data.clone();
    merged.episodes = vec![0..data.len()];
    let half = data.len() / 2 * 4;
    merged.observations.copy_within(..half, half);
    assert_eq!(look("medium", &merged).cuts.len(), 1);
    let mut mirrored = as_gymnasium(&layout, &ants, true);
    mirrored = by_a_point(&mirrored);
    mirrored.actions.clone_from(&data.actions);
    let actions = mirrored.actions.chunks_exact_mut(2);
    actions.for_each(|action| action[1] = -action[1]);
    let fit = look("medium", &mirrored);
    assert_eq!(fit.conversion.frame, Frame::GymnasiumRobotics);
    assert_close(&fit.apply(&PointBody, &layout, mirrored), &data);
    let expect = Expect {
        body: &PointBody,
        maze: "medium",
        layout: &layout,
        lags: &LAGS,
        nodes: 20,
    };
    assert_eq!(suffices(&data, &expect), Ok(()));
    let still = Dataset {
        observations: vec![0.0; data.observations.len()].into(),
        ..data
    };
    let told = suffices(&still, &expect).unwrap_err().to_string();
    assert!(told.starts_with("the point is under way in 0 of"), "{told}");
}
