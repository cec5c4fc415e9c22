//! The page: a stand-in until it is merged.
pub(crate) fn page(_: &crate::command::Report) -> String {
    String::new()
}
