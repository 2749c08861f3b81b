use super::*;

/// A square of 20 m with one wall inside.
const WALLS: [[f32; 4]; 5] = [
    [4.0, -4.0, 10.0, 2.0],
    [4.0, 12.0, 10.0, 2.0],
    [-4.0, 4.0, 2.0, 10.0],
    [12.0, 4.0, 2.0, 10.0],
    [2.0, 4.0, 4.0, 2.0],
];
const NODES: [[f32; 2]; 4] = [[0.0, 0.0], [4.0, 0.0], [8.0, 0.0], [8.0, 4.0]];

fn maze<'a>() -> Map<'a> {
    Map {
        title: "Episode <3>".into(),
        subtitle: "a & b".into(),
        walls: WALLS.to_vec(),
        start: Some([0.0, 0.0]),
        goal: Some([0.0, 8.0]),
        goal_radius: 0.5,
        ..Map::default()
    }
}

/// Values of an attribute, in order.
fn values<'a>(svg: &'a str, attribute: &str) -> Vec<&'a str> {
    let begin = format!(" {attribute}=\"");
    let rest = svg.split(begin.as_str()).skip(1);
    rest.filter_map(|rest| rest.split('"').next()).collect()
}

#[test]
fn a_maze_alone_has_its_legend_and_no_more() {
    let svg = maze().svg();
    for text in [
        "Episode &lt;3&gt;",
        "a &amp; b",
        ">start<",
        ">goal<",
        " m</text>",
    ] {
        assert!(svg.contains(text), "{text} in {svg}");
    }
    for absent in [">node<", ">edge<", ">node chosen<", "walked", "NaN", "inf"] {
        assert!(!svg.contains(absent), "{absent} in {svg}");
    }
}

#[test]
fn y_points_up_and_both_axes_have_one_scale() {
    let svg = Map {
        nodes: &NODES,
        ..maze()
    }
    .svg();
    let number = |text: &&str| text.parse::<f64>().unwrap();
    let nodes: Vec<&str> = svg
        .lines()
        .filter(|l| l.starts_with("<circle class=\"node\""))
        .collect();
    // The last one belongs to the legend.
    assert_eq!(nodes.len(), 5, "{svg}");
    let at = |i: usize| [values(nodes[i], "cx")[0], values(nodes[i], "cy")[0]].map(|v| number(&v));
    let right = at(1)[0] - at(0)[0];
    assert!(right > 20.0 && (at(0)[1] - at(1)[1]).abs() < 0.2, "{svg}");
    let up = at(2)[1] - at(3)[1];
    assert!((up - right).abs() < 0.3, "{up} {right}");
    // All of it is within the image.
    for (attribute, most) in [("cx", WIDTH), ("cy", number(&values(&svg, "height")[0]))] {
        for value in values(&svg, attribute) {
            assert!(
                (0.0..=most).contains(&number(&value)),
                "{attribute} {value}"
            );
        }
    }
}

#[test]
fn edges_in_both_directions_are_one_line_and_unknown_nodes_are_left_out() {
    let edges = [(0, 1), (1, 0), (1, 2), (2, 9), (9, 2)];
    let svg = Map {
        nodes: &NODES,
        edges: &edges,
        ..maze()
    }
    .svg();
    let drawn = svg.split("class=\"edge\" d=\"").nth(1).unwrap();
    let drawn = drawn.split('"').next().unwrap();
    assert_eq!(drawn.matches('M').count(), 2, "{drawn}");
    assert!(!svg.contains("graph ground"));
}

#[test]
fn paths_differ_by_success_and_break_at_jumps() {
    let good = [
        [0.0, 0.0],
        [f32::NAN, 1.0],
        [2.0, 0.0],
        [8.0, 8.0],
        [7.0, 8.0],
    ];
    let bad = [[0.0, 0.0], [1.0, 0.0]];
    let paths = vec![
        Path {
            points: &good,
            success: true,
        },
        Path {
            points: &bad,
            success: false,
        },
        Path::default(),
    ];
    let chosen = [1, 77, 3];
    let svg = Map {
        nodes: &NODES,
        chosen: &chosen,
        paths,
        ..maze()
    }
    .svg();
    let walk = |class: &str| {
        let begin = format!("class=\"{class}\" d=\"");
        let lines = svg.split(begin.as_str()).skip(1);
        lines
            .map(|rest| rest.split('"').next().unwrap().to_owned())
            .collect::<Vec<_>>()
    };
    // Broken once, where it is teleported. The second line belongs to the legend.
    assert_eq!(walk("walk good").len(), 2, "{svg}");
    let first = &walk("walk good")[0];
    assert_eq!(
        (first.matches('M').count(), first.matches('L').count()),
        (2, 2),
        "{first}"
    );
    // The path, its cross, and both in the legend.
    assert_eq!(walk("walk bad").len(), 4, "{svg}");
    assert_eq!(walk("plan")[0].matches('L').count(), 1, "{svg}");
    assert_eq!(svg.matches("class=\"chosen\"").count(), 3, "{svg}");
    assert!(
        svg.contains("graph ground") && !svg.contains("NaN"),
        "{svg}"
    );
}

#[test]
fn empty_maps_and_values_that_are_not_finite_are_drawn() {
    for map in [
        Map::default(),
        Map {
            nodes: &[[f32::NAN, 0.0]],
            start: Some([f32::INFINITY, 0.0]),
            ..Map::default()
        },
    ] {
        let svg = map.svg();
        assert!(svg.contains("There is nothing to draw."), "{svg}");
    }
    let far = Map {
        goal: Some([f32::MAX, -1.0]),
        goal_radius: f32::INFINITY,
        ..maze()
    }
    .svg();
    assert!(!far.contains("NaN") && !far.contains("inf"), "{far}");
    let point = Map {
        goal: Some([1.0, 1.0]),
        ..Map::default()
    }
    .svg();
    assert!(point.contains("class=\"zone\""), "{point}");
}

#[test]
fn styles_apply_to_maps_only() {
    let rules = STYLE.replace("@media screen and (prefers-color-scheme:dark){", "");
    for rule in rules.split('}').filter(|rule| !rule.trim().is_empty()) {
        assert!(rule.starts_with(".maze "), "{rule}");
    }
}
