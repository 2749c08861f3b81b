//! Sizes, styles and shapes of a map.

use std::fmt::Write;

/// Width of the image (px): that of a phone, so that its text stays readable there.
pub(super) const WIDTH: f64 = 400.0;
pub(super) const MARGIN: f64 = 14.0;
/// Maximum height of the map (px).
pub(super) const MAP_HEIGHT: f64 = 460.0;
/// Characters per line of title and subtitle.
pub(super) const TITLE: usize = 42;
pub(super) const SUBTITLE: usize = 60;
pub(super) const LEGEND_ROW: f64 = 22.0;
/// Width of a character of the legend, and of the symbol before a label (px).
pub(super) const LETTER: f64 = 7.0;
pub(super) const SIGN: f64 = 24.0;

/// Every rule starts with the root's class, since a style applies to the whole page.
pub(super) const STYLE: &str = "\
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

pub(super) fn circle(svg: &mut String, class: &str, [x, y]: [f64; 2], radius: f64) {
    let place = format!("cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{radius:.1}\"");
    let _ = writeln!(svg, "<circle class=\"{class}\" {place}/>");
}

pub(super) fn path(svg: &mut String, class: &str, line: &str) {
    if !line.is_empty() {
        let _ = writeln!(svg, "<path class=\"{class}\" d=\"{line}\"/>");
    }
}

pub(super) fn way(success: bool) -> &'static str {
    if success { "walk good" } else { "walk bad" }
}

/// Marks the end of a path that did not reach the goal.
pub(super) fn cross(svg: &mut String, [x, y]: [f64; 2]) {
    let (left, top) = (x - 3.5, y - 3.5);
    let line = format!("M{left:.1} {top:.1}l7 7m0 -7l-7 7");
    path(svg, "case", &line);
    path(svg, way(false), &line);
}
