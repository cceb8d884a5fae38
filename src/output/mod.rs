//! WRITE: pictures and reports. Knows the formats it writes and how to put a file in place whole or not at all.
