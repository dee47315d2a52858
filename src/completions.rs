//! `brdfarm completions`: completion scripts for shells.

use clap::{Args, CommandFactory};
use clap_complete::Shell;
use std::io::{self, Write};

/// Print a completion script for a shell
#[derive(Debug, Args)]
pub struct Options {
    /// The shell; for bash the script goes to ~/.local/share/bash-completion/completions/brdfarm
    shell: Shell,
}

/// Prints the script.
pub fn execute(options: &Options) -> anyhow::Result<()> {
    // Generated into memory: the generator panics where its writer fails.
    let mut script = Vec::new();
    clap_complete::generate(
        options.shell,
        &mut crate::Cli::command(),
        "brdfarm",
        &mut script,
    );
    io::stdout().write_all(&script)?;
    Ok(())
}
