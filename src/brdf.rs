//! `brdfarm brdf`: evaluates the reflectance model for JSON lines.

use anyhow::Context;
use clap::Args;
use dataset::{Material, specification::Tint};
use renderer::{reflectance::Reflectance, vector::Vec3};
use serde::{Deserialize, Serialize};
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

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Query {
    material: Material,
    wi: [f64; 3],
    wo: [f64; 3],
    #[serde(default = "hue")]
    tint: Tint,
}

fn hue() -> Tint {
    Tint::Hue
}

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
        let answer = match if cut { Err(too_long()) } else { answer(&line) } {
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

fn answer(line: &[u8]) -> Result<[f64; 3], String> {
    let query: Query = serde_json::from_slice(line).map_err(|error| error.to_string())?;
    query.material.check().map_err(|error| error.to_string())?;
    let wi = direction("wi", query.wi)?;
    let wo = direction("wo", query.wo)?;
    Ok(Reflectance::new(&query.material, 0.0, query.tint).evaluate(wi, wo))
}

/// The unit vector along `components`, scaled by the largest first so that no square overflows.
fn direction(name: &str, components: [f64; 3]) -> Result<Vec3, String> {
    let largest = components.iter().fold(0.0f64, |a, b| a.max(b.abs()));
    if largest == 0.0 {
        return Err(format!("{name} has length zero"));
    }
    Ok(Vec3::from(components.map(|component| component / largest)).normalized())
}
