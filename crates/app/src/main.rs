//! The `sonoloop` program.

fn main() -> std::process::ExitCode {
    sonoloop::main()
}
