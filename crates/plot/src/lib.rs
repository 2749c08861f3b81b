//! Charts and maps as SVG, tables and numbers as text. Knows nothing of formica: everything is passed
//! as plain values.

mod axis;
pub mod chart;
pub mod clock;
pub mod map;
pub mod markup;
pub mod number;
pub mod table;
