//! The page itself: HTML that needs no other file and runs no program.

use crate::markup::escaped;

const STYLE: &str = include_str!("page.css");

/// Nothing may be loaded, whatever a text from a run's files comes to hold.
const POLICY: &str = "default-src 'none'; style-src 'unsafe-inline'; img-src data:";

/// A part of the page with a heading. Its body is HTML.
pub(crate) struct Section {
    pub(crate) id: &'static str,
    pub(crate) heading: &'static str,
    pub(crate) body: String,
}

/// The whole page; `head` is HTML, the title is not.
pub(crate) fn page(title: &str, head: &str, sections: &[Section]) -> String {
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

/// How a figure's pictures are laid out.
#[derive(Clone, Copy)]
pub(crate) enum Layout {
    /// One, no wider than is good for it.
    One,
    /// A grid.
    Many,
    /// A grid of pictures that want more room.
    Maps,
    /// The first for screens, the second for phones.
    Either,
}

/// A figure of SVGs; its caption is HTML.
pub(crate) fn figure(id: &str, layout: Layout, pictures: &[String], caption: &str) -> String {
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

/// What stands in a figure's or a table's place when there is nothing to show.
pub(crate) fn absent(text: &str) -> String {
    format!("<p class=\"absent\">{}</p>\n", escaped(text))
}

/// A paragraph.
pub(crate) fn paragraph(text: &str) -> String {
    format!("<p>{}</p>\n", escaped(text))
}

/// A row of a table: what it is of, its cells, and whether it tells of the rows before it.
pub(crate) struct Row {
    pub(crate) head: String,
    pub(crate) cells: Vec<String>,
    pub(crate) sums_up: bool,
}

/// How a column is set.
#[derive(Clone, Copy, PartialEq)]
pub(crate) enum Column {
    Number,
    Text,
    /// Sentences, which need some room.
    Told,
}

/// A table in a box that scrolls by itself. All texts are plain.
pub(crate) fn table(name: &str, columns: &[(&str, Column)], rows: &[Row]) -> String {
    let class = |column: Column| match column {
        Column::Number => " class=\"number\"",
        Column::Text => "",
        Column::Told => " class=\"told\"",
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
    // What scrolls must be reached by keys as well.
    format!(
        "<div class=\"scroll\" role=\"region\" tabindex=\"0\" aria-label=\"{name}\">\n\
         <table>\n<thead><tr>{head}</tr></thead>\n<tbody>\n{body}</tbody>\n</table>\n</div>\n",
        name = escaped(name)
    )
}

/// What opens when it is asked for; the body is HTML.
pub(crate) fn folded(summary: &str, open: bool, body: &str) -> String {
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
    fn what_comes_from_files_is_escaped() {
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
    fn a_page_names_its_sections_and_loads_nothing() {
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
    fn figures_have_a_place_for_each_of_their_pictures() {
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
