//! The naming table: which channel names mean which role of which peel.
