//! A chart of lines and bands as one SVG without other files. It follows the viewer's light or dark
//! colour scheme.

mod frame;
mod legend;
mod series;
mod shape;

use std::fmt::Write;

use crate::axis::labels;
use crate::markup::{escaped, text, wrapped};
use frame::{Axes, Frame};
use series::{colour, dash};
use shape::Sizes;

pub use series::{Series, legend_line};
pub use shape::Shape;

/// Every rule starts with the root's class, since a style applies to the whole page.
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

/// A line chart.
#[derive(Default)]
pub struct Chart {
    /// Title.
    pub title: String,
    /// Subtitle, in small print.
    pub subtitle: String,
    /// Label of the horizontal axis.
    pub x_label: String,
    /// Label of the vertical axis.
    pub y_label: String,
    /// End of the horizontal axis, which starts at zero.
    pub x_end: f64,
    /// Values that the vertical axis includes in any case. Bands are then clipped at its ends.
    pub y_range: Option<[f64; 2]>,
    /// The lines, in the order of the legend.
    pub series: Vec<Series>,
}

impl Chart {
    fn frame(&self, sizes: &Sizes, top: f64) -> Frame {
        let axes = Axes {
            series: &self.series,
            x_end: self.x_end,
            y_range: self.y_range,
            y_label: &self.y_label,
        };
        Frame::new(&axes, sizes, top)
    }

    /// Draws the chart as SVG.
    pub fn svg(&self, shape: Shape) -> String {
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
            _ => {
                let y = frame.bottom + labelled + 27.0;
                legend::draw(&mut body, &self.series, &sizes, y)
            }
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

    /// Draws bands below all lines, and dots above them.
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
    fn a_line_spans_the_axes_and_a_band_is_clipped_at_the_range() {
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
    fn styles_apply_to_charts_only() {
        let rules = STYLE.replace("@media screen and (prefers-color-scheme:dark){", "");
        for rule in rules.split('}').filter(|rule| !rule.trim().is_empty()) {
            assert!(rule.starts_with(".chart "), "{rule}");
        }
    }
}
