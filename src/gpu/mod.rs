//! Device choice.
