//! Plots as SVG and self-contained HTML pages for measured results.
//!
//! Nothing here knows of trees or meshes: numbers and text go in, one string
//! comes out. The same input always gives the same bytes.
//!
//! ```
//! use splitcast_report::{Axis, Figure, Page, Plot, Section, Series};
//!
//! let plot = Plot::new("Update time")
//!     .x(Axis::new("frame").whole())
//!     .y(Axis::new("update time").unit("ms").include(0.0))
//!     .series(Series::line("binned", [(0.0, 5.1), (1.0, 5.4), (2.0, 5.2)]));
//! let page = Page::new("Rebuilding every frame")
//!     .lead("One tree for each frame of the animation.")
//!     .section(Section::new("Results").figure(Figure::new(plot)));
//! assert!(page.to_html().starts_with("<!DOCTYPE html>"));
//! ```

#![deny(missing_docs)]

mod escape;
mod page;
mod palette;
mod plot;
mod provenance;
mod table;

pub use page::{Figure, Image, NotPng, Page, Section};
pub use palette::Role;
pub use plot::{Axis, Dash, Family, Plot, Series};
pub use provenance::Provenance;
pub use table::{Cell, Column, Table};
