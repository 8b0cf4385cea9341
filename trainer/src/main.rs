//! The `glint` program: see `glint --help`.

use std::process::ExitCode;

fn main() -> ExitCode {
    glint::cli::run()
}
