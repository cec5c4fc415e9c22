//! The systems that are compared.

mod bvh;
mod bvh_cost;
mod embree;
mod kdtree_ray;
mod obvhs;
mod parry;
mod splitcast_trees;
mod triangle_test;

use std::fmt;

use crate::system::CatalogEntry;

/// Everything that can be measured on this machine.
#[derive(Default)]
pub struct Catalog {
    /// The systems, in the order of tables: ours first.
    pub entries: Vec<CatalogEntry>,
    /// What could be measured as well.
    pub missing: Vec<Missing>,
}

/// A library that was not found.
#[derive(Clone, Debug)]
pub struct Missing {
    /// Its name.
    pub family: &'static str,
    /// Why, and how to get it.
    pub reason: String,
}

impl fmt::Display for Missing {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} is not measured: {}", self.family, self.reason)
    }
}

impl Catalog {
    /// Looks for everything.
    pub fn new() -> Self {
        let mut catalog = Self::default();
        splitcast_trees::add_to(&mut catalog);
        embree::add_to(&mut catalog);
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
        let is_unknown = |name: &&String| {
            !self
                .entries
                .iter()
                .any(|entry| entry.name == **name || entry.family == **name)
        };
        if let Some(unknown) = choice.iter().find(is_unknown) {
            let of_family = |missing: &&Missing| {
                let rest = unknown.strip_prefix(missing.family);
                rest.is_some_and(|rest| rest.is_empty() || rest.starts_with('-'))
            };
            if let Some(missing) = self.missing.iter().find(of_family) {
                return Err(missing.to_string());
            }
            let names: Vec<&str> = self.entries.iter().map(|entry| &entry.name[..]).collect();
            let names = names.join(", ");
            return Err(format!(
                "no system is called {unknown:?}; there are {names}"
            ));
        }
        let named = |name: &str| choice.iter().any(|chosen| chosen == name);
        if !choice.is_empty() {
            self.entries
                .retain(|entry| named(&entry.name) || named(entry.family));
            self.missing.clear();
        }
        Ok(self)
    }
}
