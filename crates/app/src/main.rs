//! The `sonoloop` program.
fn main() {}
