/// What holds for every data set that a reader lets through.
fn sound(data: &dataset::Dataset) {
    let n = data.len();
    assert!(n > 0, "no row");
    let values = data.observations.len() + data.images.len();
    assert_eq!(values, n * data.shape().observation());
    assert!(data.images.is_empty() || data.image_places.len() == n);
    assert_eq!(data.actions.len(), n * data.shape().action());
    assert_eq!(data.terminals.len(), n);
    assert!(data.goals.is_empty() || data.goals.len() == n);
    let mut end = 0;
    for episode in &data.episodes {
        assert!(episode.start == end && episode.end > end, "{episode:?} after {end}");
        end = episode.end;
    }
    assert_eq!(end, n, "rows outside of all episodes");
    assert!(data.observations.iter().chain(&data.actions).all(|value| value.is_finite()));
}
