//! The rows of one material as bytes: numbers of 64 bits, the least significant byte first, and a
//! digest over them and what they belong to. So a part that is damaged, or another table's, is known.

use super::{ENCODINGS, ENTRIES, Finding, PARAMETERS, Row};
use dataset::Digest;

const DIGEST_BYTES: usize = 32;

/// Numbers of a finding.
const NUMBERS: usize = ENTRIES + 3 * PARAMETERS;

/// Bytes of a number.
const NUMBER_BYTES: usize = size_of::<f64>();

/// Bytes of a material's part.
pub(super) fn bytes(rows: usize) -> usize {
    rows * ENCODINGS * NUMBERS * NUMBER_BYTES + DIGEST_BYTES
}

/// Writes rows. `plan` is the digest of the table's plan.
pub(super) fn encode(plan: &Digest, material: u32, rows: &[Row]) -> Vec<u8> {
    let mut part = Vec::with_capacity(bytes(rows.len()));
    for finding in rows.iter().flat_map(|row| &row.findings) {
        let Finding {
            information,
            uncertainty,
            bound,
            weight,
        } = finding;
        let numbers = information.iter().chain(uncertainty).chain(bound);
        part.extend(
            numbers
                .chain(weight)
                .flat_map(|number| number.to_le_bytes()),
        );
    }
    let digest = digest(plan, material, &part);
    part.extend(digest.as_bytes());
    part
}

/// Reads the rows of a material, one for each of `sets`; `None` where these are others' bytes or
/// damaged.
pub(super) fn decode(
    plan: &Digest,
    material: u32,
    sets: &[Vec<u32>],
    part: &[u8],
) -> Option<Vec<Row>> {
    if part.len() != bytes(sets.len()) {
        return None;
    }
    let (content, told) = part.split_last_chunk::<DIGEST_BYTES>()?;
    if digest(plan, material, content) != Digest::from_bytes(*told) {
        return None;
    }
    let (chunks, _) = content.as_chunks::<NUMBER_BYTES>();
    let mut numbers = chunks.iter().map(|chunk| f64::from_le_bytes(*chunk));
    let rows = sets.iter().map(|views| Row {
        views: views.clone(),
        findings: std::array::from_fn(|_| finding(&mut numbers)),
    });
    Some(rows.collect())
}

/// The next numbers as a finding. There are enough: the part's length was checked.
fn finding(numbers: &mut impl Iterator<Item = f64>) -> Finding {
    let mut next = || numbers.next().unwrap_or(f64::NAN);
    Finding {
        information: std::array::from_fn(|_| next()),
        uncertainty: std::array::from_fn(|_| next()),
        bound: std::array::from_fn(|_| next()),
        weight: std::array::from_fn(|_| next()),
    }
}

fn digest(plan: &Digest, material: u32, content: &[u8]) -> Digest {
    let mut hashed = Vec::with_capacity(DIGEST_BYTES + size_of::<u32>() + content.len());
    hashed.extend(plan.as_bytes());
    hashed.extend(material.to_le_bytes());
    hashed.extend(content);
    Digest::of(&hashed)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic here is a failed test")]
mod tests {
    use super::*;

    #[test]
    fn rows_come_back_and_what_is_damaged_or_of_another_does_not() {
        let sets = [vec![5], vec![5, 8]];
        let number = |row: usize, at: usize| match at {
            7 => f64::INFINITY,
            _ => 1e-3 * at as f64 - row as f64,
        };
        let rows: Vec<Row> = (0..2)
            .map(|row| Row {
                views: sets[row].clone(),
                findings: std::array::from_fn(|encoding| Finding {
                    information: std::array::from_fn(|at| number(row, at)),
                    uncertainty: std::array::from_fn(|at| number(row, at + encoding)),
                    bound: std::array::from_fn(|at| number(row + 3, at)),
                    weight: std::array::from_fn(|at| number(row + 4, at)),
                }),
            })
            .collect();
        let plan = Digest::of(b"plan");
        let part = encode(&plan, 17, &rows);
        assert_eq!(part.len(), bytes(2));
        assert_eq!(decode(&plan, 17, &sets, &part).unwrap(), rows);
        assert!(decode(&plan, 18, &sets, &part).is_none());
        assert!(decode(&Digest::of(b"other"), 17, &sets, &part).is_none());
        assert!(decode(&plan, 17, &sets[..1], &part).is_none());
        assert!(decode(&plan, 17, &sets, &part[..part.len() - 1]).is_none());
        assert!(decode(&plan, 17, &sets, &[]).is_none());
        let mut damaged = part;
        damaged[100] ^= 1;
        assert!(decode(&plan, 17, &sets, &damaged).is_none());
    }
}
