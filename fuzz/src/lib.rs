//! Everything that parses bytes from outside, as functions that take any bytes and must neither
//! panic nor take memory without bound. A fuzzer calls them with what it makes up
//! (`fuzz/run.sh`), and the tests call them with the inputs in `fuzz/corpus`, among which is every
//! input that ever failed.
//!
//! A target also checks what has to be true of what it accepts: that it reads back, that limits
//! are kept, that readers agree. It tells whether it accepted its input, so that a corpus in which
//! nothing gets through shows.
//!
//! | module | whose bytes |
//! | --- | --- |
//! | `specification` | a specification as TOML or JSON: a person's, a coordinator's, a manifest's |
//! | `image` | an EXR image that a worker sent, and the label in it |
//! | `completion_log` | the log of a store that lay on a disk |
//! | `ledger` | records of the queue that lay on a disk |
//! | `credentials` | tokens, token files, certificates |
//! | `address` | addresses, forms and cookies that a browser sends |
//! | `command_line` | lists of indices, conditions on labels |
//! | `material` | materials and questions about them as JSON |
//! | `mesh` | meshes as OBJ and PLY |
//! | `manifest` | manifests in three formats, and shards of images in two |
//! | `calls` | protobuf messages of any call, to a live coordinator |

#![allow(
    clippy::unwrap_used,
    reason = "a panic here is what is looked for: a finding"
)]

mod address;
mod calls;
#[allow(dead_code, reason = "other tests use the rest")]
#[path = "../../datastore/tests/store/cheap_image.rs"]
mod cheap_image;
mod command_line;
#[path = "../../datastore/tests/store/complete_store.rs"]
mod complete_store;
mod completion_log;
mod credentials;
mod fixtures;
mod image;
mod ledger;
mod manifest;
mod material;
mod mesh;
#[path = "../../mesh/tests/invariants/mod.rs"]
mod mesh_invariants;
mod seeds;
mod specification;

pub use self::mesh::mesh;
pub use address::address;
pub use calls::calls;
pub use command_line::{condition, index_list};
pub use completion_log::completion_log;
pub use credentials::{credentials, tokens};
pub use image::{image, image_header};
pub use ledger::ledger;
pub use manifest::{manifest_csv, manifest_jsonl, manifest_parquet, shard_parquet, shard_tar};
pub use material::material;
pub use seeds::seeds;
pub use specification::specification;

/// Does something with any bytes, and tells whether it accepted them.
///
/// # Panics
/// Where they show a fault.
pub type Target = fn(&[u8]) -> bool;

/// All targets, by the names of their corpora.
pub const TARGETS: [(&str, Target); 18] = [
    ("address", address),
    ("calls", calls),
    ("completion_log", completion_log),
    ("condition", condition),
    ("credentials", credentials),
    ("image", image),
    ("image_header", image_header),
    ("index_list", index_list),
    ("ledger", ledger),
    ("manifest_csv", manifest_csv),
    ("manifest_jsonl", manifest_jsonl),
    ("manifest_parquet", manifest_parquet),
    ("material", material),
    ("mesh", mesh),
    ("shard_parquet", shard_parquet),
    ("shard_tar", shard_tar),
    ("specification", specification),
    ("tokens", tokens),
];

/// Runs the target of a name.
///
/// # Panics
/// Where there is none, and where the target does.
pub fn run(name: &str, bytes: &[u8]) -> bool {
    let target = TARGETS.iter().find(|(known, _)| *known == name);
    target.unwrap().1(bytes)
}
