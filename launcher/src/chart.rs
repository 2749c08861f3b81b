//! A chart of lines and bands as one SVG: it needs no other file, and follows the reader's light or
//! dark scheme.

use std::fmt::Write;

use crate::axis::{labels, ticks};
use crate::markup::{escaped, text, wrapped};

/// Okabe and Ito's colours, told apart by colour-blind eyes too, without those that are lost on a
/// white or a black ground. Further groups take them again, dashed.
const COLOURS: [&str; 6] = [
    "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9",
];
const DASHES: [&str; 3] = ["none", "9 4", "3 3"];

/// Of a character of a tick's label (px).
const LETTER: f64 = 7.5;
const LEGEND_ROW: f64 = 22.0;

/// How a chart is laid out. Everything is in pixels of a picture of its width.
#[derive(Clone, Copy)]
pub(crate) enum Shape {
    /// For a screen, or alone.
    Wide,
    /// For a phone: its text stays readable there.
    Narrow,
    /// One of many: as narrow, less high, without a legend.
    Small,
}

struct Sizes {
    width: f64,
    margin: f64,
    /// Of the part with the curves.
    height: f64,
    /// Intervals between the ticks of x and y, at most: with few, much of an axis could stay empty.
    intervals: [usize; 2],
    /// Characters of a line of title and subtitle.
    letters: [usize; 2],
    /// Characters of a label in the legend; longer ones would run into the note, or the edge.
    label: usize,
    /// Whether the legend's notes stand beneath the labels.
    beneath: bool,
}

impl Shape {
    fn sizes(self) -> Sizes {
        let narrow = Sizes {
            width: 400.0,
            margin: 14.0,
            height: 250.0,
            intervals: [7, 8],
            letters: [42, 60],
            label: 46,
            beneath: true,
        };
        match self {
            Self::Wide => Sizes {
                width: 860.0,
                margin: 24.0,
                height: 380.0,
                intervals: [15, 12],
                letters: [usize::MAX; 2],
                label: 68,
                beneath: false,
            },
            Self::Narrow => narrow,
            Self::Small => Sizes {
                height: 170.0,
                intervals: [7, 6],
                ..narrow
            },
        }
    }
}

/// Every rule begins with the root's class: in a page a style holds for the whole page.
const STYLE: &str = "\
    .chart text{font:13px system-ui,'DejaVu Sans',sans-serif;fill:#1f2328}\
    .chart .title{font-size:17px;font-weight:600}.chart .faint{font-size:12px;fill:#59636e}\
    .chart .paper{fill:#ffffff}.chart .dot{stroke:#ffffff;stroke-width:1.5}\
    .chart .grid{stroke:#d8dee4}.chart .axis{stroke:#59636e}\
    .chart .band{fill-opacity:.18}.chart .thin{stroke-opacity:.5}\
    .chart path{stroke-linecap:round;stroke-linejoin:round}\
    @media screen and (prefers-color-scheme:dark){\
    .chart text{fill:#e6edf3}.chart .faint{fill:#9aa4ae}\
    .chart .paper{fill:#15191e}.chart .dot{stroke:#15191e}\
    .chart .grid{stroke:#343b43}.chart .axis{stroke:#9aa4ae}\
    .chart .band{fill-opacity:.3}.chart .thin{stroke-opacity:.7}}";

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

#[derive(Default)]
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
    right: f64,
    top: f64,
    bottom: f64,
}

impl Frame {
    fn x(&self, value: f64) -> f64 {
        self.left + share(&self.x, value) * (self.right - self.left)
    }

    fn y(&self, value: f64) -> f64 {
        self.bottom + share(&self.y, value) * (self.top - self.bottom)
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
    fn frame(&self, sizes: &Sizes, top: f64) -> Frame {
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
        let y = ticks(low, high, sizes.intervals[1]);
        let longest = labels(&y).iter().map(|label| label.chars().count()).max();
        let label = if self.y_label.is_empty() { 10.0 } else { 30.0 };
        Frame {
            x: ticks(0.0, self.x_end, sizes.intervals[0]),
            y,
            left: sizes.margin + label + LETTER * longest.unwrap_or(0) as f64,
            right: sizes.width - sizes.margin,
            top,
            bottom: top + sizes.height,
        }
    }

    /// The picture.
    pub(crate) fn svg(&self, shape: Shape) -> String {
        let sizes = shape.sizes();
        let Sizes { width, margin, .. } = sizes;
        let mut body = String::new();
        let mut y = margin - 12.0;
        for line in wrapped(&self.title, sizes.letters[0]) {
            y += 20.0;
            text(&mut body, [margin, y], "class=\"title\"", &line);
        }
        y += 4.0;
        for line in wrapped(&self.subtitle, sizes.letters[1]) {
            y += 16.0;
            text(&mut body, [margin, y], "class=\"faint\"", &line);
        }
        let frame = self.frame(&sizes, y + 20.0);
        self.axes(&mut body, &frame, margin);
        self.curves(&mut body, &frame);
        let labelled = if self.x_label.is_empty() { 20.0 } else { 41.0 };
        let height = match shape {
            Shape::Small => frame.bottom + labelled + 8.0,
            _ => self.legend(&mut body, &sizes, frame.bottom + labelled + 27.0),
        };
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" class=\"chart\" \
             viewBox=\"0 0 {width} {height}\" width=\"{width}\" height=\"{height}\" \
             role=\"img\">\n<title>{}</title>\n<style>{STYLE}</style>\n\
             <rect class=\"paper\" width=\"100%\" height=\"100%\"/>\n{body}</svg>\n",
            escaped(&self.title)
        )
    }

    fn axes(&self, svg: &mut String, frame: &Frame, margin: f64) {
        let Frame {
            left,
            right,
            top,
            bottom,
            ..
        } = *frame;
        for (y, label) in frame.y.iter().zip(labels(&frame.y)) {
            let y = frame.y(*y);
            let _ = writeln!(svg, "<path class=\"grid\" d=\"M{left} {y:.1}H{right}\"/>");
            text(svg, [left - 8.0, y + 4.5], "text-anchor=\"end\"", &label);
        }
        for (x, label) in frame.x.iter().zip(labels(&frame.x)) {
            let (x, end) = (frame.x(*x), bottom + 5.0);
            let _ = writeln!(svg, "<path class=\"axis\" d=\"M{x:.1} {bottom}V{end}\"/>");
            text(svg, [x, bottom + 20.0], "text-anchor=\"middle\"", &label);
        }
        let axis = format!("M{left} {top}V{bottom}H{right}");
        let _ = writeln!(svg, "<path class=\"axis\" fill=\"none\" d=\"{axis}\"/>");
        if !self.x_label.is_empty() {
            let place = [f64::midpoint(left, right), bottom + 41.0];
            text(svg, place, "text-anchor=\"middle\"", &self.x_label);
        }
        if !self.y_label.is_empty() {
            let (x, y) = (margin + 8.0, f64::midpoint(top, bottom));
            let turned = format!("text-anchor=\"middle\" transform=\"rotate(-90 {x} {y})\"");
            text(svg, [x, y], &turned, &self.y_label);
        }
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

    /// The legend, its first row at `y`; the height of the whole picture.
    fn legend(&self, svg: &mut String, sizes: &Sizes, mut y: f64) -> f64 {
        let margin = sizes.margin;
        for (i, series) in self.series.iter().enumerate() {
            let sign = stroke(i, [margin + 2.0, y - 4.5]);
            let _ = writeln!(svg, "{sign}");
            let mut label = series.label.clone();
            if let Some((end, _)) = label.char_indices().nth(sizes.label) {
                label.truncate(end);
                label.push('…');
            }
            text(svg, [margin + 42.0, y], "", &label);
            if sizes.beneath && !series.note.is_empty() {
                y += 16.0;
                text(svg, [margin + 42.0, y], "class=\"faint\"", &series.note);
            } else {
                let right = [sizes.width - margin, y];
                text(svg, right, "text-anchor=\"end\"", &series.note);
            }
            y += LEGEND_ROW;
        }
        y
    }
}

/// The legend's sign for a series.
fn stroke(series: usize, [x, y]: [f64; 2]) -> String {
    let (colour, dash) = (colour(series), dash(series));
    format!(
        "<path stroke=\"{colour}\" stroke-width=\"4\" stroke-dasharray=\"{dash}\" \
         d=\"M{x} {y}h28\"/>"
    )
}

/// The same for a legend outside of a chart.
pub(crate) fn sign(series: usize) -> String {
    let stroke = stroke(series, [2.0, 5.0]);
    format!(
        "<svg class=\"chart sign\" viewBox=\"0 0 32 10\" width=\"32\" height=\"10\" \
         aria-hidden=\"true\">{stroke}</svg>"
    )
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
        let svg = chart.svg(Shape::Wide);
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
            title: "t".into(),
            subtitle: "s".into(),
            x_end: 10.0,
            y_range: Some([0.0, 100.0]),
            series: vec![Series {
                thin: vec![vec![[5.0, 50.0]]],
                bold: vec![[0.0, 0.0], [10.0, 100.0]],
                band: vec![[0.0, -20.0, 20.0], [10.0, 80.0, 120.0]],
                ..Series::default()
            }],
            ..Chart::default()
        };
        let svg = chart.svg(Shape::Wide);
        let sizes = Shape::Wide.sizes();
        let frame = chart.frame(&sizes, 72.0);
        let Frame {
            left,
            right,
            top,
            bottom,
            ..
        } = frame;
        let bold = format!("d=\"M{left:.1} {bottom:.1}L{right:.1} {top:.1}\"");
        assert!(svg.contains(&bold), "{bold} in {svg}");
        let middle = format!("M{:.1} 262.0h0", f64::midpoint(left, right));
        assert!(svg.contains(&middle), "{middle} in {svg}");
        let cut = format!("L{right:.1} {top:.1}L{right:.1} 148.0L{left:.1} {bottom:.1}Z");
        assert!(svg.contains(&cut), "{cut} in {svg}");
    }
    #[test]
    fn a_narrow_chart_breaks_its_lines_and_a_small_one_has_no_legend() {
        let chart = Chart {
            title: "one word after another ".repeat(4),
            x_end: 1.0,
            series: vec![Series {
                label: "label".into(),
                note: "note".into(),
                bold: vec![[0.0, 0.0], [1.0, 1.0]],
                ..Series::default()
            }],
            ..Chart::default()
        };
        let titles = |svg: &str| svg.matches("class=\"title\"").count();
        let (narrow, small) = (chart.svg(Shape::Narrow), chart.svg(Shape::Small));
        assert_eq!((titles(&narrow), titles(&chart.svg(Shape::Wide))), (3, 1));
        assert!(
            narrow.contains(">label<") && narrow.contains(">note<"),
            "{narrow}"
        );
        assert!(
            !small.contains(">label<") && !small.contains(">note<"),
            "{small}"
        );
    }

    #[test]
    fn a_style_in_a_page_holds_for_its_own_charts_alone() {
        let rules = STYLE.replace("@media screen and (prefers-color-scheme:dark){", "");
        for rule in rules.split('}').filter(|rule| !rule.trim().is_empty()) {
            assert!(rule.starts_with(".chart "), "{rule}");
        }
    }
}
