//! Tables as text.

/// Lines with aligned columns: the first column to the left, the others to the right.
pub fn aligned<C: AsRef<str>, L: AsRef<[C]>>(lines: &[L]) -> String {
    let mut widths: Vec<usize> = vec![];
    for line in lines {
        for (column, cell) in line.as_ref().iter().enumerate() {
            let width = cell.as_ref().chars().count();
            match widths.get_mut(column) {
                Some(widest) => *widest = width.max(*widest),
                None => widths.push(width),
            }
        }
    }
    let mut text = String::new();
    for line in lines {
        for (column, (cell, width)) in line.as_ref().iter().zip(&widths).enumerate() {
            let (cell, width) = (cell.as_ref(), *width);
            text += &match column {
                0 => format!("{cell:<width$}"),
                _ => format!("  {cell:>width$}"),
            };
        }
        text.push('\n');
    }
    text
}
