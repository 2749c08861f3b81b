//! A maze from above as one SVG: walls, the graph, the nodes chosen, the paths walked. It needs no
//! other file, follows the reader's light or dark scheme, and stands alone or within a page.

use std::fmt::Write;

use crate::markup::{escaped, text, wrapped};

/// Everything is in pixels of a picture this wide: a phone's, so that its text stays readable there.
const WIDTH: f64 = 400.0;
const MARGIN: f64 = 14.0;
/// A map is no higher, however narrow it is.
const MAP_HEIGHT: f64 = 460.0;
/// Characters of a line of title and subtitle.
const TITLE: usize = 42;
const SUBTITLE: usize = 60;
const LEGEND_ROW: f64 = 22.0;
/// Of a letter of the legend, and of the sign before its words.
const LETTER: f64 = 7.0;
const SIGN: f64 = 24.0;
/// What an ant never walks in a step (m): beyond it a path was teleported, and no line is drawn.
const JUMP: f64 = 4.0;

/// Every rule begins with the root's class: in a page a style holds for the whole page.
const STYLE: &str = "\
    .maze text{font:13px system-ui,'DejaVu Sans',sans-serif;fill:#1f2328}\
    .maze .title{font-size:16px;font-weight:600}.maze .faint{font-size:12px;fill:#59636e}\
    .maze .paper{fill:#ffffff}.maze .wall{fill:#d9dfe6}\
    .maze path{fill:none;stroke-linecap:round;stroke-linejoin:round}\
    .maze .edge{stroke:#0072b2;stroke-width:.8;stroke-opacity:.4}\
    .maze .node{fill:#0072b2;stroke:#ffffff;stroke-width:.8}\
    .maze .ground .edge{stroke-opacity:.13}.maze .ground .node{fill-opacity:.35;stroke:none}\
    .maze .case{stroke:#ffffff;stroke-width:4.4;stroke-opacity:.75}\
    .maze .walk{stroke-width:2.2}.maze .good{stroke:#009e73}.maze .bad{stroke:#d55e00}\
    .maze .plan{stroke:#8a6100;stroke-width:1;stroke-dasharray:1 4}\
    .maze .chosen{fill:#e69f00;stroke:#ffffff;stroke-width:1.2}\
    .maze .start{fill:#ffffff;stroke:#1f2328;stroke-width:2}\
    .maze .zone{fill:#cc79a7;fill-opacity:.28;stroke:#b0538a;stroke-width:1.6}\
    .maze .goal{fill:#b0538a}.maze .scale{stroke:#59636e;stroke-width:1.2}\
    @media screen and (prefers-color-scheme:dark){\
    .maze text{fill:#e6edf3}.maze .faint{fill:#9aa4ae}\
    .maze .paper{fill:#15191e}.maze .wall{fill:#303841}\
    .maze .edge{stroke:#56b4e9;stroke-opacity:.38}.maze .node{fill:#56b4e9;stroke:#15191e}\
    .maze .ground .edge{stroke-opacity:.15}\
    .maze .case{stroke:#15191e}.maze .good{stroke:#2dc596}.maze .bad{stroke:#f07a28}\
    .maze .plan{stroke:#e6b95c}.maze .chosen{stroke:#15191e}\
    .maze .start{fill:#15191e;stroke:#e6edf3}.maze .zone{stroke:#dd94ba}.maze .goal{fill:#dd94ba}\
    .maze .scale{stroke:#9aa4ae}}";

/// A path that was walked.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct WalkedPath<'a> {
    /// Where the ant was, step by step (m).
    pub(crate) points: &'a [[f32; 2]],
    /// Whether it came to the goal.
    pub(crate) success: bool,
}

/// What is drawn; what is empty is left out, of the legend as well.
#[derive(Default)]
pub(crate) struct Picture<'a> {
    pub(crate) title: String,
    pub(crate) subtitle: String,
    /// Centre x, y, half width, half depth (m), as `Layout::boxes` gives them.
    pub(crate) walls: Vec<[f32; 4]>,
    /// Places of the graph's nodes (m).
    pub(crate) nodes: &'a [[f32; 2]],
    /// Pairs of nodes; one that names a node that is not there is left out.
    pub(crate) edges: &'a [(u32, u32)],
    /// Nodes that were chosen as subgoals, in order.
    pub(crate) chosen: &'a [u32],
    pub(crate) paths: Vec<WalkedPath<'a>>,
    /// Centre of the start (m).
    pub(crate) start: Option<[f32; 2]>,
    /// Centre of the goal (m).
    pub(crate) goal: Option<[f32; 2]>,
    /// How near is at the goal (m).
    pub(crate) goal_radius: f32,
}

/// From metres to pixels: y grows upwards in a maze and downwards in a picture.
struct Frame {
    left: f64,
    top: f64,
    scale: f64,
    /// Where pixels begin.
    x: f64,
    y: f64,
    /// Height of the map (px).
    height: f64,
}

impl Frame {
    /// None when there is nothing to frame.
    fn around(points: impl Iterator<Item = [f64; 2]>, y: f64) -> Option<Self> {
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for point in points {
            for axis in 0..2 {
                low[axis] = low[axis].min(point[axis]);
                high[axis] = high[axis].max(point[axis]);
            }
        }
        if !low.iter().chain(&high).all(|bound| bound.is_finite()) {
            return None;
        }
        // One point alone gets a metre.
        let [width, depth] = [0, 1].map(|axis| (high[axis] - low[axis]).max(1.0));
        let room = WIDTH - 2.0 * MARGIN;
        let scale = (room / width).min(MAP_HEIGHT / depth);
        Some(Self {
            left: low[0],
            top: high[1],
            scale,
            x: MARGIN + (room - scale * width) / 2.0,
            y,
            height: scale * depth,
        })
    }

    fn at(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        [
            self.x + (x - self.left) * self.scale,
            self.y + (self.top - y) * self.scale,
        ]
    }
}

/// A point whose numbers are numbers.
fn finite(point: [f32; 2]) -> Option<[f64; 2]> {
    let whole = point.iter().all(|value| value.is_finite());
    whole.then(|| point.map(f64::from))
}

fn circle(svg: &mut String, class: &str, [x, y]: [f64; 2], radius: f64) {
    let place = format!("cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{radius:.1}\"");
    let _ = writeln!(svg, "<circle class=\"{class}\" {place}/>");
}

fn path(svg: &mut String, class: &str, line: &str) {
    if !line.is_empty() {
        let _ = writeln!(svg, "<path class=\"{class}\" d=\"{line}\"/>");
    }
}

impl Picture<'_> {
    /// The picture.
    pub(crate) fn svg(&self) -> String {
        let titles = wrapped(&self.title, TITLE);
        let subtitles = wrapped(&self.subtitle, SUBTITLE);
        let head = 20.0 * titles.len() as f64 + 16.0 * subtitles.len() as f64;
        let top = MARGIN + head + if head > 0.0 { 8.0 } else { 0.0 };
        let mut body = String::new();
        let mut y = MARGIN - 4.0;
        for line in &titles {
            y += 20.0;
            text(&mut body, [MARGIN, y], "class=\"title\"", line);
        }
        for line in &subtitles {
            y += 16.0;
            text(&mut body, [MARGIN, y], "class=\"faint\"", line);
        }
        let bottom = match Frame::around(self.extent(), top) {
            Some(frame) => {
                self.map(&mut body, &frame);
                self.legend(&mut body, &frame)
            }
            None => {
                let place = [MARGIN, top + 16.0];
                text(&mut body, place, "", "There is nothing to draw.");
                top + 24.0
            }
        };
        let height = (bottom + MARGIN).ceil();
        let name = match self.title.trim() {
            "" => "A maze from above",
            title => title,
        };
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" class=\"maze\" \
             viewBox=\"0 0 {WIDTH} {height}\" width=\"{WIDTH}\" height=\"{height}\" \
             role=\"img\">\n<title>{}</title>\n<style>{STYLE}</style>\n\
             <rect class=\"paper\" width=\"100%\" height=\"100%\"/>\n{body}</svg>\n",
            escaped(name)
        )
    }

    /// Every point that must be seen.
    fn extent(&self) -> impl Iterator<Item = [f64; 2]> {
        let corners = self
            .walls
            .iter()
            .flat_map(|[x, y, width, depth]| [[x - width, y - depth], [x + width, y + depth]]);
        let walked = self.paths.iter().flat_map(|path| path.points).copied();
        let points = corners.chain(self.nodes.iter().copied()).chain(walked);
        points.chain(self.start).chain(self.goal).filter_map(finite)
    }

    fn map(&self, svg: &mut String, frame: &Frame) {
        // One path, so that no seam shows where two walls meet.
        let mut walls = String::new();
        for [x, y, width, depth] in &self.walls {
            let corners = [[x - width, y + depth], [x + width, y - depth]].map(finite);
            if let [Some(first), Some(second)] = corners {
                let ([left, top], [right, bottom]) = (frame.at(first), frame.at(second));
                let _ = write!(
                    walls,
                    "M{left:.1} {top:.1}H{right:.1}V{bottom:.1}H{left:.1}Z"
                );
            }
        }
        if !walls.is_empty() {
            let _ = writeln!(
                svg,
                "<path class=\"wall\" style=\"fill-rule:nonzero\" d=\"{walls}\"/>"
            );
        }
        let place = |point: Option<[f32; 2]>| point.and_then(finite).map(|point| frame.at(point));
        let goal = place(self.goal);
        if let Some(goal) = goal {
            let radius = f64::from(self.goal_radius) * frame.scale;
            let radius = if radius.is_finite() { radius } else { 0.0 };
            circle(svg, "zone", goal, radius.max(5.0));
        }
        self.graph(svg, frame);
        let chosen: Vec<[f64; 2]> = self
            .chosen
            .iter()
            .filter_map(|node| self.node(*node))
            .collect();
        path(
            svg,
            "plan",
            &line(frame, chosen.iter().copied(), f64::INFINITY),
        );
        for walked in &self.paths {
            let points = walked.points.iter().copied().filter_map(finite);
            let line = line(frame, points, JUMP);
            path(svg, "case", &line);
            path(svg, way(walked.success), &line);
        }
        for node in chosen {
            circle(svg, "chosen", frame.at(node), 3.6);
        }
        if let Some(start) = place(self.start) {
            circle(svg, "start", start, 4.5);
        }
        if let Some(goal) = goal {
            circle(svg, "goal", goal, 2.2);
        }
        for walked in self.paths.iter().filter(|walked| !walked.success) {
            let last = walked.points.iter().rev().copied().find_map(finite);
            if let Some(end) = last.map(|point| frame.at(point)) {
                cross(svg, end);
            }
        }
    }

    /// A node's place; none where there is no such node.
    fn node(&self, node: u32) -> Option<[f64; 2]> {
        self.nodes.get(node as usize).copied().and_then(finite)
    }

    /// The graph, pale where it is only the ground of a path. An edge both ways is one line.
    fn graph(&self, svg: &mut String, frame: &Frame) {
        let ground = !self.paths.is_empty() || !self.chosen.is_empty();
        let class = if ground { "graph ground" } else { "graph" };
        let mut pairs: Vec<(u32, u32)> = self
            .edges
            .iter()
            .map(|&(a, b)| (a.min(b), a.max(b)))
            .collect();
        pairs.sort_unstable();
        pairs.dedup();
        let mut lines = String::new();
        for (a, b) in pairs {
            if let (Some(a), Some(b)) = (self.node(a), self.node(b)) {
                let ([x, y], [to_x, to_y]) = (frame.at(a), frame.at(b));
                let _ = write!(lines, "M{x:.1} {y:.1}L{to_x:.1} {to_y:.1}");
            }
        }
        let _ = writeln!(svg, "<g class=\"{class}\">");
        path(svg, "edge", &lines);
        for node in self.nodes.iter().copied().filter_map(finite) {
            circle(svg, "node", frame.at(node), 2.4);
        }
        svg.push_str("</g>\n");
    }

    /// Its lowest pixel.
    fn legend(&self, svg: &mut String, frame: &Frame) -> f64 {
        let walked = |success| self.paths.iter().any(|path| path.success == success);
        let shown = [
            (self.start.is_some(), "start"),
            (self.goal.is_some(), "goal"),
            (!self.nodes.is_empty(), "node"),
            (!self.edges.is_empty(), "edge"),
            (!self.chosen.is_empty(), "node chosen"),
            (walked(true), "walked to the goal"),
            (walked(false), "walked, goal not reached"),
        ];
        let (mut x, mut y) = (MARGIN, frame.y + frame.height + 24.0);
        for (_, word) in shown.iter().filter(|(is_shown, _)| *is_shown) {
            let width = SIGN + LETTER * word.chars().count() as f64;
            if x > MARGIN && x + width > WIDTH - MARGIN {
                (x, y) = (MARGIN, y + LEGEND_ROW);
            }
            let middle = [x + 9.0, y - 4.5];
            let line = format!("M{x:.1} {:.1}h18", middle[1]);
            match *word {
                "start" => circle(svg, "start", middle, 4.5),
                "goal" => {
                    circle(svg, "zone", middle, 6.5);
                    circle(svg, "goal", middle, 2.2);
                }
                "node" => circle(svg, "node", middle, 3.2),
                "edge" => path(svg, "edge", &line),
                "node chosen" => circle(svg, "chosen", middle, 4.2),
                "walked to the goal" => path(svg, way(true), &line),
                _ => {
                    path(svg, way(false), &line);
                    cross(svg, middle);
                }
            }
            text(svg, [x + SIGN, y], "", word);
            x += width + 12.0;
        }
        self.ruler(svg, frame, [x, y])
    }

    /// A length to measure by, to the right of the legend or below it; its lowest pixel.
    fn ruler(&self, svg: &mut String, frame: &Frame, [x, mut y]: [f64; 2]) -> f64 {
        // The longest round length within a quarter of the map.
        let most = WIDTH / 4.0 / frame.scale;
        let power = 10_f64.powf(most.log10().floor());
        let round = [5.0, 2.0, 1.0].map(|factor| factor * power);
        let length = round.into_iter().find(|length| *length <= most);
        let Some(length) = length.filter(|length| *length >= 0.01) else {
            return y + 4.0;
        };
        let label = format!("{length} m");
        let width = length * frame.scale;
        let all = width + 8.0 + LETTER * label.chars().count() as f64;
        let left = WIDTH - MARGIN - all;
        if left < x {
            y += LEGEND_ROW;
        }
        let ends = y - 4.5;
        let line = format!("M{left:.1} {:.1}v6m0 -3h{width:.1}m0 -3v6", ends - 3.0);
        path(svg, "scale", &line);
        let right = [WIDTH - MARGIN, y];
        text(svg, right, "class=\"faint\" text-anchor=\"end\"", &label);
        y + 4.0
    }
}

fn way(success: bool) -> &'static str {
    if success { "walk good" } else { "walk bad" }
}

/// Where a path ended without the goal.
fn cross(svg: &mut String, [x, y]: [f64; 2]) {
    let (left, top) = (x - 3.5, y - 3.5);
    let line = format!("M{left:.1} {top:.1}l7 7m0 -7l-7 7");
    path(svg, "case", &line);
    path(svg, way(false), &line);
}

/// A line through points, broken where it jumps farther than that. A point that stays where the last one is to the
/// tenth of a pixel tells nothing.
fn line(frame: &Frame, points: impl Iterator<Item = [f64; 2]>, jump: f64) -> String {
    let mut line = String::new();
    let mut last: Option<([f64; 2], String)> = None;
    for point in points {
        let [x, y] = frame.at(point);
        let told = format!("{x:.1} {y:.1}");
        let letter = match &last {
            Some((_, before)) if *before == told => continue,
            Some((before, _)) if (point[0] - before[0]).hypot(point[1] - before[1]) <= jump => 'L',
            _ => 'M',
        };
        line.push(letter);
        line.push_str(&told);
        last = Some((point, told));
    }
    line
}

#[cfg(test)]
mod tests;
