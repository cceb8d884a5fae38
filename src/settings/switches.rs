//! Effects that the user forces on or leaves out.

use serde::Serialize;

/// Effects that the user switches, by their names in reports.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct Switches {
    /// Effects that are forced on.
    pub force: Vec<String>,
    /// Effects that are left out.
    pub without: Vec<String>,
}
