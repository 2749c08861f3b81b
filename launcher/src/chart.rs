//! A chart of lines and bands as one SVG: it needs no other file, and follows the reader's light or
//! dark scheme.

use std::fmt::Write;

use crate::axis::{labels, ticks};
use crate::markup::{escaped, text};

/// Okabe and Ito's colours, told apart by colour-blind eyes too, without those that are lost on a
/// white or a black ground. Further groups take them again, dashed.
const COLOURS: [&str; 6] = [
    "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9",
];
const DASHES: [&str; 3] = ["none", "9 4", "3 3"];

/// Everything is in pixels of a picture this wide.
const WIDTH: f64 = 860.0;
const MARGIN: f64 = 24.0;
const TOP: f64 = 72.0;
const BOTTOM: f64 = 452.0;
const LEGEND: f64 = BOTTOM + 68.0;
const LEGEND_ROW: f64 = 22.0;
/// Of a character of a tick's label.
const LETTER: f64 = 7.5;
/// Intervals between the ticks of x and y, at most: with few, much of an axis could stay empty.
const INTERVALS: [usize; 2] = [15, 12];
/// Characters of a label in the legend; longer ones would run into the note.
const LABEL: usize = 68;

const STYLE: &str = "text{font:13px system-ui,'DejaVu Sans',sans-serif;fill:#1f2328}\
    .title{font-size:17px;font-weight:600}.faint{font-size:12px;fill:#59636e}\
    .paper{fill:#ffffff}.dot{stroke:#ffffff;stroke-width:1.5}.grid{stroke:#d8dee4}\
    .axis{stroke:#59636e}.band{fill-opacity:.18}.thin{stroke-opacity:.5}path{stroke-linecap:round;stroke-linejoin:round}\
    @media(prefers-color-scheme:dark){text{fill:#e6edf3}.faint{fill:#9aa4ae}\
    .paper{fill:#15191e}.dot{stroke:#15191e}.grid{stroke:#343b43}.axis{stroke:#9aa4ae}\
    .band{fill-opacity:.3}.thin{stroke-opacity:.7}}";

/// What one colour shows.
#[derive(Default)]
pub(crate) struct Series {
    pub(crate) label: String,
    /// Told at the end of the legend's row.
    pub(crate) note: String,
    pub(crate) thin: Vec<Vec<[f64; 2]>>,
    pub(crate) bold: Vec<[f64; 2]>,
    /// x, lower and upper bound.
    pub(crate) band: Vec<[f64; 3]>,
    pub(crate) dots: Vec<[f64; 2]>,
}

pub(crate) struct Chart {
    pub(crate) title: String,
    pub(crate) subtitle: String,
    pub(crate) x_label: String,
    pub(crate) y_label: String,
    /// The horizontal axis goes from zero to here.
    pub(crate) x_end: f64,
    /// Values that the vertical axis shows in any case; bands are then cut off where it ends.
    pub(crate) y_range: Option<[f64; 2]>,
    pub(crate) series: Vec<Series>,
}

/// From values to pixels.
struct Frame {
    x: Vec<f64>,
    y: Vec<f64>,
    left: f64,
}

impl Frame {
    fn x(&self, value: f64) -> f64 {
        self.left + share(&self.x, value) * (WIDTH - MARGIN - self.left)
    }

    fn y(&self, value: f64) -> f64 {
        BOTTOM + share(&self.y, value) * (TOP - BOTTOM)
    }

    /// A path through points; one point alone is a dot of the line's width.
    fn path(&self, points: impl Iterator<Item = [f64; 2]>) -> String {
        let mut text = String::new();
        for [x, y] in points {
            let letter = if text.is_empty() { 'M' } else { 'L' };
            let _ = write!(text, "{letter}{:.1} {:.1}", self.x(x), self.y(y));
        }
        if !text.is_empty() && !text.contains('L') {
            text.push_str("h0");
        }
        text
    }
}

/// Where a value lies between the first and the last tick.
fn share(ticks: &[f64], value: f64) -> f64 {
    let (low, high) = (ticks[0], ticks[ticks.len() - 1]);
    ((value - low) / (high - low)).clamp(0.0, 1.0)
}

impl Chart {
    fn frame(&self) -> Frame {
        let lines = |series: &Series| -> Vec<f64> {
            let points = series.thin.iter().flatten();
            let points = points.chain(&series.bold).chain(&series.dots);
            points.map(|[_, y]| *y).collect()
        };
        let mut values: Vec<f64> = self.series.iter().flat_map(lines).collect();
        let bands = self.series.iter().flat_map(|series| &series.band);
        let bands = bands.flat_map(|[_, low, high]| [*low, *high]);
        match self.y_range {
            Some(range) => values.extend(range),
            None => values.extend(bands),
        }
        let low = values.iter().copied().reduce(f64::min).unwrap_or(0.0);
        let high = values.iter().copied().reduce(f64::max).unwrap_or(0.0);
        let y = ticks(low, high, INTERVALS[1]);
        let longest = labels(&y).iter().map(|label| label.chars().count()).max();
        Frame {
            x: ticks(0.0, self.x_end, INTERVALS[0]),
            y,
            left: MARGIN + 30.0 + LETTER * longest.unwrap_or(0) as f64,
        }
    }

    /// The picture.
    pub(crate) fn svg(&self) -> String {
        let frame = self.frame();
        let height = LEGEND + LEGEND_ROW * self.series.len() as f64;
        let mut svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {height}\" \
             width=\"{WIDTH}\" height=\"{height}\" role=\"img\">\n<title>{}</title>\n\
             <style>{STYLE}</style>\n<rect class=\"paper\" width=\"100%\" height=\"100%\"/>\n",
            escaped(&self.title)
        );
        text(&mut svg, [MARGIN, 32.0], "class=\"title\"", &self.title);
        text(&mut svg, [MARGIN, 52.0], "class=\"faint\"", &self.subtitle);
        self.axes(&mut svg, &frame);
        self.curves(&mut svg, &frame);
        self.legend(&mut svg);
        svg.push_str("</svg>\n");
        svg
    }

    fn axes(&self, svg: &mut String, frame: &Frame) {
        let (left, right) = (frame.left, WIDTH - MARGIN);
        for (y, label) in frame.y.iter().zip(labels(&frame.y)) {
            let y = frame.y(*y);
            let _ = writeln!(svg, "<path class=\"grid\" d=\"M{left} {y:.1}H{right}\"/>");
            text(svg, [left - 8.0, y + 4.5], "text-anchor=\"end\"", &label);
        }
        for (x, label) in frame.x.iter().zip(labels(&frame.x)) {
            let (x, end) = (frame.x(*x), BOTTOM + 5.0);
            let _ = writeln!(svg, "<path class=\"axis\" d=\"M{x:.1} {BOTTOM}V{end}\"/>");
            text(svg, [x, BOTTOM + 20.0], "text-anchor=\"middle\"", &label);
        }
        let axis = format!("M{left} {TOP}V{BOTTOM}H{right}");
        let _ = writeln!(svg, "<path class=\"axis\" fill=\"none\" d=\"{axis}\"/>");
        let place = [f64::midpoint(left, right), BOTTOM + 41.0];
        text(svg, place, "text-anchor=\"middle\"", &self.x_label);
        let (x, y) = (MARGIN + 8.0, f64::midpoint(TOP, BOTTOM));
        let turned = format!("text-anchor=\"middle\" transform=\"rotate(-90 {x} {y})\"");
        text(svg, [x, y], &turned, &self.y_label);
    }

    /// Bands lie below all lines, dots above them.
    fn curves(&self, svg: &mut String, frame: &Frame) {
        let coloured = || {
            let series = self.series.iter().enumerate();
            series.map(|(i, series)| (colour(i), dash(i), series))
        };
        for (colour, _, Series { band, .. }) in coloured() {
            let above = band.iter().map(|[x, _, high]| [*x, *high]);
            let below = band.iter().rev().map(|[x, low, _]| [*x, *low]);
            let path = frame.path(above.chain(below));
            if !path.is_empty() {
                let class = format!("class=\"band\" fill=\"{colour}\"");
                let _ = writeln!(svg, "<path {class} d=\"{path}Z\"/>");
            }
        }
        for (colour, dash, series) in coloured() {
            let thin = series.thin.iter().map(|line| (line, "thin", 1.0));
            for (line, class, width) in thin.chain([(&series.bold, "bold", 2.5)]) {
                let path = frame.path(line.iter().copied());
                if !path.is_empty() {
                    let _ = writeln!(
                        svg,
                        "<path class=\"{class}\" fill=\"none\" stroke=\"{colour}\" \
                         stroke-width=\"{width}\" stroke-dasharray=\"{dash}\" d=\"{path}\"/>"
                    );
                }
            }
        }
        for (colour, _, series) in coloured() {
            for [x, y] in &series.dots {
                let (x, y) = (frame.x(*x), frame.y(*y));
                let place = format!("cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"5\"");
                let _ = writeln!(svg, "<circle class=\"dot\" fill=\"{colour}\" {place}/>");
            }
        }
    }

    fn legend(&self, svg: &mut String) {
        for (i, series) in self.series.iter().enumerate() {
            let y = LEGEND + LEGEND_ROW * i as f64;
            let (colour, dash) = (colour(i), dash(i));
            let _ = writeln!(
                svg,
                "<path stroke=\"{colour}\" stroke-width=\"4\" stroke-dasharray=\"{dash}\" \
                 d=\"M{} {}h28\"/>",
                MARGIN + 2.0,
                y - 4.5
            );
            let mut label = series.label.clone();
            if let Some((end, _)) = label.char_indices().nth(LABEL) {
                label.truncate(end);
                label.push('…');
            }
            text(svg, [MARGIN + 42.0, y], "", &label);
            let right = [WIDTH - MARGIN, y];
            text(svg, right, "text-anchor=\"end\"", &series.note);
        }
    }
}

fn colour(series: usize) -> &'static str {
    COLOURS[series % COLOURS.len()]
}

fn dash(series: usize) -> &'static str {
    DASHES[series / COLOURS.len() % DASHES.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_is_escaped() {
        let chart = Chart {
            title: "<t>".into(),
            subtitle: "&s".into(),
            x_label: "x<".into(),
            y_label: "y<".into(),
            x_end: 1.0,
            y_range: None,
            series: vec![Series {
                label: "<l>".into(),
                note: "n&".into(),
                ..Series::default()
            }],
        };
        let svg = chart.svg();
        for text in [
            "&lt;t&gt;",
            "&amp;s",
            "x&lt;",
            "y&lt;",
            "&lt;l&gt;",
            "n&amp;",
        ] {
            assert!(svg.contains(&format!(">{text}</")), "{text} in {svg}");
        }
    }

    #[test]
    fn a_line_spans_the_axes_and_a_band_is_cut_at_the_range() {
        let chart = Chart {
            title: String::new(),
            subtitle: String::new(),
            x_label: String::new(),
            y_label: String::new(),
            x_end: 10.0,
            y_range: Some([0.0, 100.0]),
            series: vec![Series {
                thin: vec![vec![[5.0, 50.0]]],
                bold: vec![[0.0, 0.0], [10.0, 100.0]],
                band: vec![[0.0, -20.0, 20.0], [10.0, 80.0, 120.0]],
                ..Series::default()
            }],
        };
        let (svg, frame) = (chart.svg(), chart.frame());
        let (left, right) = (frame.left, WIDTH - MARGIN);
        let bold = format!("d=\"M{left:.1} {BOTTOM:.1}L{right:.1} {TOP:.1}\"");
        assert!(svg.contains(&bold), "{bold} in {svg}");
        let middle = format!("M{:.1} 262.0h0", f64::midpoint(left, right));
        assert!(svg.contains(&middle), "{middle} in {svg}");
        let cut = format!("L{right:.1} {TOP:.1}L{right:.1} 148.0L{left:.1} {BOTTOM:.1}Z");
        assert!(svg.contains(&cut), "{cut} in {svg}");
    }
}
