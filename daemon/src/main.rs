//! The `glintd` program: see `glintd --help`.

use std::process::ExitCode;

fn main() -> ExitCode {
    glintd::cli::run()
}
