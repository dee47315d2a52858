//! `brdfarm brdf`: evaluates the reflectance model for JSON lines.

use anyhow::Context;
use clap::Args;
use renderer::query;
use serde::Serialize;
use std::io::{self, BufRead, BufReader, BufWriter, Read, Write};

/// The longest line accepted.
const LINE_BYTES_MAX: u64 = 1 << 20;

/// Evaluate the reflectance model for JSON lines on standard input
///
/// Reads one JSON object a line and answers each with one line. In (all on one line):
///
///   {"material": {"roughness": 30, "anisotropy": 0.5, "angle_deg": 40, "ior": 2,
///     "rgb0": [0.8, 0.5, 0.3], "rgb90": [1, 1, 1]},
///    "wi": [0, 0.5, 0.5], "wo": [0, -0.5, 0.5], "tint": "hue"}
///
/// Out:
///
///   {"f": [0.1, 0.06, 0.04]}            the BRDF, in 1/sr; or, for a line that is
///   {"line": 7, "error": "why"}         wrong, what is wrong with it
///
/// Colours are linear Rec.709. wi points to the light and wo to the viewer; their
/// lengths do not matter. The normal is +z. tint is "hue" where it is left out, or
/// "product".
#[derive(Debug, Args)]
#[command(verbatim_doc_comment)]
pub struct Options {}

const CANNOT_READ: &str = "cannot read standard input";
const CANNOT_WRITE: &str = "cannot write to standard output";

#[derive(Serialize)]
#[serde(untagged)]
enum Answer {
    Value { f: [f64; 3] },
    Fault { line: u64, error: String },
}

/// Answers lines until standard input ends.
pub fn execute(_: &Options) -> anyhow::Result<()> {
    let mut input = BufReader::new(io::stdin().lock());
    let mut output = BufWriter::new(io::stdout().lock());
    let mut line = Vec::new();
    for number in 1.. {
        if input.buffer().is_empty() {
            // Whoever writes may be waiting for the answers so far.
            output.flush().context(CANNOT_WRITE)?;
        }
        line.clear();
        let length = input
            .by_ref()
            .take(LINE_BYTES_MAX)
            .read_until(b'\n', &mut line)
            .context(CANNOT_READ)?;
        if length == 0 {
            break;
        }
        let cut = length as u64 == LINE_BYTES_MAX && line.last() != Some(&b'\n');
        if cut {
            input.skip_until(b'\n').context(CANNOT_READ)?;
        } else if line.trim_ascii().is_empty() {
            continue;
        }
        let answered = if cut {
            Err(too_long())
        } else {
            query::answer(&line).map_err(|error| error.to_string())
        };
        let answer = match answered {
            Ok(f) => Answer::Value { f },
            Err(error) => Answer::Fault {
                line: number,
                error,
            },
        };
        serde_json::to_writer(&mut output, &answer)
            .map_err(io::Error::from)
            .and_then(|()| output.write_all(b"\n"))
            .context(CANNOT_WRITE)?;
    }
    output.flush().context(CANNOT_WRITE)
}

fn too_long() -> String {
    format!("the line is longer than {LINE_BYTES_MAX} bytes")
}
