//! Map of an episode as text: walls, path, subgoals.

use maze::Layout;

use super::summary::EpisodeSummary;

/// Width and height of a character (m). Characters are twice as high as wide.
const CHARACTER: [f32; 2] = [1.0, 2.0];
/// Maximum characters of a map.
const MOST: usize = 200 * 100;

/// The maze from above, with y up; `None` if it is too large for a terminal.
pub(super) fn text_map(
    layout: &Layout,
    nodes: &[[f32; 2]],
    summary: &EpisodeSummary,
) -> Option<String> {
    let boxes = layout.boxes();
    let bound = |of: fn(f32, f32) -> f32, from: f32, edge: &dyn Fn(&[f32; 4]) -> f32| {
        boxes.iter().map(edge).fold(from, of)
    };
    let low = [
        bound(f32::min, f32::INFINITY, &|b| b[0] - b[2]),
        bound(f32::min, f32::INFINITY, &|b| b[1] - b[3]),
    ];
    let high = [
        bound(f32::max, f32::NEG_INFINITY, &|b| b[0] + b[2]),
        bound(f32::max, f32::NEG_INFINITY, &|b| b[1] + b[3]),
    ];
    let size = [0, 1].map(|axis| {
        let size = ((high[axis] - low[axis]) / CHARACTER[axis]).ceil();
        if size.is_finite() { size as usize } else { 0 }
    });
    let [width, height] = size;
    if width == 0 || height == 0 || width.saturating_mul(height) > MOST {
        return None;
    }
    let mut rows = vec![vec![' '; width]; height];
    for (row, line) in rows.iter_mut().enumerate() {
        for (column, character) in line.iter_mut().enumerate() {
            let place = [
                low[0] + (column as f32 + 0.5) * CHARACTER[0],
                high[1] - (row as f32 + 0.5) * CHARACTER[1],
            ];
            if layout.is_wall_at(place) {
                *character = '█';
            }
        }
    }
    let mut put = |[x, y]: [f32; 2], character: char| {
        let (column, row) = ((x - low[0]) / CHARACTER[0], (high[1] - y) / CHARACTER[1]);
        if column >= 0.0
            && row >= 0.0
            && let Some(place) = rows.get_mut(row as usize)
            && let Some(place) = place.get_mut(column as usize)
        {
            *place = character;
        }
    };
    for place in &summary.path {
        put(*place, '·');
    }
    for subgoal in &summary.subgoals {
        let place = usize::try_from(subgoal.subgoal_node).ok();
        if let Some(place) = place.and_then(|node| nodes.get(node)) {
            let reached = subgoal.reached != Some(false);
            put(*place, if reached { 'o' } else { 'x' });
        }
    }
    put(summary.start, 'S');
    if let Some(end) = summary.path.last() {
        put(*end, 'E');
    }
    put(summary.goal, 'G');
    let rows: Vec<String> = rows
        .into_iter()
        .map(|row| row.into_iter().collect())
        .collect();
    let key = "S start  · path  o subgoal  x subgoal given up  E end  G goal";
    Some(format!("{}\n{key}", rows.join("\n")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn everything_is_at_its_position() {
        let layout = Layout::named("umaze").unwrap();
        let mut summary = EpisodeSummary::of(&trace::Trace::default());
        summary.start = [0.0, 0.0];
        summary.goal = [0.0, 8.0];
        summary.path = vec![
            [0.0, 0.0],
            [4.0, 0.0],
            [8.0, 4.0],
            [f32::NAN, 0.0],
            [1e30, 0.0],
        ];
        summary.path.push([4.0, 8.0]);
        let map = text_map(&layout, &[], &summary).unwrap();
        let rows: Vec<Vec<char>> = map.lines().map(|line| line.chars().collect()).collect();
        // Five cells of 4 m, with y up: the start is in the second row of cells from the bottom.
        assert_eq!((rows.len(), rows[0].len()), (11, 20));
        assert!(rows[0].iter().chain(&rows[9]).all(|c| *c == '█'));
        let find = |wanted: char| {
            let row = rows[..10]
                .iter()
                .position(|row| row.contains(&wanted))
                .unwrap();
            (row, rows[row].iter().position(|c| *c == wanted).unwrap())
        };
        assert_eq!((find('S'), find('G'), find('E')), ((7, 6), (3, 6), (3, 10)));
    }
}
