//! Standard output.

use std::fmt::Display;
use std::io::{ErrorKind, Write};

/// Prints a line. A reader that has left (`sonoloop list | head -1`) is no fault; anything else that keeps a result from
/// being written ends the program as a runtime fault, as nobody must take silence for a pass.
pub fn say(line: impl Display) {
    match writeln!(std::io::stdout().lock(), "{line}") {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => {
            eprintln!("error: standard output: {error}");
            std::process::exit(3);
        }
        _ => {}
    }
}
