//! What is said on standard error.

use std::io::{self, Write};

/// Says why the command fails.
pub fn report(message: &str) {
    // Standard error may be gone too; there is nobody left to tell.
    let _ = writeln!(io::stderr(), "error: {message}");
}
