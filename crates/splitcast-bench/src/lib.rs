//! Splitcast side by side with its peers: the same moving meshes, the same rays, one run.
//!
//! [`Catalog`] finds the systems, [`measure()`] lets them follow a scene in turns.
//! A system is added by implementing [`System`] in one file; see `docs/benchmarks.md`.

mod args;
mod check;
pub mod command;
mod figures;
mod front;
mod measure;
mod memory;
mod page;
mod rays;
mod results;
mod system;
mod systems;
mod terminal;
mod workers;

pub use check::{Agreement, TOLERANCE};
pub use measure::{
    MeasureError, Plan, SceneMeasurement, SystemMeasurement, TraceSample, UpdateSample, measure,
    wall_clock,
};
pub use rays::{LANES, Picture, RayBlock, RaySet, RaySetKind, ray_sets};
pub use results::{BySet, Figure, Ratio, Row, Spread};
pub use system::{
    CatalogEntry, FrameMesh, HitChunk, MakeSystem, RayChunk, System, SystemError, Tracer,
};
pub use systems::{Catalog, Missing};
pub use workers::pool;
