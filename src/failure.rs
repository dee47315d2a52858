//! What a failure tells the shell.

use std::io::{self, Write};
use std::process::ExitCode;

/// The exit code of input that is wrong; 1 is everything else that went wrong.
const BAD_INPUT: u8 = 2;

/// Input that is wrong: its message is one sentence with the place.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct BadInput(pub String);

/// Reports an outcome on standard error and turns it into an exit code. A reader that has gone
/// away, as `head` does, is no failure.
pub fn exit_code(outcome: anyhow::Result<()>) -> ExitCode {
    let Err(error) = outcome else {
        return ExitCode::SUCCESS;
    };
    let reader_left = error.chain().any(|cause| {
        cause
            .downcast_ref::<io::Error>()
            .is_some_and(|cause| cause.kind() == io::ErrorKind::BrokenPipe)
    });
    if reader_left {
        return ExitCode::SUCCESS;
    }
    // Standard error may be gone too; there is nobody left to tell.
    let _ = writeln!(io::stderr(), "error: {error:#}");
    let bad_input = error
        .chain()
        .any(|cause| cause.is::<BadInput>() || cause.is::<dataset::SpecificationError>());
    if bad_input {
        ExitCode::from(BAD_INPUT)
    } else {
        ExitCode::FAILURE
    }
}
