//! Configs of the runs, and the keys in which groups differ.

use plot::markup::escaped;
use runs::seeds::{SeedGroup, differing};

use super::html::{Column, Row, folded, paragraph, table};

/// A line of a file, with tabs as spaces.
fn text(line: &str) -> String {
    escaped(&line.replace('\t', "    "))
}

/// The keys that differ, and the config of each group.
pub(super) fn section(groups: &[SeedGroup]) -> String {
    let mut body = String::new();
    if groups.len() > 1 {
        let all: Vec<&SeedGroup> = groups.iter().collect();
        let keys = differing(&all);
        let mut columns = vec![("Key", Column::Text)];
        columns.extend(
            groups
                .iter()
                .map(|group| (group.label.as_str(), Column::Text)),
        );
        let rows: Vec<Row> = keys
            .into_iter()
            .map(|key| {
                let value = |group: &SeedGroup| group.runs[0].config.get(key).cloned();
                let cells = groups
                    .iter()
                    .map(|group| value(group).unwrap_or("–".to_owned()));
                Row {
                    head: key.clone(),
                    cells: cells.collect(),
                    sums_up: false,
                }
            })
            .collect();
        body += &paragraph("Keys in which the groups differ:");
        body += &table("Keys in which the groups differ", &columns, &rows);
    }
    for group in groups {
        let Some(run) = group.runs.first() else {
            continue;
        };
        let others: Vec<&str> = group.runs[1..]
            .iter()
            .map(|run| run.name.as_str())
            .collect();
        let summary = match others.as_slice() {
            [] => format!("config.toml of {}", run.name),
            _ => format!(
                "config.toml of {}; but for name and seed that of {} too",
                run.name,
                others.join(", ")
            ),
        };
        let lines: Vec<String> = run.toml.lines().map(text).collect();
        let text = format!("<pre tabindex=\"0\">{}</pre>\n", lines.join("\n"));
        body += &folded(&summary, false, &text);
    }
    body
}
