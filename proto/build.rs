//! Compiles `farm.proto` with a compiler written in Rust: the build needs no `protoc`.

use std::error::Error;

fn main() -> Result<(), Box<dyn Error>> {
    println!("cargo:rerun-if-changed=farm.proto");
    let descriptors = protox::compile(["farm.proto"], ["."])?;
    tonic_prost_build::configure()
        .bytes(".brdfarm.v1.PutBlobRequest.data")
        .compile_fds(descriptors)?;
    Ok(())
}
