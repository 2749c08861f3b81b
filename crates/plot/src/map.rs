//! A map of a maze as one SVG: walls, the graph, chosen nodes, paths. It needs no other files, follows
//! the viewer's light or dark colour scheme, and works as a file or within a page.

mod frame;
mod legend;
mod style;

use std::fmt::Write;

use crate::markup::{escaped, text, wrapped};
use frame::{Frame, finite, line};
use style::{MARGIN, STYLE, SUBTITLE, TITLE, WIDTH, circle, cross, path, way};

/// Farther than anything moves in one step (m). A path that jumps farther is broken there.
const JUMP: f64 = 4.0;

/// A path through the maze.
#[derive(Debug, Clone, Copy, Default)]
pub struct Path<'a> {
    /// Position at each step (m).
    pub points: &'a [[f32; 2]],
    /// Whether it reached the goal.
    pub success: bool,
}

/// A map of a maze. Parts that are empty are left out, also from the legend.
#[derive(Default)]
pub struct Map<'a> {
    /// Title.
    pub title: String,
    /// Subtitle, in small print.
    pub subtitle: String,
    /// Walls as boxes: centre x, y, half width, half depth (m).
    pub walls: Vec<[f32; 4]>,
    /// Positions of the nodes of the graph (m).
    pub nodes: &'a [[f32; 2]],
    /// Pairs of nodes. A pair with an unknown node is left out.
    pub edges: &'a [(u32, u32)],
    /// Nodes that were chosen as subgoals, in order.
    pub chosen: &'a [u32],
    /// Paths through the maze.
    pub paths: Vec<Path<'a>>,
    /// Centre of the start (m).
    pub start: Option<[f32; 2]>,
    /// Centre of the goal (m).
    pub goal: Option<[f32; 2]>,
    /// Distance within which the goal counts as reached (m).
    pub goal_radius: f32,
}

impl Map<'_> {
    /// Draws the map as SVG.
    pub fn svg(&self) -> String {
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
                legend::draw(&mut body, &frame, self.parts())
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

    /// Labels of the parts that are drawn.
    fn parts(&self) -> impl Iterator<Item = &'static str> {
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
        let shown = shown.into_iter().filter(|(is_shown, _)| *is_shown);
        shown.map(|(_, label)| label)
    }

    /// All points that must be visible.
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

    /// Position of a node; `None` if there is no such node.
    fn node(&self, node: u32) -> Option<[f64; 2]> {
        self.nodes.get(node as usize).copied().and_then(finite)
    }

    /// Draws the graph, pale if it is only the background of a path. Edges in both directions are one
    /// line.
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
}

#[cfg(test)]
mod tests;
