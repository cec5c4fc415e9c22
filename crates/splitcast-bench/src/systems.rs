//! The systems that are compared.

mod bvh;
mod bvh_cost;
mod embree;
mod kdtree_ray;
mod obvhs;
mod parry;
mod splitcast_trees;
mod tinybvh;
mod triangle_test;

use crate::system::CatalogEntry;

/// Everything that can be measured on this machine.
#[derive(Default)]
pub struct Catalog {
    /// The systems, in the order of tables: ours first.
    pub entries: Vec<CatalogEntry>,
    /// What is missing, why, and how to get it, in one line each.
    pub missing: Vec<String>,
}

impl Catalog {
    /// Looks for everything.
    pub fn new() -> Self {
        let mut catalog = Self::default();
        splitcast_trees::add_to(&mut catalog);
        embree::add_to(&mut catalog);
        tinybvh::add_to(&mut catalog);
        obvhs::add_to(&mut catalog);
        parry::add_to(&mut catalog);
        bvh::add_to(&mut catalog);
        kdtree_ray::add_to(&mut catalog);
        catalog
    }

    /// The entries that `choice` names, one by one or by family, in the catalog's order; all
    /// of them if it is empty.
    ///
    /// # Errors
    /// Names what is neither a system nor a family, and what there is.
    pub fn choose(mut self, choice: &[String]) -> Result<Self, String> {
        let is_known = |name: &&String| {
            !self
                .entries
                .iter()
                .any(|entry| entry.name == **name || entry.family == **name)
        };
        if let Some(unknown) = choice.iter().find(is_known) {
            let names: Vec<&str> = self.entries.iter().map(|entry| &entry.name[..]).collect();
            let missing = self.missing.join("; ");
            return Err(format!(
                "no system is called {unknown:?}; there are {}{}{missing}",
                names.join(", "),
                if missing.is_empty() { "" } else { "; " },
            ));
        }
        let named = |name: &str| choice.iter().any(|chosen| chosen == name);
        if !choice.is_empty() {
            self.entries
                .retain(|entry| named(&entry.name) || named(entry.family));
        }
        Ok(self)
    }
}
