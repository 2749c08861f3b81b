//! A series of a chart, its colour and its line.

/// Okabe and Ito's colours, which colour-blind people can distinguish, without those of low contrast
/// on white or black. Further series repeat the colours with dashed lines.
const COLOURS: [&str; 6] = [
    "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9",
];
const DASHES: [&str; 3] = ["none", "9 4", "3 3"];

/// The lines of one colour.
#[derive(Default)]
pub struct Series {
    /// Its name in the legend.
    pub label: String,
    /// Shown at the end of its legend row.
    pub note: String,
    /// Thin lines: x and y of each point.
    pub thin: Vec<Vec<[f64; 2]>>,
    /// The bold line: x and y of each point.
    pub bold: Vec<[f64; 2]>,
    /// x, lower and upper bound.
    pub band: Vec<[f64; 3]>,
    /// x and y of each dot.
    pub dots: Vec<[f64; 2]>,
}

/// The legend's line for a series.
pub(super) fn stroke(series: usize, [x, y]: [f64; 2]) -> String {
    let (colour, dash) = (colour(series), dash(series));
    format!(
        "<path stroke=\"{colour}\" stroke-width=\"4\" stroke-dasharray=\"{dash}\" \
         d=\"M{x} {y}h28\"/>"
    )
}

/// The legend line of a series as an SVG, for a legend outside of a chart.
pub fn legend_line(series: usize) -> String {
    let stroke = stroke(series, [2.0, 5.0]);
    format!(
        "<svg class=\"chart sign\" viewBox=\"0 0 32 10\" width=\"32\" height=\"10\" \
         aria-hidden=\"true\">{stroke}</svg>"
    )
}

/// Colour of a series, by its index.
pub(super) fn colour(series: usize) -> &'static str {
    COLOURS[series % COLOURS.len()]
}

/// Dash pattern of a series, by its index.
pub(super) fn dash(series: usize) -> &'static str {
    DASHES[series / COLOURS.len() % DASHES.len()]
}
