//! Standard output.

use std::fmt::Display;
use std::io::Write;

/// Prints a line. A reader that has left (`sonoloop list | head -1`) is no fault of ours.
pub fn say(line: impl Display) {
    let _ = writeln!(std::io::stdout().lock(), "{line}");
}
