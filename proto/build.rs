//! Compiles `farm.proto` with a compiler written in Rust: the build needs no `protoc`.

use prost::Message;
use std::{env, error::Error, fs, path::PathBuf};

fn main() -> Result<(), Box<dyn Error>> {
    println!("cargo:rerun-if-changed=farm.proto");
    let descriptors = protox::compile(["farm.proto"], ["."])?;
    let out = PathBuf::from(env::var("OUT_DIR")?);
    fs::write(out.join("farm.bin"), descriptors.encode_to_vec())?;
    tonic_prost_build::configure()
        .bytes(".brdfarm.v1.GetMeshResponse.bytes")
        .bytes(".brdfarm.v1.PutBlobRequest.data")
        .bytes(".brdfarm.v1.View.image")
        .bytes(".brdfarm.v1.GetBlobResponse.data")
        .compile_fds(descriptors)?;
    Ok(())
}
