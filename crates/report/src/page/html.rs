//! HTML that needs no other file and runs no script.

use plot::markup::escaped;

const STYLE: &str = include_str!("page.css");

/// Forbids loading anything, whatever texts from files of a run contain.
const POLICY: &str = "default-src 'none'; style-src 'unsafe-inline'; img-src data:";

/// A section of the page. Its body is HTML.
pub(super) struct Section {
    pub(super) id: &'static str,
    pub(super) heading: &'static str,
    pub(super) body: String,
}

/// The whole page. `head` is HTML, `title` is plain text.
pub(super) fn page(title: &str, head: &str, sections: &[Section]) -> String {
    let title = escaped(title);
    let version = env!("CARGO_PKG_VERSION");
    let (mut links, mut parts) = (String::new(), String::new());
    for Section { id, heading, body } in sections {
        links += &format!("<li><a href=\"#{id}\">{heading}</a></li>\n");
        parts += &format!(
            "<section id=\"{id}\" aria-labelledby=\"{id}-heading\">\n\
             <h2 id=\"{id}-heading\">{heading}</h2>\n{body}</section>\n"
        );
    }
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <meta name=\"color-scheme\" content=\"light dark\">\n\
         <meta http-equiv=\"Content-Security-Policy\" content=\"{POLICY}\">\n\
         <meta name=\"generator\" content=\"formica {version}\">\n\
         <link rel=\"icon\" href=\"data:,\">\n<title>{title}</title>\n\
         <style>\n{STYLE}</style>\n</head>\n<body>\n<header id=\"head\">\n{head}\
         <nav aria-label=\"Sections\">\n<ul>\n{links}</ul>\n</nav>\n</header>\n\
         <main>\n{parts}</main>\n\
         <footer>Written by formica {version}. This file needs no other.</footer>\n\
         </body>\n</html>\n"
    )
}

/// Layout of the images of a figure.
#[derive(Clone, Copy)]
pub(super) enum Layout {
    /// One image of limited width.
    One,
    /// A grid of small images.
    Many,
    /// A grid of larger images.
    Maps,
    /// The first for screens, the second for phones.
    Either,
}

/// A figure of SVGs. Its caption is HTML.
pub(super) fn figure(id: &str, layout: Layout, pictures: &[String], caption: &str) -> String {
    let card = |class: &str, svg: &String| format!("<div class=\"card{class}\">\n{svg}</div>\n");
    let body: String = match (layout, pictures) {
        (Layout::Either, [wide, narrow]) => card(" wide", wide) + &card(" narrow", narrow),
        (Layout::One, [one]) => card(" one", one),
        _ => {
            let cards: String = pictures.iter().map(|svg| card("", svg)).collect();
            let maps = match layout {
                Layout::Maps => " maps",
                _ => "",
            };
            format!("<div class=\"many{maps}\">\n{cards}</div>\n")
        }
    };
    format!("<figure id=\"{id}\">\n{body}<figcaption>{caption}</figcaption>\n</figure>\n")
}

/// A message in place of a figure or a table.
pub(super) fn absent(text: &str) -> String {
    format!("<p class=\"absent\">{}</p>\n", escaped(text))
}

/// A paragraph.
pub(super) fn paragraph(text: &str) -> String {
    format!("<p>{}</p>\n", escaped(text))
}

/// A row of a table: its header, its cells, and whether it summarizes the rows before it.
pub(super) struct Row {
    pub(super) head: String,
    pub(super) cells: Vec<String>,
    pub(super) sums_up: bool,
}

/// Layout of a column.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Column {
    Number,
    Text,
    /// Sentences, which need more room.
    Sentence,
}

/// A table in a scrollable box. All texts are plain.
pub(super) fn table(name: &str, columns: &[(&str, Column)], rows: &[Row]) -> String {
    let class = |column: Column| match column {
        Column::Number => " class=\"number\"",
        Column::Text => "",
        Column::Sentence => " class=\"told\"",
    };
    let mut head = String::new();
    for (title, column) in columns {
        let title = escaped(title);
        head += &format!("<th scope=\"col\"{}>{title}</th>", class(*column));
    }
    let mut body = String::new();
    for row in rows {
        let group = if row.sums_up { " class=\"group\"" } else { "" };
        body += &format!("<tr{group}><th scope=\"row\">{}</th>", escaped(&row.head));
        for (cell, (_, column)) in row.cells.iter().zip(columns.iter().skip(1)) {
            body += &format!("<td{}>{}</td>", class(*column), escaped(cell));
        }
        body += "</tr>\n";
    }
    // A scrollable box must be reachable by keyboard.
    format!(
        "<div class=\"scroll\" role=\"region\" tabindex=\"0\" aria-label=\"{name}\">\n\
         <table>\n<thead><tr>{head}</tr></thead>\n<tbody>\n{body}</tbody>\n</table>\n</div>\n",
        name = escaped(name)
    )
}

/// A part that opens on a click. The body is HTML.
pub(super) fn folded(summary: &str, open: bool, body: &str) -> String {
    let open = if open { " open" } else { "" };
    format!(
        "<details{open}>\n<summary>{}</summary>\n{body}</details>\n",
        escaped(summary)
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_are_escaped() {
        let row = Row {
            head: "<h>".into(),
            cells: vec!["<c>".into()],
            sums_up: true,
        };
        let columns = [("<t>", Column::Text), ("<u>", Column::Number)];
        let parts = [
            table("<n>", &columns, &[row]),
            absent("<a>"),
            paragraph("<p>"),
            folded("<s>", false, ""),
            page("<title>", "", &[]),
        ];
        let all = parts.concat();
        for text in ["h", "c", "t", "u", "n", "a", "p", "s", "title"] {
            assert!(all.contains(&format!("&lt;{text}&gt;")), "{text} in {all}");
        }
        for text in ["<c>", "<t>", "<n>"] {
            assert!(!all.contains(text), "{text} in {all}");
        }
    }

    #[test]
    fn a_page_links_its_sections_and_loads_nothing() {
        let section = Section {
            id: "scores",
            heading: "Scores",
            body: "<p>body</p>\n".into(),
        };
        let page = page("t", "<h1>t</h1>\n", &[section]);
        assert!(page.contains("<a href=\"#scores\">Scores</a>"), "{page}");
        assert!(page.contains("<section id=\"scores\""), "{page}");
        for absent in ["<script", "url(", "@import", "http:", "https:", "src=\""] {
            assert!(!page.contains(absent), "{absent}");
        }
    }

    #[test]
    fn figures_have_a_card_for_each_image() {
        let svgs = ["<svg>1</svg>".to_owned(), "<svg>2</svg>".to_owned()];
        for (layout, pictures, class) in [
            (Layout::One, &svgs[..1], "card one"),
            (Layout::Either, &svgs[..], "card narrow"),
            (Layout::Many, &svgs[..], "many"),
            (Layout::Maps, &svgs[..], "many maps"),
        ] {
            let figure = figure("f", layout, pictures, "caption");
            assert!(figure.contains(&format!("class=\"{class}\"")), "{figure}");
            assert_eq!(figure.matches("<svg>").count(), pictures.len(), "{figure}");
        }
    }
}
