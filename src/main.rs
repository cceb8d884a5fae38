//! The `thinlens` program: parse, run, print the error chain, exit code.

mod cli;

fn main() -> std::process::ExitCode {
    cli::run()
}
