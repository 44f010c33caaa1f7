//! Compiles `proto/`, messages that log viewers know, to Rust and to the descriptors that every log carries.

use std::{env, error::Error, fs, path::PathBuf};

const FILES: [&str; 2] = ["foxglove/Log.proto", "foxglove/FrameTransform.proto"];

fn main() -> Result<(), Box<dyn Error>> {
    println!("cargo:rerun-if-changed=proto");
    let out = PathBuf::from(env::var("OUT_DIR")?);
    let mut compiler = protox::Compiler::new(["proto"])?;
    compiler.include_imports(true);
    for file in FILES {
        compiler.open_file(file)?;
    }
    let descriptors = compiler.file_descriptor_set();
    fs::write(out.join("descriptors.bin"), compiler.encode_file_descriptor_set())?;
    prost_build::Config::new().enable_type_names().out_dir(out).compile_fds(descriptors)?;
    Ok(())
}
