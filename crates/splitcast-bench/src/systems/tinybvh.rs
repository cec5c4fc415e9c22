use super::Catalog;
pub(super) fn add_to(_: &mut Catalog) {}
