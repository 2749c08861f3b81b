//! Layouts of a chart.

/// Layout of a chart.
#[derive(Clone, Copy)]
pub enum Shape {
    /// For a screen, or as a file of its own.
    Wide,
    /// For a phone.
    Narrow,
    /// One of many: narrow, lower, without a legend.
    Small,
}

/// Sizes of a layout, in pixels.
pub(super) struct Sizes {
    pub(super) width: f64,
    pub(super) margin: f64,
    /// Height of the plot area.
    pub(super) height: f64,
    /// Maximum intervals between ticks of x and y. With few, much of an axis could stay empty.
    pub(super) intervals: [usize; 2],
    /// Characters per line of title and subtitle.
    pub(super) letters: [usize; 2],
    /// Maximum characters of a legend label. A longer one would overlap the note or the edge.
    pub(super) label: usize,
    /// Whether the legend's notes are below the labels.
    pub(super) beneath: bool,
}

impl Shape {
    pub(super) fn sizes(self) -> Sizes {
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
